"""Single readings that are no noise. Truth: those that were put in, and the fit of the same flight without them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights, rough_file

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import outliers, without_outliers
from casid.model.causes.controls import actuator_lag, input_delay
from casid.model.causes.instruments import sensor_scale
from casid.records.record import Record

_HIDDEN = (
    Attached(effect=actuator_lag("delta_e"), values={"value": 0.12}),
    Attached(effect=sensor_scale("beta"), values={"value": 0.06}),
)


@cache
def flown() -> tuple[Record, ...]:
    return tuple(flights(_HIDDEN, seed=6, count=3))


def fitted(records: tuple[Record, ...]) -> FlightFit:
    flight = prepare(rough_file(), records)
    return fit(flight, _HIDDEN, flight.noise(), extent="settled")


def with_outliers(share: float, size: float) -> tuple[tuple[Record, ...], np.ndarray]:
    """A share of the readings of every channel off by `size` 1-sigmas; (N, R, channels) which."""
    rng, records, marks = np.random.default_rng(0), [], []
    for one in flown():
        hit = rng.random((len(one), len(NOISE))) < share
        sign = rng.choice([-1.0, 1.0], hit.shape)
        moved = {o: one[o] + size * s * hit[:, i] * sign[:, i] for i, (o, s) in enumerate(NOISE.items())}
        records.append(one.with_channels(**moved))
        marks.append(hit)
    return tuple(records), np.stack(marks, axis=1)


def furthest(found: FlightFit, true: FlightFit) -> float:
    return max(abs(found[one.name] - true[one.name]) / true.std(one.name) for one in _HIDDEN)


def test_noise_alone_shows_none_nor_does_what_a_model_misses() -> None:
    """Nothing is left out, and nothing changes: no efficiency is lost. An elevator that is a sample late makes single
    innovations where it moves."""
    clean = fitted(flown())
    assert without_outliers(clean) is clean
    late = Attached(effect=input_delay("delta_e"), values={"value": 0.04})
    flight = prepare(rough_file(), flights([late], seed=3, count=3))
    missing = fit(flight, [], flight.noise(), extent="settled")
    assert missing.deviance > fit(flight, [late], flight.noise(), extent="settled").deviance + 1000.0
    assert not outliers(missing).any()


@pytest.mark.parametrize("size", [8.0, 50.0, *(pytest.param(one, marks=pytest.mark.slow) for one in (12.0, 20.0))])
def test_one_per_cent_of_outliers_moves_no_size_by_its_interval(size: float) -> None:
    records, put_in = with_outliers(0.01, size)
    found, true = fitted(records), fitted(flown())
    at = outliers(found)
    index = [list(NOISE).index(o) for o in found.model.outputs]
    assert at.sum() > 20 and not np.any(at & ~put_in[..., index])
    left = without_outliers(found)
    assert furthest(left, true) < 1.96
    assert np.sum(left.white**2) / left.readings < np.sum(found.white**2) / found.readings
    assert any("far from all others" in note for record in left.flight.records for note in record.notes)
