"""Noise of channels that were filtered, quantised or neither: the density in the band of the motion is what counts.

Truth: noise made here with a known density, added to simulated flights; white noise of 1-sigma s, low-pass filtered
before sampling, keeps its density below the filter's corner. A factor of two covers the octave it is read from, the
filter's own droop and the noise that recorded surfaces bring into the simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import NOISE, SURFACE_NOISE, flights
from scipy import signal

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare, with_noise_above
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import in_colour, level_of, unread, with_noise_level
from casid.diagnosis.flight.subject import Subject
from casid.model.causes.controls import actuator_lag
from casid.records.noise import mean_over, quiet_windows
from casid.records.noise_spectrum import density_sigma, high_band_holds, motion_edge
from casid.records.record import Record
from casid.signals import SURFACES
from problems.do328 import do328

_OVERSAMPLING, _LEAD = 8, 200
_FACTOR = 2.0


def filtered_noise(rng: np.random.Generator, n: int, rate_hz: float, corner_hz: float) -> np.ndarray:
    """(n,) unit white noise, Butterworth filtered of second order at several times the rate, then sampled."""
    white = rng.normal(0.0, np.sqrt(_OVERSAMPLING), (n + _LEAD) * _OVERSAMPLING)
    low_pass = signal.butter(2, corner_hz, fs=rate_hz * _OVERSAMPLING, output="sos")
    return np.asarray(signal.sosfilt(low_pass, white))[_LEAD * _OVERSAMPLING :: _OVERSAMPLING]


def measured(
    rate_hz: float, corner_hz: float, step: float, hidden: Sequence[Attached] = (), count: int = 3
) -> list[Record]:
    """Do 328 flights with filtered noise of density as in NOISE, quantised in steps of `step` times that."""
    rng, records = np.random.default_rng(5), []
    for record in flights(hidden, seed=1, count=count, rate_hz=rate_hz, noise=dict.fromkeys(NOISE, 0.0)):
        channels = {}
        for name, sigma in NOISE.items():
            values = record[name] + sigma * filtered_noise(rng, len(record), rate_hz, corner_hz)
            channels[name] = np.round(values / (step * sigma)) * step * sigma if step else values
        records.append(record.with_channels(**channels))
    return records


def ratios(flight: Subject) -> np.ndarray:
    return np.array([flight.sigma[name] / NOISE[name] for name in flight.outputs])


@pytest.mark.parametrize("rate_hz", [20.0, 25.0, 50.0, 100.0])
def test_white_noise_is_read_from_the_high_band(rate_hz: float) -> None:
    flight = prepare(do328(), flights(seed=1, rate_hz=rate_hz))
    assert flight.doubted == ()
    assert with_noise_level(flight, []) is flight
    np.testing.assert_allclose(ratios(flight), 1.0, atol=0.1)


@pytest.mark.parametrize(
    ("rate_hz", "corner_hz", "step"),
    [(20.0, 5.0, 0.0), (25.0, 5.0, 0.0), (25.0, 10.0, 0.0), (50.0, 5.0, 0.05), (50.0, 10.0, 0.3), (100.0, 10.0, 0.0)],
)
def test_filtered_noise_has_the_density_below_its_filter(rate_hz: float, corner_hz: float, step: float) -> None:
    count = 1 if rate_hz > 50.0 else 3  # enough samples, less to wait for
    flight = prepare(do328(), measured(rate_hz, corner_hz, step, count=count))
    found = ratios(with_noise_level(flight, []))
    assert found.min() > 1.0 / _FACTOR and found.max() < _FACTOR


def test_the_high_band_of_filtered_noise_is_far_too_low() -> None:
    """Second order: density falls by (f / corner)^2 in amplitude, so at 25 Hz to a hundredth and less of its power."""
    flight = prepare(do328(), measured(50.0, 5.0, 0.0))
    assert flight.doubted == flight.outputs
    assert ratios(flight).max() < 0.15


def test_a_simulation_that_departed_leaves_the_noise_to_the_records() -> None:
    """No residual of any record is finite: the octave above the motion has the noise's density, and is all there is."""
    flight = prepare(do328(), measured(50.0, 5.0, 0.0, count=1))
    none = [r.with_channels(**{o: np.full(len(r), np.nan) for o in flight.outputs}) for r in flight.records]
    found = ratios(with_noise_above(flight, none))
    assert np.isfinite(found).all() and found.min() > 1.0 / _FACTOR


def test_a_noise_that_the_file_states_leaves_that_of_the_others_to_the_fit() -> None:
    """Truth: the noise that was flown. The level and colour of the other channels are estimated with the model."""
    stated = replace(do328(), noise={"alpha": NOISE["alpha"]})
    flight = unread(prepare(stated, measured(50.0, 5.0, 0.0)))
    assert flight.noise_by_fit and "alpha" not in flight.doubted
    found = in_colour(fit(flight, [], flight.noise(), extent="settled")).noise
    assert found.measurement["alpha"] == NOISE["alpha"] and set(found.colour) == set(flight.outputs) - {"alpha"}


def test_the_level_that_a_true_model_leaves_is_the_noise_that_was_added() -> None:
    """Surfaces are recorded without noise; the r.m.s. of 500 readings has a 1-sigma of 3 %."""
    flight = prepare(do328(), flights(seed=1, count=1, surface_noise=0.0))
    flight = replace(flight, doubted=flight.outputs)
    found = level_of(fit(flight, [], flight.noise(), extent="settled"))
    assert found == pytest.approx({name: NOISE[name] for name in flight.outputs}, rel=0.15)


@pytest.mark.parametrize("filtered", [True, False])
def test_noise_of_inputs_behind_a_filter_common_to_all_channels(filtered: bool) -> None:
    """Truth: the density of the surfaces' noise before a filter at 5 Hz. Their own high band shows a fifth of it; it is
    left as it is where only the surfaces seem to be filtered."""
    rng = np.random.default_rng(5)
    found = measured(50.0, 5.0, 0.0) if filtered else flights(seed=5, count=3, rate_hz=50.0)
    plain = flights(seed=5, count=3, rate_hz=50.0, noise={}, surface_noise=0.0)
    behind = [
        record.with_channels(**{s: p[s] + SURFACE_NOISE * filtered_noise(rng, len(p), 50.0, 5.0) for s in SURFACES})
        for record, p in zip(found, plain, strict=True)
    ]
    flight = with_noise_level(prepare(do328(), behind), ())
    density = np.array([flight.input_sigma[f"d_{s}"] for s in SURFACES]) / SURFACE_NOISE
    assert density.min() > 1.0 / _FACTOR and density.max() < _FACTOR if filtered else density.max() < 0.5


@pytest.mark.slow
def test_filtered_records_are_diagnosed_like_others() -> None:
    """Nothing is named where nothing was hidden, and what was hidden is: with the noise of the high band, the first
    ends in turbulence of 0.5 m/s, and of the second a delay is named beside it."""
    records = measured(25.0, 5.0, 0.0, count=3)
    assert diagnose(do328(), records[:3], records[3:]).verdict == "adequate"
    hidden = Attached(effect=actuator_lag("delta_e"), values={"value": 0.12})
    records = measured(25.0, 5.0, 0.0, [hidden], count=3)
    found = diagnose(do328(), records[:3], records[3:])
    assert [(cause.kind, cause.target) for cause in found.causes] == [("actuator_lag", "delta_e")]
    assert abs(found.causes[0].value - 0.12) < 3.0 * found.causes[0].std


def test_noise_below_the_quantisation_is_not_believed() -> None:
    """White noise of a fifth of the step: most differences vanish, and what is recorded is the rounding error."""
    rng, t = np.random.default_rng(2), np.arange(0.0, 30.0, 0.02)
    values = np.round((np.sin(t) + rng.normal(0.0, 0.002, len(t))) / 0.01) * 0.01
    record = Record(name="m", t=t, channels={"theta": values})
    assert not high_band_holds([record], "theta", 0.5)


def test_density_of_a_channel_at_its_own_rate() -> None:
    """Every fourth sample of white noise is white noise of the same 1-sigma at a quarter of the rate."""
    rng, t = np.random.default_rng(3), np.arange(0.0, 80.0, 0.01)
    values = rng.normal(0.0, 0.7, len(t))
    slow = np.where(np.arange(len(t)) % 4 == 0, values, np.nan)
    record = Record(name="m", t=t, channels={"V": values, "alpha": slow})
    for name, band in (("V", (1.0, 40.0)), ("alpha", (1.0, 10.0)), ("alpha", (10.0, 40.0))):
        assert density_sigma([record], name, band) == pytest.approx(0.7, rel=0.1)


def test_edge_of_the_motion() -> None:
    """A rate that is a sum of two lines: 90 % of the power of its slope lies below the higher one or not."""
    t = np.arange(0.0, 40.0, 0.02)
    for high, edge in ((0.02, 0.5), (0.5, 2.0)):
        q = np.sin(2.0 * np.pi * 0.5 * t) + high * np.sin(2.0 * np.pi * 2.0 * t)
        assert motion_edge([Record(name="m", t=t, channels={"q": q})]) == pytest.approx(edge, abs=0.06)
    assert motion_edge([Record(name="m", t=t, channels={"alpha": 0.01 * t})]) == 0.0


def test_denoising_keeps_the_time_at_which_a_surface_begins_to_move() -> None:
    """Truth: steps of 30 sigmas, made within four samples, beginning anywhere between two. Denoised, a rest is known
    better than its noise, a movement no worse, and neither late nor early. (Means over windows that reach into the
    movement were 1.4 sigmas off around it, and what follows with a limited rate was 4 % too fast.)"""
    rng, t, width = np.random.default_rng(3), np.arange(120.0), 4.0
    moving, resting, late = [], [], []
    for _ in range(300):
        begin = 60.0 + rng.uniform(-0.5, 0.5)
        surface = 30.0 * np.clip((t - begin) / width, 0.0, 1.0)
        noisy = surface + rng.standard_normal(len(t))
        error = mean_over(noisy, *quiet_windows(noisy, 1.0)) - surface
        near = np.abs(t - begin - width / 2.0) < width / 2.0 + 3.0
        moving.append(error[near])
        resting.append(error[~near])
        late.append(error[near].mean())
    assert np.sqrt(np.mean(np.concatenate(resting) ** 2)) < 0.4
    assert abs(np.concatenate(resting).mean()) < 0.01
    assert np.sqrt(np.mean(np.concatenate(moving) ** 2)) < 1.0
    assert abs(np.mean(late)) < 0.1
