"""Small offsets of instruments, which every instrumentation has: put into the model beforehand, and no cause."""

from __future__ import annotations

import numpy as np
from diagnosis_flights import DEG, NOISE, flights, rough_file

from casid.diagnosis import diagnose as stages
from casid.diagnosis import naming
from casid.diagnosis.fit import fit
from casid.diagnosis.flight import prepare
from casid.diagnosis.hypothesis import Attached
from casid.diagnosis.structure import demanded_offsets
from casid.model.causes import actuator_lag
from casid.records.record import Record

SMALL = {"az": -0.03, "p": 0.05 * DEG, "q": -0.04 * DEG, "r": 0.05 * DEG, "ay": 0.02, "theta": 0.12 * DEG}


def with_offsets(records: list[Record], offsets: dict[str, float]) -> list[Record]:
    return [record.with_channels(**{name: record[name] + v for name, v in offsets.items()}) for record in records]


def demanded(records: list[Record]) -> list[Attached]:
    flight = prepare(rough_file(), records)
    return demanded_offsets(fit(flight, [], flight.noise(), iterations=20))


def test_small_offsets_are_found_with_their_sizes():
    """Those of the rates, which attitudes tell at once; others may stand for each other (a bank angle and ay)."""
    found = {one.effect.target: one for one in demanded(with_offsets(flights(seed=7), SMALL))}
    for rate in ("p", "q", "r"):
        assert abs(found[rate].values["value"] - SMALL[rate]) < 0.15 * abs(SMALL[rate])
    aircraft = rough_file()
    for one in found.values():
        assert one.slight and abs(one.values["value"]) < one.effect.smallest_that_matters(aircraft)


def test_what_matters_is_left_for_the_naming():
    """A bias of q of 1 deg/s; the small ones beside it do not take its place."""
    found = demanded(with_offsets(flights(seed=7), SMALL | {"q": 1.0 * DEG}))
    assert "q" not in {one.effect.target for one in found}
    assert {"p", "r"} <= {one.effect.target for one in found}


def test_instruments_without_offsets_get_none():
    for seed in (8, 9):
        assert demanded(flights(seed=seed)) == []


def test_a_fault_is_named_beside_small_offsets_of_all_instruments():
    """The lag alone, and offsets as minor."""
    hidden = [Attached(effect=actuator_lag("delta_e"), values={"value": 0.15})]
    records = with_offsets(flights(hidden, seed=10, count=4, duration_s=30.0), SMALL)
    found = stages.diagnose(rough_file(), records)
    assert found.verdict == "explained" and [c.kind for c in found.causes] == ["actuator_lag"]
    minor = {c.target: c.value for c in found.minor if c.kind == "sensor_bias"}
    assert np.isclose(minor["p"], SMALL["p"], rtol=0.15)


def test_a_good_model_is_adequate_beside_small_offsets(monkeypatch):
    """In precise records; without the offsets in the model something seems to be missing."""
    records = with_offsets(
        flights(seed=11, count=4, duration_s=30.0, noise={k: 0.3 * s for k, s in NOISE.items()}), SMALL
    )
    assert stages.diagnose(rough_file(), records).verdict == "adequate"
    for stage in (stages, naming):
        monkeypatch.setattr(stage, "demanded_offsets", lambda base: [])
    assert stages.diagnose(rough_file(), records).verdict == "unexplained"
