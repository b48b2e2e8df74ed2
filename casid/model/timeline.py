"""Rows of a record and of the events in it: a motion is integrated from row to row, and jumps at the events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casid.errors import check_known
from casid.model.system import Model
from casid.records.record import Record

_SAME = 1e-9  # of a sample interval: an event as near as that to a sample is at it


@dataclass(frozen=True, eq=False, kw_only=True)
class Timeline:
    """Times t (rows,) [s] of the samples and events of a record, and sample (N,), the row of each sample.

    `jumps` are (row, event) in the order in which they happen: the state at the row, and the reading there, come after.
    """

    t: np.ndarray
    sample: np.ndarray
    jumps: tuple[tuple[int, str], ...] = ()


def timeline(model: Model, record: Record) -> Timeline:
    """Return the times of a record and of the events that the model has; simultaneous events keep the order of their
    declaration."""
    found = [(float(t), name) for name in model.events for t in record.events.get(name, ())]
    if not found:
        return Timeline(t=record.t, sample=np.arange(len(record)))
    order = list(model.events)
    times = np.array([t for t, _ in found])
    nearest = record.t[np.abs(record.t[:, None] - times).argmin(axis=0)]
    times = np.where(np.abs(nearest - times) <= _SAME * record.dt, nearest, times)
    rows = np.unique(np.concatenate([record.t, times]))
    happens = zip(np.searchsorted(rows, times).tolist(), (order.index(name) for _, name in found), strict=True)
    jumps = tuple((row, order[i]) for row, i in sorted(happens))
    return Timeline(t=rows, sample=np.searchsorted(rows, record.t), jumps=jumps)


def between_samples(record: Record, line: Timeline, values: np.ndarray, held: np.ndarray | None = None) -> np.ndarray:
    """(rows, columns) of values (N, columns) at the samples: on straight lines, or those of the sample before where a
    column is held (columns,)."""
    if len(line.t) == len(record):
        return values
    last = np.clip(np.searchsorted(record.t, line.t, side="right") - 1, 0, len(record) - 2)
    share = (line.t - record.t[last]) / (record.t[last + 1] - record.t[last])
    straight = values[last] + share[:, None] * (values[last + 1] - values[last])
    straight[line.sample] = values
    if held is None or not held.any():
        return straight
    stays = values[np.searchsorted(record.t, line.t, side="right") - 1]
    return np.where(held, stays, straight)


def check_events(model: Model, records: Sequence[Record], where: str) -> None:
    """Raise InputError for an event of the records that the model does not have."""
    for record in records:
        check_known("event", record.events, model.events, f"{where}: record '{record.name}'")
