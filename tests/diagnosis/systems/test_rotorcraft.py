"""The noise of an aircraft with rotors, sought where covariances are no more than rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.rotorcraft import before_vertical, most_likely_noise, rotorcraft
from casid.diagnosis.flight.subject import Subject
from casid.filtering.innovations import NoiseModel, PointFunctions, linearise, make_batch
from casid.filtering.kalman import kalman_filter

G, HOVER = 9.80665, 0.6
Hovering = tuple[Subject, cs.Model]


@pytest.fixture(scope="module")
def hovering() -> Hovering:
    """Three seconds of a quadrotor that rests in the air, read with noise."""
    rng, t = np.random.default_rng(1), np.arange(0.0, 3.0, 0.02)
    corners = [(1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1)]
    each = [
        cs.Rotor(name=f"m{i}", position=(0.1 * x, 0.1 * y, 0.0), spin=float(spin), thrust=(0.0, G / HOVER), torque=0.02)
        for i, (x, y, spin) in enumerate(corners, start=1)
    ]
    inertia = cs.Inertia(Ixx=0.02, Iyy=0.02, Izz=0.04, Ixz=0.0)
    aircraft = cs.Aircraft(name="quad", mass=4.0, inertia=inertia, rotors=cs.Rotors(each=each))
    still = {"p": 0.0, "q": 0.0, "r": 0.0, "phi": 0.0, "theta": 0.0, "psi": 0.0, "az": -G, "v_down": 0.0}
    channels = {name: value + rng.normal(0.0, 0.01, len(t)) for name, value in still.items()}
    channels |= {one.name: HOVER + rng.normal(0.0, 0.002, len(t)) for one in each}
    record = cs.Record.from_arrays(name="hover", t=t, channels=channels, units=dict.fromkeys("pqr", "rad/s"))
    return rotorcraft(aircraft, [record], Criteria())


def has_density(hovering: Hovering, noise: NoiseModel) -> bool:
    """Whether the innovations have one along the motion as read."""
    subject, model = hovering
    (record,) = subject.records
    P, X = model.nominal_vector()[None], model.guess(record)[:, None]
    try:
        kalman_filter(linearise(PointFunctions(model, ()), make_batch(model, [record]), P, X), noise)
    except np.linalg.LinAlgError:
        return False
    return True


def test_no_noise_from_which_the_search_begins_ends_it(hovering: Hovering):
    """Readings up to 1e14 times as exact as they are, forces from nothing to a million times the weight: most begin
    without a density, and what is found has one wherever the beginning has."""
    subject, model = hovering
    rng, usual, ill = np.random.default_rng(2), subject.noise(), 0
    numerics = subject.criteria.numerics
    few = replace(numerics, naming=replace(numerics.naming, trials=1))
    criteria = replace(subject.criteria, numerics=few)
    for _ in range(12):
        drawn = {
            part: {name: value * 10.0 ** rng.uniform(*decades) for name, value in table.items()}
            for part, table, decades in (
                ("measurement", usual.measurement, (-14.0, 0.0)),
                ("white", usual.white, (-12.0, 6.0)),
                ("inputs", usual.inputs, (-6.0, 6.0)),
            )
        }
        start = replace(usual, **drawn)
        found = most_likely_noise(model, subject.records, subject.freed, start, criteria)
        sizes = [*found.measurement.values(), *found.white.values(), *found.inputs.values()]
        assert np.isfinite(sizes).all() and min(sizes) > 0.0
        begun = has_density(hovering, start)
        assert has_density(hovering, found) or not begun
        ill += not begun
    assert 0 < ill < 12  # the draw has both


@pytest.mark.parametrize("measured", [("theta", "q"), ("theta",), ("phi",)])
def test_a_record_ends_where_the_nose_passes_the_vertical(measured: tuple[str, ...]):
    """A pitch rate of 0.5 rad/s from level: vertical after pi s, by the attitude with or without the rate."""
    t = np.arange(0.0, 4.0, 0.01)
    all_of_it = {"theta": 0.5 * t, "q": np.full(len(t), 0.5), "phi": 0.5 * t}
    channels = {name: all_of_it[name] for name in measured}
    record = cs.Record.from_arrays(name="loop", t=t, channels=channels)
    kept, left = before_vertical(record, 0.02)
    if "theta" in measured:
        assert kept.t[-1] == pytest.approx(np.pi - 0.02, abs=0.02)
        assert [one.what for one in left] == ["loop from 3.1 s on"]
    else:
        assert kept is record and not left
