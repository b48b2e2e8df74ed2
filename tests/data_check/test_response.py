"""What surfaces do at once. Truth: the formulas of a rigid body with a plane of symmetry, written out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.data_check.response import answers
from casid.model.dynamics import standard_density
from casid.records.record import check_radians
from problems.every_problem import DEMO

T = np.arange(200) / 50.0
STEPS = {"delta_e": 0.05 * (T > 1.0), "delta_a": 0.1 * (T > 2.0), "delta_r": 0.2 * (T > 3.0)}
NAMES = ("ax", "ay", "az", "pdot", "qdot", "rdot")


@pytest.mark.parametrize("known", ["rho", "altitude", "trim"])
def test_the_immediate_answer_is_that_of_the_derivatives(known: str) -> None:
    """Density is recorded, or that of the standard atmosphere, or that of the trim; a gap of V is bridged."""
    plane = cs.Aircraft.read(DEMO / "aircraft.toml")
    V, z = np.full(len(T), 90.0), np.zeros(len(T))
    V[50:60] = np.nan
    channels = STEPS | dict.fromkeys(NAMES, z) | {"V": V}
    channels |= {"rho": z + 0.9} if known == "rho" else {"altitude": z + 4000.0} if known == "altitude" else {}
    rho = {"rho": 0.9, "altitude": float(standard_density(np.array(4000.0)))}.get(known, plane.trim.get("rho"))
    rho = float(standard_density(np.array(plane.trim["altitude"]))) if rho is None else rho
    found = answers(cs.Record(name="m", t=T, channels=channels), plane)
    qS = 0.5 * rho * 90.0**2 * plane.area

    def moved(coefficient: str) -> np.ndarray:
        return sum((plane.derivatives.get(f"{coefficient}_{s}", 0.0) * x for s, x in STEPS.items()), z)

    L, M, N = (
        qS * length * moved(c)
        for c, length in (
            ("Cl", plane.moment_length_lateral),
            ("Cm", plane.moment_length_pitch),
            ("Cn", plane.moment_length_lateral),
        )
    )
    inertia = plane.inertia
    Ixx, Izz, Ixz = inertia.Ixx, inertia.Izz, inertia.Ixz
    truth = {
        "ax": -qS * moved("CD") / plane.mass,
        "ay": qS * moved("CY") / plane.mass,
        "az": -qS * moved("CL") / plane.mass,
        "pdot": (Izz * L + Ixz * N) / (Ixx * Izz - Ixz**2),
        "qdot": M / inertia.Iyy,
        "rdot": (Ixz * L + Ixx * N) / (Ixx * Izz - Ixz**2),
    }
    assert plane.force_axes == "wind" and np.ptp(truth["pdot"]) > 0.0 and np.ptp(truth["az"]) > 0.0
    for name, values in truth.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-12, err_msg=name)


def test_without_airspeed_nothing_is_known() -> None:
    plane = cs.Aircraft.read(DEMO / "aircraft.toml")
    record = cs.Record(name="m", t=T, channels=STEPS | {"q": 0.0 * T, "qdot": 0.0 * T})
    assert set(answers(record, plane)) == {"qdot"}
    assert not answers(record, replace(plane, trim={}))


@pytest.mark.parametrize("part", [0.1, 0.2])
def test_no_unit_is_corrected_to_values_that_no_aircraft_has(part: float) -> None:
    """The derivatives of the elevator suit a record 57 times as large, of more than a right angle."""
    aircraft, records = cs.Aircraft.read(DEMO / "aircraft.toml"), cs.read_records([DEMO / "m*.csv"])
    of_elevator = {n: v for n, v in aircraft.derivatives.items() if n.endswith("delta_e")}
    off = aircraft.with_derivatives({n: v / part / math.degrees(1.0) for n, v in of_elevator.items()})
    moved = [record.with_channels(delta_e=part * record["delta_e"] - 0.06) for record in records]
    found = cs.check(moved, aircraft=off)
    for record, read in zip(moved, found.records, strict=True):
        check_radians(read)
        assert np.array_equal(read["delta_e"], record["delta_e"])
