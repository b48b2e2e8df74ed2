"""Truth: limits are met, multipliers are what a limit costs (envelope theorem), an equality is an elimination."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import NOISE, START, TRUTH, flight, short_period

from casid.errors import EstimationError, InputError
from casid.estimation import (
    Collocation,
    GaussNewton,
    Ipopt,
    MultipleShooting,
    Problem,
    SingleShooting,
    linear,
    parameter,
    path,
    solve,
)

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
        return solve(problem(parameter("Mq", **moved)), MultipleShooting(), solver)

    fit = fit_with(0.0)
    assert fit.converged
    assert fit["Mq"].value == pytest.approx(next(iter(limits.values())), abs=1e-7)
    assert fit["Mq"].std == pytest.approx(0.0, abs=1e-12) and fit["Ma"].std > 0
    assert (fit.multipliers[0] > 0) == ("upper" in limits)
    step = 1e-3
    price = -(fit_with(step).cost - fit_with(-step).cost) / (2 * step)
    assert fit.multipliers[0] == pytest.approx(price, rel=1e-3)


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_inactive_bound_changes_nothing(solver):
    free, bounded = solve(problem(), solver=solver), solve(problem(parameter("Mq", upper=0.0)), solver=solver)
    np.testing.assert_allclose(list(bounded.values.values()), list(free.values.values()), rtol=1e-7)
    assert bounded.multipliers[0] == 0.0 and bounded["Mq"].std == pytest.approx(free["Mq"].std, rel=1e-6)


@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=20), Collocation(degree=2)])
@pytest.mark.parametrize("solver", SOLVERS)
def test_an_equality_is_the_same_as_fixing_the_parameter(method, solver):
    tied = solve(problem(parameter("Mq", lower=-2.0, upper=-2.0)), method, solver)
    fixed = solve(problem(fixed={"Mq": -2.0}), method, solver)
    assert tied.converged
    for name in ("Za", "Zde", "Ma", "Mde"):
        assert tied[name].value == pytest.approx(fixed[name].value, rel=1e-6)
        assert tied[name].std == pytest.approx(fixed[name].std, rel=1e-5)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_linear_combination_of_parameters_is_limited(solver):
    free = solve(problem())
    limit = free["Ma"].value - 2 * free["Mq"].value - 0.3
    fit = solve(problem(linear({"Ma": 1.0, "Mq": -2.0}, upper=limit)), solver=solver)
    assert fit.converged
    assert fit["Ma"].value - 2 * fit["Mq"].value == pytest.approx(limit, abs=1e-7)
    assert fit.multipliers[0] > 0 and fit.cost > free.cost


@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(), Collocation(degree=2)])
def test_a_path_constraint_holds_at_every_sample(method):
    free = solve(problem(), method)
    column = 0
    peak = float(free.predictions["m1"][:, column].max())
    fit = solve(problem(path("alpha", upper=0.95 * peak)), method, Ipopt())
    assert fit.converged, fit.status
    assert fit.predictions["m1"][:, column].max() == pytest.approx(0.95 * peak, abs=1e-6)
    assert fit.cost > free.cost


def test_gauss_newton_says_that_it_cannot_hold_a_path():
    with pytest.raises(EstimationError, match="Ipopt"):
        solve(problem(path("alpha", upper=0.1)), solver=GaussNewton())


def test_a_path_goes_to_ipopt_without_being_told():
    given = problem(path("alpha", upper=0.95 * float(solve(problem()).predictions["m1"][:, 0].max())))
    found, named = solve(given), solve(given, solver=Ipopt())
    assert found.converged and found.solver == "Ipopt" and found.values == named.values


def test_limits_that_contradict_each_other_end_with_a_word():
    contrary = problem(parameter("Mq", upper=-3.0), linear({"Mq": 2.0}, lower=-2.0))
    for solver in SOLVERS:
        fit = solve(contrary, solver=solver)
        assert not fit.converged and "cannot be satisfied" in fit.status


def test_constraints_are_checked_when_they_are_made():
    with pytest.raises(EstimationError, match="above upper"):
        parameter("Mq", lower=1.0, upper=0.0)
    with pytest.raises(EstimationError, match="neither"):
        path("alpha")
    with pytest.raises(InputError, match="did you mean 'Mq'"):
        problem(parameter("MQ", upper=0.0))
    with pytest.raises(InputError, match="did you mean 'alpha'"):
        problem(path("alfa", upper=0.0))


def test_a_bound_on_a_per_record_parameter_holds_in_every_record():
    rng = np.random.default_rng(2)
    records = [flight(n, noise=NOISE, rng=rng, values=TRUTH | {"Mde": v}) for n, v in (("m1", -6.0), ("m2", -7.0))]
    given = Problem(
        short_period(),
        records,
        free=["Ma", "Mq"],
        per_record=["Mde"],
        noise=NOISE,
        constraints=[parameter("Mde", lower=-6.5)],
    )
    fit = solve(given)
    assert fit["Mde[m2]"].value == pytest.approx(-6.5, abs=1e-9) and fit["Mde[m1]"].value > -6.5
    assert fit.multipliers[0] == 0.0 > fit.multipliers[1]
