"""Truth: published optima of COPS, Bellman and PEtab."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import casid as cs
from casid.errors import InputError
from problems.references.differential import PUBLISHED, boehm
from problems.references.goodwin import goodwin
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
    """By shooting every estimate is within a tenth of a standard deviation of that with many steps, and the cost
    -ln(likelihood) within 0.01."""
    problem = BY_NAME[name].make(published_data)
    fit, fine = cs.solve(problem), cs.solve(problem, cs.Collocation(substeps=3))
    assert fit.converged and fit.method == "MultipleShooting"
    for parameter in fit.values:
        assert abs(fit[parameter].value - fine[parameter].value) < 0.1 * fine[parameter].std
    assert fit.log_likelihood == pytest.approx(fine.log_likelihood, abs=0.01)


@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting()], ids=lambda m: type(m).__name__)
def test_goodwins_oscillator_from_many_starts(method):
    """Twice too much or too little, and a decade either way of that: the best is where the truth's neighbourhood leads,
    found by collocation with many steps."""
    truth = cs.solve(goodwin(1.0), cs.Collocation(substeps=6))
    fit = cs.solve(goodwin(2.0), method, starts=3)
    assert truth.converged and fit.converged and fit.starts is not None
    assert fit.log_likelihood == pytest.approx(truth.log_likelihood, abs=0.01)


def test_a_stiff_system_at_its_optimum(published_data):
    """Boehm et al., four parameters from 1.3 times too much or too little, by what `solve` chooses."""
    fit = cs.solve(boehm(published_data, off=1.3), cs.SingleShooting())
    assert fit.converged and "implicit" in fit.integrator, fit.status
    assert -fit.log_likelihood == pytest.approx(138.2220, abs=0.01)


def test_cvodes_flies_a_stiff_system_as_radau_and_collocation_do(published_data):
    """Boehm's percentages, up to 92, against scipy's Radau at 1e-11 and collocation in 20 steps per sample interval;
    one step of Runge and Kutta departs."""
    problem = replace(boehm(published_data, off=1.0), free=("k_phos", "Epo_deg"), constraints=())
    model, record = problem.model, problem.records[0]
    fit = cs.solve(problem, cs.Collocation(substeps=20))
    begin, values = fit.states["boehm"].trajectory[0], dict(fit.values)
    flown = cs.simulate(model, record, begin, values, integrator="cvodes")
    p = [values.get(name, model.nominal[name]) for name in model.parameters]
    f = ca.Function("f", [model.x, model.u, model.p], [model.f])
    h = ca.Function("h", [model.x, model.u, model.p], [model.h])
    motion = solve_ivp(
        lambda t, x: f(x, [t], p).full()[:, 0],
        (record.t[0], record.t[-1]),
        begin,
        "Radau",
        record.t,
        rtol=1e-11,
        atol=1e-11,
    )
    truth = np.array([h(x, [t], p).full()[:, 0] for t, x in zip(record.t, motion.y.T, strict=True)])
    read = np.stack([flown.output(name) for name in model.outputs], axis=1)
    np.testing.assert_allclose(read, truth, atol=1e-6)
    np.testing.assert_allclose(fit.predictions["boehm"], truth, atol=1e-6)
    with pytest.raises(InputError, match="diverged"):
        cs.simulate(model, record, begin, values)


def test_what_the_data_of_boehm_do_not_tell_is_named(published_data):
    problem = boehm(published_data, off=1.0)
    limits = [*problem.constraints, cs.limit_parameter("k_imp_homo", lower=1e-5, upper=1e5)]
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
