"""Readings that are late by a fitted time, compared with the state that they speak of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.system import Model


def lateness(attached: Sequence[Attached], flight: Flight, model: Model) -> np.ndarray:
    """(R, ny) by how many samples a reading is late: it is compared with the state that it speaks of."""
    outputs, records = model.outputs, flight.records
    late = np.zeros((len(records), len(outputs)), dtype=int)
    for one in (a for a in attached if a.effect.late):
        rows = [outputs.index(c) for c in flight.channels_of(one.effect) if c in outputs]
        for j, record in enumerate(records):
            late[j, rows] += round(one.values["value"] / record.dt) if one.concerns(record.name) else 0
    return np.maximum(late, 0)


def earlier(series: np.ndarray, late: np.ndarray) -> np.ndarray:
    """(N, R, ny, ...) series of readings moved to the time of what they speak of; zero at the end."""
    moved = series.copy()
    for j, i in np.argwhere(late):
        k = min(late[j, i], len(series))
        moved[: len(series) - k, j, i], moved[len(series) - k :, j, i] = series[k:, j, i], 0
    return moved


def as_read(late: np.ndarray, series: np.ndarray) -> np.ndarray:
    """(N, R, ny, ...) series of a fit, in which readings that are `late` stand at the time of what they speak of, with
    each reading at the time at which it was made."""
    if not late.any():
        return series
    moved = series.copy()
    for j, i in np.argwhere(late):
        k = min(late[j, i], len(series))
        moved[k:, j, i], moved[:k, j, i] = series[: len(series) - k, j, i], 0
    return moved
