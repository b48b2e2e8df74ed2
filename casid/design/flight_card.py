"""A flight card: what the pilot or the autopilot moves and when, what to expect, and what ends the manoeuvre."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from casid.design.experiment import Experiment
from casid.keeping import plain
from casid.records.record import Record
from casid.signals import for_a_person, unit_of

_STILL = 0.01  # of the range of an input: smaller changes are none
_MOVING = 0.5  # of the samples: a motion that is not made of steps
_READ = 24  # steps that a person can fly by reading; a sum of sines has more
_DIGITS = 6


@dataclass(frozen=True, kw_only=True)
class Movement:
    """The inputs from a time [s] on, as changes from trim in `FlightCard.units`."""

    t: float
    change: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Expected:
    """The least and the largest change of a channel from trim, and the change that ends the manoeuvre; NaN if none."""

    channel: str
    least: float
    most: float
    limit: float


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightCard:
    """The card of a designed manoeuvre.

    Attributes
    ----------
    trim
        Channel -> its value before the manoeuvre, in `units`.
    units
        Channel -> unit for a person.
    movements
        Where the inputs change; empty for a motion that is not made of steps, which an autopilot flies from `command`.
    duration
        Length of the manoeuvre [s].
    expected
        Changes of the channels that are measured or limited.
    command
        (N, 1 + inputs) time [s] and the change of each input from trim, in `units`.
    inputs
        Names of the inputs that move.

    Examples
    --------
    After the example of `standard_3211`:

    >>> from casid.design.flight_card import flight_card
    >>> card = flight_card(design.record, experiment)
    >>> card.inputs, card.movements[0].t
    (('u',), 0.0)
    """

    trim: Mapping[str, float]
    units: Mapping[str, str]
    movements: tuple[Movement, ...]
    duration: float
    expected: tuple[Expected, ...]
    command: np.ndarray
    inputs: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the entry `card` of design.json."""
        return {
            **plain(self, "trim units"),
            "movements": [{"t": one.t, **one.change} for one in self.movements],
            "duration_s": self.duration,
            "expected": [
                {"channel": one.channel, "unit": self.units[one.channel], "change": [one.least, one.most]}
                | ({"limit": one.limit} if np.isfinite(one.limit) else {})
                for one in self.expected
            ],
        }

    def to_csv(self) -> str:
        """Return the command for an autopilot: time, and the change of each input from trim in the unit of its head."""
        head = ",".join(["t_s", *(f"{name}_change_{_word(self.units[name])}" for name in self.inputs)])
        rows = [",".join(f"{value:.{_DIGITS}g}" for value in row) for row in self.command]
        return "\n".join([head, *rows]) + "\n"


def flight_card(record: Record, experiment: Experiment) -> FlightCard:
    """Return the card of a manoeuvre of an experiment.

    Parameters
    ----------
    record
        Inputs and expected outputs, as `design_input` gives them.
    experiment
        What it was designed for, with its limits.
    """
    inputs = tuple(name for name in experiment.surfaces if name in record and np.ptp(record[name]) > 0.0)
    shown = [name for name in dict.fromkeys([*experiment.limits, *experiment.noise]) if name in record]
    scales = {name: for_a_person(unit_of(name)) for name in (*inputs, *shown)}
    t = record.t - record.t[0]
    change = {name: scales[name][0] * (record[name] - experiment.rest[name]) for name in inputs}
    command = np.column_stack([t, *change.values()]) if inputs else t[:, None]
    steps = _steps(np.column_stack(list(change.values()))) if inputs else np.zeros(0, dtype=int)
    movements = [Movement(t=float(t[k]), change={n: float(u[k]) for n, u in change.items()}) for k in steps]
    return FlightCard(
        trim={name: float(scale[0] * record[name][0]) for name, scale in scales.items()}
        | {name: float(scales[name][0] * experiment.rest[name]) for name in inputs},
        units={name: scale[1] for name, scale in scales.items()},
        movements=tuple(movements) if len(movements) <= _READ else (),
        duration=float(t[-1]),
        expected=tuple(_expected(name, record, experiment, scales[name][0]) for name in shown),
        command=command,
        inputs=inputs,
    )


def _steps(change: np.ndarray) -> np.ndarray:
    """Return the samples at which inputs (N, inputs) have reached another level; none where they hardly rest."""
    still = _STILL * np.max(np.abs(change), axis=0)
    moves = np.any(np.abs(np.diff(change, axis=0)) > still, axis=1)
    if moves.mean() > _MOVING:
        return np.zeros(0, dtype=int)
    begins = np.flatnonzero(moves) + 1
    reached = [k for k in begins if k == len(change) - 1 or not moves[k]]
    first = [0] if np.any(np.abs(change[0]) > still) else []
    return np.array([*first, *reached], dtype=int)


def _expected(name: str, record: Record, experiment: Experiment, factor: float) -> Expected:
    change = factor * (record[name] - record[name][0])
    limit = factor * experiment.limits.get(name, np.nan)
    low, high = (float(end(change)) for end in (np.min, np.max))
    return Expected(channel=name, least=low, most=high, limit=float(limit))


def _word(unit: str) -> str:
    """Return a unit as a part of a name."""
    return "".join(c if c.isalnum() else "_" for c in unit) or "1"
