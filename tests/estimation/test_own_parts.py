"""A cost, a transcription and a solver of a user's own, written against the protocols alone, without touching casid.

Truth: casid's own result for the same minimum; scipy's least squares for a regression and for a likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from estimation_cases import NOISE, START, flight, short_period, with_derivatives
from scipy.optimize import least_squares
from scipy.stats import norm

import casid as cs
from casid.errors import InputError
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import moved, step_length
from casid.estimation.solvers.solver import Outcome
from casid.estimation.solvers.status import CONVERGED, out_of_steps
from casid.estimation.transcriptions.dynamics import Dynamics
from casid.estimation.transcriptions.equation import EquationPart


def problem(**options: Any) -> cs.Problem:
    rng = np.random.default_rng(5)
    record = flight(noise=NOISE, rng=rng)
    dots = {"alphadot": 0.01, "qdot": 0.05}
    return cs.Problem(
        short_period(), [with_derivatives(record, flight(), dots, rng)], free=["*"], start=START, **options
    )


@dataclass(frozen=True)
class Damped:
    """Gauss-Newton with a fixed damping: slow, and short."""

    steps: int = 60

    def minimise(self, objective: Objective) -> Outcome:
        point = objective.start()
        value = objective.value(point)
        length, iteration = np.inf, 0
        while length >= 1e-7 and iteration < self.steps:
            iteration += 1
            value, _ = objective.relaxed(point, value)
            step = objective.step(point, value, objective.linearise(point, value), damping=0.1)
            length = step_length(step, value)
            point = moved(point, step, 1.0)
            value = objective.value(point, value.noise)
        return Outcome(
            point=point,
            value=value,
            status=CONVERGED if length < 1e-7 else out_of_steps(iteration),
            iterations=iteration,
            stationarity=length,
            limit_multipliers=np.zeros(0),
            solver="Damped",
        )


@dataclass(frozen=True)
class MostlyOutputs:
    """A cost: nine parts of outputs, one of equations."""

    output_weight: float = 0.9
    equation_weight: float = 0.1


@dataclass(frozen=True)
class Halved:
    """A transcription: as many segments as it takes to halve every record."""

    def dynamics(self, problem: cs.Problem) -> Dynamics:
        longest = max(len(record) for record in problem.records)
        return cs.MultipleShooting(interval=-(-longest // 2)).dynamics(problem)


def test_a_solver_of_ones_own_finds_the_same_minimum():
    ours, theirs = cs.solve(problem()), cs.solve(problem(), solver=Damped())
    assert theirs.converged and theirs.solver == "Damped"
    for name in ours.values:
        assert theirs[name].value == pytest.approx(ours[name].value, abs=1e-4 * ours[name].std)
        assert theirs[name].std_cramer_rao == pytest.approx(ours[name].std_cramer_rao, rel=1e-4)


def test_a_cost_of_ones_own_is_what_casid_says_of_the_same_weights():
    ours = cs.solve(problem(cost=cs.CombinedError(equation_weight=0.1)))
    theirs = cs.solve(problem(cost=MostlyOutputs()))
    assert theirs.converged and theirs.to_dict()["estimator"] == "MostlyOutputs"
    np.testing.assert_allclose(list(theirs.values.values()), list(ours.values.values()), rtol=1e-12)


def test_a_transcription_of_ones_own_gives_the_same_estimates():
    ours, theirs = cs.solve(problem()), cs.solve(problem(), Halved())
    assert theirs.converged and theirs.method == "Halved" and len(theirs.states["m1"].nodes) == 2
    for name in ours.values:
        assert theirs[name].value == pytest.approx(ours[name].value, abs=1e-4 * ours[name].std)


@pytest.mark.parametrize(
    ("cost", "says"),
    [
        ("output", "cs.OutputError()"),
        (cs.OutputError, "cost=OutputError()"),
        (3, "cs.OutputError()"),
        (None, "cs.OutputError()"),
        (MostlyOutputs(output_weight=0.0, equation_weight=0.0), "not both zero"),
        (MostlyOutputs(output_weight=-1.0), "not negative"),
    ],
)
def test_what_is_no_cost_is_refused_with_what_to_write(cost, says):
    with pytest.raises(InputError, match="Problem: ") as error:
        problem(cost=cost)
    assert says in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"method": cs.MultipleShooting}, "write MultipleShooting()"),
        ({"method": 20}, "cs.MultipleShooting()"),
        ({"solver": "ipopt"}, "cs.GaussNewton()"),
        ({"solver": cs.Ipopt}, "write Ipopt()"),
    ],
)
def test_what_is_no_method_or_solver_is_refused_with_what_to_write(arguments, says):
    with pytest.raises(InputError, match="solve: ") as error:
        cs.solve(problem(), **arguments)
    assert says in str(error.value)


def test_a_linearisation_changes_nothing():
    """The same call gives the same numbers whatever was called before, with levels and random defects of the value."""
    given = problem(noise=NOISE)
    objective = Objective(given, cs.MultipleShooting(interval=10, process_noise={"q": 0.1}).dynamics(given))
    point = objective.start()
    value = objective.value(point)
    first = objective.linearise(point, value)
    objective.step(point, objective.reweighed(point, value, first.noise), first, 0.0)
    again, cost = objective.linearise(point, value), objective.value(point).cost
    np.testing.assert_array_equal(again.hessian, first.hessian)
    assert cost == value.cost and objective.noise.factor is not None and not objective.noise.factor.any()
    assert first.noise.factor is not None and first.noise.factor.any()


def regression(y: np.ndarray, x: np.ndarray) -> cs.Problem:
    model = cs.define_regression(
        "decay",
        inputs=("x",),
        parameters={"a": 1.0, "k": 0.5},
        outputs=("y",),
        output=lambda s: {"y": s.a * (1.0 - s.k * s.x) ** 2 / (1.0 + s.x)},
    )
    return cs.Problem(model, [cs.Record(name="table", t=np.arange(len(x)), channels={"x": x, "y": y})], free=["*"])


@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting(), cs.Collocation()])
@pytest.mark.parametrize("cost", [cs.OutputError(), cs.EquationError(), cs.CombinedError()])
def test_a_model_without_states_is_a_regression(method, cost):
    x = np.linspace(0.0, 5.0, 40)
    y = 2.0 * (1.0 - 0.3 * x) ** 2 / (1.0 + x) + 0.01 * np.random.default_rng(1).standard_normal(40)
    y[7] = np.nan
    given = regression(y, x)
    fit = cs.solve(cs.Problem(given.model, given.records, free=["*"], cost=cost), method)
    seen = np.isfinite(y)
    theirs = least_squares(
        lambda p: (p[0] * (1.0 - p[1] * x) ** 2 / (1.0 + x) - y)[seen], [1.0, 0.5], xtol=1e-15, ftol=1e-15
    )
    assert fit.converged and fit.channels["y"].samples == 39
    np.testing.assert_allclose(list(fit.values.values()), theirs.x, rtol=1e-7)
    assert fit.noise["y"] == pytest.approx(np.sqrt(2 * theirs.cost / 39), rel=1e-6)


@dataclass(frozen=True)
class FirstHalf:
    """Equation error of the first half of each record alone: a cost that makes its equation part itself."""

    output_weight: float = 0.0
    equation_weight: float = 1.0

    def equations(self, problem: cs.Problem) -> EquationPart:
        whole = EquationPart(problem)
        return EquationPart(problem, [(r, signals[: len(signals) // 2]) for r, signals in enumerate(whole.data)])


def test_a_cost_may_make_its_equation_part_itself() -> None:
    record = problem().records[0]
    half = record.between(-np.inf, record.t[len(record) // 2])
    own = cs.solve(problem(cost=FirstHalf()))
    cut = cs.solve(cs.Problem(short_period(), [half], free=["*"], start=START, cost=cs.EquationError()))
    assert own.values == pytest.approx(cut.values, rel=1e-9)
    assert np.allclose(own.covariance, cut.covariance, rtol=1e-6)


@dataclass(frozen=True)
class Correlated:
    """The likelihood of the outputs of a regression with first-order noise of given size and correlation."""

    sigma: float = 0.1
    share: float = 0.6

    def likelihood(self, problem: cs.Problem) -> _CorrelatedResiduals:
        record = problem.records[0]
        told = self.share ** np.abs(np.subtract.outer(np.arange(len(record)), np.arange(len(record))))
        root = np.linalg.cholesky(self.sigma**2 * told)
        return _CorrelatedResiduals(record["x"], record["y"], root)


@dataclass(frozen=True)
class _CorrelatedResiduals:
    x: np.ndarray
    y: np.ndarray
    root: np.ndarray

    def residual(self, theta: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self.root, np.exp(theta[0] * self.x) + theta[1] * self.x - self.y)

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self.root, np.stack([self.x * np.exp(theta[0] * self.x), self.x], axis=1))

    def log_determinant(self, theta: np.ndarray) -> float:
        return 2.0 * float(np.log(np.diag(self.root)).sum())


def correlated(**options: Any) -> cs.Problem:
    """y = exp(a x) + b x with first-order noise."""
    x = np.linspace(0.0, 2.0, 60)
    model = cs.define_model(
        "sum",
        states=(),
        inputs=("x",),
        dynamics=lambda s: {},
        parameters={"a": 0.1, "b": 0.0},
        outputs=("y",),
        output=lambda s: {"y": s.a * s.x + s.b},
    )
    told = 0.6 ** np.abs(np.subtract.outer(np.arange(60), np.arange(60)))
    noise = 0.1 * np.linalg.cholesky(told) @ np.random.default_rng(3).standard_normal(60)
    record = cs.Record(name="m1", t=x, channels={"x": x, "y": np.exp(0.5 * x) - 0.3 * x + noise})
    return cs.Problem(model, [record], free=["*"], **{"cost": Correlated(), **options})


@pytest.mark.parametrize("solver", [cs.Automatic(), cs.GaussNewton()], ids=repr)
def test_a_cost_may_make_its_likelihood_itself(solver: Any) -> None:
    """Truth: scipy's least squares of the same whitened residuals, the density of scipy.stats, and the covariance
    (J'J)^-1; within a limit scipy's bounded solution."""
    posed = correlated()
    fit = cs.solve(posed, solver=solver)
    own = Correlated().likelihood(posed)
    theirs = least_squares(own.residual, [0.1, 0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert fit.converged and not fit.remarks
    np.testing.assert_allclose(list(fit.values.values()), theirs.x, rtol=1e-5)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(theirs.jac.T @ theirs.jac), rtol=1e-4)
    density = norm.logpdf(theirs.fun).sum() - np.log(np.diag(own.root)).sum()
    assert fit.log_likelihood == pytest.approx(density, abs=1e-6)
    bounded = cs.solve(correlated(constraints=[cs.limit_parameter("a", upper=0.4)]), solver=solver)
    within = least_squares(own.residual, [0.1, 0.0], bounds=([-9.0, -9.0], [0.4, 9.0]), xtol=1e-15)
    np.testing.assert_allclose(list(bounded.values.values()), within.x, rtol=1e-4)


@dataclass(frozen=True)
class Ignored(MostlyOutputs):
    """A cost with a residual of its own, which nothing would call."""

    def residual(self, theta: np.ndarray) -> np.ndarray:
        return theta


@dataclass(frozen=True)
class Nothing:
    """A solver that forgets to return, and a likelihood without a method."""

    def minimise(self, objective: Objective) -> None:
        objective.start()

    def likelihood(self, problem: cs.Problem) -> object:
        return self


def test_parts_of_ones_own_that_would_be_ignored_are_refused() -> None:
    with pytest.raises(cs.InputError, match="Ignored whose method 'residual' nothing would call"):
        problem(cost=Ignored())
    with pytest.raises(cs.InputError, match="Nothing.minimise returned is None"):
        cs.solve(problem(), solver=Nothing())  # pyright: ignore[reportArgumentType]
    with pytest.raises(cs.InputError, match="without a method 'residual'"):
        cs.solve(correlated(cost=Nothing()))
