"""How inputs run between samples: found where surfaces agree, left alone where one of them is late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import flights, one_round, rough_file

from casid.diagnosis import diagnose as stages
from casid.diagnosis.engine import baseline, search
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_inputs_run, held_share
from casid.filtering.innovations import Batch
from casid.model.causes.controls import actuator_lag, input_delay
from casid.model.causes.instruments import sensor_delay
from casid.records.record import Record

SURFACES = ("delta_e", "delta_a", "delta_r")


def fitted(records: list[Record]) -> FlightFit:
    """The baseline of records that say nothing of how their inputs run."""
    flight = prepare(rough_file(), records)
    return fit(flight, [], flight.noise(), extent="settled")


def every_second(record: Record) -> Record:
    return replace(record, t=record.t[::2], channels={name: y[::2] for name, y in record.channels.items()})


def led(record: Record) -> Record:
    """The inputs one sample later: what acts over an interval stands at its end, as in a log written after a step."""
    later = {name: np.concatenate([record[name][:1], record[name][:-1]]) for name in (*SURFACES, "thrust")}
    return record.with_channels(**later)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, -1.0])
def test_the_share_that_was_flown_is_found(share):
    """Held from sample to sample; held at twice the rate of the records; as in a log written after the step."""
    if share == 0.5:
        records = [every_second(record) for record in flights(seed=3, rate_hz=50.0, hold="held")]
    else:
        records = flights(seed=3, hold="held" if share else "linear")
        records = [led(record) for record in records] if share < 0.0 else records
    begun = fitted(records)
    moved = as_inputs_run(begun)
    assert held_share(begun) == moved.flight.held == share
    assert held_share(moved) == share  # and stays there
    assert moved is begun if share == 0.0 else moved.deviance < begun.deviance - 1000.0
    notes = [note for record in moved.flight.records for note in record.notes if note.startswith("inputs")]
    assert len(notes) == (3 if share else 0)


@pytest.mark.parametrize("axes", ["full", "longitudinal"])
def test_a_hold_from_one_recorded_sample_to_the_next_is_found_in_averages(axes: str) -> None:
    """By all surfaces, and by the elevator alone."""
    records = flights(seed=3, count=2, rate_hz=100.0, hold="held")
    flight = prepare(rough_file(), records, axes=axes, average=True)
    assert flight.every > 1
    assert held_share(fit(flight, [], flight.noise(), extent="settled")) == 1.0


@pytest.mark.parametrize(
    "late",
    [
        [Attached(effect=actuator_lag("delta_e"), values={"value": 0.04})],
        [Attached(effect=input_delay("delta_a"), values={"value": 0.03})],
        [Attached(effect=input_delay(one), values={"value": 0.1}) for one in SURFACES],
        [Attached(effect=sensor_delay("inertial"), values={"value": 0.1})],
    ],
)
def test_what_is_late_for_another_reason_is_no_hold(late):
    """One surface alone, and all of them by more than a sample of 0.04 s."""
    assert held_share(fitted(flights(late, seed=4))) == 0.0


def test_a_late_elevator_does_not_hide_that_inputs_are_held():
    late = [Attached(effect=actuator_lag("delta_e"), values={"value": 0.15})]
    assert held_share(fitted(flights(late, seed=5, hold="held"))) == 1.0


@pytest.mark.slow
def test_held_inputs_are_no_fault_and_hide_none(monkeypatch):
    """The lag is named and explains all; taken as linear, more seems to be missing, and the lag is too long."""
    late = [Attached(effect=actuator_lag("delta_e"), values={"value": 0.15})]
    records = flights(late, seed=6, hold="held", count=2)
    found = stages.diagnose(rough_file(), records, criteria=one_round())
    assert found.verdict == "explained"
    assert [(c.kind, c.target) for c in found.causes] == [("actuator_lag", "delta_e")]
    assert abs(found.causes[0].value - 0.15) < 3.0 * found.causes[0].std
    for module in (baseline, search):
        monkeypatch.setattr(module, "as_inputs_run", lambda fit, named=False: fit)
    without = stages.diagnose(rough_file(), records, criteria=one_round())
    assert without.verdict == "partly explained"
    assert abs(without.causes[0].value - 0.15) > 0.03


def test_ends_of_an_interval():
    series = np.array([[[0.0]], [[2.0]], [[6.0]]])
    for share, ends in [
        (0.0, (0, 2, 2, 6)),
        (1.0, (0, 0, 2, 2)),
        (-1.0, (2, 2, 6, 6)),
        (0.5, (0, 1, 2, 4)),
        (-0.5, (1, 2, 4, 6)),
    ]:
        given = dict.fromkeys(("t", "dt", "U", "Z", "live"), series)
        first, last = Batch(names=("m1",), held=np.array([share]), **given).ends(series)
        assert np.stack([first, last], axis=1).ravel().tolist() == list(ends)


@pytest.mark.parametrize("late_s", [0.008, 0.015])
def test_an_inertial_unit_that_is_late_leaves_the_inputs_as_they_stand(late_s: float) -> None:
    """All surfaces seem to act late by as much, which a hold of the inputs would explain; but attitude and air
    data are in time."""
    late = Attached(effect=sensor_delay("inertial"), values={"value": late_s})
    begun = fitted(flights([late], seed=4))
    assert held_share(begun) > 0.0
    assert as_inputs_run(begun) is begun
