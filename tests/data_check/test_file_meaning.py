"""Other meanings of a file. Truth: moments and forces by their definitions, and the file that was flown."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.data_check.file_meaning import FileMeaning, ForceAxes, MomentPoint, StabilityAxes
from casid.model.aircraft import Aircraft
from casid.model.flown_records import flown_records
from casid.records.record import Record
from casid.signals import EXTERNAL_FORCE, FORCE_POINT
from problems.blind.sets import fly_set
from problems.every_problem import DEMO

PLANE = Aircraft.read(DEMO / "aircraft.toml")
RNG = np.random.default_rng(55)
MOTION = {
    name: float(RNG.normal(0.0, 0.1)) for name in ("alpha", "beta", "p", "q", "r", "delta_e", "delta_a", "delta_r")
}


@cache
def demo(*names: str) -> tuple[Record, ...]:
    return tuple(cs.read_record(DEMO / f"{name}.csv") for name in names)


def linear(aircraft: Aircraft, coefficient: str, motion: dict[str, float]) -> float:
    """A coefficient by the derivatives of a file, with rates that are dimensionless already."""
    of_terms = aircraft.terms.get(coefficient, {})
    assert coefficient not in of_terms or coefficient == "CD"
    at = {**motion, "0": 1.0}
    values = (
        (name.partition("_")[2], v) for name, v in aircraft.derivatives.items() if name.startswith(f"{coefficient}_")
    )
    return sum(value * at[variable] for variable, value in values)


def test_moments_about_another_point_are_those_of_the_force_there() -> None:
    ahead = 0.7
    about = MomentPoint(ahead=ahead, chords=ahead / PLANE.moment_length_pitch).corrected(PLANE)
    force = np.array([0.0, linear(PLANE, "CY", MOTION), -linear(PLANE, "CL", MOTION)])
    lengths = np.array([PLANE.moment_length_lateral, PLANE.moment_length_pitch, PLANE.moment_length_lateral])
    more = np.cross([ahead, 0.0, 0.0], force) / lengths
    for name, by in zip(("Cl", "Cm", "Cn"), more, strict=True):
        assert linear(about, name, MOTION) - linear(PLANE, name, MOTION) == pytest.approx(by, abs=1e-12)


def test_stability_axes_are_turned_about_y() -> None:
    """Moments in body axes of the motion are those of the file in its axes, of the motion as it is there."""
    alpha = 0.2
    turn = np.array([[np.cos(alpha), np.sin(alpha)], [-np.sin(alpha), np.cos(alpha)]])  # body to stability
    seen = {**MOTION, **dict(zip("pr", turn @ [MOTION["p"], MOTION["r"]], strict=True))}
    there = np.array([linear(PLANE, "Cl", seen), linear(PLANE, "Cn", seen)])
    meant = StabilityAxes(alpha=alpha).corrected(PLANE)
    assert [linear(meant, "Cl", MOTION), linear(meant, "Cn", MOTION)] == pytest.approx(turn.T @ there, abs=1e-12)


def test_forces_along_other_axes_point_the_other_way() -> None:
    turned = ForceAxes(stated="wind").corrected(PLANE)
    assert turned.force_axes == "body" and turned.derivatives["CZ_alpha"] == -PLANE.derivatives["CL_alpha"]
    assert turned.terms["CX"]["alpha^2"] == -PLANE.terms["CD"]["alpha^2"]
    back = ForceAxes(stated="body").corrected(turned)
    assert (back.derivatives, back.terms, back.force_axes) == (PLANE.derivatives, PLANE.terms, "wind")


def wrongly(meaning: FileMeaning, aircraft: Aircraft) -> Aircraft:
    """The file as somebody would write it who means it so."""
    return meaning.corrected(aircraft)


def test_a_point_of_moments_is_told_as_one_reference() -> None:
    """The file of the example about a point 1 m behind its c.g.: not three derivatives, and not in its own file."""
    records = demo("m1", "m2", "m3")
    assert not cs.check(records, PLANE).doubts
    chords = 1.0 / PLANE.moment_length_pitch
    (found,) = cs.check(records, wrongly(MomentPoint(ahead=1.0, chords=chords), PLANE)).doubts
    assert found.parameter == "moment_reference" and "behind the centre of gravity" in found.sentence


@pytest.mark.parametrize("case", ["clean-1", "clean-2"])
def test_forces_along_other_axes_are_told(case: str) -> None:
    flight = fly_set("do328", case, 3101)
    assert not cs.check(flight.records, flight.aircraft).doubts
    (found,) = cs.check(flight.records, wrongly(ForceAxes(stated="wind"), flight.aircraft)).doubts
    assert found.parameter == "force derivatives"


@pytest.mark.parametrize("raw", ["", ".raw"])
def test_force_axes_are_not_told_where_neither_explains_the_force(known_faults_data: Path, raw: str) -> None:
    """Lateral manoeuvres, in which the force along x hardly follows the angle of attack: the file is right."""
    records = [cs.read_record(known_faults_data / f"totter_f1_{flight}{raw}.csv") for flight in ("017", "014")]
    assert not cs.check(records, known_faults_data / "totter_f1_017.toml").doubts


def test_stability_axes_are_told_at_an_angle_of_attack() -> None:
    """The example's motion seen by a unit that is pitched by 10 deg: there the file is one in stability axes."""
    alpha = float(np.radians(10.0))
    pitch = np.array([[np.cos(alpha), 0.0, np.sin(alpha)], [0.0, 1.0, 0.0], [-np.sin(alpha), 0.0, np.cos(alpha)]])
    inertia = pitch.T @ PLANE.inertia.tensor @ pitch
    turned = replace(PLANE.inertia, Ixx=float(inertia[0, 0]), Izz=float(inertia[2, 2]), Ixz=float(-inertia[0, 2]))
    meant = StabilityAxes(alpha=alpha).corrected(PLANE)
    seen = [_pitched(record, pitch.T, alpha) for record in demo("m1", "m2", "m3")]
    trim = {key: value for key, value in PLANE.trim.items() if key in ("V", "rho")}
    plane = replace(PLANE, inertia=turned, trim=trim, thrust_line_z=0.0)
    lift = {"CL_0": PLANE.derivatives["CL_0"] - alpha * PLANE.derivatives["CL_alpha"]}
    right = replace(plane, derivatives={**meant.derivatives, **lift, "Cm_0": -alpha * PLANE.derivatives["Cm_alpha"]})
    assert not cs.check(seen, right).doubts
    given = {n: PLANE.derivatives.get(n, 0.0) for n in right.derivatives if n.startswith(("Cl_", "Cn_"))}
    doubts = cs.check(seen, replace(right, derivatives={**right.derivatives, **given})).doubts
    assert [one.parameter for one in doubts] == ["lateral derivatives"]


def _pitched(record: Record, turn: np.ndarray, alpha: float) -> Record:
    """The record in body axes that are pitched up by alpha; thrust goes along, so that forces are not all right."""
    changed = {"alpha": record["alpha"] + alpha, "theta": record["theta"] + alpha}
    for triad in (("p", "q", "r"), ("ax", "ay", "az"), ("pdot", "qdot", "rdot")):
        changed |= dict(zip(triad, turn @ [record[name] for name in triad], strict=True))
    return record.with_channels(**changed)


def test_a_sign_of_the_file_that_the_motion_contradicts_is_said() -> None:
    """Pitching moment, weathercock and roll damping of the other sign, each alone, in three records and in one."""
    for records in (demo("m1", "m2", "m3"), demo("m1")):
        for name in ("Cm_alpha", "Cn_beta", "Cl_p"):
            found = cs.check(records, PLANE.with_derivatives({name: -PLANE.derivatives[name]}))
            assert [one for one in found.remarks if one.startswith(f"{name} is ")] == list(found.remarks) != []


def test_a_recorded_external_force_is_no_force_of_the_air() -> None:
    """A flight under a tether 2 m below the c.g., which pulls with a part of the weight: well where the record states
    the force, and something else is blamed where it does not."""
    (record,) = demo("m1")
    pull = 0.25 * PLANE.gravity * PLANE.mass * np.outer([0.3, 0.5, 1.0], 1.0 + np.sin(0.9 * record.t))
    columns = dict(zip(EXTERNAL_FORCE, pull, strict=True)) | {"force_at_z": np.full(len(record), 2.0)}
    applied = flown_records(PLANE, [record.with_channels(**columns)], "full")
    model, ready = applied.model, applied.records[0]
    flown = cs.simulate(model, ready, model.guess(ready)[0]).as_record()
    noise = np.random.default_rng(3)
    seen = ready.with_channels(
        **{name: flown[name] + 1e-4 * noise.standard_normal(len(flown)) for name in model.outputs if name in record}
    )
    assert cs.check(seen, PLANE).clean, cs.check(seen, PLANE)
    assert not cs.check(seen.without(*EXTERNAL_FORCE, *FORCE_POINT), PLANE).clean
