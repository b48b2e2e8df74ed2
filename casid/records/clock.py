"""Time stamps of any kind as seconds, and channels of several rates on one clock.

The clock of a record is that of its rows. What comes at a slower regular rate is put on it by straight lines between
its own samples, inputs only: a missing sample of an output takes no part in any cost. Irregular gaps stay gaps.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime

import numpy as np

from casid.records.series import across_gaps

_DAY = 86400  # s
_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d\d):(?P<s>\d\d)(?:[.,:](?P<f>\d+))?\s?(?P<half>[AaPp][Mm])?"
_ZONE = r"\s?(?P<zone>Z|UTC|GMT|[+-]\d\d:?\d\d)?"
_STAMPS = tuple(
    re.compile(pattern, re.ASCII)
    for pattern in (
        r"(?P<y>\d{4})([-/.])(?P<o>\d{1,2})\2(?P<d>\d{1,2})[T ,]\s?" + _CLOCK + _ZONE,
        r"(?P<y>\d{4})[-/.](?P<o>\d{1,2})[-/.](?P<d>\d{1,2})[T ](?P<h>\d\d):(?P<m>\d\d)" + _ZONE,
        r"(?P<y>\d{4})(?P<o>\d\d)(?P<d>\d\d)T?(?P<h>\d\d)(?P<m>\d\d)(?P<s>\d\d)[.,](?P<f>\d+)" + _ZONE,
        r"(?P<first>\d{1,2})([./-])(?P<second>\d{1,2})\2(?P<y>\d{4}|\d\d)[T ,]\s?" + _CLOCK + _ZONE,
        r"((?P<y>\d{4})[-:])?(?P<n>\d{3})[:T -](?P<h>\d\d):(?P<m>\d\d):(?P<s>\d\d)([.,](?P<f>\d+))?" + _ZONE,
        _CLOCK,
        r"(?P<m>\d{1,3}):(?P<s>\d\d)[.,](?P<f>\d+)",
    )
)
# a number is a date where it gives a time from 1990 to 2100 in one of these units [s], at steps of a measurement
_EPOCH = (6.3e8, 4.1e9)
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LONGEST_STEP = 100.0  # s


def seconds_of(cell: str, day_first: bool = False) -> float | None:
    """Seconds of a date and time (since 1970, UTC where it names no zone), of a clock (since midnight), or of a day of
    the year with its clock (IRIG); None for any other text. `day_first`: of two numbers that may be day or month."""
    text = cell.strip()
    match = next((found for stamp in _STAMPS if (found := stamp.fullmatch(text))), None)
    if match is None:
        return None
    part = {key: value for key, value in match.groupdict().items() if value is not None}
    hours = int(part.get("h", 0))
    if "half" in part:
        hours = hours % 12 + (12 if part["half"].lower() == "pm" else 0)
    minutes = int(part.get("m", 0))
    seconds = int(part.get("s", 0))
    if hours > 24 or (minutes > 59 and "h" in part) or seconds > 60:
        return None
    day = _day(part, day_first)
    fraction = part.get("f", "")
    if day is None:
        return None
    whole = day + 3600 * hours + 60 * minutes + seconds - _offset(part.get("zone", ""))
    return (whole * 10 ** len(fraction) + int(fraction or 0)) / 10 ** len(fraction)  # correctly rounded


def _day(part: Mapping[str, str], day_first: bool) -> int | None:
    """Seconds from 1970, or from the beginning of the year, to the day of a stamp; 0 of a clock alone."""
    year = int(part.get("y", 1970))
    year += 0 if year > 99 else 2000
    if "n" in part:
        return _DAY * ((date(year, 1, 1) - date(1970, 1, 1)).days + int(part["n"]) - 1)
    if "y" not in part:
        return 0
    day, month = (part["d"], part["o"]) if "d" in part else (part["second"], part["first"])
    if "first" in part and (day_first or int(month) > 12):
        day, month = month, day
    try:
        return _DAY * (date(year, int(month), int(day)) - date(1970, 1, 1)).days
    except ValueError:
        return None


def _offset(zone: str) -> int:
    if zone in ("", "Z", "UTC", "GMT"):
        return 0
    return (1 if zone[0] == "+" else -1) * (3600 * int(zone[1:3]) + 60 * int(zone[-2:]))


def clock_of(cells: Sequence[str]) -> np.ndarray | None:
    """(N,) seconds of a column of dates or clocks, on over midnight; None where a cell is none. Of two orders of day
    and month the one with the shorter record is taken."""
    found: list[np.ndarray] = []
    for day_first in (False, True):
        if cells and seconds_of(cells[0], day_first) is None:
            continue
        seconds = [seconds_of(cell, day_first) for cell in cells]
        if None not in seconds:
            found.append(np.array(seconds, dtype=float))
    if not found:
        return None
    shortest = min(found, key=np.ptp)
    back = np.diff(shortest, prepend=shortest[:1]) < -0.5 * _DAY
    return shortest + _DAY * np.cumsum(back) if shortest[0] < _DAY else shortest


def from_first(t: np.ndarray, stated: bool) -> tuple[np.ndarray, str]:
    """Time from the first sample where the stamps are dates, and the remark on that; else as it is, and "". Dates
    are in s, ms, us or ns since 1970, by their size; in s where the unit is `stated`."""
    if not np.isfinite(t).all() or len(t) < 2:
        return t, ""
    step = float(np.median(np.diff(t)))
    for unit, factor in (UNITS if not stated else {"s": 1.0}).items():
        if _EPOCH[0] < t[0] * factor < _EPOCH[1] and step * factor < LONGEST_STEP:
            began = datetime.fromtimestamp(float(t[0]) * factor, UTC).isoformat(timespec="milliseconds")
            known = "" if unit == "s" else f" (its stamps are {unit} since 1970)"
            return (t - t[0]) * factor, f"time is counted from its first sample, {began}{known}"
    return t, ""


def on_one_clock(
    t: np.ndarray, channels: Mapping[str, np.ndarray], inputs: tuple[str, ...]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Channels with the inputs of a slower regular rate filled by straight lines, and a remark for each."""
    filled = dict(channels)
    notes = []
    for name in inputs:
        if name not in channels:
            continue
        stride = stride_of(channels[name])
        if stride > 1:
            filled[name] = across_gaps(t, channels[name])
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
