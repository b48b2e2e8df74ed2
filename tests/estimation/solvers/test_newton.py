"""Truth: formulas of a small problem with large residuals, and IPOPT with CasADi's exact Hessian on the Do 328."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import cut

from casid.estimation import Automatic, GaussNewton, Ipopt, OutputError, Problem, limit_parameter, solve
from casid.estimation.solvers import newton
from casid.model.system import define_model
from casid.records.record import Record
from problems.every_problem import every_problem
from problems.paper.cases import Condition
from problems.paper.estimation import paper_problem
from problems.paper.truth import fly

U = np.random.default_rng(0).standard_normal(50)


def nonlinear(bend: float, limited: bool = False) -> Problem:
    """Residuals (a + 1) u, (bend a^2 + a - 1) u and (b - 1) u.

    The cost has the slope zero and the curvature (2 - 2 bend) sum u^2 in a at a = 0, Gauss-Newton takes it for
    2 sum u^2: its error shrinks by |bend| a step.
    """
    model = define_model(
        "nonlinear",
        states=("theta",),
        inputs=("u",),
        parameters={"a": 0.3, "b": 0.0},
        outputs=("p", "q", "r"),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"p": s.a * s.u, "q": (bend * s.a**2 + s.a) * s.u, "r": s.b * s.u},
    )
    record = Record(name="m1", t=0.1 * np.arange(50), channels={"u": U, "p": -U, "q": U, "r": U})
    limits = (limit_parameter("b", upper=0.5),) if limited else ()
    noise = {"p": 1.0, "q": 1.0, "r": 1.0}
    return Problem(model, [record], free=["a", "b"], noise=noise, constraints=limits)


@pytest.mark.parametrize("limited", [False, True])
def test_what_gauss_newton_creeps_towards_is_reached(limited):
    alone, fit = solve(nonlinear(0.97, limited), solver=GaussNewton()), solve(nonlinear(0.97, limited))
    assert alone.solver == "GaussNewton" and not alone.converged and alone.iterations == 100
    assert fit.solver == "Newton" and fit.converged and fit.iterations < 50
    assert fit.values == pytest.approx({"a": 0.0, "b": 0.5 if limited else 1.0}, abs=1e-6)
    if limited:
        assert fit.multipliers == pytest.approx([0.5 * U @ U])
    # as of any fit: the information of Gauss-Newton
    assert fit["a"].std_cramer_rao == pytest.approx(1.0 / np.sqrt(2.0 * U @ U))


def test_a_maximum_is_no_solution():
    """With a bend above 1 the cost has a maximum at a = 0 and minima where 2 bend^2 a^2 + 3 bend a + 2 = 2 bend."""
    bend = 1.5
    fit = solve(nonlinear(bend), solver=Automatic(tolerance=1e-9))
    a = fit.values["a"]
    assert fit.converged and 2 * bend**2 * a**2 + 3 * bend * a + 2 == pytest.approx(2 * bend)


@pytest.mark.parametrize(
    ("noise", "samples"),
    [("range", 125), *(pytest.param(noise, 250, marks=pytest.mark.slow) for noise in ("range", "residuals"))],
)
def test_a_linear_model_of_a_nonlinear_aircraft(noise, samples, load_script):
    """IPOPT with the exact Hessian from there: estimates equal to 1e-8 of their value or standard deviation."""
    whole = paper_problem(fly(Condition(case="H", manoeuvre=2, variant=3, seed=1)), OutputError(), noise=noise)
    problem = cut(whole, samples)
    usual, fit = solve(problem), solve(problem, solver=Automatic(tolerance=1e-10))
    assert usual.converged and fit.converged and fit.stationarity < 1e-8
    # steps of 1e-6 that shrink by a tenth each come from ten times as far
    assert all(abs(value - fit.values[name]) < 1e-5 * fit[name].std for name, value in usual.values.items())
    theirs = solve(replace(problem, start=fit.values), solver=Ipopt(tolerance=1e-12))
    assert theirs.stationarity < 1e-8 and load_script("compare_solvers").apart(fit, theirs) <= 1.0


ORDINARY = ["do328 B-m5-v0-s1 output", "do328 D-m5-v0-s1 combined", "do328 F-m5-v1-s1 equation", "demo"]


@pytest.mark.parametrize("name", ORDINARY)
def test_where_gauss_newton_converges_it_does_it_alone(name, monkeypatch):
    def refused(*_):
        raise AssertionError("Newton was asked")

    monkeypatch.setattr(newton, "_Newton", refused)
    # the second fit would find a kernel that the first had to do without
    monkeypatch.setenv("CASID_COMPILE_FIRST", "1")
    problem = dict(every_problem())[name]()
    fit, alone = solve(problem), solve(problem, solver=GaussNewton())
    assert fit.converged and fit.solver == "GaussNewton"
    assert fit.values == alone.values and fit.iterations == alone.iterations
