"""Manoeuvres in a record, by the input that moves: where each begins and ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from types import MappingProxyType

import numpy as np

from casid.records.noise import high_band_sigma
from casid.records.record import Record
from casid.signals import GRAVITY, SURFACES


@dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """Rule by which a manoeuvre is found in a record: the inputs that begin it, whether it is the `free` response
    after these have come to rest, and whether it is `slow`, as a phugoid: then one period of it must fit. Without
    inputs its time must be given."""

    inputs: tuple[str, ...] = ()
    free: bool = False
    slow: bool = False


MANOEUVRES: Mapping[str, Manoeuvre] = MappingProxyType(
    {
        "elevator input": Manoeuvre(inputs=("delta_e",)),
        "aileron input": Manoeuvre(inputs=("delta_a",)),
        "rudder input": Manoeuvre(inputs=("delta_r",)),
        "power change": Manoeuvre(inputs=("thrust",)),
        "phugoid": Manoeuvre(inputs=("delta_e",), free=True, slow=True),
        "longitudinal free response": Manoeuvre(inputs=("delta_e",), free=True),
        "lateral free response": Manoeuvre(inputs=("delta_a", "delta_r"), free=True),
        "configuration change": Manoeuvre(),
        "any": Manoeuvre(),
    }
)
_INPUTS = (*SURFACES, "thrust")
_LEAD_S = 1.0  # before the first movement: gives the state from which the simulation starts
_SHORTEST_S = 2.0  # of a response that is judged
_STEP_S = 0.5  # in which a movement must become visible
_SIGMAS = 6.0  # of noise, beyond which a change is a movement
_SHARE = 0.1  # of the range of an input, likewise
_OTHERS = 0.05  # of the largest range of a surface, likewise
# of the thrust, likewise, within as many seconds
_POWER = 0.1
_POWER_STEP_S = 2.0


@dataclass(frozen=True, kw_only=True)
class Window:
    """A manoeuvre in a record: from `start` to `end`, its `begin` between them, all on the clock of the record [s].

    The simulation starts at `start`; `begin` is the first movement of the input, or where a free response begins;
    `rest` is how long the input rests before the end.
    """

    start: float
    begin: float
    end: float
    rest: float

    def part_of(self, record: Record) -> Record:
        """Return the samples of the window, both ends with it."""
        return record.between(self.start, np.nextafter(self.end, np.inf))


def windows(record: Record, manoeuvre: str, before_s: float = 0.0) -> tuple[Window, ...]:
    """Find where a manoeuvre is flown: one input moves, and no other until the end. The simulation starts `before_s`
    before that, where the inputs rest for so long, and 1 s at least."""
    how = MANOEUVRES[manoeuvre]
    runs = _runs(record)
    shortest = max(_SHORTEST_S, _phugoid_period(record) if how.slow else 0.0)
    found = []
    for k, (name, first, last) in enumerate(runs):
        end = runs[k + 1][1] if k + 1 < len(runs) else float(record.t[-1])
        begin = last if how.free else first
        if name not in how.inputs or end - begin < shortest:
            continue
        earliest = max(float(record.t[0]), min(runs[k - 1][2] if k else -np.inf, begin - _LEAD_S))
        start = begin if how.free else max(begin - max(_LEAD_S, before_s), earliest)
        found.append(Window(start=start, begin=begin, end=end, rest=end - last))
    return tuple(found)


def window_between(record: Record, manoeuvre: str, start: float, end: float) -> Window:
    """A window that the user gives; its manoeuvre begins where an input of it first moves, if one does."""
    how = MANOEUVRES[manoeuvre]
    inside = [run for run in _runs(record) if run[0] in how.inputs and start <= run[1] < end]
    moves = [last if how.free else first for _, first, last in inside]
    last = min(inside[-1][2], end) if inside else start
    return Window(start=start, begin=next((at for at in moves if at < end), start), end=end, rest=end - last)


def _phugoid_period(record: Record) -> float:
    """Lanchester's estimate pi sqrt(2) V / g [s] (Aerodonetics, 1908); infinite where no airspeed is measured."""
    if "V" not in record or not np.isfinite(record["V"]).any():
        return np.inf
    return float(np.pi * np.sqrt(2.0) * np.nanmedian(record["V"]) / GRAVITY)


def _runs(record: Record) -> list[tuple[str, float, float]]:
    """(input, first, last movement) of consecutive movements of one input, in the order of time."""
    spans = [span for name in _INPUTS if name in record for span in _movements(record, name)]
    in_order = sorted(spans, key=itemgetter(1))
    runs = [list(run) for _, run in groupby(in_order, key=itemgetter(0))]
    return [(run[0][0], run[0][1], run[-1][2]) for run in runs]


def _movements(record: Record, name: str) -> list[tuple[str, float, float]]:
    """Spans in which an input leaves the value that it had a moment ago, by more than its noise, a part of its range
    and what `_least` asks."""
    t = record.t
    values = record[name]
    if not np.isfinite(values).all() or np.ptp(values) == 0.0:
        return []
    sigma = high_band_sigma(values)
    step_s = _POWER_STEP_S if name == "thrust" else _STEP_S
    visible = max(_SHARE * float(np.ptp(values)), _SIGMAS * (sigma if np.isfinite(sigma) else 0.0))
    back = np.searchsorted(t, t - step_s)
    moving = np.abs(values - values[back]) > max(visible, _least(record, name))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving.astype(int), [0]])))
    spans = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        # seen for `step_s` after it is over: it ends where the value is last off that which it then keeps
        kept = values[back[after - 1] : after]
        off = np.flatnonzero(np.abs(kept - kept[-1]) > visible)
        last = t[back[after - 1] + (off[-1] + 1 if len(off) else 0)]
        spans.append((name, float(t[max(first - 1, 0)]), float(last)))
    return spans


def _least(record: Record, name: str) -> float:
    """Return the least size of a movement: thrust is compared with its own level, a surface with the movements of
    the others, which a pilot who moves one of them makes with it."""
    if name == "thrust":
        return _POWER * float(np.median(np.abs(record[name])))
    ranges = [np.ptp(record[other]) for other in SURFACES if other in record and np.isfinite(record[other]).all()]
    return _OTHERS * float(max(ranges))
