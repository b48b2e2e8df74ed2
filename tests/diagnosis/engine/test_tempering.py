"""Gains beside what a model leaves. Truth: the long-run variance of an autoregressive series."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import Remainder, distance
from casid.diagnosis.engine.trial import Gain, Trial
from casid.model.causes.instruments import sensor_bias, sensor_scale
from casid.model.effect import Effect

N, R, RATE = 4000, 3, 25.0


def evidence(correlation: float, seed: int = 1) -> SimpleNamespace:
    """What a fit leaves of two channels: series of unit variance, each correlated from sample to sample."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((N, R, 2)) * np.sqrt(1.0 - correlation**2)
    left = lfilter([1.0], [1.0, -correlation], white, axis=0)
    records = [SimpleNamespace(dt=1.0 / RATE)] * R
    fit = SimpleNamespace(flight=SimpleNamespace(records=records))
    return SimpleNamespace(fit=fit, criteria=Criteria(), left=left)


def inflation(correlation: float, direction: np.ndarray) -> float:
    return float(np.mean([Remainder(evidence(correlation, s)).inflation(direction) for s in range(6)]))  # pyright: ignore


def test_a_gain_along_white_noise_counts_as_it_is() -> None:
    assert inflation(0.0, np.ones((N, R, 2)).ravel()) == pytest.approx(1.0, abs=0.2)


def test_a_steady_direction_counts_for_as_much_less_as_noise_is_slow() -> None:
    """Truth: (1 + x) / (1 - x) for a correlation x from sample to sample, over stretches far longer than that."""
    steady = np.ones((N, R, 2)).ravel()
    assert inflation(0.8, steady) == pytest.approx(9.0, rel=0.25)


def test_a_quick_direction_counts_as_it_is_beside_slow_noise() -> None:
    quick = np.broadcast_to((-1.0) ** np.arange(N)[:, None, None], (N, R, 2)).ravel()
    assert inflation(0.8, quick) == pytest.approx(1.0, abs=0.1)


def trial(effect: Effect, gain: float, fingerprint: np.ndarray) -> Trial:
    return Trial(
        candidate=SimpleNamespace(attached=SimpleNamespace(effect=effect)),  # pyright: ignore
        std=1.0,
        fingerprint=fingerprint,
        gain=Gain(raw=gain, price=0.0, spared=0.0, exact=gain),
        share=2.0,
    )


def test_two_causes_that_differ_by_something_slow_are_one_set_beside_slow_noise() -> None:
    """200 of 4000 in gain, at an angle of 0.2: apart where white noise is left, and one set where it moves slowly."""
    t = np.arange(N)[:, None, None] / RATE
    one = np.broadcast_to(np.sin(t) + 1.0, (N, R, 2)).ravel()
    other = np.broadcast_to(np.sin(t) + 0.7, (N, R, 2)).ravel()
    first, second = trial(sensor_bias("q"), 4000.0, one), trial(sensor_scale("q"), 3800.0, other)
    round_ = SimpleNamespace(named=True, leader=first, rivals=(second,), equivalents=())
    for correlation, alike in ((0.0, False), (0.97, True)):
        left = Remainder(evidence(correlation))  # pyright: ignore
        slow = left.inflation(one / np.linalg.norm(one) * 4000**0.5 - other / np.linalg.norm(other) * 3800**0.5)
        beside = Trial(**{**vars(second), "inflation": slow})
        assert (distance(round_.leader, beside, Criteria()) < 1.0) is alike
