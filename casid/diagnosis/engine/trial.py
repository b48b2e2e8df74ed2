"""What a round of the search found: the candidates, those that were fitted, and what each of them gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from casid.diagnosis.decision import IN_A_SET, NAMED, NOT_TRIED, REFUSED, Decision, Gate, all_passed
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.kinematics.check import KinematicCheck
from casid.model.effect import Effect


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Drop of the deviance (2 ln L) that a cause brings, and what is taken off it or added to it, in this order.

    Attributes
    ----------
    raw
        With the cause and all values fitted, small terms of the structure allowed for as they are left beside it.
    price
        Taken off for the places, shapes and records that were tried: `net`.
    spared
        Added for the small terms of the structure that are not needed any more beside it: `total`.
    exact
        Instead of all these, with the structure taken as exact; a second opinion, in no sum with the others.
    """

    raw: float
    price: float
    spared: float
    exact: float

    @property
    def net(self) -> float:
        """What decides whether a cause is named."""
        return self.raw - self.price

    @property
    def total(self) -> float:
        """What compares causes with each other: one that spares small terms leaves less to explain."""
        return self.net + self.spared

    def and_further(self, more: float) -> Gain:
        """With what a fit to the end gained besides."""
        return replace(self, raw=self.raw + more)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """A cause that was fitted, or refuted at once; then its values, gain and 1-sigma are the predicted ones.

    Attributes
    ----------
    candidate
        With the fitted values; `std` of its value.
    fingerprint
        Its whitened sensitivity, projected off the derivatives fitted beside it; none when refuted at once.
    gain
        What it gains, see `Gain`.
    share
        Its size in units of the smallest that matters.
    size
        What its size had to pass; `meaningful` when it passed all.
    enough
        What its gain had to pass to be named; None when it was not fitted.
    inflation
        Factor by which its gain, or where another leads what it is behind that, counts for less than it seems beside
        what the last model leaves (`comparison.tempered`).
    check
        What kinematics say of it.
    given_up
        The gate that it failed before it was fitted, None when it was fitted.
    """

    candidate: Candidate
    std: float
    fingerprint: np.ndarray
    gain: Gain
    share: float
    size: tuple[Gate, ...] = ()
    enough: Gate | None = None
    inflation: float = 1.0
    check: KinematicCheck = KinematicCheck()
    given_up: Gate | None = None

    @property
    def effect(self) -> Effect:
        return self.candidate.attached.effect

    @property
    def meaningful(self) -> bool:
        """Whether its size matters, is clear and possible."""
        return self.given_up is None and all_passed(self.size)

    @property
    def not_refuted(self) -> tuple[Gate, ...]:
        """What it had to pass by kinematics, and to be fitted at all."""
        before = () if self.given_up is None else (self.given_up,)
        return (*before, *self.check.gates, *(self.check.must_be_seen if self.effect.grounded else ()))

    @property
    def refuted(self) -> bool:
        """Whether kinematics contradict it, or do not see what they alone tell from forces."""
        return not all_passed(self.not_refuted)

    @property
    def gates(self) -> tuple[Gate, ...]:
        """Everything that it had to pass by itself."""
        return (*self.not_refuted, *self.size, *(() if self.enough is None else (self.enough,)))

    @property
    def confirmed(self) -> bool:
        """Whether kinematics find it with this size."""
        return self.check.confirmed


@dataclass(frozen=True, eq=False, kw_only=True)
class Round:
    """One round of the search.

    Attributes
    ----------
    candidates
        All candidates by predicted net gain.
    trials
        What was fitted of them, best first.
    equivalents
        The trials that are equivalent to the first.
    screened
        Name of a candidate that was not fitted -> its gates.
    believed
        What the first trial had to pass to be accepted beside what was missing before and after it.
    ranked
        Name of a rival -> what it had to pass to stand beside the first trial.
    detectable
        Name -> smallest size that would show; of the first round.
    """

    candidates: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    equivalents: tuple[Trial, ...]
    named: bool
    screened: Mapping[str, tuple[Gate, ...]] = field(default_factory=dict)
    believed: tuple[Gate, ...] = ()
    ranked: Mapping[str, Gate] = field(default_factory=dict)
    detectable: Mapping[str, float] = field(default_factory=dict)

    @property
    def doubt(self) -> str:
        """Why its first trial was not accepted, "" if it was."""
        return next((gate.gate for gate in self.believed if not gate.passed), "")

    def decisions(self, number: int) -> tuple[Decision, ...]:
        """What was decided of every candidate in this round, the `number` of which is given."""
        tried = [self._decision(trial, number) for trial in self.trials]
        seen = {one.cause for one in tried}
        others = [
            Decision(cause=name, round=number, outcome=NOT_TRIED, gates=gates)
            for name, gates in self.screened.items()
            if name not in seen
        ]
        return (*tried, *others)

    def _decision(self, trial: Trial, number: int) -> Decision:
        name, leads = trial.candidate.name, trial is self.trials[0]
        first = () if leads or name not in self.ranked else (self.ranked[name],)
        gates = (*trial.gates, *first, *(self.believed if leads else ()))
        outcome = IN_A_SET if any(one is trial for one in self.equivalents) else REFUSED
        against = [one.candidate.name for one in self.equivalents] if leads else [self.trials[0].candidate.name]
        return Decision(
            cause=name,
            round=number,
            outcome=NAMED if leads and self.named else outcome,
            gates=gates,
            against=tuple(dict.fromkeys(against)),
        )

    @property
    def leader(self) -> Trial:
        """The cause that explains best, named or not. Raises ValueError for a round that fitted none."""
        if not self.trials:
            raise ValueError("this round fitted no cause")
        return self.trials[0]

    @property
    def rivals(self) -> tuple[Trial, ...]:
        """The other causes that were fitted, best first."""
        return self.trials[1:]
