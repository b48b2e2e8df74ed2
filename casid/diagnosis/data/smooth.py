"""A record as the relations between its channels see it: smooth values and rates at one set of instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.data.criteria import DataCriteria
from casid.records.checks import INPUTS
from casid.records.record import Record

_ANGLES = ("psi",)


@dataclass(frozen=True, eq=False, kw_only=True)
class Smooth:
    """Smoothed channels of a record.

    values, rates  channel -> (N,) mean over a Hann window, and its slope per second of the record's time
    known          channel -> (N,) whether enough samples of the window are there
    independent    number of independent samples of a smoothed series: windows in the record
    density        [kg/m3] where neither density nor altitude is recorded; None where nothing says it
    """

    name: str
    t: np.ndarray
    values: Mapping[str, np.ndarray]
    rates: Mapping[str, np.ndarray]
    known: Mapping[str, np.ndarray]
    independent: float
    density: float | None = None

    def __contains__(self, channel: str) -> bool:
        return channel in self.values

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])


def smooth(record: Record, window: float, criteria: DataCriteria, density: float | None = None) -> Smooth:
    """The record on a uniform grid of its median interval, every channel by a mean over a `window` [s]."""
    dt = record.dt
    count = max(criteria.fewest, min(round(window / dt), len(record) // criteria.windows)) | 1
    weights = np.hanning(count + 2)[1:-1]
    weights /= weights.sum()
    t = np.arange(record.t[0], record.t[-1] + 0.5 * dt, dt)
    values, rates, known = dict[str, np.ndarray](), dict[str, np.ndarray](), dict[str, np.ndarray]()
    for name, series in record.channels.items():
        good = np.isfinite(series)
        if good.sum() < max(criteria.fewest, len(series) // 10) or len(t) < 2 * count:
            continue
        there = np.unwrap(series[good]) if name in _ANGLES else series[good]
        even = np.interp(t, record.t[good], there)
        values[name] = np.convolve(np.pad(even, count // 2, mode="edge"), weights, mode="valid")
        rates[name] = np.gradient(values[name], dt)
        own = max(dt, float(np.median(np.diff(record.t[good]))))  # of a slower channel
        nearest = np.abs(t - record.t[good][_nearest(record.t[good], t)]) < 0.75 * own
        known[name] = np.ones(len(t), dtype=bool) if name in INPUTS else _share(nearest, count) >= criteria.present
        known[name][: count // 2], known[name][-(count // 2) :] = False, False
    every = slice(None, None, max(1, count // criteria.instants))
    kept = ({name: series[every] for name, series in table.items()} for table in (values, rates, known))
    values, rates, known = kept
    independent = max(2.0, len(t) / count)
    return Smooth(
        name=record.name,
        t=t[every],
        values=values,
        rates=rates,
        known=known,
        independent=independent,
        density=density,
    )


def _nearest(sorted_times: np.ndarray, t: np.ndarray) -> np.ndarray:
    after = np.clip(np.searchsorted(sorted_times, t), 1, len(sorted_times) - 1)
    return np.where(t - sorted_times[after - 1] < sorted_times[after] - t, after - 1, after)


def _share(there: np.ndarray, count: int) -> np.ndarray:
    return np.convolve(there.astype(float), np.ones(count) / count, mode="same")
