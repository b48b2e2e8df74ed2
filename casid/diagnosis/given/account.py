"""The account of the error on held-out records: its size as given, and the share that each step removes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from casid.diagnosis.criteria import GivenCriteria
from casid.diagnosis.given.budget import Budget

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
