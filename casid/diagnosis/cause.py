"""A cause as a diagnosis tells it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from casid.diagnosis.decision import Gate
from casid.model.vocabulary import effect_title


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """A named cause, or one that is real but minor.

    Attributes
    ----------
    std
        1-sigma of the value, small terms of the structure and unlike stretches of record allowed for.
    statistic
        Drop of the deviance (2 ln L) when it is added and everything is fitted again, `dof` its parameters; the model
        without it is given no more nonlinear coefficients than are left beside it.
    held_out_gain
        Log likelihood per sample gained on records never used; None for an event, which does not recur.
    onset_s
        Record -> interval [s] that contains the onset with 95 % probability, for a cause that sets in.
    share
        Its part of the variation of the coefficient it adds to, or of its smallest size that matters.
    gates
        What it had to pass, beside all others and on held-out records, to be named.
    probability
        That it, or one of what it cannot be told from, is there; `alone` that it itself is; `log_odds` against
        everything that does without it.
    """

    kind: str
    target: str
    term: str | None
    value: float
    std: float
    unit: str
    records: tuple[str, ...]
    onset_s: Mapping[str, tuple[float, float]] | None
    statistic: float
    dof: int
    held_out_gain: float | None
    indistinguishable_from: tuple[Mapping[str, Any], ...]
    sentence: str
    parameters: Mapping[str, float]
    meaningful: bool
    share: float
    gates: tuple[Gate, ...] = ()
    probability: float | None = None
    alone: float | None = None
    log_odds: float | None = None

    @property
    def key(self) -> tuple[str, str, str | None]:
        """Kind, target and term."""
        return self.kind, self.target, self.term

    @property
    def statement(self) -> str:
        """Its sentence, and what these data cannot tell it apart from."""
        titles = (effect_title(one["kind"], one["target"], one["term"]) for one in self.indistinguishable_from)
        others = dict.fromkeys(titles)  # variants of a kind have one title
        alike = f" These data cannot tell that apart from {' or '.join(others)}." if others else ""
        return self.sentence + alike
