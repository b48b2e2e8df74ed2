"""Time stamps of any kind as seconds, and channels of several rates on one clock.

The clock of a record is that of its rows. What comes at a slower regular rate is put on it by straight lines between
its own samples, inputs only: a missing sample of an output takes no part in any cost. Irregular gaps stay gaps.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

_STAMP = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?", re.ASCII)
_EPOCH = 1e8  # s: later than this is a date (1973), not a time in a flight


def seconds_of(cell: str) -> float | None:
    """Seconds since 1970 of an ISO 8601 date and time, UTC where it names no zone; None for any other text."""
    if not _STAMP.fullmatch(cell):
        return None
    try:
        stamp = datetime.fromisoformat(cell.replace(",", "."))
    except ValueError:
        return None
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


def from_first(t: np.ndarray) -> tuple[np.ndarray, str]:
    """Time from the first sample where the stamps are dates, and the remark that says so; else as it is, and ""."""
    if not np.isfinite(t).all() or len(t) == 0 or abs(t[0]) < _EPOCH:
        return t, ""
    try:
        began = datetime.fromtimestamp(float(t[0]), UTC).isoformat(timespec="milliseconds")
    except (ValueError, OverflowError, OSError):
        return t, ""
    return t - t[0], f"time is counted from its first sample, {began}"


def on_one_clock(
    t: np.ndarray, channels: Mapping[str, np.ndarray], inputs: tuple[str, ...]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Channels with the inputs of a slower regular rate filled by straight lines, and a remark for each."""
    filled, notes = dict(channels), []
    for name in inputs:
        if name not in channels:
            continue
        stride = stride_of(channels[name])
        if stride > 1:
            there = np.isfinite(channels[name])
            filled[name] = np.interp(t, t[there], channels[name][there])
            notes.append(f"{name}: one sample in {stride} rows; straight lines between its samples are taken")
    return filled, notes


def stride_of(values: np.ndarray) -> int:
    """Every how many rows a channel has a sample: 1 when it has them all, 0 when its gaps are not regular."""
    there = np.flatnonzero(np.isfinite(values))
    if len(there) == len(values):
        return 1
    if len(there) < 3:
        return 0
    strides = np.diff(there)
    stride = int(strides[0])
    whole = (strides == stride).all() and there[0] < stride and len(values) - 1 - there[-1] < stride
    return stride if whole else 0
