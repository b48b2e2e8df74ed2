"""Records of instruments as they are: what each part of an installation does to a known motion."""

from __future__ import annotations

import numpy as np
import pytest

from casid.records.record import Record
from problems.blind.instruments import Instruments
from problems.jsbsim.airframe import RATE_HZ
from problems.jsbsim.flight import NOISE


def test_instruments_as_they_are_leave_their_marks() -> None:
    """The same flight by ideal instruments and as they are: what is written is a multiple of the converter's step; a
    channel that comes slowly has nothing between; the filter makes a rate late by its group delay at low frequencies,
    and the rest of the difference is noise and offset, of the size that they are said to have."""
    t = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    q = 0.1 * np.sin(2.0 * np.pi * 0.5 * t)
    flown = Record(name="m1", t=t, channels={"q": q, "alpha": 0.02 + q, "delta_e": q})
    installed = Instruments(corner=0.3, bits=14, jitter=0.02, offset=1.0, slow=0.5, memory_s=0.2, every=5)
    read = installed.recorded(flown, 50.0, 0.01, np.random.default_rng(1))
    assert np.all(np.isfinite(read["alpha"]) == (np.arange(len(read)) % 5 == 0))
    step = np.radians(200.0) / 2**14
    assert read["q"] / step == pytest.approx(np.round(read["q"] / step), abs=1e-6)
    # a Bessel filter of second order with its -3 dB at w is late by 1.36 / w
    late = 1.36 / (2.0 * np.pi * 0.3 * 50.0)
    left = read["q"] - 0.1 * np.sin(2.0 * np.pi * 0.5 * (read.t - late))
    assert abs(np.mean(left)) < NOISE["q"] * 1.05
    assert np.std(left) < 0.003 * 0.1 + np.pi * 0.1 * 0.02 / 50.0 + step


def test_slow_noise_has_its_variance_and_memory() -> None:
    """Unit variance, and the correlation of its slow part at one correlation time: slow / e."""
    installed = Instruments(corner=0.3, bits=16, jitter=0.0, offset=0.0, slow=0.4, memory_s=0.5, every=1)
    t = np.arange(0.0, 4000.0, 1.0 / RATE_HZ)
    read = installed.recorded(Record(name="m", t=t, channels={"ax": 0.0 * t}), 20.0, 100.0, np.random.default_rng(2))
    noise = read["ax"] / (100.0 * NOISE["ax"])
    assert np.var(noise) == pytest.approx(1.0, rel=0.05)
    assert np.mean(noise[10:] * noise[:-10]) == pytest.approx(0.4 / np.e, abs=0.03)
