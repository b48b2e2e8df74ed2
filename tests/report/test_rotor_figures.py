"""The answers of a multirotor about each axis. Truth: thrust, arms, mass and lag in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import casid as cs
from casid.diagnosis.axis_responses import axis_responses
from casid.diagnosis.facts import ChangedValue
from casid.diagnosis.given.contradicted import FlightValue
from casid.model.rotors import effectiveness
from casid.report.rotor_figures import rotors_from_above

ARM, HOVER, LAG = 0.1, 0.8 * 9.80665 / 4.0, 0.05


def aircraft(*effects: cs.EffectValue) -> cs.Aircraft:
    places = {"m1": (1, 1, 1), "m2": (-1, 1, -1), "m3": (-1, -1, 1), "m4": (1, -1, -1)}
    rotors = [
        cs.Rotor(
            name=name,
            position=(ARM * x, ARM * y, 0.0),
            spin=spin,
            thrust=(0.0, 0.0, 4.0 * HOVER),
            torque=0.02,
            lag=LAG,
        )
        for name, (x, y, spin) in places.items()
    ]
    inertia = cs.Inertia(Ixx=0.005, Iyy=0.006, Izz=0.01, Ixz=0.0)
    quad = cs.Aircraft(name="quad", mass=0.8, inertia=inertia, rotors=cs.Rotors(each=rotors))
    return quad.with_effects(effects)


HOVERS = cs.Record(name="hover", t=np.arange(50) * 0.01, channels={f"m{i}": np.full(50, 0.5) for i in range(1, 5)})


def test_the_file_answers_a_step_with_a_unit_acceleration_behind_its_lag():
    found = axis_responses(aircraft(), aircraft(), [HOVERS])
    expected = found.t - LAG * (1.0 - np.exp(-found.t / LAG))
    for axis in ("roll", "pitch", "yaw", "climb"):
        np.testing.assert_allclose(found.as_given[axis], expected, atol=1e-12)
        np.testing.assert_allclose(found.extended[axis], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "factors"),
    [
        (cs.EffectValue(kind="inertia", target="Ixx", value=0.005), {"roll": 0.5}),
        (cs.EffectValue(kind="mass", value=0.2), {"climb": 0.8}),
        (cs.EffectValue(kind="rotor_torque", target="rotors", value=0.5), {"yaw": 1.5}),
        (
            cs.EffectValue(kind="thrust_curve", target="rotors", term="slope", value=-0.5),
            dict.fromkeys(("roll", "pitch", "yaw", "climb"), 0.5),
        ),
    ],
)
def test_an_effect_changes_the_answer_of_its_axes_alone(effect: cs.EffectValue, factors: dict[str, float]):
    found = axis_responses(aircraft(), aircraft(effect), [HOVERS])
    for axis, answer in found.as_given.items():
        np.testing.assert_allclose(found.extended[axis], factors.get(axis, 1.0) * answer, atol=1e-12)


def test_a_longer_lag_is_in_the_answer():
    slow = aircraft(cs.EffectValue(kind="rotor_lag", target="rotors", value=0.1))
    found = axis_responses(aircraft(), slow, [HOVERS])
    expected = found.t - 0.15 * (1.0 - np.exp(-found.t / 0.15))
    np.testing.assert_allclose(found.extended["roll"], expected, atol=1e-12)


@given(
    sizes=st.lists(st.floats(0.5, 1.5).map(lambda x: round(x, 2)), min_size=4, max_size=4),
    told=st.sets(st.integers(0, 3)),
)
def test_the_view_from_above_has_the_numbers_of_the_sentences_and_no_others(sizes: list[float], told: set[int]) -> None:
    """The records determine every rotor; the number of a rotor is drawn where a sentence has it."""
    names = list(HOVERS.channels)
    moved = [
        ChangedValue(
            parameter=effectiveness(names[k]),
            unit="1",
            given=1.0,
            extended=sizes[k],
            stated_std=0.01,
            identifiable=True,
        )
        for k in sorted(told)
    ]
    document: Any = SimpleNamespace(
        aircraft=aircraft(),
        causes=(),
        contradicted=(),
        moved=moved,
        flight={effectiveness(name): FlightValue(value=0.3, std=0.01, determined=True) for name in names},
        as_given=SimpleNamespace(records=[HOVERS]),
    )
    picture = rotors_from_above(document)
    assert picture is not None
    for k, name in enumerate(names):
        number = f"{100.0 * (sizes[k] - 1.0):+.0f} per cent"
        assert f"{name} {number if k in told else 'as given'}" in picture.alt
