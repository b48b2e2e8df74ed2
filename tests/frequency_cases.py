"""Smooth motions of the small systems of `estimation_cases`, for estimation in the frequency domain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from estimation_cases import TRUTH, exact, matrices

from casid.records.record import Record

T = np.arange(0.0, 20.0, 0.02)
BAND = (0.3, 14.0)  # rad/s, wider than the input of `smooth_input`


def smooth_input(t: np.ndarray, seed: int = 0) -> np.ndarray:
    """A sum of twelve sines of 0.01 rad, from 1 to 6 rad/s, of no common period with the record."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 12)
    return sum(0.01 * np.sin(2.0 * np.pi * k * t / 13.0 + phase) for k, phase in enumerate(phases, start=2))


def flown(
    values: Mapping[str, float] = TRUTH,
    *,
    t: np.ndarray = T,
    hold: str = "linear",
    x0: tuple[float, float] = (0.01, -0.02),
    name: str = "m1",
    seed: int = 0,
) -> Record:
    """A short period with alphadot and qdot, without noise, that neither starts at rest nor ends where it began."""
    a, b = matrices(values)
    u = smooth_input(t, seed)
    x = exact(a, b, t, u[:, None], np.array(x0), hold)
    slopes = x @ a.T + u[:, None] * b[:, 0]
    columns = {"alpha": x[:, 0], "q": x[:, 1], "alphadot": slopes[:, 0], "qdot": slopes[:, 1]}
    return Record(name=name, t=t, channels={"delta_e": u, **columns}, hold=hold)


def noisy(record: Record, sigma: Mapping[str, float], rng: np.random.Generator) -> Record:
    """The record with white noise of these 1-sigma on channels."""
    return record.with_channels(**{n: record[n] + s * rng.standard_normal(len(record)) for n, s in sigma.items()})
