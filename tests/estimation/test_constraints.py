"""Truth: limits are met, multipliers are what a limit costs (envelope theorem), an equality is an elimination."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from estimation_cases import NOISE, START, TRUTH, flight, short_period

from casid.errors import EstimationError, InputError
from casid.estimation import (
    Collocation,
    GaussNewton,
    InitialState,
    Ipopt,
    MultipleShooting,
    Problem,
    SingleShooting,
    limit_combination,
    limit_function,
    limit_parameter,
    limit_trajectory,
    solve,
)
from casid.estimation.attempt import build_objective
from casid.estimation.solvers.quadratic import parameter_step
from casid.estimation.solvers.status import Results
from casid.keeping import load
from casid.model.system import define_model, define_regression
from casid.records.record import Record

SOLVERS = (GaussNewton(tolerance=1e-9), Ipopt(hessian="gauss-newton"))
RECORD = flight(noise=NOISE, rng=np.random.default_rng(9))


def problem(*constraints, **options) -> Problem:
    return Problem(
        short_period(), [RECORD], constraints=constraints, **({"free": ["*"], "start": START, "noise": NOISE} | options)
    )


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("limits", [{"upper": -2.0}, {"lower": -1.5}])
def test_an_active_bound_is_met_and_its_multiplier_is_its_price(solver, limits):
    def fit_with(shift: float):
        moved = {side: value + shift for side, value in limits.items()}
        return solve(problem(limit_parameter("Mq", **moved)), MultipleShooting(), solver)

    fit = fit_with(0.0)
    assert fit.converged
    assert fit["Mq"].value == pytest.approx(next(iter(limits.values())), abs=1e-7)
    low, high = fit["Mq"].interval
    assert (high if "upper" in limits else low) == fit["Mq"].value and low < high and fit["Mq"].std > 0.0
    assert any(remark.startswith("Mq: held by a limit") for remark in fit.remarks)
    assert (fit.multipliers[0] > 0) == ("upper" in limits)
    step = 1e-3
    price = -(fit_with(step).cost - fit_with(-step).cost) / (2 * step)
    assert fit.multipliers[0] == pytest.approx(price, rel=1e-3)


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_inactive_bound_changes_nothing(solver):
    free, bounded = solve(problem(), solver=solver), solve(problem(limit_parameter("Mq", upper=0.0)), solver=solver)
    np.testing.assert_allclose(list(bounded.values.values()), list(free.values.values()), rtol=1e-7)
    assert bounded.multipliers[0] == 0.0 and bounded["Mq"].std == pytest.approx(free["Mq"].std, rel=1e-6)


@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=20), Collocation(degree=2)])
@pytest.mark.parametrize("solver", SOLVERS)
def test_an_equality_is_the_same_as_fixing_the_parameter(method, solver):
    tied = solve(problem(limit_parameter("Mq", lower=-2.0, upper=-2.0)), method, solver)
    fixed = solve(problem(fixed={"Mq": -2.0}), method, solver)
    assert tied.converged
    for name in ("Za", "Zde", "Ma", "Mde"):
        assert tied[name].value == pytest.approx(fixed[name].value, rel=1e-6)
        assert tied[name].std_cramer_rao == pytest.approx(fixed[name].std_cramer_rao, rel=1e-5)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_linear_combination_of_parameters_is_limited(solver):
    free = solve(problem())
    limit = free["Ma"].value - 2 * free["Mq"].value - 0.3
    fit = solve(problem(limit_combination({"Ma": 1.0, "Mq": -2.0}, upper=limit)), solver=solver)
    assert fit.converged
    assert fit["Ma"].value - 2 * fit["Mq"].value == pytest.approx(limit, abs=1e-7)
    assert fit.multipliers[0] > 0 and fit.cost > free.cost


METHODS = (SingleShooting(), MultipleShooting(), Collocation(degree=2))


def limited(kind: str, price: float | None = None) -> tuple:
    """Constraints that the free fit breaks, by kind."""
    free = solve(problem())
    alpha, q = (free.predictions["m1"][:, i] for i in range(2))
    return {
        "path": (limit_trajectory("alpha", upper=0.95 * float(alpha.max()), price=price),),
        "paths": (
            limit_trajectory("alpha", upper=0.8 * float(alpha.max())),
            limit_trajectory("q", lower=0.8 * float(q.min())),
        ),
        "function": (limit_function(lambda s: s.Za * s.Mq - s.Ma, upper=5.5),),
        "equation": (limit_function(lambda s: s.Ma / s.Mde, lower=0.6, upper=0.6),),
        "all": (
            limit_function(lambda s: s.Za * s.Mq - s.Ma, upper=5.5),
            limit_trajectory("alpha", upper=0.8 * float(alpha.max())),
            limit_parameter("Mq", upper=-2.0),
        ),
    }[kind]


KINDS = ("path", "paths", "function", "equation", "all")
QUICK = (("path", 2), ("paths", 0), ("equation", 1))  # where the noise is estimated; the others are a campaign
ESTIMATED = [
    pytest.param(kind, method, None, marks=[] if (kind, i) in QUICK else pytest.mark.slow)
    for kind in KINDS
    for i, method in enumerate(METHODS)
]


@pytest.mark.parametrize(
    ("kind", "method", "noise"), [*((kind, method, NOISE) for kind in KINDS for method in METHODS), *ESTIMATED]
)
def test_gauss_newton_and_ipopt_agree_under_constraints(kind, method, noise):
    given = problem(*limited(kind), noise=noise)
    found, other = solve(given, method, GaussNewton(tolerance=1e-9)), solve(given, method, Ipopt())
    assert found.converged and other.converged, (found.status, other.status)
    np.testing.assert_allclose(list(found.values.values()), list(other.values.values()), rtol=1e-6)
    assert found.log_likelihood == pytest.approx(other.log_likelihood, abs=1e-5)


@pytest.mark.parametrize("price", [100.0, 1e3, 1e6])
@pytest.mark.parametrize("method", METHODS)
def test_gauss_newton_and_ipopt_agree_under_soft_limits(method, price):
    """All samples beyond, some at the limit, none beyond: which of these is a question of the price."""
    given = problem(*limited("path", price))
    found, other = solve(given, method, GaussNewton(tolerance=1e-9)), solve(given, method, Ipopt(tolerance=1e-11))
    assert found.converged and other.converged, (found.status, other.status)
    np.testing.assert_allclose(list(found.values.values()), list(other.values.values()), rtol=1e-6)
    assert found.cost == pytest.approx(other.cost, rel=1e-8)


def test_a_high_price_is_a_limit_and_a_low_one_is_paid():
    hard, free = solve(problem(*limited("path"))), solve(problem())
    limit = limited("path")[0].upper
    dear, cheap = (solve(problem(*limited("path", price))) for price in (1e6, 10.0))
    assert dear.cost == pytest.approx(hard.cost, rel=1e-9)
    assert dear.predictions["m1"][:, 0].max() == pytest.approx(limit, abs=1e-8)
    excess = np.maximum(cheap.predictions["m1"][:, 0] - limit, 0.0).sum()
    assert excess > 0.0 and cheap.prior_cost >= 10.0 * excess > 0.0
    assert free.cost < cheap.cost < hard.cost
    for fit in (hard, dear, cheap):  # that a limit holds samples is said
        assert any(remark.startswith("alpha") for remark in fit.remarks)
    assert not any(remark.startswith("alpha") for remark in free.remarks)


@pytest.mark.parametrize("method", METHODS)
def test_the_optimum_under_a_path_limit_satisfies_the_conditions_of_kuhn_and_tucker(method):
    """Multipliers at samples that touch alone, of the right sign, and their sum is the price of the limit."""
    (limit,) = limited("path")

    def solved(shift: float):
        objective = build_objective(problem(limit_trajectory("alpha", upper=limit.upper + shift)), method)
        return objective, GaussNewton(tolerance=1e-10).minimise(objective)

    objective, outcome = solved(0.0)
    assert outcome.status.result is Results.CONVERGED and outcome.value.worst() < 1e-9
    linear_there = objective.linearise(outcome.point, outcome.value)
    step = objective.step(outcome.point, outcome.value, linear_there, 0.0)
    multipliers = step.path_multipliers
    assert multipliers is not None and linear_there.paths is not None
    assert (multipliers >= 0.0).all() and multipliers.max() > 1.0
    room = limit.upper - linear_there.paths.values
    assert np.abs(room[multipliers > 0.0]).max() < 1e-9 and room.min() > -1e-9
    costs = [solved(side * 1e-6)[1].value.cost for side in (1, -1)]
    assert multipliers.sum() == pytest.approx((costs[1] - costs[0]) / 2e-6, rel=1e-3)


@pytest.mark.parametrize(
    "solver", [GaussNewton(tolerance=1e-10), Ipopt(tolerance=1e-11)], ids=["gauss-newton", "ipopt"]
)
def test_multipliers_of_a_path_limit_are_the_rate_at_which_the_cost_falls(tmp_path: Path, solver: Any) -> None:
    """Truth: the envelope theorem, by fits with the limit moved to either side."""
    (limit,) = limited("path")
    low, fit, high = (
        solve(problem(limit_trajectory("alpha", upper=limit.upper + shift)), solver=solver)
        for shift in (-1e-6, 0.0, 1e-6)
    )
    (of_limit,) = fit.path_multipliers
    assert sum(one.sum() for one in of_limit.values()) == pytest.approx((low.cost - high.cost) / 2e-6, rel=1e-3)
    for record, one in of_limit.items():
        alpha = fit.predictions[record][:, fit.problem.model.outputs.index("alpha")]
        assert one.shape == alpha.shape and (one >= 0.0).all()
        assert np.abs(alpha - limit.upper)[one > 0.0].max(initial=0.0) < 1e-7
    fit.save(tmp_path / "fit.casid")
    kept = load(tmp_path / "fit.casid").path_multipliers
    assert all((kept[0][record] == one).all() for record, one in of_limit.items())
    assert solve(problem()).path_multipliers == ()


def test_constrained_fits_from_zero_come_to_those_from_near():
    zero = dict.fromkeys(START, 0.0)
    for kind in ("path", "function"):
        far, near = solve(problem(*limited(kind), start=zero)), solve(problem(*limited(kind)))
        assert far.converged and far.solver == "GaussNewton"
        assert far.log_likelihood == pytest.approx(near.log_likelihood, abs=1e-6)
    with pytest.raises(EstimationError, match="no number at the start"):
        solve(problem(*limited("equation"), start=zero))


@pytest.mark.slow
def test_paths_that_contradict_each_other_end_with_a_word():
    contrary = problem(limit_trajectory("alpha", upper=0.001), limit_trajectory("alpha", lower=0.002))
    fit = solve(contrary, solver=GaussNewton())
    assert not fit.converged and "cannot be satisfied together" in fit.status


def test_a_path_that_begins_beyond_its_limit_ends_with_a_word():
    begin = InitialState(value={"alpha": 0.01, "q": -0.02}, std={"alpha": 0.0, "q": 0.0})
    fit = solve(problem(limit_trajectory("alpha", upper=0.005), initial_state=begin), solver=GaussNewton())
    assert not fit.converged and "cannot be satisfied together" in fit.status


def test_a_limit_on_a_function_of_logarithms_is_one_of_the_parameters():
    """A sum of two, of which one is estimated by its logarithm, and the same sum as a function."""
    positive = define_model(
        "decay",
        states=(),
        inputs=("t",),
        parameters={"a": 1.0, "k": 0.5},
        outputs=("y",),
        dynamics=lambda s: {},
        output=lambda s: {"y": s.a * np.exp(-s.k * s.t)},
    )
    t = np.linspace(0.0, 4.0, 60)
    record = Record(name="d", t=t, channels={"y": 2.0 * np.exp(-0.7 * t)})
    sums = (limit_combination({"a": 1.0, "k": 1.0}, upper=2.5), limit_function(lambda s: s.a + s.k, upper=2.5))
    fits = [
        solve(Problem(positive, record, free=["*"], log=log, noise={"y": 0.1}, constraints=one))
        for log in ((), ("k",), ("a", "k"))
        for one in sums
    ]
    for fit in fits:
        assert fit.converged and fit["a"].value + fit["k"].value == pytest.approx(2.5, abs=1e-8)
        assert fit["a"].value == pytest.approx(fits[0]["a"].value, rel=1e-6)
        assert fit.multipliers == pytest.approx(fits[0].multipliers, rel=1e-4)


def test_a_limit_on_a_function_of_per_record_parameters_holds_in_every_record():
    rng = np.random.default_rng(2)
    records = [flight(n, noise=NOISE, rng=rng, values=TRUTH | {"Mde": v}) for n, v in (("m1", -6.0), ("m2", -7.0))]
    given = Problem(
        short_period(),
        records,
        free=["Ma", "Mq"],
        per_record=["Mde"],
        noise=NOISE,
        constraints=[limit_function(lambda s: s.Mde * s.Mq, upper=11.5)],
    )
    fit = solve(given)
    assert fit["Mde[m2]"].value * fit["Mq"].value == pytest.approx(11.5, abs=1e-8)
    assert fit["Mde[m1]"].value * fit["Mq"].value < 11.5 and fit.multipliers[0] == 0.0 < fit.multipliers[1]


def test_constrained_linear_least_squares_is_the_analytic_solution():
    """min |Z b - y|^2 subject to C b = d: the normal equations with Lagrange's multiplier."""
    rng = np.random.default_rng(4)
    inputs, b = [f"z{i}" for i in range(4)], [f"b{i}" for i in range(4)]
    model = define_regression(
        "line",
        inputs=inputs,
        parameters=dict.fromkeys(b, 0.0),
        outputs=["y"],
        output=lambda s: {"y": sum(getattr(s, f"b{i}") * getattr(s, f"z{i}") for i in range(4))},
    )
    z = rng.standard_normal((80, 4))
    y = z @ np.array([1.0, -2.0, 0.5, 3.0]) + 0.1 * rng.standard_normal(80)
    channels = {f"z{i}": z[:, i] for i in range(4)} | {"y": y}
    record = Record(name="r", t=np.arange(80.0), channels=channels)
    c, d = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 2.0, 0.0, -1.0]]), np.array([0.3, -4.0])
    rows = [limit_combination(dict(zip(b, row, strict=True)), lower=v, upper=v) for row, v in zip(c, d, strict=True)]
    fit = solve(Problem(model, record, free=["*"], noise={"y": 0.1}, constraints=rows))
    information = z.T @ z / 0.01
    matrix = np.block([[information, c.T], [c, np.zeros((2, 2))]])
    wanted = np.linalg.solve(matrix, np.concatenate([z.T @ y / 0.01, d]))
    np.testing.assert_allclose([*fit.values.values(), *fit.multipliers], wanted, rtol=1e-8)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(matrix)[:4, :4], rtol=1e-8, atol=1e-16)


@pytest.mark.parametrize("seed", range(20))
def test_the_quadratic_problem_is_solved_to_its_optimality_conditions(seed):
    """Random ones with hard and soft limits: stationary, feasible, complementary, multipliers within their price."""
    rng = np.random.default_rng(seed)
    n, w = int(rng.integers(2, 20)), int(rng.integers(1, 60))
    root, size = rng.standard_normal((n, n)), 10.0 ** rng.uniform(-4.0, 4.0, n)
    h, g = (root @ root.T + 1e-6 * np.eye(n)) * np.outer(size, size), rng.standard_normal(n) * size
    rows = rng.standard_normal((w, n))
    length = np.linalg.norm(rows / size, axis=1)
    middle = rows @ (0.1 * rng.standard_normal(n) / size)
    upper = middle + 0.1 * length * rng.random(w)
    lower = np.where(rng.random(w) < 0.3, middle - 0.1 * length * rng.random(w), -np.inf)
    price = np.where(rng.random(w) < 0.4, 3.0 / length, np.inf)
    step, m = parameter_step(h, g, rows, lower, upper, price)
    scale = 1.0 / np.sqrt(np.diagonal(h))
    assert np.abs((h @ step + g + rows.T @ m) * scale).max() < 1e-9
    at = rows @ step
    excess, hard = np.maximum(at - upper, 0.0) + np.maximum(lower - at, 0.0), np.isinf(price)
    assert (excess / length)[hard].max(initial=0.0) < 1e-9
    assert (np.abs(m) <= price * (1.0 + 1e-12)).all()
    room = np.where(m > 0.0, upper - at, np.where(m < 0.0, at - lower, 0.0))
    within = np.where(excess > 1e-12 * length, np.where(hard, 0.0, price - np.abs(m)) * excess, np.abs(m * room))
    assert within.max() < 1e-9


def test_limits_that_contradict_each_other_end_with_a_word():
    contrary = problem(limit_parameter("Mq", upper=-3.0), limit_combination({"Mq": 2.0}, lower=-2.0))
    for solver in SOLVERS:
        fit = solve(contrary, solver=solver)
        assert not fit.converged and "cannot be satisfied" in fit.status


def test_constraints_are_checked_when_they_are_made():
    with pytest.raises(EstimationError, match="above upper"):
        limit_parameter("Mq", lower=1.0, upper=0.0)
    with pytest.raises(EstimationError, match="neither"):
        limit_trajectory("alpha")
    with pytest.raises(InputError, match="did you mean 'Mq'"):
        problem(limit_parameter("MQ", upper=0.0))
    with pytest.raises(InputError, match="did you mean 'alpha'"):
        problem(limit_trajectory("alfa", upper=0.0))
    with pytest.raises(InputError, match="did you mean 'Mq'"):
        problem(limit_function(lambda s: s.MQ * s.Ma, upper=0.0))
    with pytest.raises(InputError, match="no free parameter"):
        problem(limit_function(lambda s: s.Mq * s.Ma, upper=0.0), free=["Za"])
    with pytest.raises(InputError, match="price"):
        limit_trajectory("alpha", upper=0.0, price=-1.0)


@pytest.mark.parametrize("wrong", [None, 3.0, "Mq < 0", {"Mq": (-9.0, 0.0)}])
def test_what_is_no_list_of_constraints_is_refused(wrong):
    with pytest.raises(InputError, match="constraints"):
        Problem(short_period(), RECORD, free=["*"], constraints=wrong)


def test_a_bound_on_a_per_record_parameter_holds_in_every_record():
    rng = np.random.default_rng(2)
    records = [flight(n, noise=NOISE, rng=rng, values=TRUTH | {"Mde": v}) for n, v in (("m1", -6.0), ("m2", -7.0))]
    given = Problem(
        short_period(),
        records,
        free=["Ma", "Mq"],
        per_record=["Mde"],
        noise=NOISE,
        constraints=[limit_parameter("Mde", lower=-6.5)],
    )
    fit = solve(given)
    assert fit["Mde[m2]"].value == pytest.approx(-6.5, abs=1e-9) and fit["Mde[m1]"].value > -6.5
    assert fit.multipliers[0] == 0.0 > fit.multipliers[1]
