"""Ends of problems that newcomers pose. Truth: the likelihood by LSODA, and the most likely end of several starts."""

from __future__ import annotations

import pytest

from casid.estimation import Automatic, solve
from problems.references.ends import DRAWN, Posed, by_lsoda, posed


@pytest.mark.parametrize("name", ["decay from 1e-6, another name", "enzyme"])
def test_an_end_has_the_likelihood_of_its_motion(name):
    for problem in Posed(name=name, make=DRAWN[name]).starts():
        fit = solve(problem)
        assert fit.converged
        assert by_lsoda(problem, fit) == pytest.approx(-fit.log_likelihood, abs=0.01)


@pytest.mark.parametrize(("name", "lowest"), [("epidemic", -208.773), ("third order", -36.417)])
def test_no_end_on_few_readings_is_a_minimum_that_is_not_the_lowest(name, lowest):
    """-ln L by LSODA at the lowest of eight starts. The epidemic has another minimum, 0.9 above, to which one search
    comes from each start. The third order has none on its way: the likelihood grows for ever with the rate of a decay,
    and steps that are too long stop it, 1.7 above."""
    ends = [solve(one) for one in next(p for p in posed(None) if p.name == name).starts()]
    assert all(-fit.log_posterior < lowest + 0.1 for fit in ends if fit.converged)
    assert name != "epidemic" or all(fit.converged for fit in ends)


@pytest.mark.slow
@pytest.mark.parametrize("problem", list(posed(None)), ids=lambda problem: problem.name)
def test_no_end_that_converged_is_contradicted(problem):
    for one in problem.starts():
        fit = solve(one, solver=Automatic(seconds=60.0))
        if fit.converged and problem.judged:
            assert by_lsoda(one, fit) == pytest.approx(-fit.log_likelihood, abs=0.01)
