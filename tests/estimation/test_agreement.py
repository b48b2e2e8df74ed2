"""Truth: IPOPT on the problem as a nonlinear programme, with derivatives of CasADi's own, started where ours starts.

`benchmarks/compare_solvers.py` does the same for every problem in full; here records are cut short.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import cut

from casid.estimation import Fit, Problem
from casid.estimation.solvers.status import out_of_steps
from casid.model.system import define_model
from casid.records.record import Record
from problems.every_problem import every_problem

BOOK = ("hfb320", "attas lateral", "attas longitudinal", "unstable short period")


@pytest.mark.parametrize("name", BOOK)
@pytest.mark.slow
def test_solvers_agree_on_records_of_the_book(name, flight_data, load_script):
    """Those of ATTAS by their first half: IPOPT alone takes seconds with all of it."""
    problem = dict(every_problem(flight_data))[name]()
    problem = cut(problem, 300) if name.startswith("attas") else problem
    found = load_script("compare_solvers").compared(name, problem)
    assert found["apart"] <= 1.0, found


@pytest.mark.parametrize("name", ["do328 B-m5-v0-s1 output", "do328 F-m5-v1-s1 equation"])
def test_solvers_agree_on_the_do328(name, load_script):
    found = load_script("compare_solvers").compared(name, cut(dict(every_problem())[name](), 500))
    assert found["apart"] <= 1.0, found


def test_every_case_and_estimator_is_a_problem():
    names = [name for name, _ in every_problem()]
    assert len(names) == len(set(names)) == 8 * 3 + 1
    assert len([name for name, _ in every_problem(whole=True)]) == 384 * 3 + 1


def test_what_does_not_agree_is_seen(load_script):
    script = load_script("compare_solvers")
    problem = cut(dict(every_problem())["do328 B-m5-v0-s1 equation"](), 250)

    def shifted(fit: Fit, factor: float) -> Fit:
        return replace(fit, values={name: factor * value for name, value in fit.values.items()})

    fit = script.solve(problem)
    assert script.apart(fit, shifted(fit, 1.0 + 1e-6)) > 1.0 > script.apart(fit, fit)


def test_two_minima_are_told_from_a_wrong_solution(load_script):
    """reading = a^2 u: a and -a fit alike, and a solver that starts at one stays there. 1.1 a is no minimum."""
    script = load_script("compare_solvers")
    model = define_model(
        "square",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 1.0},
        outputs=("reading",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"reading": s.a**2 * s.delta_e},
    )
    rng = np.random.default_rng(0)
    u = rng.standard_normal(50)
    record = Record(
        name="m1", t=0.1 * np.arange(50), channels={"delta_e": u, "reading": 4.0 * u + 0.1 * rng.standard_normal(50)}
    )
    problem = Problem(model, [record], free=["a"], noise={"reading": 0.1})
    right, left = (script.by_ours(replace(problem, start={"a": a})) for a in (1.5, -1.5))
    assert right.values["a"] == pytest.approx(-left.values["a"]) == pytest.approx(2.0, abs=0.05)
    assert script.apart(right, left) > 1.0 and script.found(problem, right, left) == "two minima"
    wrong = replace(right, values={"a": 1.1 * right.values["a"]}, stationarity=1.0)
    assert script.found(problem, right, wrong) == script.DISAGREE
    assert script.found(problem, wrong, left) == script.DISAGREE
    lost = replace(left, ended=out_of_steps(3))
    assert script.found(problem, right, lost) == "ours, IPOPT stopped"
    assert script.found(problem, lost, right) == script.DISAGREE
    assert script.found(problem, lost, lost) == script.DISAGREE
