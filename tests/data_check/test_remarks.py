"""Remarks of the check. Truth: what was put into the example's records, the standard atmosphere, the true airspeed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.data_check.criteria import DataCriteria
from casid.data_check.remarks import remarks
from casid.model.aircraft import Aircraft
from casid.model.dynamics import standard_density
from casid.records.record import Record
from problems.every_problem import DEMO


def indicated(record: Record) -> Record:
    ratio = np.sqrt(standard_density(record["altitude"]) / standard_density(np.array(0.0)))
    return record.with_channels(V=record["V"] * ratio)


def slower(record: Record) -> Record:
    kept = np.arange(len(record)) < len(record) // 2
    kept[::3] = True
    parts = {name: values[kept] for name, values in record.channels.items()}
    return Record(name=record.name, t=record.t[kept], channels=parts)


CHANGES: dict[str, Callable[[Record], Record]] = {
    "is V indicated": indicated,
    "rho is 1.2": lambda r: r.with_channels(rho=np.full(len(r), 1.225)),
    "sampling rate changes": slower,
    "the thrust is 0.": lambda r: r.with_channels(thrust=0.5 * r["thrust"]),
}


@pytest.mark.parametrize("said", CHANGES)
def test_what_does_not_fit_is_said(said: str) -> None:
    aircraft = Aircraft.read(DEMO / "aircraft.toml")
    records = [cs.read_record(DEMO / f"{name}.csv") for name in ("m1", "m2")]
    assert not remarks(records, aircraft, DataCriteria())
    found = remarks([CHANGES[said](one) for one in records], aircraft, DataCriteria())
    assert found and all(said in one for one in found), found


def test_one_factor_of_the_thrust_is_said_of_every_record_that_has_it() -> None:
    """Half the thrust in three of four records: those are named, and the one that is well is not."""
    aircraft = Aircraft.read(DEMO / "aircraft.toml")
    records = [cs.read_record(DEMO / f"m{i}.csv") for i in (1, 2, 3, 4)]
    (found,) = remarks([*map(CHANGES["the thrust is 0."], records[:3]), records[3]], aircraft, DataCriteria())
    assert found.startswith("m1, m2, m3: the thrust is 0.5")


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 400.0])
def test_a_recorder_that_halves_its_rate_is_told_with_both_rates(rate_hz: float) -> None:
    """Whatever the rate, and whichever half is the slower. One that misses a sample now and then keeps its rate."""
    steps = np.repeat([1.0, 2.0], 120) / rate_hz
    for t in (np.cumsum(steps), np.cumsum(steps[::-1])):
        (found,) = remarks([Record(name="m1", t=t, channels={})], None, DataCriteria())
        assert "m1: the sampling rate changes" in found and {f"{rate_hz:g}", f"{rate_hz / 2:g}"} <= set(found.split())
    steady = np.arange(240) / rate_hz
    assert not remarks([Record(name="m1", t=np.delete(steady, slice(5, None, 9)), channels={})], None, DataCriteria())


@pytest.mark.parametrize("name", ["phi", "beta"])
def test_an_angle_of_zero_was_not_measured(name: str) -> None:
    """It is left out, and nothing else is at fault; a file of data has the same findings as one without the column."""
    aircraft = Aircraft.read(DEMO / "aircraft.toml")
    records = [cs.read_record(DEMO / f"{one}.csv") for one in ("m1", "m2")]
    found = cs.check([one.with_channels(**{name: np.zeros(len(one))}) for one in records], aircraft)
    assert [(one.kind, one.target, one.handled) for one in found.findings] == [("data_stuck", name, "excluded")]
    assert all(name not in one for one in found.records) and not found.remarks


def test_lengths_that_are_exchanged_are_no_unit_of_the_inertia() -> None:
    """Chord and span of the example's file in each other's place; and a metric file whose derivatives are off."""
    aircraft = Aircraft.read(DEMO / "aircraft.toml")
    records = [cs.read_record(DEMO / f"{name}.csv") for name in ("m1", "m2")]
    turned = replace(
        aircraft, moment_length_lateral=aircraft.moment_length_pitch, moment_length_pitch=aircraft.moment_length_lateral
    )
    (found,) = cs.check(records, turned).doubts
    assert found.parameter == "lateral and pitch lengths"
