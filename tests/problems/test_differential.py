"""Truth: published optima of COPS, Bellman and PEtab."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from problems.references.differential import PUBLISHED, boehm
from problems.references.peers import motion_by_scipy

BY_NAME = {published.name: published for published in PUBLISHED}
QUICK = sorted(set(BY_NAME) - {"Boehm"})


@pytest.mark.parametrize("name", QUICK)
def test_published_optima_by_collocation(name, published_data):
    published = BY_NAME[name]
    problem = published.make(published_data)
    assert len(problem.start_vector) == len(problem.parameters)
    fit = cs.solve(problem, cs.Collocation(substeps=3))
    assert fit.converged, fit.status
    assert published.figure(fit) == pytest.approx(published.optimum, rel=2e-5 if name != "alpha-pinene" else 1e-4)


@pytest.mark.parametrize("name", ["alpha-pinene", "Bruno"])
def test_steps_that_were_chosen_are_fine_enough(name, published_data):
    """By shooting every estimate is within a tenth of a standard deviation of that with many steps."""
    problem = BY_NAME[name].make(published_data)
    fit, fine = cs.solve(problem), cs.solve(problem, cs.Collocation(substeps=3))
    assert fit.converged and fit.method == "MultipleShooting"
    for parameter in fit.values:
        assert abs(fit[parameter].value - fine[parameter].value) < 0.1 * fine[parameter].std


def test_a_stiff_system_at_its_optimum(published_data):
    """Boehm et al., four parameters from 1.3 times too much or too little, by what `solve` chooses."""
    fit = cs.solve(boehm(published_data, off=1.3), cs.SingleShooting())
    assert fit.converged and "implicit" in fit.integrator, fit.status
    assert -fit.log_likelihood == pytest.approx(138.2220, abs=0.02)


def test_what_the_data_of_boehm_do_not_tell_is_named(published_data):
    problem = boehm(published_data, off=1.0)
    limits = [*problem.constraints, cs.parameter("k_imp_homo", lower=1e-5, upper=1e5)]
    fit = cs.solve(
        cs.Problem(
            problem.model,
            problem.records,
            free=["*"],
            fixed={"k_exp_hetero": 1.00068e-5},
            log=["*"],
            constraints=limits,
        ),
        cs.Collocation(),
    )
    assert not fit.converged and "k_imp_homo" in fit.status


def test_scipy_ends_where_we_do(published_data):
    published = BY_NAME["gas oil cracking"]
    problem = published.make(published_data)
    end, fit = motion_by_scipy(problem), cs.solve(problem, cs.Collocation(substeps=3))
    assert isinstance(problem.noise, dict)
    assert end.squares.sum() == pytest.approx(2.0 * fit.cost, rel=1e-5)
    np.testing.assert_allclose(end.parameters, list(fit.values.values()), rtol=1e-3)
