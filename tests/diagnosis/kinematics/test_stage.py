"""Whether the noise is as it was read is for kinematics to say, which no aerodynamics can mislead."""

from __future__ import annotations

import pytest
from diagnosis_flights import flights, one_round

import casid as cs
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import is_far, with_noise_level
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.given.scope import scope_of
from casid.diagnosis.kinematics.check import comes_near
from casid.model.aircraft import Aircraft
from casid.model.causes.instruments import sensor_delay
from casid.model.causes.recording import clock_drift
from casid.model.effect import Effect
from casid.records.record import Record
from problems.do328 import do328
from problems.faults.flights import real_flight

LATE = Attached(effect=sensor_delay("inertial"), values={"value": 0.3})


def as_read(aircraft: Aircraft, records: list[Record]) -> Subject:
    scope = scope_of(aircraft, (records, records), Criteria(), None)
    return with_noise_level(scope.flight, ())


def test_a_fault_that_is_far_from_the_data_leaves_the_noise_as_read() -> None:
    """An inertial unit 0.3 s late is 250 squares a reading from the data. Noise that was estimated from what the model
    left there hid it: a lag was named in its place, and two scale errors."""
    flight = as_read(do328(), flights([LATE], seed=4))
    calm = fit(flight, (), flight.noise(), extent="settled")
    assert is_far(calm, flight.criteria.parts.tenfold**2)
    assert comes_near(flight, ())


def test_noise_that_the_records_hide_is_not_as_read(flight_data) -> None:
    """A Tu-144, whose channels were filtered before they were sampled: kinematics stay as far from it, and so its noise
    is not what the high band shows."""
    flight = real_flight("tu144 4d", flight_data.parent)
    flown = as_read(flight.aircraft, list(flight.records))
    calm = fit(flown, (), flown.noise(), extent="settled")
    assert is_far(calm, flown.criteria.parts.tenfold**2)
    assert not comes_near(flown, ())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "size"),
    [(sensor_delay("inertial"), 0.16), (clock_drift("attitude"), -0.01), (clock_drift("surfaces"), -0.01)],
)
def test_timing_faults_far_from_the_data_are_named(hidden: Effect, size: float) -> None:
    """Truth: the one that was flown, of its size. Clocks that lose were never looked for."""
    records = flights([Attached(effect=hidden, values={"value": size})], seed=4, count=4)
    found = cs.diagnose(do328(), records, criteria=one_round())
    (cause,) = found.causes
    assert (cause.kind, cause.target) == (hidden.kind, hidden.target)
    assert abs(cause.value - size) < 3.0 * cause.std + 0.01 * abs(size)
