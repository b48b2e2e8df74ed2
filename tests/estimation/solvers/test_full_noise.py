"""Truth: generalised least squares in closed form, the residuals' own covariance, the scatter of many estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import NOISE, START, TRUTH, flight, short_period

from casid.analysis import drawn_problem, profile
from casid.errors import EstimationError, InputError
from casid.estimation import (
    Collocation,
    CombinedError,
    GaussNewton,
    Ipopt,
    MultipleShooting,
    Problem,
    SingleShooting,
    solve,
)
from casid.estimation.attempt import build_objective
from casid.estimation.solvers.full_noise import full_noise, moments_of
from casid.estimation.solvers.gauss_newton import FilterSearch
from casid.estimation.solvers.iteration import Iteration
from casid.estimation.solvers.levels import noise_levels
from casid.estimation.solvers.timed import Clock
from casid.filtering.cost import FilterError
from casid.model.system import define_model
from casid.records.record import Record

SIGMA = np.array(list(NOISE.values()))
COVARIANCE = np.outer(SIGMA, SIGMA) * np.array([[1.0, 0.95], [0.95, 1.0]])
PRECISE = GaussNewton(tolerance=1e-9)


def measured(seed: int, holes: bool = False, t: np.ndarray | None = None) -> Record:
    """A short period whose two outputs have noise of covariance COVARIANCE, and samples with one or no output."""
    record, rng = flight(t=t), np.random.default_rng((31, seed))
    noise = rng.standard_normal((len(record), 2)) @ np.linalg.cholesky(COVARIANCE).T
    alpha, q = record["alpha"] + noise[:, 0], record["q"] + noise[:, 1]
    if holes:
        alpha[::3], q[1::7], q[20:60] = np.nan, np.nan, np.nan
    return record.with_channels(alpha=alpha, q=q)


def vector(fit) -> np.ndarray:
    return np.array(list(fit.values.values()))


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=7)])
def test_known_covariance_is_generalised_least_squares(method, holes):
    """Outputs linear in the parameters: (X' R^-1 X)^-1 X' R^-1 y, with the covariance of what is present."""
    model = define_model(
        "lines",
        states=("theta",),
        inputs=("x",),
        parameters={"a": 0.0, "b": 0.0},
        outputs=("y1", "y2", "y3"),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"y1": s.a * s.x + s.b, "y2": s.b - 2.0 * s.a, "y3": s.a + s.b * s.x},
    )
    rng = np.random.default_rng(5)
    factor = rng.standard_normal((3, 3))
    R = factor @ factor.T + 0.1 * np.eye(3)
    u = rng.standard_normal(60)
    X = np.stack([np.stack([[k, 1.0], [-2.0, 1.0], [1.0, k]]) for k in u])
    y = X @ [2.0, -0.5] + rng.standard_normal((60, 3)) @ np.linalg.cholesky(R).T
    if holes:
        y[rng.random(y.shape) < 0.3] = np.nan
    information, right = np.zeros((2, 2)), np.zeros(2)
    for rows, values in zip(X, y, strict=True):
        s = np.isfinite(values)
        weight = np.linalg.inv(R[np.ix_(s, s)])
        information += rows[s].T @ weight @ rows[s]
        right += rows[s].T @ weight @ values[s]
    channels = dict(zip(("y1", "y2", "y3"), y.T, strict=True)) | {"x": u}
    record = Record(name="m1", t=0.1 * np.arange(60), channels=channels)
    fit = solve(Problem(model, [record], free=["*"], noise=R), method)
    np.testing.assert_allclose(vector(fit), np.linalg.solve(information, right), rtol=1e-8)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information), rtol=1e-8)
    np.testing.assert_array_equal(fit.noise_covariance, R)


def test_estimated_covariance_is_that_of_the_residuals():
    fit = solve(Problem(short_period(), [measured(0), replace(measured(1), name="m2")], free=["*"], noise="full"))
    assert fit.converged
    residuals = np.concatenate(list(fit.residuals.values()))
    np.testing.assert_allclose(fit.noise_covariance, residuals.T @ residuals / len(residuals), rtol=1e-5)
    # 400 samples: 1-sigma of an estimated correlation r is (1 - r^2)/20
    correlation = fit.noise_covariance[0, 1] / np.prod(list(fit.noise.values()))
    assert correlation == pytest.approx(0.95, abs=4.0 * (1.0 - 0.95**2) / 20.0)
    white = residuals @ np.linalg.inv(np.linalg.cholesky(fit.noise_covariance)).T
    log_determinant = np.linalg.slogdet(2.0 * np.pi * fit.noise_covariance)[1]
    assert fit.log_likelihood == pytest.approx(-0.5 * (white**2).sum() - 0.5 * len(white) * log_determinant, rel=1e-10)


def test_with_missing_samples_the_covariance_is_of_highest_likelihood_and_no_step_lowers_it():
    rng, seen = np.random.default_rng(3), np.array([[1, 1, 1], [1, 0, 1], [0, 1, 0], [0, 0, 0]], dtype=float)
    factor = rng.standard_normal((3, 3))
    pattern = rng.integers(0, 4, 300)
    residuals = (rng.standard_normal((300, 3)) @ factor.T) * seen[pattern]
    moments = moments_of(residuals, pattern, seen)
    independent = noise_levels(None, ("p", "q", "r"), np.where(seen[pattern] > 0, residuals, np.nan), np.ones(3))
    noise = full_noise(
        replace(independent, sigma=np.ones(3), floor=np.zeros(3)), None, ("p", "q", "r"), seen, pattern, residuals
    )

    def likelihood(matrix: np.ndarray) -> float:
        return replace(noise, matrix=matrix).log_likelihood(moments)

    at, found = noise.matrix, [noise.log_likelihood(moments)]
    for _ in range(15):
        at = noise._expected(moments, at)
        found.append(likelihood(at))
    assert (np.diff(found) > 0.0).all()
    noise, _ = noise.relaxed(moments)
    best, top = noise.matrix, noise.log_likelihood(moments)
    assert top >= found[-1]
    for i in range(3):
        for j in range(i + 1):
            step = np.zeros((3, 3))
            step[i, j] = step[j, i] = 1e-6
            up, down = likelihood(best + step), likelihood(best - step)
            assert abs(up - down) < 1e-3 * (2.0 * top - up - down) and up < top > down


@pytest.mark.parametrize("noise", [None, "full"], ids=["independent", "full"])
def test_a_step_of_the_coordinates_of_the_noise_is_one_standard_deviation(noise):
    """Half the squared step is the fall of the likelihood from its maximum, to second order; with residuals of
    independent channels."""
    objective = build_objective(Problem(short_period(), [measured(0)], free=["*"], noise=noise), MultipleShooting())
    levels, squares = objective.noise.levels, objective.value(objective.start()).squares
    if noise == "full":
        squares = squares * np.eye(2)
    levels, _ = levels.relaxed(squares)
    best, top = levels.coordinates, levels.log_likelihood(squares)
    for step in 0.01 * np.eye(len(best)):
        moved = levels.at(best + step)
        np.testing.assert_allclose(moved.coordinates, best + step, rtol=1e-12)
        assert top - moved.log_likelihood(squares) == pytest.approx(0.5 * 0.01**2, rel=0.01)
    np.testing.assert_allclose(levels.at(best).sigma, levels.sigma, rtol=1e-12)


@pytest.mark.parametrize("holes", [False, True])
def test_the_likelihood_descends_from_one_relaxation_to_the_next(holes):
    given = Problem(short_period(), [measured(2, holes)], free=["*"], start=START, noise="full")
    objective, costs = build_objective(given, MultipleShooting(interval=10)), []

    class Noted(FilterSearch):
        def advance(self, at, linear):
            relaxed, status = self.relaxing, super().advance(at, linear)
            if relaxed and at.value.worst() < 1e-9:
                costs.append(objective.likelihood_cost(at.value))
            return status

    iteration = Iteration(objective, Clock(PRECISE.seconds, objective), PRECISE.tolerance)
    assert iteration.run(Noted(iteration), PRECISE.iterations).converged and len(costs) >= 4
    assert (np.diff(costs) < 1e-9 * abs(costs[0])).all(), costs


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=20), Collocation(degree=3)])
@pytest.mark.parametrize("noise", ["full", COVARIANCE], ids=["estimated", "given"])
def test_ipopt_finds_the_optimum_of_gauss_newton(noise, method, holes):
    given = Problem(short_period(), [measured(4, holes)], free=["*"], start=START, noise=noise)
    ours, theirs = solve(given, method, PRECISE), solve(given, method, Ipopt())
    assert ours.converged and theirs.converged
    np.testing.assert_allclose(vector(theirs), vector(ours), rtol=1e-8)
    np.testing.assert_allclose(theirs.noise_covariance, ours.noise_covariance, rtol=1e-7)
    assert theirs.cost == pytest.approx(ours.cost, rel=1e-8)


def test_estimates_are_more_precise_than_with_independent_weights():
    truth, errors = np.array(list(TRUTH.values())), {None: [], "full": []}
    promised = []
    for seed in range(40):
        for noise, found in errors.items():
            fit = solve(Problem(short_period(), [measured(seed, t=np.arange(0.0, 6.0, 0.05))], free=["*"], noise=noise))
            assert fit.converged
            found.append(vector(fit) - truth)
        promised.append(np.diagonal(fit.covariance))
    spread = {noise: np.sqrt(np.mean(np.square(found), axis=0)) for noise, found in errors.items()}
    # Gauss and Markov: none is less precise, and those of the pitching moment are twice as precise
    assert (spread["full"] < spread[None]).all() and (spread["full"][2:] < 0.6 * spread[None][2:]).all(), spread
    # 40 runs: the ratio of a root mean square to its expectation has a 1-sigma of 11 %
    assert (np.abs(spread["full"] / np.sqrt(np.mean(promised, axis=0)) - 1.0) < 0.45).all()


def test_a_profile_and_a_bootstrap_know_the_correlation():
    fit = solve(Problem(short_period(), [measured(6)], free=["*"], noise=COVARIANCE), solver=PRECISE)
    interval = profile(fit, ["Mq"])["Mq"]
    assert interval.upper - interval.lower == pytest.approx(2.0 * 1.959964 * fit["Mq"].std_cramer_rao, rel=0.03)
    drawn = drawn_problem(fit, np.random.default_rng(1), {})
    (record,) = drawn.records
    noise = record.matrix(["alpha", "q"]) - fit.predictions["m1"]
    assert np.corrcoef(noise.T)[0, 1] == pytest.approx(0.95, abs=0.03)
    np.testing.assert_allclose(noise.std(axis=0), SIGMA, rtol=0.2)


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        ("complete", "full"),
        (np.eye(3), r"\(2, 2\)"),
        (np.array([[1.0, 0.5], [0.4, 1.0]]), "symmetric"),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), "positive definite"),
    ],
)
def test_what_is_no_covariance_is_refused(noise, words):
    with pytest.raises(InputError, match=words):
        solve(Problem(short_period(), [measured(0)], free=["*"], noise=noise))


def test_what_takes_independent_noise_says_so():
    model = short_period(disturbances=("w",))
    with pytest.raises(EstimationError, match="independent"):
        Problem(model, [measured(0)], free=["*"], noise=COVARIANCE, cost=FilterError(process_noise={"w": 0.0}))


def test_only_outputs_have_a_covariance():
    with pytest.raises(EstimationError, match="outputs alone"):
        Problem(short_period(), [measured(0)], free=["*"], noise="full", cost=CombinedError())
