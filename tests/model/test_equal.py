"""Causes that are equal by algebra. Truth: the derivative of the state with each of them."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from diagnosis_flights import flights

import casid as cs
from casid.model.causes import KINDS
from casid.model.dynamics import aircraft_model
from casid.model.effect import Effect
from problems.do328 import do328

ALONE = [
    kind.make("")
    for kind in KINDS.values()
    if kind.place == "aircraft" and not (kind.targets or kind.terms or kind.of_rotors)
]
PAIRS = [effect for effect in ALONE if effect.traits.equal is not None]


@pytest.mark.parametrize("effect", PAIRS, ids=lambda effect: effect.name)
def test_equal_causes_move_the_aircraft_alike(effect: Effect) -> None:
    aircraft, record = do328(), flights(seed=1, count=1)[0]
    assert effect.traits.equal is not None
    other, factor = effect.traits.equal(aircraft)

    def rates(one: Effect, value: float) -> np.ndarray:
        model = aircraft_model(aircraft, effects=[one])
        p = model.nominal_vector()
        p[model.parameters.index(one.name)] = value
        u = [record[name][100] for name in model.inputs]
        f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        return f(model.guess(record)[100], u, p, np.zeros(len(model.disturbances))).full().ravel()

    np.testing.assert_allclose(rates(effect, 0.2), rates(other, 0.2 * factor), rtol=1e-9, atol=1e-12)
    assert np.abs(rates(effect, 0.2) - rates(effect, 0.0)).max() > 1e-4


def test_the_thrust_line_and_its_asymmetry_have_an_equal() -> None:
    assert {one.name for one in PAIRS} == {"thrust_line", "thrust_asymmetry"}


def test_a_missing_term_in_its_own_state_is_damping() -> None:
    """Of any model. Truth: the rate with each of them."""
    model = cs.define_model(
        "lag",
        states=["x"],
        inputs=["u"],
        parameters={"a": 1.0},
        outputs=["x"],
        dynamics=lambda s: {"x": s.u - s.a * s.x**3},
        output=lambda s: {"x": s.x},
    )
    entries = [
        cs.EffectValue(kind="missing_term", target="x", term="x", value=0.3),
        cs.EffectValue(kind="damping", target="x", value=-0.3),
    ]
    record = cs.Record(name="m1", t=0.1 * np.arange(50), channels={"u": np.sin(np.arange(50.0))})
    one, same = (cs.simulate(model.with_effects([entry]), record, [1.0]).output("x") for entry in entries)
    np.testing.assert_allclose(one, same, rtol=1e-12)
    assert np.abs(one - cs.simulate(model, record, [1.0]).output("x")).max() > 0.1


def test_a_missing_derivative_is_that_of_the_file() -> None:
    """Truth: the derivative of the state by a file that has it."""
    aircraft, record = do328(), flights(seed=1, count=1)[0]
    known = {name: value for name, value in aircraft.derivatives.items() if name != "Cm_alpha"}
    entry = cs.EffectValue(kind="missing_derivative", target="Cm_alpha", value=aircraft.derivatives["Cm_alpha"])
    lacking = replace(aircraft, derivatives=known)

    def rates(plane: cs.Aircraft) -> np.ndarray:
        model = aircraft_model(plane)
        f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        u = [record[name][100] for name in model.inputs]
        return f(model.guess(record)[100], u, model.nominal_vector(), np.zeros(len(model.disturbances))).full()

    assert entry.unit == "1/rad"
    np.testing.assert_allclose(rates(lacking.with_effects([entry])), rates(aircraft), rtol=1e-12)
    assert np.abs(rates(lacking) - rates(aircraft)).max() > 1e-3
