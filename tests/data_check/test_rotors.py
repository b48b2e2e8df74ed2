"""Records of multirotors against their file. Truth: Newton and Euler, written out here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import casid as cs

PLACES = {"m1": (0.1, 0.1, 1), "m2": (-0.1, 0.1, -1), "m3": (-0.1, -0.1, 1), "m4": (0.1, -0.1, -1)}
MASS, INERTIA, G, TORQUE = 0.8, (0.005, 0.006, 0.01), 9.80665, 0.02


def aircraft(**more: object) -> cs.Aircraft:
    each = [
        cs.Rotor(name=name, position=(x, y, 0.0), spin=s, thrust=(0.0, 4.0), torque=TORQUE)
        for name, (x, y, s) in PLACES.items()
    ]
    rotors = cs.Rotors(each=tuple(each), relative_uncertainty=0.1, **more)
    inertia = cs.Inertia(Ixx=INERTIA[0], Iyy=INERTIA[1], Izz=INERTIA[2], Ixz=0.0)
    return cs.Aircraft(name="quad", mass=MASS, gravity=G, inertia=inertia, rotors=rotors)


def flight(seed: int, standing: float = 0.0) -> cs.Record:
    """20 s near hover with independent commands; `standing` [s] on the ground at the beginning."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.01)
    hover = MASS * G / 4.0 / 4.0
    force = {}
    for name in PLACES:
        wave = sum(np.sin(rng.uniform(3.0, 12.0) * t + rng.uniform(0.0, 6.0)) for _ in range(4))
        spun = np.clip(0.1 + t / standing, 0.0, 1.0) if standing else 1.0
        force[name] = spun * 4.0 * (hover + 0.02 * hover * wave)
    lifted = (t >= standing).astype(float)
    p_dot = sum(-PLACES[n][1] * f for n, f in force.items()) / INERTIA[0] * lifted
    q_dot = sum(PLACES[n][0] * f for n, f in force.items()) / INERTIA[1] * lifted
    az = np.where(lifted > 0.0, -sum(force.values()) / MASS, -G)
    p, q = (np.cumsum(x) * 0.01 + rng.normal(0.0, 0.005, t.size) for x in (p_dot, q_dot))
    channels = {name: f / 4.0 for name, f in force.items()}
    channels |= {"p": p, "q": q, "r": rng.normal(0.0, 0.005, t.size), "az": az + rng.normal(0.0, 0.05, t.size)}
    return cs.Record(name="hover", t=t, channels=channels)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_record_that_fits_its_file_has_no_fault(seed: int) -> None:
    assert cs.check([flight(seed)], aircraft()).clean


@pytest.mark.parametrize("pair", [("m1", "m2"), ("m1", "m3"), ("m2", "m4")])
def test_interchanged_motors_are_reported(pair: tuple[str, str]) -> None:
    a, b = pair
    record = flight(4)
    wrong = record.with_channels(**{a: record[b], b: record[a]})
    (found,) = cs.check([wrong], aircraft()).findings
    assert (found.kind, set(found.target.split("+"))) == ("data_swap", {a, b})


def test_another_numbering_of_all_motors_is_one_fault() -> None:
    record = flight(5)
    turned = record.with_channels(**{f"m{i}": record[f"m{i % 4 + 1}"] for i in range(1, 5)})
    (found,) = cs.check([turned], aircraft()).findings
    assert (found.kind, len(found.target.split("+"))) == ("data_swap", 4)


def test_a_motor_that_is_not_driven_is_reported() -> None:
    record = flight(6)
    dead = record.with_channels(m3=np.where(record.t > 8.0, 0.0, record["m3"]))
    found = cs.check([dead], aircraft()).findings
    assert any(one.target == "m3" and "motor" in one.sentence for one in found)


def test_the_ground_at_the_beginning_is_told_with_its_time() -> None:
    """Thrust grows evenly from a tenth of the weight at 0 s to all of it at 5.4 s; lift-off at 6 s."""
    (said,) = cs.check([flight(7, standing=6.0)], aircraft()).remarks
    at = float(said.split("up to ")[1].split(" s")[0])
    assert 4.0 < at < 6.5  # from 0.75 of the weight on to the lift-off


@pytest.mark.parametrize("dropped", [0.2, 0.4])
def test_a_payload_that_is_dropped_is_no_ground(dropped: float) -> None:
    """The controller takes the thrust back, so that the specific force follows it as before, with another factor."""
    record = flight(8)
    after = np.where(record.t > 12.0, 1.0 - dropped, 1.0)
    lighter = record.with_channels(**{name: after * record[name] for name in PLACES})
    assert not cs.check([lighter], aircraft()).remarks


def test_a_battery_that_the_file_needs_is_missed() -> None:
    needs = aircraft(voltage=cs.Voltage(reference=4.0))
    found = cs.check([flight(8)], needs).findings
    assert "battery" in {one.target for one in found}
    there = flight(8).with_channels(battery=np.linspace(4.1, 3.9, 2000))
    assert cs.check([there], replace(needs)).clean


def test_acceleration_without_gravity_is_no_other_unit_of_time() -> None:
    """In milliseconds 20 s were a record too short to feel its weight, which says nothing of the time."""
    record = flight(7)
    (found,) = cs.check([record.with_channels(az=record["az"] + G)], aircraft()).findings
    assert (found.kind, found.target, found.handled) == ("data_gravity", "az", "corrected")
