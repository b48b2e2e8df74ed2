"""Records that are sampled faster than the motion needs: their averages tell the same, with the same certainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights

from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import view_of
from casid.model.causes.air import wind_shear
from casid.model.causes.controls import actuator_lag
from casid.records.record import Record
from casid.records.thinning import averaged
from problems.do328 import do328

LAG = Attached(effect=actuator_lag("delta_e"), values={"value": 0.12})


def test_averages_keep_a_straight_line_and_white_noise_white() -> None:
    """A line at the mean times has the mean values, and the mean of n white samples has 1/n of their variance."""
    t = 0.01 * np.arange(30_001)
    noise = np.random.default_rng(5).standard_normal(len(t))
    record = averaged(Record(name="m1", t=t, channels={"V": 3.0 + 2.0 * t, "q": noise}), 3)
    assert len(record) == 10_000
    assert record["V"] == pytest.approx(3.0 + 2.0 * record.t, rel=1e-12)
    assert np.var(record["q"]) == pytest.approx(1.0 / 3.0, rel=0.06)  # four standard deviations
    assert abs(record["q"][1:] @ record["q"][:-1]) / (record["q"] @ record["q"]) < 4.0 / np.sqrt(len(record))


def test_a_mean_of_which_a_sample_is_missing_is_missing() -> None:
    values = np.arange(7.0)
    values[3] = np.nan
    record = averaged(Record(name="m1", t=np.arange(7.0), channels={"V": np.ones(7), "q": values}), 2)
    assert record["q"] == pytest.approx([0.5, np.nan, 4.5], nan_ok=True)


@pytest.mark.parametrize("hold", ["linear", "held"])
def test_a_lag_is_as_large_and_as_certain_in_averages(hold: str) -> None:
    """Truth: 0.12 s, from half of it. Inputs that are held over a sample act late in their averages."""
    records = [replace(r, hold=hold) for r in flights([LAG], seed=4, count=2, rate_hz=100.0, hold=hold)]
    begun, lags = replace(LAG, values={"value": 0.06}), []
    for average in (False, True):
        flight = prepare(do328(), records, average=average)
        fitted = fit(flight, [begun], flight.noise(), extent="settled")
        lags.append((flight.every, fitted[LAG.name], fitted.std(LAG.name)))
    (one, _, std_of_all), (every, lag, std) = lags
    assert one == 1 and every > 1
    assert lag == pytest.approx(0.12, abs=4.0 * std)
    assert std < 1.1 * std_of_all


def test_noise_and_error_are_reported_for_samples_as_recorded() -> None:
    """Truth: the noise that was flown. It is all that the right model leaves."""
    flight = prepare(do328(), flights(seed=4, count=2, rate_hz=100.0), average=True)
    found = view_of(fit(flight, [], flight.noise(), extent="settled")).channels
    assert flight.every > 1
    for name in ("V", "q", "phi"):
        assert found[name].noise == pytest.approx(NOISE[name], rel=0.1)
        assert found[name].rms == pytest.approx(NOISE[name], rel=0.15)


def test_a_channel_of_a_slower_rate_is_not_averaged() -> None:
    """Its readings would get the mean of other times."""
    slow = [r.with_channels(V=np.where(np.arange(len(r)) % 4, np.nan, r["V"])) for r in flights(count=2, rate_hz=100.0)]
    assert prepare(do328(), slow, average=True).every == 1


def test_an_event_after_the_end_of_the_records_has_no_slope() -> None:
    flight = prepare(do328(), flights(seed=3, count=1))
    late = Attached(effect=wind_shear("z"), values={"value": -0.3, "duration": 7.0}, onsets={"m1": 1e4})
    fitted = fit(flight, [late], flight.noise(), extent=(1, 0.5))
    own = [i for i, slot in enumerate(fitted.slots) if slot.attached == 0]
    assert own and not fitted.columns[..., own].any()
