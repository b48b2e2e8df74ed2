"""What a cause of any dynamic system is, and a cause with its value: how it changes a model and its records.

A cause enters a model in symbols (`CandidateCause.change`), so that the engine fits it like any parameter. An operator
on an input has no symbols: the record gets the input as the operator leaves it and its slope with the value, and the
fit goes back and forth until the value stays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from casid.records.record import Record

Change = Callable[[Any, Any, Any], None]  # (model under change, value, flag)
Operator = Callable[[np.ndarray, np.ndarray, float], np.ndarray]  # (t, series, value) -> series


@dataclass(frozen=True, kw_only=True)
class Run:
    """One record as a model explains it: time stamps [s], inputs as they act and readings by name, each (N,), and what
    each term of the library is along it."""

    t: np.ndarray
    inputs: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]
    terms: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateCause:
    """One thing that may be wrong with a simulation.

    port       disturbance at which its history enters; None: it enters as the parameter `target` does
    size       what its value is, for sentences and tables
    grid       values that are tried, with the 1-sigma about each; empty: it enters linearly, its null is 0
    everywhere it may be in all records;  somewhere  it may be in some of them
    onset      it begins within a record
    late       it delays a reading: its record says what a series of two terms leaves along the motion
    history    (run, value) -> (N,) at its port; of a linear one for a value of 1
    operator   of an operator on an input: what it makes of it; `slope_over` the part of its value for its slope
    change     of all others: how it enters the model, `casid.diagnosis.systems.extended.Draft`
    sentence   template with fields target, term, size, where
    """

    kind: str
    target: str
    term: str | None = None
    unit: str = ""
    port: str | None
    grid: tuple[tuple[float, float], ...] = ()
    everywhere: bool = True
    somewhere: bool = False
    onset: bool = False
    late: bool = False
    history: Callable[[Run, float], np.ndarray] | None = None
    operator: Operator | None = None
    slope_over: float = 0.0
    change: Change | None = None
    sentence: str

    @property
    def name(self) -> str:
        """Name of its parameter in a model and in tables."""
        return f"{self.kind}({self.target}:{self.term})" if self.term else f"{self.kind}({self.target})"


@dataclass(frozen=True, eq=False, kw_only=True)
class PartOfModel:
    """A cause in a model.

    value          where the fit begins
    centre, spread what is believed of it before: a point of its grid, or 0, and the 1-sigma about that
    matters        the value from which one that enters linearly matters
    records        names of those that have it; empty: all
    onset_s        record -> time [s] from which it is there
    left           record -> (N,) what the series of a delayed reading leaves
    log_prior      of the odds that it is there in this shape
    """

    cause: CandidateCause
    value: float
    spread: float
    centre: float
    matters: float = 1.0
    records: tuple[str, ...] = ()
    onset_s: Mapping[str, float] = field(default_factory=dict)
    left: Mapping[str, np.ndarray] = field(default_factory=dict)
    log_prior: float

    @property
    def name(self) -> str:
        return self.cause.name

    @property
    def rest(self) -> str | None:
        """Channel with what is left of a delayed reading."""
        return f"rest[{self.name}]" if self.cause.late else None

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the model needs of a record for it."""
        return tuple(name for name in (self.slope, self.rest, self.flag) if name is not None)

    @property
    def flag(self) -> str | None:
        """Channel that is 1 where it is there; None when it is everywhere."""
        return f"there[{self.name}]" if self.records or self.onset_s else None

    @property
    def slope(self) -> str | None:
        """Channel with the slope of its operator."""
        return f"slope[{self.name}]" if self.cause.operator else None

    def at(self, value: float) -> PartOfModel:
        """The same with another value."""
        return replace(self, value=float(value))

    def prepared(self, record: Record) -> Record:
        """The record with what the extended model needs of it: an operator's input, its slope, the flag."""
        if self.cause.operator is not None:
            u, step = record[self.cause.target], self.cause.slope_over * abs(self.value)
            at, above, below = (self.cause.operator(record.t, u, self.value + d) for d in (0.0, step, -step))
            slope = (above - below) / (2.0 * step)
            return record.with_channels(**{self.cause.target: at - self.value * slope, str(self.slope): slope})
        if self.rest is not None:
            record = record.with_channels(**{self.rest: self.left.get(record.name, np.zeros(len(record)))})
        return record if self.flag is None else record.with_channels(**{self.flag: self._there(record)})

    def _there(self, record: Record) -> np.ndarray:
        if record.name in self.onset_s:
            return (record.t >= self.onset_s[record.name]).astype(float)
        concerned = record.name in self.records if self.records else not self.onset_s
        return np.full(len(record), float(concerned))

    def stated(self, value: float, size: str) -> str:
        """What it is, in a sentence."""
        where = f" in {', '.join(self.records)}" if self.records else ""
        if self.onset_s:
            where = " in " + ", ".join(f"{name} from {onset:.3g} s" for name, onset in self.onset_s.items())
        way = "late" if value > 0.0 else "early"
        return self.cause.sentence.format(
            target=self.cause.target, term=self.cause.term, size=size, where=where, way=way
        )
