"""A measured external force, as of a tether, in the model. Truth: Newton's and Euler's laws written out, and an
aeroplane simulated with a force, whose values an estimation finds again when the record states it."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.cli.options import DEMO
from casid.model.flown_records import flown_records
from casid.signals import EXTERNAL_FORCE, FORCE_POINT

PLANE = cs.Aircraft.read(DEMO / "aircraft.toml")
RECORD = cs.read_record(DEMO / "m1.csv", between=(0.0, 12.0))
FORCE, POINT = np.array([300.0, -120.0, 500.0]), np.array([-1.5, 0.2, 0.4])


def pulled(record: cs.Record, force: np.ndarray = FORCE, point: np.ndarray = POINT) -> cs.Record:
    columns = {name: np.full(len(record), value) for name, value in zip(EXTERNAL_FORCE, force, strict=True)}
    columns |= {name: np.full(len(record), value) for name, value in zip(FORCE_POINT, point, strict=True)}
    return record.with_channels(**columns)


def accelerations(record: cs.Record) -> dict[str, np.ndarray]:
    """First readings of the model along a record."""
    applied = flown_records(PLANE, [record], "full")
    model, ready = applied.model, applied.records[0]
    import casadi as ca

    p = [model.nominal[name] for name in model.parameters]
    h = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
    x, u = model.guess(ready)[0], ready.matrix(model.inputs)[0]
    return dict(zip(model.outputs, h(x, u, p, 0.0).full().ravel(), strict=True))


def test_a_force_accelerates_by_newton_and_turns_by_euler():
    free, held = accelerations(RECORD), accelerations(pulled(RECORD))
    turn = np.linalg.solve(PLANE.inertia.tensor, np.cross(POINT, FORCE))
    for i, name in enumerate(("pdot", "qdot", "rdot")):
        assert held[name] - free[name] == pytest.approx(turn[i], rel=1e-9, abs=1e-12)
    arm = np.array(PLANE.accelerometer)
    for i, name in enumerate(("ax", "ay", "az")):
        expected = FORCE[i] / PLANE.mass + np.cross(turn, arm)[i]
        assert held[name] - free[name] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_no_force_is_a_force_of_zero_and_a_point_alone_is_nothing():
    free, held = accelerations(RECORD), accelerations(pulled(RECORD, force=np.zeros(3)))
    assert held == pytest.approx(free, rel=1e-12)


def test_equation_error_takes_the_force_off():
    """The coefficients that accelerations show do not change when force and what it makes are added to both sides."""
    model = cs.aircraft_model(PLANE, known=(*EXTERNAL_FORCE, *FORCE_POINT))
    assert model.equation is not None and set(EXTERNAL_FORCE) <= set(model.equation.channels)
    import casadi as ca

    form = model.equation
    function = ca.Function("c", [form.m], [form.target])
    rng = np.random.default_rng(5)
    at = dict(zip(form.channels, rng.uniform(0.05, 0.1, len(form.channels)), strict=True)) | {"V": 120.0, "rho": 1.0}
    at |= dict.fromkeys((*EXTERNAL_FORCE, *FORCE_POINT), 0.0)
    turn = np.linalg.solve(PLANE.inertia.tensor, np.cross(POINT, FORCE))
    moved = at | dict(zip(EXTERNAL_FORCE, FORCE, strict=True)) | dict(zip(FORCE_POINT, POINT, strict=True))
    shift = FORCE / PLANE.mass + np.cross(turn, np.array(PLANE.accelerometer))
    for name, by in zip(("ax", "ay", "az", "pdot", "qdot", "rdot"), (*shift, *turn), strict=True):
        moved[name] = moved[name] + by
    here, there = ([one.get(name, 0.0) for name in form.channels] for one in (at, moved))
    np.testing.assert_allclose(function(there).full(), function(here).full(), rtol=1e-9, atol=1e-12)


def test_a_record_of_two_without_the_force_has_none():
    applied = flown_records(PLANE, [RECORD, pulled(RECORD.renamed("tethered"))], "full")
    assert not np.any([applied.records[0][name] for name in EXTERNAL_FORCE])
    np.testing.assert_array_equal(applied.records[1]["fz"], FORCE[2])


def test_a_gap_in_the_force_is_an_error():
    gap = pulled(RECORD).with_channels(fx=np.where(np.arange(len(RECORD)) == 7, np.nan, 1.0))
    with pytest.raises(cs.InputError, match="input fx is missing"):
        cs.flight_inputs(PLANE, gap)


def test_values_are_found_again_when_the_record_states_the_force():
    """The truth has Cm_alpha a quarter larger; a tether that pulls harder and harder turns the nose besides."""
    pull = np.outer(np.linspace(0.0, 1.0, len(RECORD)), 0.2 * 9.81 * PLANE.mass * np.array([0.5, 0.0, 1.0]))
    columns = dict(zip(EXTERNAL_FORCE, pull.T, strict=True)) | {"force_at_x": np.full(len(RECORD), 1.0)}
    applied = flown_records(PLANE, [RECORD.with_channels(**columns)], "longitudinal")
    model, ready = applied.model, applied.records[0]
    truth = {"Cm_alpha": 1.25 * model.nominal["Cm_alpha"]}
    flown = cs.simulate(model, ready, model.guess(ready)[0], truth).as_record()
    noise = np.random.default_rng(2)
    noisy = {name: flown[name] + 1e-4 * noise.standard_normal(len(flown)) for name in ("alpha", "q", "theta")}
    seen = ready.with_channels(**noisy).without("V", "ax", "az", "qdot")
    fits = []
    for record in (seen, seen.without(*EXTERNAL_FORCE, *FORCE_POINT)):
        one = flown_records(PLANE, [record], "longitudinal")
        problem = cs.Problem(one.model, one.records, free=["Cm_alpha", "Cm_0"], cost=cs.OutputError())
        fits.append(cs.solve(problem, cs.MultipleShooting(interval=20)).values["Cm_alpha"])
    assert fits[0] == pytest.approx(truth["Cm_alpha"], rel=0.01)
    assert abs(fits[1] / truth["Cm_alpha"] - 1.0) > 0.05
