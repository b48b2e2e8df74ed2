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


@pytest.mark.slow
@pytest.mark.parametrize("problem", list(posed(None)), ids=lambda problem: problem.name)
def test_no_end_that_converged_is_contradicted(problem):
    for one in problem.starts():
        fit = solve(one, solver=Automatic(seconds=60.0))
        if fit.converged and problem.judged:
            assert by_lsoda(one, fit) == pytest.approx(-fit.log_likelihood, abs=0.01)
