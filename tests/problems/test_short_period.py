"""Truth: the likelihood of a linear motion by matrix exponentials, and its optimum by least squares on that."""

from __future__ import annotations

import pytest

import casid as cs
from problems.references.petab import Likelihood, times
from problems.references.short_period import TRUTH, likelihood, optimum, write


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> cs.Problem:
    pytest.importorskip("libsbml")
    return cs.read_petab(write(tmp_path_factory.mktemp("short_period")))


def test_the_problem_as_it_is_read_has_the_likelihood_on_paper(problem: cs.Problem) -> None:
    for values in (TRUTH, {name: 1.3 * value for name, value in TRUTH.items()}):
        assert Likelihood(problem)(values) == pytest.approx(likelihood(values), abs=1e-4)


@pytest.mark.parametrize("factor", [1.0, 2.0, 5.0])
def test_the_optimum_on_paper_is_reached_from_far_starts(problem: cs.Problem, factor: float) -> None:
    fit, best = cs.solve(times(problem, factor)), optimum()
    assert fit.converged, fit.status
    assert -fit.log_likelihood == pytest.approx(best.cost, abs=0.01)
    assert likelihood(fit.values) == pytest.approx(best.cost, abs=0.01)
    for name, value in best.values.items():
        assert fit[name].value == pytest.approx(value, abs=0.1 * fit[name].std)
        assert value == pytest.approx(TRUTH[name], abs=4.0 * fit[name].std)
