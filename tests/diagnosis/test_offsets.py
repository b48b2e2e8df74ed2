"""Small offsets of instruments, which every instrumentation has: put into the model beforehand, and no cause."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from diagnosis_flights import DEG, NOISE, flights, one_round, rough_file

from casid.diagnosis import diagnose as stages
from casid.diagnosis.evidence.nuisance import demanded_offsets
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics import check as kinematic_stage
from casid.diagnosis.kinematics import kinematics
from casid.model import operators
from casid.model.causes.controls import actuator_lag, effectiveness_change
from casid.model.causes.instruments import sensor_bias, sensor_delay, sensor_lag, vane_position
from casid.records.record import Record
from problems.do328 import do328

SMALL = {"az": -0.03, "p": 0.05 * DEG, "q": -0.04 * DEG, "r": 0.05 * DEG, "ay": 0.02, "theta": 0.12 * DEG}


def with_offsets(records: list[Record], offsets: dict[str, float]) -> list[Record]:
    return [record.with_channels(**{name: record[name] + v for name, v in offsets.items()}) for record in records]


def demanded(records: list[Record]) -> list[Attached]:
    flight = prepare(rough_file(), records)
    return demanded_offsets(fit(flight, [], flight.noise(), extent="settled"))


def test_small_offsets_are_found_with_their_sizes():
    """Those of the rates, which attitudes tell at once; others may stand for each other (a bank angle and ay)."""
    found = {one.effect.target: one for one in demanded(with_offsets(flights(seed=7), SMALL))}
    for rate in ("p", "q", "r"):
        assert abs(found[rate].values["value"] - SMALL[rate]) < 0.15 * abs(SMALL[rate])
    aircraft = rough_file()
    for one in found.values():
        assert one.nuisance and abs(one.values["value"]) < (one.effect.smallest_that_matters(aircraft) or 0.0)


def test_what_matters_is_left_for_the_naming():
    """A bias of q of 1 deg/s; the small ones beside it do not take its place."""
    found = demanded(with_offsets(flights(seed=7), SMALL | {"q": 1.0 * DEG}))
    assert "q" not in {one.effect.target for one in found}
    assert {"p", "r"} <= {one.effect.target for one in found}


def test_instruments_without_offsets_get_none():
    for seed in (8, 9):
        assert demanded(flights(seed=seed)) == []


def late(records: list[Record], seconds: Mapping[str, float]) -> list[Record]:
    """Channels as they were so much before, or after, if negative."""
    return [r.with_channels(**{c: operators.delay(r.t, r[c], tau) for c, tau in seconds.items()}) for r in records]


def skews(records: list[Record]) -> dict[str, float]:
    flight = prepare(do328(), records)
    return {
        one.effect.target: one.values["value"]
        for one in kinematic_stage._leading_skews(flight, kinematics.reconstruct(flight))
    }


QUIET = {name: 0.2 * sigma for name, sigma in NOISE.items()}
ATTITUDES: Mapping[str, float] = {"phi": 0.004, "theta": 0.004}
UNIT: Mapping[str, float] = dict.fromkeys(("p", "q", "r", "ax", "ay", "az"), -0.004)


def test_milliseconds_between_attitudes_and_rates_are_found():
    """Both attitudes 4 ms late, which is one delay; one of them alone; and the inertial unit 4 ms early, which is the
    same but for the air data. What is large enough to matter is left to the search, and no part of it is taken."""
    flown = flights(seed=12, count=4, rate_hz=50.0, noise=QUIET)
    found = skews(late(flown, ATTITUDES))
    assert set(found) == {"attitude"} and np.isclose(found["attitude"], 0.004, atol=0.001)
    found = skews(late(flown, {"theta": 0.004}))
    assert set(found) == {"theta"} and np.isclose(found["theta"], 0.004, atol=0.001)
    assert skews(late(flown, dict.fromkeys(ATTITUDES, 0.012))) == {}
    found = skews(late(flown, UNIT))
    assert set(found) == {"inertial"} and np.isclose(found["inertial"], -0.004, atol=0.001)
    assert skews(flown) == {}
    assert skews([record.without("phi", "theta") for record in late(flown, UNIT)]) == {}


@pytest.mark.slow
def test_milliseconds_are_minor_and_no_displaced_vane(monkeypatch):
    """The inertial unit 4 ms early; left out, a vane stands half a metre off, and more is missing."""
    records = late(flights(seed=12, rate_hz=50.0, noise=QUIET), UNIT)
    found = stages.diagnose(rough_file(), records)
    assert found.verdict == "values wrong"
    assert ("sensor_delay", "inertial") in {(c.kind, c.target) for c in found.minor}
    monkeypatch.setattr(kinematic_stage, "_leading_skews", lambda flight, found: [])
    assert "vane_position" in {c.kind for c in stages.diagnose(rough_file(), records, criteria=one_round()).causes}


@pytest.mark.parametrize(
    "fault",
    [
        Attached(effect=vane_position("beta"), values={"value": 3.0}),
        Attached(effect=vane_position("alpha"), values={"value": 3.0}),
        Attached(effect=sensor_delay("inertial"), values={"value": 0.05}),
        Attached(effect=sensor_lag("phi"), values={"value": 0.08}),
    ],
)
def test_a_fault_of_one_instrument_is_not_taken_for_milliseconds(fault):
    assert skews(flights([fault], seed=13, count=4, rate_hz=50.0)) == {}


def test_offsets_that_a_fault_had_hidden_are_put_in_beside_it():
    """While the surfaces' loss is not in the model nothing is told of them."""
    hidden = [Attached(effect=effectiveness_change("delta_e"), values={"value": -0.5}, onsets={"m1": 7.0, "m2": 9.0})]
    records = with_offsets(flights(hidden, seed=14), {"q": 0.04 * DEG})
    flight = prepare(rough_file(), records)
    blind = fit(flight, [], flight.noise(), extent="settled")
    beside = fit(flight, hidden, flight.noise(), extent="settled")
    assert not demanded_offsets(blind)
    (found,) = demanded_offsets(beside)
    assert found.effect.key == sensor_bias("q").key and found.nuisance
    assert np.isclose(found.values["value"], 0.04 * DEG, rtol=0.2)


@pytest.mark.slow
def test_a_fault_is_named_beside_small_offsets_of_all_instruments():
    """The lag alone, and offsets as minor."""
    hidden = [Attached(effect=actuator_lag("delta_e"), values={"value": 0.15})]
    records = with_offsets(flights(hidden, seed=10, duration_s=30.0), SMALL)
    found = stages.diagnose(rough_file(), records)
    assert found.verdict == "explained" and [c.kind for c in found.causes] == ["actuator_lag"]
    minor = {c.target: c.value for c in found.minor if c.kind == "sensor_bias"}
    assert np.isclose(minor["p"], SMALL["p"], rtol=0.15)


@pytest.mark.slow
def test_a_good_structure_is_enough_beside_small_offsets():
    """In precise records, in which the offsets are many times the noise."""
    records = with_offsets(flights(seed=11, duration_s=30.0, noise={k: 0.3 * s for k, s in NOISE.items()}), SMALL)
    assert stages.diagnose(rough_file(), records).verdict == "values wrong"
