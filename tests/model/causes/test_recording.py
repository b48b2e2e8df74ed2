"""Causes in how instruments are mounted, fed and written down. Truth: the formula of each."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from casid.model.aircraft import EffectValue
from casid.model.dynamics import aircraft_model
from casid.model.effects import effect_of
from casid.model.path import STATES
from casid.signals import SURFACES
from problems.do328 import do328

AIRCRAFT = do328()
MIXED = {"u": 140.0, "v": 3.0, "w": 6.0, "p": 0.2, "q": -0.1, "r": 0.15, "phi": 0.3, "theta": 0.1}
MIXED |= {"delta_e": 0.04, "delta_a": -0.03, "delta_r": 0.05, "thrust": 1.1e4, "rho": 0.9}


def response(effects) -> tuple[ca.Function, np.ndarray, dict[str, int]]:
    """(p) -> [f; h] at one mixed flight point, nominal p, and where every parameter stands."""
    model = aircraft_model(AIRCRAFT, effects=effects)
    x, u = ([MIXED[name] for name in names] for names in (model.states, model.inputs))
    inner = ca.Function("inner", [model.x, model.u, model.p, model.w], [ca.vertcat(model.f, model.h)])
    outer = ca.Function("response", [model.p], [inner(x, u, model.p, np.zeros(len(model.disturbances)))])
    return outer, model.nominal_vector(), {name: i for i, name in enumerate(model.parameters)}


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_unit_mounted_askew_reads_along_its_own_axes(axis):
    """A rotation of the axes by 0.05 rad: every triad keeps its length, and its part along the axis of rotation."""
    effect = effect_of(EffectValue(kind="sensor_misalignment", target="inertial", term=axis, value=0.0))
    f, p, at = response([effect])
    model = aircraft_model(AIRCRAFT, effects=[effect])
    rows = [len(model.states) + model.outputs.index(name) for name in ("ax", "ay", "az")]
    before = f(p).full()[rows, 0]
    p[at[effect.name]] = 0.05
    after = f(p).full()[rows, 0]
    rotation = Rotation.from_rotvec(0.05 * np.eye(3)["xyz".index(axis)]).as_matrix().T
    np.testing.assert_allclose(after, rotation @ before, rtol=1e-12)


def test_a_position_error_is_none_at_trim_and_grows_with_its_term():
    """At the alpha of the file the reading is right; 0.01 rad above it V reads 0.4 m/s more at 40 m/s per rad."""
    effect = effect_of(EffectValue(kind="position_error", target="V", term="alpha", value=0.0))
    at_rest = float(np.arctan2(MIXED["w"], MIXED["u"]))
    for trim_alpha, expected in ((at_rest, 0.0), (at_rest - 0.01, 0.4)):
        aircraft = replace(AIRCRAFT, trim={**AIRCRAFT.trim, "alpha": trim_alpha})
        model = aircraft_model(aircraft, effects=[effect])
        point = [[MIXED[name] for name in names] for names in (model.states, model.inputs)]
        h = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
        p, calm = model.nominal_vector(), np.zeros(len(model.disturbances))
        row, at = model.outputs.index("V"), model.parameters.index(effect.name)
        before = float(h(*point, p, calm)[row])
        p[at] = 40.0
        assert float(h(*point, p, calm)[row]) - before == pytest.approx(expected, abs=1e-9)


def test_recorded_thrust_that_is_low_acts_with_more():
    """A scale of 0.25 adds a quarter of the thrust to the force along x, over the mass."""
    effect = effect_of(EffectValue(kind="thrust_scale", value=0.0))
    f, p, at = response([effect])
    u_dot = STATES.index("u")
    before = f(p).full()[u_dot, 0]
    p[at[effect.name]] = 0.25
    assert f(p).full()[u_dot, 0] - before == pytest.approx(0.25 * MIXED["thrust"] / AIRCRAFT.mass)


@pytest.mark.parametrize("value", [0.01, -0.02])
def test_a_clock_that_gains_reads_later_and_later_and_is_undone(value):
    """A clock that gains v s/s stamps t with what was at t / (1 + v); undoing it gives the truth back."""
    t = np.arange(0.0, 20.0, 0.01)
    truth = {name: np.sin(1.3 * t + i) for i, name in enumerate(("V", "alpha", "beta"))}
    effect = effect_of(EffectValue(kind="clock_drift", target="air_data", value=0.0))
    assert effect.output is not None and effect.forms.undo is not None
    read = effect.output(t, truth, {"value": value})
    inside = t / (1.0 + value) < t[-1]
    np.testing.assert_allclose(read["V"][inside], np.sin(1.3 * t / (1.0 + value))[inside], atol=1e-4)
    back = effect.forms.undo(t, read, {"value": value})
    known = np.isfinite(back["V"]) & (t * (1.0 + value) < t[-1] - 0.5)
    np.testing.assert_allclose(back["V"][known], truth["V"][known], atol=2e-4)


def test_surfaces_that_are_recorded_late_act_ahead_of_their_record():
    t = np.arange(0.0, 10.0, 0.01)
    known = {name: np.sin(t + i) for i, name in enumerate(SURFACES)}
    effect = effect_of(EffectValue(kind="sensor_delay", target="surfaces", value=0.0))
    assert effect.series is not None
    added = effect.series(t, known, {"value": 0.12})
    acting = known["delta_r"] + added["d_delta_r"]
    np.testing.assert_allclose(acting[:-20], np.sin(t + 2 + 0.12)[:-20], atol=1e-4)
