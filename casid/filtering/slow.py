"""Noise of a reading that is white in part and slow in part: first-order Gauss-Markov processes beside the white noise.

A reading whose noise is slow has less information than as many independent ones on what is slow itself, and as much as
before on what is quick. So white and slow noise are apart: in a Kalman filter the slow one is a state that only this
reading sees. An offset is the slowest: its correlation time is infinite.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from casid.filtering.innovations import Linear

# shares of the variance that are slow, as odds: from what no record shows to what leaves next to nothing white
_LEAST_ODDS = 0.02
_MOST_ODDS = 50.0
_ODDS = 9
# correlation time: of the interval between readings, of the record
_SHORTEST = 1.0
_LONGEST = 0.5
_TIMES = 9
_MEDIAN_DEVIATION = 1.4826  # 1-sigma over the median absolute deviation, of a Gaussian
_FINER = 3  # times that the search is repeated about the best, each with steps half as long


def with_slow_readings(
    linear: Linear, slow: Mapping[str, Sequence[tuple[float, float]]], made: tuple[Any, ...]
) -> tuple[Any, ...]:
    """A, C, Q, M, S and P of a filter (`kalman.augmented`) with slow noise of readings (`NoiseModel.slow`) as further
    states."""
    A, C, Q, M, S, P = made
    channel = [linear.model.outputs.index(name) for name, parts in slow.items() for _ in parts]
    sigma, tau = np.array([part for parts in slow.values() for part in parts]).T
    n = C.shape[3]
    k = len(channel)
    inside = range(n, n + k)
    told = np.exp(-linear.dt[..., None] / tau)
    A, Q, P = (np.pad(one, (*[(0, 0)] * (one.ndim - 2), (0, k), (0, k))) for one in (A, Q, P))
    C = np.pad(C, ((0, 0), (0, 0), (0, 0), (0, k)))
    A[..., inside, inside] = told
    Q[..., inside, inside] = sigma**2 * (1.0 - told**2)
    P[..., inside, inside] = sigma**2
    C[..., channel, inside] = linear.seen[..., channel]
    S = None if S is None else np.pad(S, ((0, 0), (0, 0), (0, k), (0, 0)))
    return A, C, Q, M, S, P


def slow_states(slow: Mapping[str, Sequence[tuple[float, float]]]) -> list[str]:
    """Names of these further states."""
    return [f"slow_{name}_{i}" for name, parts in slow.items() for i in range(len(parts))]


@dataclass(frozen=True, kw_only=True)
class WhiteAndSlow:
    """Noise of a channel."""

    white: float  # white, slow, tau: 1-sigma of its parts, and correlation time [s] of the slow one
    slow: float
    tau: float
    gain: float  # what they gain beside white noise alone, 2 ln L
    offsets: np.ndarray  # offsets, stds: (R,) offset in every record, and its 1-sigma; NaN where it has not the channel
    stds: np.ndarray


def white_and_slow(t: np.ndarray, values: np.ndarray, seen: np.ndarray) -> list[WhiteAndSlow]:
    """Noise of every channel by maximum likelihood, from values (N, R, ny) where they are `seen`, at times t (N, R).
    Nothing is known of the mean of a record (REML). The level follows from slow share and correlation time, looked for
    on grids."""
    intervals = np.diff(t, axis=0)
    shortest = _SHORTEST * float(np.median(intervals))
    longest = _LONGEST * float(np.max(t[-1] - t[0]))
    odds = np.linspace(np.log(_LEAST_ODDS), np.log(_MOST_ODDS), _ODDS)
    times = np.linspace(np.log(shortest), np.log(max(longest, 2.0 * shortest)), _TIMES)
    ny = values.shape[2]
    points = np.broadcast_to(_around(odds, times), (ny, len(odds) * len(times), 2))
    alone = _at(intervals, values, seen, np.full((ny, 1, 2), [-np.inf, 0.0])).deviance[:, 0]
    tried = _at(intervals, values, seen, points)
    for finer in range(1, _FINER + 1):
        best = np.take_along_axis(points, np.argmin(tried.deviance, axis=1)[:, None, None], axis=1)
        steps = np.array([odds[1] - odds[0], times[1] - times[0]]) * 0.5**finer
        points = best + _around(np.arange(-1.0, 2.0), np.arange(-1.0, 2.0)) * steps
        points[..., 1] = np.clip(points[..., 1], times[0], times[-1])
        tried = _at(intervals, values, seen, points)
    return [tried.best(i, points[i], float(alone[i])) for i in range(ny)]


def usual_offset(offsets: np.ndarray, stds: np.ndarray) -> float:
    """1-sigma of the offsets of all channels in all records, in units of their noise, by what most of them show. One
    that is off is no reason to expect it of the others. `stds` is how well each is known; NaN is none."""
    if not np.isfinite(stds).any():
        return 0.0
    scale = _MEDIAN_DEVIATION * float(np.nanmedian(np.abs(offsets)))
    return math.sqrt(max(scale**2 - float(np.nanmedian(stds)) ** 2, 0.0))


def _around(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(points, 2) all pairs."""
    return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Tried:
    """-2 ln L (ny, points) but for constants, and most likely variance; offset (R, ny, points) of every record, and its
    1-sigma, of those that have the channel (R, ny)."""

    deviance: np.ndarray
    level: np.ndarray
    offset: np.ndarray
    std: np.ndarray
    there: np.ndarray

    def best(self, i: int, points: np.ndarray, alone: float) -> WhiteAndSlow:
        at = int(np.argmin(self.deviance[i]))
        slow = float(self.level[i, at] / (1.0 + np.exp(-points[at, 0])))
        there = self.there[:, i]
        return WhiteAndSlow(
            white=(float(self.level[i, at]) - slow) ** 0.5,
            slow=slow**0.5,
            tau=float(np.exp(points[at, 1])),
            gain=max(alone - float(self.deviance[i, at]), 0.0),
            offsets=np.where(there, self.offset[:, i, at], np.nan),
            stds=np.where(there, self.std[:, i, at], np.nan),
        )


def _at(intervals: np.ndarray, values: np.ndarray, seen: np.ndarray, points: np.ndarray) -> _Tried:
    """At logarithms (ny, points, 2) of the odds of a slow share and of its correlation time: a Kalman filter of one
    state, side by side, for the values and for an offset of one."""
    share = 1.0 / (1.0 + np.exp(-points[..., 0]))
    white = 1.0 - share
    rate = np.exp(-points[..., 1])
    R = seen.shape[1]
    P = np.broadcast_to(share, (R, *share.shape)).copy()
    x = np.zeros((2, R, *share.shape))
    sums = np.zeros((3, R, *share.shape))
    logs = np.zeros((R, *share.shape))
    for k in range(len(values)):
        if k:
            told = np.exp(-intervals[k - 1][:, None, None] * rate)
            x *= told
            P = share + told**2 * (P - share)
        here = seen[k][..., None]
        F = P + white
        one = np.where(here, 1.0, 0.0)
        news = np.stack([np.where(here, values[k][..., None], 0.0) - one * x[0], one * (1.0 - x[1])])
        sums += np.stack([news[0] ** 2, news[0] * news[1], news[1] ** 2]) / F
        logs += one * np.log(F)
        gain = one * P / F
        x += gain * news
        P = P - gain * P
    there = seen.sum(axis=0) > 1
    information = np.where(there[..., None], sums[2], 1.0)
    offset = sums[1] / information
    squares = np.sum(np.where(there[..., None], sums[0] - sums[1] * offset, 0.0), axis=0)
    count = np.maximum(np.where(there, seen.sum(axis=0) - 1, 0).sum(axis=0), 1)[:, None]
    level = np.maximum(squares / count, 1e-300)
    determinant = np.sum(np.where(there[..., None], logs + np.log(information), 0.0), axis=0)
    deviance = count * np.log(level) + determinant
    return _Tried(deviance=deviance, level=level, offset=offset, std=np.sqrt(level / information), there=there)
