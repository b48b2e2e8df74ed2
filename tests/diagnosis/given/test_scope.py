"""What the records cannot tell of is said and not judged. Truth: which channels were taken away, what stood still."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import one_round
from small_flight import aircraft_file, records

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.given.scope import axes_that_tell, left_open, scope_of
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.records.record import Record
from problems.do328 import THRUST

LATERAL = ("CY", "Cl", "Cn")


def without(*channels: str) -> list[Record]:
    return [record.without(*(c for c in channels if c in record)) for record in records()]


def lost(found: Diagnosis) -> dict[str, str]:
    return {one.what: one.because for one in found.not_judged}


def lost_in(given: list[Record]) -> dict[str, str]:
    return {one.what: one.because for one in left_open(prepare(aircraft_file(), given), given, {})}


def test_without_an_elevator_longitudinal_motion_is_not_judged() -> None:
    """The flights hide a term of the pitching moment: without delta_e nothing of it may be named."""
    found = diagnose(aircraft_file(), without("delta_e"))
    assert lost(found)["longitudinal motion"] == "no channel delta_e"
    assert found.verdict == "adequate" and "Not judged: longitudinal motion (no channel delta_e)" in found.sentence
    assert {name[:2] for name in found.refitted.fit.derivatives} == set(LATERAL)
    assert not {c.target for c in (*found.causes, *found.minor)} & {"Cm", "CL", "CD", "delta_e"}
    document = found.to_dict()
    assert {"what": "longitudinal motion", "because": "no channel delta_e"} in document["not_judged"]


def test_longitudinal_axes_find_what_is_longitudinal() -> None:
    found = diagnose(aircraft_file(), records(), axes="longitudinal")
    assert lost(found)["lateral motion"] == "longitudinal axes were asked for"
    assert not {name[:2] for name in found.refitted.fit.derivatives} & set(LATERAL)
    assert [(c.kind, c.target, c.term) for c in found.causes] == [("aero_term", "Cm", "alpha^2")]


def test_a_channel_that_is_read_too_rarely_is_not_said_to_stand_still() -> None:
    """A heading that turns, read twice in a record; and one that does not turn."""
    turning, still = [
        [r.with_channels(psi=np.where(np.arange(len(r)) % (len(r) - 1), np.nan, turns * r.t)) for r in records()]
        for turns in (0.1, 0.0)
    ]
    said = [lost_in(given)["the instruments of psi"] for given in (turning, still)]
    assert said[0] != said[1] and "move" in said[1]


def test_axes_that_there_are_not_are_an_error() -> None:
    with pytest.raises(InputError, match="unknown axes 'roll'"):
        diagnose(aircraft_file(), records(), axes="roll")


def small(record: Record, names: tuple[str, ...], factor: float) -> Record:
    moved = {n: np.median(record[n]) + factor * (record[n] - np.median(record[n])) for n in names}
    return record.with_channels(**moved)


@pytest.mark.parametrize(
    ("names", "axes", "lost"),
    [
        (("delta_e", "alpha"), "lateral", ["longitudinal motion"]),
        (("delta_a", "delta_r", "beta"), "longitudinal", ["lateral motion"]),
        ((), "full", []),
    ],
)
def test_axes_whose_surfaces_and_flow_angle_hardly_move_are_left_out(names, axes, lost) -> None:
    quiet = [small(record, names, 0.1) for record in records()]
    found = axes_that_tell(quiet)
    assert (found.name, [one.what for one in found.not_judged]) == (axes, lost)
    assert axes_that_tell(quiet, "full").not_judged == ()


def test_axes_that_were_asked_for_and_rest_are_said_to() -> None:
    """They are judged, for that was asked; that couplings with the other axes make as much of their motion is said."""
    quiet = [small(record, ("delta_e", "alpha"), 0.1) for record in records()]
    found = axes_that_tell(quiet, "longitudinal")
    assert [one.what for one in found.not_judged] == ["lateral motion", "what moves the longitudinal motion"]
    assert found.not_judged[1].because.endswith("of what the lateral ones do: small couplings make as much of it")
    assert [one.what for one in axes_that_tell(records(), "longitudinal").not_judged] == ["lateral motion"]


@pytest.mark.parametrize(
    ("names", "lacks", "axes"),
    [(("delta_e", "alpha", "q"), "alpha", "lateral"), (("delta_a", "delta_r", "p", "r"), "beta", "longitudinal")],
)
def test_without_a_flow_angle_rates_tell_what_hardly_moves(names: tuple[str, ...], lacks: str, axes: str) -> None:
    quiet = [small(record, names, 0.05).without(lacks) for record in records()]
    found = axes_that_tell(quiet)
    assert found.name == axes and names[-1] in found.not_judged[0].because
    assert axes_that_tell([record.without(lacks) for record in records()]).name == "full"


def test_axes_of_which_the_file_has_no_aerodynamics_are_no_part_of_the_simulation() -> None:
    """A longitudinal simulation flown in rough air rolls as much as it pitches; that it lacks CY is no finding."""
    file, axis = aircraft_file(), {True: ("longitudinal", "lateral"), False: ("lateral", "longitudinal")}
    for symmetric, (modelled, absent) in axis.items():
        own = {name: v for name, v in file.derivatives.items() if (name[:2] not in LATERAL) is symmetric}
        found = axes_that_tell(records(), aircraft=replace(file, derivatives=own, terms={}))
        assert (found.name, [one.what for one in found.not_judged]) == (modelled, [f"{absent} motion"])
        assert found.not_judged[0].because.startswith("the aircraft file has nothing of ")
    assert axes_that_tell(records(), aircraft=file).name == "full"


def test_a_surface_that_stands_still_is_not_fitted() -> None:
    still = [r.with_channels(delta_r=np.full(len(r), np.median(r["delta_r"]))) for r in records(rudder=0.0)]
    found = diagnose(aircraft_file(), still, criteria=one_round())
    assert lost(found)["derivatives by delta_r"] == "delta_r stands still"
    assert not [name for name in found.refitted.fit.derivatives if name.endswith("_delta_r")]
    assert not [one for one in found.contradicted if one.parameter.endswith("_delta_r")]


def test_unknown_thrust_is_balanced_by_the_drag_of_the_file_and_nothing_hangs_on_it() -> None:
    """The flights have a constant thrust of 10 kN: the balance finds it but for noise and the hidden term."""
    plain = replace(aircraft_file(), trim={})
    found = scope_of(plain, (without("thrust"), without("thrust")), Criteria(), None)
    assert found.flight.unknown == ("thrust",)
    assert not [e for e in found.flight.effects if e.target == "thrust" or e.kind.startswith("thrust")]
    assert [one.what for one in found.lost] == ["thrust, its line, and the level of drag"]
    for record in found.flight.records:
        assert np.ptp(record["thrust"]) == 0.0
        assert record["thrust"][0] == pytest.approx(THRUST, rel=0.1)
    by_path = scope_of(plain, (without("thrust", "ax"), without("thrust", "ax")), Criteria(), None).flight.records
    assert by_path[0]["thrust"][0] == pytest.approx(THRUST, rel=0.1)


def no_air_data(aircraft: Aircraft) -> Aircraft:
    return replace(aircraft, trim={**aircraft.trim, "V": 144.0})


@pytest.mark.parametrize(
    ("channels", "file", "what", "because"),
    [
        pytest.param(("beta",), lambda a: a, "beta", "no channel beta", marks=pytest.mark.slow),
        (("V", "alpha", "beta"), no_air_data, "moving air along z", "no channel V, alpha, beta"),
        (("ax", "ay", "az"), lambda a: a, "instruments by kinematics alone", "they take ax, ay and az too"),
    ],
)
def test_what_a_missing_channel_costs_is_said(
    channels: tuple[str, ...], file: Callable[[Aircraft], Aircraft], what: str, because: str
) -> None:
    found = diagnose(file(aircraft_file()), without(*channels))
    assert any(what in one and because in why for one, why in lost(found).items()), lost(found)
    read = {c.target for c in (*found.causes, *found.minor) if c.kind.startswith(("sensor", "vane"))}
    assert not read & set(channels)
    assert (found.causes[0].kind, found.causes[0].term) == ("aero_term", "alpha^2")


def test_what_would_have_to_be_implausibly_large_to_show_is_said_to_be_not_judged() -> None:
    """A thrust that never moves is a level of drag, whatever its scale."""
    steady = [r.with_channels(thrust=np.full(len(r), THRUST)) for r in records()]
    beyond = [
        what
        for what, because in lost(diagnose(aircraft_file(), steady, criteria=one_round())).items()
        if because == "not identifiable: the derivatives absorb any plausible size"
    ]
    assert any("thrust scale" in what for what in beyond)


@pytest.mark.slow
def test_the_scale_of_a_thrust_that_moves_is_judged() -> None:
    waves = [r.with_channels(thrust=THRUST * (1.0 + 0.3 * np.sin(0.5 * r.t))) for r in records()]
    moved = lost(diagnose(aircraft_file(), waves, criteria=one_round()))
    assert not any("thrust scale" in what for what in moved)
