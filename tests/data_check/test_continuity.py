"""The course of time in records. Truth: the second that was cut out, and the two that were put in."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.data_check.continuity import discontinuities
from problems.blind.sets import fly_set


@pytest.fixture(scope="module")
def record() -> cs.Record:
    """A manoeuvre of the Do 328 about all axes."""
    return fly_set("do328", "clean-1", 1).records[0]


def of_samples(record: cs.Record, samples: np.ndarray) -> cs.Record:
    """Return a record of some samples of another, with a time of its own that has no gap."""
    channels = {name: values[samples] for name, values in record.channels.items()}
    return cs.Record(name="cut", t=record.dt * np.arange(len(samples)), channels=channels)


def quick_at(record: cs.Record) -> int:
    """The sample at which the aircraft rolls most."""
    return int(np.argmax(np.abs(record["p"])))


def test_a_record_without_a_fault_has_none(record: cs.Record):
    assert not discontinuities([record])


def test_a_second_that_was_cut_out_is_told_with_its_time(record: cs.Record):
    second = round(1.0 / record.dt)
    at = quick_at(record)
    kept = np.r_[0:at, at + second : len(record)]
    (found,) = discontinuities([of_samples(record, kept)])
    ((told, _),) = found.intervals_s["cut"]
    assert told == pytest.approx(at * record.dt, abs=1.5 * record.dt) and found.handled == "reported"
    checked = cs.check([of_samples(record, kept)])
    assert ("data_dropout", "t") in {(one.kind, one.target) for one in checked.findings}


def test_a_stretch_that_occurs_twice_is_told(record: cs.Record):
    twice = round(2.0 / record.dt)
    at = quick_at(record)
    (found,) = discontinuities([of_samples(record, np.r_[0 : at + twice, at : len(record)])])
    assert "twice" in found.sentence


def test_a_position_that_a_filter_corrects_is_no_time_that_is_missing(record: cs.Record):
    step = np.where(np.arange(len(record)) < quick_at(record), 0.0, 3.0)
    moved = record.with_channels(**{name: step + 0.0 * record.t for name in ("north", "east", "altitude")})
    assert not discontinuities([moved])


def test_time_that_is_trusted_as_recorded_is_not_judged(record: cs.Record):
    cut = of_samples(record, np.r_[0 : quick_at(record), quick_at(record) + round(1.0 / record.dt) : len(record)])
    assert not [one for one in cs.check([cut], undo=["t"]).findings if one.target == "t"]
