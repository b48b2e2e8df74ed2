"""Thrust that is recorded wrong, or not at all. Truth: the balance of steady level flight, and what was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.data_check.criteria import DataCriteria
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.given.contradicted import FlightValue, contradicted
from casid.diagnosis.given.scope import or_thrust, with_thrust
from casid.records.record import Record
from problems.do328 import THRUST, do328
from problems.faults.fault import DataFault, with_fault


def level(thrust: float | np.ndarray) -> Record:
    t = np.arange(0.0, 10.0, 0.1)
    given = {"V": 100.0, "rho": 1.0, "thrust": thrust}
    return Record(name="m1", t=t, channels={name: value * np.ones(len(t)) for name, value in given.items()})


def drag_off(records: list[Record], true: float) -> str:
    """The sentence on CD_0, by the thrust [N] that flew with q = 5000 Pa."""
    aircraft = do328()
    recorded = float(np.mean(records[0]["thrust"]))
    flight = aircraft.derivatives["CD_0"] - (true - recorded) / (5000.0 * aircraft.area)
    values = {"CD_0": FlightValue(value=flight, std=1e-4, determined=True)}
    (one,) = contradicted(aircraft, values)
    return or_thrust(aircraft, one, records, DataCriteria()).sentence


@pytest.mark.parametrize(("true", "said"), [(10000.0, "20 % too low"), (8000.0 / 1.5, "50 % too high")])
def test_a_level_of_drag_has_the_scale_of_a_steady_thrust_as_its_alternative(true: float, said: str) -> None:
    """T = CD q S: thrust that is recorded 20 % low leaves so much less drag."""
    assert f"the recorded thrust is {said}" in drag_off([level(8000.0)], true)


def test_thrust_that_moves_is_told_from_drag_by_its_motion() -> None:
    assert "thrust" not in drag_off([level(np.linspace(6000.0, 10000.0, 100))], 10000.0)


NODES = Criteria().numerics.missing_input.times[0]


@pytest.mark.parametrize("trimmed", [True, False])
def test_a_thrust_that_was_not_recorded_is_a_history_where_it_moves(trimmed: bool) -> None:
    """The Do 328 of its true file: the thrust that flew, in steps of 2 kN, comes back but for the
    edges of the steps, which are sharper than the nodes; drag is not judged beside it."""
    aircraft = replace(do328(), trim={**do328().trim, "thrust": 1e4} if trimmed else {})
    (flown,) = flights(seed=5, count=1)
    throttled = flown.with_channels(throttle=flown["thrust"] / 2e4)
    found = with_thrust(aircraft, [throttled.without("thrust")], "longitudinal", NODES)
    error = found.records[0]["thrust"] - flown["thrust"]
    assert np.std(error) < 0.3 * np.std(flown["thrust"]) and abs(np.mean(error)) < 0.05 * THRUST
    assert found.unknown == ("thrust", "CD")
    assert [one.what for one in found.lost] == ["thrust, its line, and drag"]
    assert with_thrust(aircraft, [throttled], "longitudinal", NODES).unknown == ()


def test_a_thrust_of_the_trim_stands_where_the_throttle_rests() -> None:
    aircraft = replace(do328(), trim={**do328().trim, "thrust": 1e4})
    (flown,) = flights(seed=5, count=1, duration_s=10.0)
    resting = flown.without("thrust").with_channels(throttle=np.full(len(flown), 0.5))
    found = with_thrust(aircraft, [resting], "longitudinal", NODES)
    assert "thrust" not in found.records[0] and found.lost == () and found.unknown == ()


@pytest.mark.slow
@pytest.mark.parametrize("late", [-0.08, 0.08])
def test_all_surfaces_early_or_late_are_one_finding(late: float) -> None:
    """Of a true file. What acts is 80 ms behind, or ahead of, the record of every surface."""
    names = ("m1", "m2", "m3")
    fault = DataFault(kind="sensor_delay", target="surfaces", records=names, value=late)
    found = diagnose(do328(), with_fault(fault, flights(seed=5), 5))
    assert [(c.kind, c.target) for c in found.causes] == [("sensor_delay", "surfaces")], str(found)
    assert found.causes[0].value == pytest.approx(late, abs=0.01)


@pytest.mark.slow
def test_thrust_that_is_recorded_low_is_named_where_it_moves() -> None:
    """Of a true file: 20 % low, which a mass does that is a fifth less where all forces are a fifth less."""
    low = [one.with_channels(thrust=0.8 * one["thrust"]) for one in flights(seed=5)]
    (cause,) = diagnose(do328(), low).causes
    assert "thrust_scale" in {cause.kind, *(one["kind"] for one in cause.indistinguishable_from)}
