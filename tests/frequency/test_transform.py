"""Fourier transforms against the definition of the sums and the fast Fourier transform."""

from __future__ import annotations

import numpy as np
import pytest

from casid.errors import InputError
from casid.frequency.transform import chirp_z, stretches
from casid.records.record import Record

RNG = np.random.default_rng(20)


def test_the_chirp_z_transform_is_the_fourier_transform_at_its_bins() -> None:
    x = RNG.standard_normal((240, 2))
    bins = 2.0 * np.pi * np.arange(121) / (240 * 0.02)
    assert chirp_z(x, 0.02, bins) == pytest.approx(np.fft.rfft(x, axis=0), abs=1e-10)


@pytest.mark.parametrize("omega", [np.linspace(0.3, 25.0, 80), np.geomspace(0.3, 25.0, 80)], ids=["even", "by ratio"])
def test_the_chirp_z_transform_is_the_sum_that_defines_it(omega: np.ndarray) -> None:
    x = RNG.standard_normal(501)
    sums = [sum(value * np.exp(-1j * w * k * 0.02) for k, value in enumerate(x)) for w in omega]
    assert chirp_z(x, 0.02, omega) == pytest.approx(np.array(sums), abs=1e-9)


def test_gaps_divide_a_record_unless_they_are_short() -> None:
    """At 10 rad/s a tenth of a period is 0.063 s: two missing samples of 50 Hz are bridged, forty are not."""
    t = 0.02 * np.arange(500)
    x, y = np.sin(t), np.cos(t)
    x[100:102], y[250:290] = np.nan, np.nan
    parts = stretches(Record(name="m1", t=t, channels={"x": x, "y": y}), ["x", "y"], 10.0)
    assert [(part.start, len(part.values)) for part in parts] == [(0.0, 250), (pytest.approx(5.8), 210)]
    assert parts[0].values == pytest.approx(np.stack([np.sin(parts[0].t), np.cos(parts[0].t)], axis=1), abs=1e-3)
    assert parts[1].values[:, 0] == pytest.approx(x[290:], abs=0.0)


def test_jumps_of_time_are_gaps() -> None:
    t = 0.02 * np.arange(400)
    t[200:] += 3.0
    parts = stretches(Record(name="m1", t=t, channels={"x": np.sin(t)}), ["x"], 20.0)
    assert [len(part.values) for part in parts] == [200, 200]
    assert parts[1].values[:, 0] == pytest.approx(np.sin(t[200:]), abs=1e-12)


def test_rounded_time_stamps_are_those_of_an_even_clock() -> None:
    """30 Hz written with three decimals: the median interval is 0.033 s, the clock's 1/30 s."""
    exact = np.arange(900) / 30.0
    x = np.sin(2.0 * exact)
    (part,) = stretches(Record(name="m1", t=np.round(exact, 3), channels={"x": x}), ["x"], 15.0)
    assert part.dt == pytest.approx(1.0 / 30.0, rel=1e-4)
    assert part.values[:, 0] == pytest.approx(x, abs=0.0)


def test_jitter_is_brought_onto_an_even_grid() -> None:
    t = 0.02 * np.arange(1000) + 0.004 * RNG.uniform(-1.0, 1.0, 1000)
    (part,) = stretches(Record(name="m1", t=t, channels={"x": np.sin(2.0 * t)}), ["x"], 15.0)
    assert part.values[:, 0] == pytest.approx(np.sin(2.0 * part.t), abs=1e-3)


def test_sums_in_parts_are_the_sums() -> None:
    """Of so many samples and frequencies that the table of all terms would not fit into memory."""
    x = RNG.standard_normal(100_000)
    omega = np.geomspace(0.1, 30.0, 90)
    found = chirp_z(x, 0.02, omega)
    k = 57
    assert found[k] == pytest.approx(np.sum(x * np.exp(-1j * omega[k] * 0.02 * np.arange(len(x)))), abs=1e-8)


def test_frequencies_above_nyquist_are_refused() -> None:
    record = Record(name="m1", t=0.02 * np.arange(100), channels={"x": np.sin(0.02 * np.arange(100))})
    for highest in (160.0, np.inf):
        with pytest.raises(InputError, match="Nyquist"):
            stretches(record, ["x"], highest)


def test_missing_samples_are_in_no_stretch() -> None:
    x = np.where(np.arange(100) > 50, np.nan, np.sin(0.02 * np.arange(100)))
    (part,) = stretches(Record(name="m1", t=0.02 * np.arange(100), channels={"x": x}), ["x"], 5.0)
    assert len(part.values) == 51 and np.isfinite(part.values).all()
