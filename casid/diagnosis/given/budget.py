"""The error budget: the error on held-out records after each step from the file as given to the best model.

as given -> data corrected -> values of the file -> structure (causes) -> unexplained -> noise. A step that makes a
channel worse is a loss in the budget.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.diagnosis.criteria import GivenCriteria
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import View, view_of
from casid.errors import InputError
from casid.filtering.initial_state import measured_start
from casid.model.applied import values_of
from casid.model.effects import effect_of
from casid.native.processors import side_by_side
from casid.records.record import Record
from casid.signals import label_of
from casid.views import view


@dataclass(frozen=True, kw_only=True)
class BudgetSteps:
    """R.m.s. of measured minus simulated after each step, in units of the channel's noise, which itself is 1. The
    difference between `structure` and `noise` is unexplained. Infinite if a simulation diverges.
    """

    as_given: float
    data_mended: float
    values: float
    structure: float
    noise: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Channel -> its steps in open-loop simulation of `records`, which no fit has seen; and those of all channels
    together, root mean square over the channels. `labels` are words for channels, where these are an aircraft's."""

    records: tuple[str, ...]
    channels: Mapping[str, BudgetSteps]
    together: BudgetSteps
    labels: Mapping[str, str] = field(default_factory=dict)

    def plot(self) -> Any:
        """The steps of every channel as a waterfall, worst as given first.

        Returns a matplotlib figure, which pyplot has: a notebook shows it, and `plt.show()`.
        """
        return view("budget.plot")(self)

    def to_dict(self) -> dict[str, Any]:
        """`budget` of diagnosis.json."""
        return {
            "records": list(self.records),
            "channels": {name: asdict(steps) for name, steps in self.channels.items()},
            "all": asdict(self.together),
        }


def budget_of(given: AsGiven, values: View, structure: View) -> Budget:
    """The budget on held-out records of the file as given, and of the simulations with re-estimated `values` and with
    extended `structure`.
    """
    views = {"as_given": given.held, "data_mended": given.mended[1], "values": values, "structure": structure}
    shared = [name for name in given.held.channels if all(name in view.channels for view in views.values())]
    channels = {
        name: BudgetSteps(**{step: _in_noise(view, name, structure) for step, view in views.items()}) for name in shared
    }
    together = {
        one.name: math.sqrt(math.fsum(getattr(steps, one.name) ** 2 for steps in channels.values()) / len(channels))
        for one in fields(BudgetSteps)
    }
    labels = {} if given.held.fit.flight.sizes else {name: label_of(name) for name in shared}
    return Budget(records=given.held.records, channels=channels, together=BudgetSteps(**together), labels=labels)


def _in_noise(view: View, channel: str, best: View) -> float:
    """Error in units of the noise of the best model. Noise that is estimated from residuals differs between fits."""
    return view.channels[channel].rms / best.channels[channel].noise


_WORDS = MappingProxyType(
    {"data": "correction of data", "values": "re-estimation of values", "structure": "added structure"}
)


@dataclass(frozen=True, kw_only=True)
class AccountStep:
    """One step from the simulation as given to the noise.

    Attributes
    ----------
    step
        "data", "values", "structure", "unexplained" or "noise".
    before, after
        Error on the held-out records before and after it, r.m.s. over all channels in units of their noise.
    share
        Part of the error as given that it takes away; negative where it adds to the error.
    what
        Its contributions in words, the largest first.
    """

    step: str
    before: float
    after: float
    share: float
    what: tuple[str, ...] = ()

    @property
    def percent(self) -> int:
        """Its share in per cent; zero where there is none."""
        return round(100.0 * self.share) if math.isfinite(self.share) else 0

    def to_dict(self) -> dict[str, Any]:
        """One entry of `account` in diagnosis.json."""
        return {"step": self.step, "from": self.before, "to": self.after, "share": self.share, "what": [*self.what]}


def account_of(budget: Budget, what: Mapping[str, Sequence[str]]) -> tuple[AccountStep, ...]:
    """The steps of a budget, the largest share first and the noise last; `what` has the contributions of each step."""
    steps = budget.together
    levels = {
        "data": (steps.as_given, steps.data_mended),
        "values": (steps.data_mended, steps.values),
        "structure": (steps.values, steps.structure),
        "unexplained": (steps.structure, min(steps.noise, steps.structure)),
        "noise": (min(steps.noise, steps.structure), 0.0),
    }
    whole = steps.as_given if math.isfinite(steps.as_given) and steps.as_given > 0.0 else math.nan
    found = [
        AccountStep(
            step=name, before=before, after=after, share=(before - after) / whole, what=tuple(what.get(name, ()))
        )
        for name, (before, after) in levels.items()
    ]
    *taken, noise = found
    return (*sorted(taken, key=lambda one: -one.share if math.isfinite(one.share) else math.inf), noise)


def account_sentence(budget: Budget, account: Sequence[AccountStep], most: int) -> str:
    """The sentence of the account: the error as given, the share of each step, and the rest. `most` is the largest
    number of contributions that are listed for each step.
    """
    steps, where = budget.together, f"On {', '.join(budget.records)}, which no fit has seen, the simulation as given"
    left = f"{steps.structure:.2g} times the noise is left"
    if not math.isfinite(steps.as_given):
        return f"{where} diverges; with the best model {left}."
    told = [one for one in account if one.step in _WORDS and one.percent]
    if not told:
        return f"{where} is off by {steps.as_given:.2g} times the noise."
    removing, adding = ([_part(one, most) for one in told if (one.share > 0.0) == less] for less in (True, False))
    parts = [f"{first} removes {percent} % of that" for first, percent in removing[:1]]
    parts += [f"{words} {percent} %" for words, percent in removing[1:]]
    parts += [f"{words} adds {percent} %" for words, percent in adding]
    opening = ", ".join(parts)
    return f"{where} is off by {steps.as_given:.2g} times the noise. {opening[0].upper()}{opening[1:]}; {left}."


def _part(one: AccountStep, most: int) -> tuple[str, int]:
    listed = ", ".join(one.what[:most]) + (", ..." if len(one.what) > most else "")
    return f"{_WORDS[one.step]}{f' ({listed})' if listed else ''}", abs(one.percent)


def failure_sentence(budget: Budget, criteria: GivenCriteria) -> str:
    """The sentence for a best model that is much worse on held-out records than the simulation as given; otherwise
    empty.
    """
    steps = budget.together
    if steps.structure <= criteria.fails * max(steps.as_given, steps.noise):
        return ""
    ratio = steps.structure / steps.as_given
    worse = f"{ratio:.2g}" if math.isfinite(ratio) else "infinitely many"
    return (
        f"The extended model fails on {', '.join(budget.records)}: its error there is {worse} times that of the "
        "simulation as given. No cause is named, and no re-estimated value should be used."
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class AsGiven:
    """Simulations by the unmodified file of the fitted and the held-out records, with the data corrected; and as they
    were `recorded`, where that differs."""

    mended: tuple[View, View]
    recorded: tuple[View, View] | None = None

    @property
    def fitted(self) -> View:
        """In the fitted records as they were recorded."""
        return (self.recorded or self.mended)[0]

    @property
    def held(self) -> View:
        """In the held-out records as they were recorded."""
        return (self.recorded or self.mended)[1]


def fly_as_given(flight: Flight, held: Sequence[Record], known: Sequence[Attached]) -> AsGiven:
    """Simulations of the fitted and the held-out records by the unmodified file; `known` are its own effects."""
    both = [flight, flight.with_records(flight.aircraft, held)]
    fitted, unseen = side_by_side(lambda one: _flown(one, known), both)
    return AsGiven(mended=(fitted, unseen))


def fly_recorded(
    flight: Flight, recorded: tuple[Sequence[Record], Sequence[Record]], known: Sequence[Attached]
) -> tuple[View, View] | None:
    """The same with the records before they were corrected; None if it cannot be simulated with these."""
    fitted, held = recorded
    try:
        return fly_as_given(flight.with_records(flight.aircraft, fitted), held, known).mended
    except InputError:
        return None


def attached_effects(flight: Flight) -> list[Attached]:
    """The effects of the aircraft file as parameters of the flight, to be fitted further."""
    found = []
    for value in flight.aircraft.effects:
        effect = effect_of(value)
        onsets = {r: 0.5 * (lo + hi) for r, (lo, hi) in (value.onset_s or {}).items() if r in flight.names}
        records = tuple(r for r in value.records if r in flight.names)
        elsewhere = not onsets if effect.timed else bool(value.records) and not records
        if not effect.stochastic and not elsewhere:
            values = effect.in_words(values_of(value, effect))  # a time constant below zero acts as its size does
            found.append(Attached(effect=effect, values=values, onsets=onsets, records=records))
    return found


def _flown(flight: Flight, known: Sequence[Attached]) -> View:
    view = view_of(_states(flight, known), _start(flight, known))
    return replace(view, fit=view.fit.lighter())


def _states(flight: Flight, known: Sequence[Attached]) -> FlightFit:
    return fit(flight, known, flight.noise(), free="states")


def _start(flight: Flight, known: Sequence[Attached]) -> np.ndarray | None:
    """(R, states) initial states: measured ones, and fits to the first seconds for the others; None if those seconds do
    not determine them.
    """
    window = flight.criteria.given.window
    parts = [record.between(record.t[0], record.t[0] + window) for record in flight.records]
    try:
        short = flight.with_records(flight.aircraft, parts)
        begun = _states(short, known)
    except InputError:
        return None
    beginning = flight.criteria.given.beginning
    return np.stack(
        [
            measured_start(begun.model, record, begun.motion.X[0, r], begun.parameters[r], beginning)
            for r, record in enumerate(short.records)
        ]
    )
