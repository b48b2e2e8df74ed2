"""Fourier transforms against integrals in closed form, the definition of the sums, and the fast Fourier transform."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import polynomial

from casid.errors import InputError
from casid.frequency.transform import band, chirp_z, derivative_fourier, detrended, finite_fourier, stretches
from casid.records.record import Record

RNG = np.random.default_rng(20)


def by_parts(coefficients: np.ndarray, span: float, omega: np.ndarray) -> np.ndarray:
    """Integral of a polynomial times exp(-j omega t) from 0 to span: by parts, once per power."""
    total, c = np.zeros(len(omega), complex), coefficients
    for k in range(len(coefficients)):
        ends = polynomial.polyval(0.0, c) - polynomial.polyval(span, c) * np.exp(-1j * omega * span)
        total += ends / (1j * omega) ** (k + 1)
        c = polynomial.polyder(c)
    return total


def test_the_chirp_z_transform_is_the_fourier_transform_at_its_bins() -> None:
    x = RNG.standard_normal((240, 2))
    bins = 2.0 * np.pi * np.arange(121) / (240 * 0.02)
    assert chirp_z(x, 0.02, bins) == pytest.approx(np.fft.rfft(x, axis=0), abs=1e-10)


@pytest.mark.parametrize("omega", [band(0.3, 25.0, 80), np.geomspace(0.3, 25.0, 80)], ids=["even", "by ratio"])
def test_the_chirp_z_transform_is_the_sum_that_defines_it(omega: np.ndarray) -> None:
    x = RNG.standard_normal(501)
    sums = [sum(value * np.exp(-1j * w * k * 0.02) for k, value in enumerate(x)) for w in omega]
    assert chirp_z(x, 0.02, omega) == pytest.approx(np.array(sums), abs=1e-9)


@pytest.mark.parametrize("top", [0.099, 3.0], ids=["power series", "closed form"])
def test_the_integral_of_a_cubic_is_exact(top: float) -> None:
    """Joined by cubics, the samples of a cubic are that cubic, at any frequency and between few samples."""
    t = 0.1 * np.arange(33)
    omega = band(0.02 * top / 0.1, top / 0.1, 40)
    cubic = np.array([0.7, -1.1, 0.9, -0.25])
    exact = by_parts(cubic, t[-1], omega)
    assert finite_fourier(t, polynomial.polyval(t, cubic), omega) == pytest.approx(exact, abs=1e-8)


def test_the_integral_is_that_of_a_damped_oscillation() -> None:
    """x = exp(s t): the integral is (exp((s - j omega) T) - 1) / (s - j omega). A plain sum is off by far more."""
    s, t, omega = -0.6 + 3.0j, 0.02 * np.arange(1301), band(0.5, 25.0, 100)
    x, span = np.exp(s * t), 26.0
    exact = (np.exp((s - 1j * omega) * span) - 1.0) / (s - 1j * omega)
    found = finite_fourier(t, x, omega)
    assert found == pytest.approx(exact, abs=2e-6)
    assert np.abs(0.02 * chirp_z(x, 0.02, omega) - exact).max() > 1e3 * np.abs(found - exact).max()


def test_the_derivative_is_taken_by_parts() -> None:
    s, t, omega = -0.6 + 3.0j, 0.02 * np.arange(501), band(0.5, 15.0, 30)
    x = np.stack([np.exp(s * t), 2.0 * np.exp(s * t)], axis=1)
    assert derivative_fourier(t, x, omega) == pytest.approx(finite_fourier(t, s * x, omega), abs=1e-4)


def test_uneven_time_stamps_give_the_same_integral() -> None:
    even = 0.02 * np.arange(1001)
    t = even + np.concatenate([[0.0], 0.004 * RNG.uniform(-1.0, 1.0, 999), [0.0]])
    omega = band(0.5, 12.0, 40)
    wave = [np.sin(2.0 * time) * np.exp(-0.1 * time) for time in (even, t)]
    assert finite_fourier(t, wave[1], omega) == pytest.approx(finite_fourier(even, wave[0], omega), abs=1e-6)


def test_a_line_is_taken_away() -> None:
    t = np.sort(RNG.uniform(0.0, 10.0, 60))
    values = np.stack([3.0 - 0.4 * t, 0.2 * t], axis=1)
    assert np.abs(detrended(t, values)).max() < 1e-13
    assert detrended(t, values, 0).mean(axis=0) == pytest.approx([0.0, 0.0], abs=1e-14)


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


def test_what_cannot_be_transformed_is_refused() -> None:
    t = 0.02 * np.arange(100)
    x, late = np.sin(t), np.concatenate([t[:50], t[50:] + 1.0])
    for what, wrong in (
        ("missing", lambda: finite_fourier(t, np.where(t > 1.0, np.nan, x), band(1.0, 5.0, 4))),
        ("gap", lambda: finite_fourier(late, x, band(1.0, 5.0, 4))),
        ("Nyquist", lambda: chirp_z(x, 0.02, band(1.0, 160.0, 4))),
        ("low", lambda: band(5.0, 1.0, 4)),
    ):
        with pytest.raises(InputError, match=what):
            wrong()
