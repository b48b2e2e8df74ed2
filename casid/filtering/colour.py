"""Colour of innovations: what a model leaves of a channel is no white noise, but moves slowly from reading to reading.

An innovation is then predicted in part by the one before it, and only the rest of it is new. Of a channel whose
innovations are a first-order Gauss-Markov process of 1-sigma s and correlation time tau, the reading after an interval
d brings (e - rho e_before) / (s sqrt(1 - rho^2)), rho = exp(-d / tau). It is white with unit variance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from casid.filtering.innovations import Linear

# correlation time: of the shortest interval between readings, of the record
_SHORTEST = 0.05
_LONGEST = 20.0


@dataclass(frozen=True, eq=False, kw_only=True)
class _Stretch:
    """Readings `at` (n,) of a channel in a record: share `told` (n,) by the one before, and size `unit` (n,) of what is
    news."""

    record: int
    channel: int
    at: np.ndarray
    told: np.ndarray
    unit: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Colouring:
    """The colour of every channel that has one, at its readings; log_determinant (N, R, ny) of the news."""

    stretches: tuple[_Stretch, ...]
    log_determinant: np.ndarray

    def taken_off(self, white: np.ndarray) -> np.ndarray:
        """The array (R, N, ny, nc), in place, with the news of every reading of a coloured channel."""
        for one in self.stretches:
            series = white[one.record, one.at, one.channel]
            series[1:] -= one.told[1:, None] * white[one.record, one.at[:-1], one.channel]
            white[one.record, one.at, one.channel] = series / one.unit[:, None]
        return white

    def transposed(self, white: np.ndarray) -> np.ndarray:
        """The transposed of `taken_off`: columns (R, N, ny, nc), in place."""
        for one in self.stretches:
            series = white[one.record, one.at, one.channel] / one.unit[:, None]
            series[:-1] -= one.told[1:, None] * series[1:]
            white[one.record, one.at, one.channel] = series
        return white


def colouring(linear: Linear, colour: Mapping[str, tuple[float, float]]) -> Colouring:
    """The colour `colour` (output -> 1-sigma, correlation time [s]) at the readings of a linearised model."""
    found = []
    total = np.zeros(linear.seen.shape)
    for name, (sigma, tau) in colour.items():
        channel = linear.model.outputs.index(name)
        for record in range(linear.seen.shape[1]):
            at = np.flatnonzero(linear.seen[:, record, channel])
            t = np.concatenate([[0.0], np.cumsum(linear.dt[:, record])])[at]
            told, unit = _told(t, tau)
            found.append(_Stretch(record=record, channel=channel, at=at, told=told, unit=sigma * unit))
            total[at, record, channel] = 2.0 * np.log(sigma * unit)
    return Colouring(stretches=tuple(found), log_determinant=total)


def most_likely(series: Sequence[tuple[np.ndarray, np.ndarray]], longest: float = np.inf) -> tuple[float, float]:
    """(1-sigma, correlation time [s]) of a first-order Gauss-Markov process with zero mean, by maximum likelihood, from
    times and values (n,) of each record, evenly spaced or not; the time is at most `longest` [s]."""
    read = [(t, values) for t, values in series if len(t) > 1]
    shortest = min(float(np.diff(t).min()) for t, _ in read)
    longest = max(min(_LONGEST * max(float(t[-1] - t[0]) for t, _ in read), longest), shortest)

    def variance(tau: float) -> tuple[float, float]:
        squares = 0.0
        logs = 0.0
        count = 0
        for t, values in read:
            told, unit = _told(t, tau)
            news = values.copy()
            news[1:] -= told[1:] * values[:-1]
            squares += float(np.sum((news / unit) ** 2))
            logs += 2.0 * float(np.sum(np.log(unit)))
            count += len(t)
        return max(squares / count, 1e-300), logs / count

    def deviance(log_tau: float) -> float:
        square, log = variance(float(np.exp(log_tau)))
        return float(np.log(square)) + log

    bounds = np.log(_SHORTEST * shortest), np.log(longest)
    lowest: Any = scipy.optimize.minimize_scalar(deviance, bounds=bounds, method="bounded")
    tau = float(np.exp(lowest.x))
    return float(np.sqrt(variance(tau)[0])), tau


def _told(t: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """Share of every value that the one before it predicts, none of the first; and 1-sigma of the rest, of the
    whole."""
    told = np.zeros(len(t))
    told[1:] = np.exp(-np.diff(t) / tau)
    return told, np.sqrt(-np.expm1(2.0 * np.log(np.maximum(told, 1e-150))))
