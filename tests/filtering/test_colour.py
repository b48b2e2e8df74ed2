"""Colour of innovations. Truth: first-order Gauss-Markov processes drawn here, and their dense covariance matrices."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from filter_cases import covariance, process

from casid.filtering.colour import colouring, most_likely


def linear(t: np.ndarray, seen: np.ndarray) -> Any:
    """What of a linearised model the colour looks at: one record, one output."""
    return SimpleNamespace(
        model=SimpleNamespace(outputs=("q",)), seen=seen[:, None, None], dt=np.diff(t)[:, None], residual=None
    )


@pytest.mark.parametrize("tau", [0.002, 0.3, 4.0])
def test_level_and_correlation_time_are_found(tau: float) -> None:
    """Of four records of 20 s at 8 Hz with a seventh of the readings missing. The level of a process that takes 4 s to
    forget is known from some 20 independent values, to 16 % (1-sigma)."""
    rng, series = np.random.default_rng(3), []
    for _ in range(4):
        t = np.arange(0.0, 20.0, 0.125)
        t = t[rng.random(len(t)) > 1.0 / 7.0]
        series.append((t, process(rng, t, 0.7, tau)))
    sigma, found = most_likely(series)
    independent = sum(len(t) * np.tanh(0.0625 / tau) for t, _ in series)
    assert sigma == pytest.approx(0.7, rel=4.0 / np.sqrt(2.0 * independent))
    assert found == pytest.approx(tau, rel=0.6) if tau > 0.125 else found < 0.06


def test_density_of_readings_with_gaps_is_that_of_the_dense_covariance() -> None:
    rng = np.random.default_rng(5)
    t, seen = np.arange(0.0, 6.0, 0.1), rng.random(60) > 0.3
    e = rng.standard_normal(60)
    one = colouring(linear(t, seen), {"q": (1.7, 0.6)})
    white = one.taken_off(np.where(seen, e, 0.0)[None, :, None, None].copy())[0, :, 0, 0]
    R = covariance(t[seen], 1.7, 0.6)
    assert np.sum(white[seen] ** 2) == pytest.approx(e[seen] @ np.linalg.solve(R, e[seen]))
    assert one.log_determinant.sum() == pytest.approx(np.linalg.slogdet(R)[1])


@pytest.mark.parametrize("rho", [0.0, 0.94, 0.998])
def test_a_constant_is_known_from_the_effective_number_of_readings(rho: float) -> None:
    """1001 readings of lag-1 correlation rho tell of a constant as much as (n (1 - rho) + 2 rho) / (1 + rho)
    independent ones: 32 at 0.94, and 2 at 0.998."""
    t = np.arange(1001) * 0.02
    tau = -0.02 / np.log(max(rho, 1e-9))
    one = colouring(linear(t, np.ones(1001, dtype=bool)), {"q": (1.0, tau)})
    column = one.taken_off(np.ones((1, 1001, 1, 1)))
    assert np.sum(column**2) == pytest.approx((1001 * (1.0 - rho) + 2.0 * rho) / (1.0 + rho), rel=1e-5)


def test_without_colour_nothing_is_taken_off() -> None:
    t = np.arange(5) * 0.1
    one = colouring(linear(t, np.ones(5, dtype=bool)), {})
    assert np.all(one.taken_off(np.ones((1, 5, 1, 2))) == 1.0) and not one.log_determinant.any()
