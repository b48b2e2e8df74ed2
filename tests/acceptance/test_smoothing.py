"""The smoother. Truth: a smooth curve, with noise of known size and without."""

from __future__ import annotations

import numpy as np

from casid.acceptance.smoothing import smooth

T = np.arange(0.0, 20.0, 0.02)
CURVE = 95.0 + 3.0 * np.sin(0.5 * T) * np.exp(-0.05 * T)


def test_noise_is_taken_off_and_its_size_found() -> None:
    found = smooth(T, CURVE + np.random.default_rng(1).normal(0.0, 0.3, len(T)))
    assert np.sqrt(np.mean((found.curve - CURVE) ** 2)) < 0.15 * 0.3
    assert abs(found.sigma - 0.3) < 0.03


def test_a_curve_without_noise_stays() -> None:
    assert np.abs(smooth(T, CURVE).curve - CURVE).max() < 1e-6


def test_missing_samples_and_uneven_sampling() -> None:
    rng = np.random.default_rng(2)
    keep = np.sort(rng.choice(len(T), 700, replace=False))
    t, values = T[keep], CURVE[keep].copy()
    values[100:120] = np.nan
    found = smooth(t, values).curve
    assert np.abs(found - CURVE[keep]).max() < 0.01


def test_the_end_of_a_ramp_is_not_bent() -> None:
    ramp = 2.0 * T
    found = smooth(T, ramp + np.random.default_rng(3).normal(0.0, 0.1, len(T))).curve
    assert np.abs(found - ramp).max() < 0.1


def test_a_step_stays_a_step() -> None:
    """Truth: a step of 30 times the noise, between two samples."""
    level = 3.0 * (T > 10.0)
    found = smooth(T, level + np.random.default_rng(4).normal(0.0, 0.1, len(T))).curve
    near = np.abs(T - 10.0) < 0.1
    assert np.abs(found - level)[near].max() < 6.0 * 0.1
    assert np.abs(smooth(T, level).curve - level).max() < 1e-9
