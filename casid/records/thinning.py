"""Fewer samples: for a quick look, or as many as the motion needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casid.records.record import Record


def thinned(record: Record, rate_hz: float) -> Record:
    """Every n-th sample, so that the rate comes as near to `rate_hz` as it can without falling below; nothing is
    filtered, so a motion above half of that rate appears at a wrong frequency."""
    step = max(1, int(1.0 / (record.dt * rate_hz) + 1e-6))
    channels = {name: values[::step] for name, values in record.channels.items()}
    return replace(record, t=record.t[::step], channels=channels)


def averaged(record: Record, every: int) -> Record:
    """The means of `every` samples after each other, at the mean of their times; missing where a sample is. Motion of
    frequency f loses the share (pi f every dt)^2 / 6 of its amplitude; samples at the end that fill no mean are left
    out."""
    if every == 1:
        return record
    whole = len(record) // every * every

    def means(values: np.ndarray) -> np.ndarray:
        return values[:whole].reshape(-1, every).mean(axis=1)

    channels = {name: means(values) for name, values in record.channels.items()}
    return replace(record, t=means(record.t), channels=channels)


def spaced(t: np.ndarray, values: np.ndarray, spacing: float) -> np.ndarray:
    """(N,) True at the first sample that is there (not NaN) of every interval of `spacing` [s] from the beginning."""
    there = np.flatnonzero(np.isfinite(values))
    _, first = np.unique(np.floor((t[there] - t[0]) / spacing + 1e-6), return_index=True)
    kept = np.zeros(len(t), dtype=bool)
    kept[there[first]] = True
    return kept
