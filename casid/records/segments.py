"""Manoeuvres in a long record: stretches in which surfaces move far more than they do between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from casid.keeping import by_fields
from casid.records.channel_ranges import gaps
from casid.records.checks import MIN_DURATION, MIN_SAMPLES
from casid.records.given import given_record
from casid.records.noise import pooled_sigma
from casid.records.record import Record
from casid.signals import DEGREE, unit_of

_SURFACE_AXES = {"delta_e": "pitch", "delta_a": "roll", "delta_r": "yaw"}
# axis by what moves: surfaces, or their commands in a log, or the rates of an aircraft that has neither, as of rotors
_MOVERS: tuple[Mapping[str, str], ...] = (
    _SURFACE_AXES,
    {f"{surface}_command": axis for surface, axis in _SURFACE_AXES.items()},
    {"p": "roll", "q": "pitch", "r": "yaw"},
)
AXES: Mapping[str, str] = {name: axis for movers in _MOVERS for name, axis in movers.items()}
_RATES: Mapping[str, str] = {"pitch": "q", "roll": "p", "yaw": "r"}
_WINDOW = 1.0  # s: over which activity is measured; inputs of flight tests have steps of 0.2 to 2 s
_TREND = 15.0  # s: slower changes of a surface are trim
# quantiles of activity between and in manoeuvres
_QUIET = 0.2
_PEAK = 0.995
_DISTINCT = 5.0  # peak over quiet activity from which manoeuvres stand out
# r.m.s. activity that excites nothing: of a surface, of a command of which 1 is full, of a rate
_SMALLEST = {"rad": 0.2 * DEGREE, "": 0.01, "rad/s": 2.0 * DEGREE}
_NOISE = 3.0  # 1-sigmas of noise that quiet activity is at least
# s: shorter rests are within a manoeuvre; kept before and after it
_JOINED = 3.0
_BEFORE = 1.0
_AFTER = 4.0


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A manoeuvre in a long record.

    Attributes
    ----------
    start, stop
        Times [s] as `Record.between` takes them.
    axes
        "pitch", "roll" and "yaw", those whose surface moves.
    surfaces
        Surface -> r.m.s. deflection [rad] about its mean; or a command -> of 1, or a rate -> [rad/s].
    rates
        Rate of rotation -> its range [rad/s], of those recorded.

    Examples
    --------
    >>> import casid as cs
    >>> one = cs.segments("casid/cli/demo/m1.csv")[0]
    >>> one.axes, one.stop > one.start
    (('pitch', 'roll', 'yaw'), True)
    """

    start: float
    stop: float
    axes: tuple[str, ...]
    surfaces: Mapping[str, float]
    rates: Mapping[str, float]

    @property
    def duration(self) -> float:
        """Time [s] from start to stop."""
        return self.stop - self.start

    to_dict = by_fields


def segments(record: Record | str | Path) -> tuple[Segment, ...]:
    """Find the manoeuvres in a long record by the excitation of each axis.

    It is measured by the surfaces, or in a log by their commands; of an aircraft with neither, as of rotors, its rates.

    The activity of a surface is its r.m.s. deflection over 1 s, without changes of trim. A manoeuvre is where it is
    above the geometric mean of its quiet and its largest level, where these are a factor of 5 apart. A surface that
    always moves alike, as under an autopilot in gusts, has none.

    Parameters
    ----------
    record
        A record, or the name of its file. Pauses in its time part manoeuvres.

    Returns
    -------
    tuple of Segment
        In the order of time, 1 s before the first movement to 4 s after the last one.

    Raises
    ------
    InputError
        As `read_record`.

    Examples
    --------
    >>> record = casid.read_record("log.bin", "map.toml")  # doctest: +SKIP
    >>> parts = [record.between(one.start, one.stop) for one in casid.segments(record)]  # doctest: +SKIP
    """
    record = given_record(record, "segments")
    read = [name for name, values in record.channels.items() if np.isfinite(values).any()]
    movers = next((found for some in _MOVERS if (found := [name for name in some if name in read])), [])
    moving = {name: _moves(record, name) for name in movers}
    spans = _joined(record, np.logical_or.reduce(list(moving.values()))) if moving else []
    found = [_segment(record, moving, start, stop) for start, stop in spans]
    return tuple(one for one in found if one is not None)


def _moves(record: Record, name: str) -> np.ndarray:
    """(N,) whether a surface moves as in a manoeuvre."""
    activity = surface_activity(record, name)
    noise = float(np.nan_to_num(pooled_sigma([record[name]])))
    quiet = max(float(np.quantile(activity, _QUIET)), _NOISE * noise)
    peak = float(np.quantile(activity, _PEAK))
    level = np.sqrt(max(quiet, peak / _DISTINCT**2) * peak)
    if peak < max(_SMALLEST[unit_of(name)], _DISTINCT * quiet):
        return np.zeros(len(record), dtype=bool)
    return activity > level


def surface_activity(record: Record, name: str) -> np.ndarray:
    """(N,) r.m.s. deflection [rad] of a surface over a second, without changes of trim."""
    there = np.isfinite(record[name])
    even = np.interp(_clock(record), record.t[there], record[name][there])
    trend = scipy.ndimage.median_filter(even, _odd(_TREND / record.dt), mode="nearest")
    square = scipy.ndimage.uniform_filter1d((even - trend) ** 2, _odd(_WINDOW / record.dt), mode="nearest")
    return np.interp(record.t, _clock(record), np.sqrt(np.maximum(square, 0.0)))


def _clock(record: Record) -> np.ndarray:
    return np.arange(record.t[0], record.t[-1] + 0.5 * record.dt, record.dt)


def _odd(samples: float) -> int:
    return max(3, round(samples) | 1)


def _joined(record: Record, moving: np.ndarray) -> list[tuple[float, float]]:
    """Begin and end [s] of manoeuvres: movements less than some seconds apart are one, pauses of the time part them."""
    at = np.flatnonzero(moving)
    if not len(at):
        return []
    t = record.t
    parts = np.flatnonzero(np.diff(record.t[at]) > _JOINED)
    first = np.concatenate([[0], parts + 1])
    last = np.concatenate([parts, [len(at) - 1]])
    edges = [float(t[0]), *(edge for pause in gaps(record) for edge in pause), float(t[-1]) + record.dt]
    spans = []
    for a, b in zip(t[at[first]], t[at[last]], strict=True):
        low = max(edge for edge in edges if edge <= a)
        high = min(edge for edge in edges if edge > b)
        start = max(float(a) - _BEFORE, low)
        stop = min(float(b) + _AFTER, high)
        if (
            spans
            and start <= spans[-1][1]
            and not any(spans[-1][1] <= x <= start for pause in gaps(record) for x in pause)
        ):
            spans[-1] = spans[-1][0], stop
        else:
            spans.append((start, stop))
    return spans


def _segment(record: Record, moving: Mapping[str, np.ndarray], start: float, stop: float) -> Segment | None:
    """The manoeuvre between two times; None of one that is too short."""
    inside = (record.t >= start) & (record.t < stop)
    if inside.sum() < MIN_SAMPLES or stop - start < MIN_DURATION:
        return None
    surfaces = {name: float(np.nanstd(record[name][inside])) for name, at in moving.items() if at[inside].any()}
    axes = tuple(AXES[name] for name in surfaces)
    rates = {
        r: float(np.nanmax(x) - np.nanmin(x))
        for r in _RATES.values()
        if r in record and np.isfinite(x := record[r][inside]).any()
    }
    return Segment(start=start, stop=stop, axes=axes, surfaces=surfaces, rates=rates)
