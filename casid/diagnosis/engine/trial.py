"""Result of one round of the search: the candidates, the fitted ones, and their likelihood-ratio statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from casid.diagnosis import comparisons as ask
from casid.diagnosis.cause import IN_A_SET, NAMED, NOT_TRIED, REFUSED, Decision
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.kinematics.check import KinematicCheck
from casid.model.effect import Effect


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Likelihood-ratio statistic of a cause, with its corrections in the order in which they are applied."""

    # decrease of the deviance with the cause and all values fitted. The model discrepancy has the scale that is left
    # beside the cause.
    raw: float
    price: float  # selection penalty for the places, shapes and records that were tried; subtracted in `net`
    spared: float  # statistic of the model discrepancy that the cause makes unnecessary; added in `total`
    exact: float  # the statistic without model discrepancy. It is an independent second value and part of no sum.

    @property
    def net(self) -> float:
        """The statistic that decides whether a cause is named, unless it is a term (`Trial.decisive_gain`)."""
        return self.raw - self.price

    @property
    def total(self) -> float:
        """The statistic that compares causes: a cause that makes model discrepancy unneeded leaves less to explain."""
        return self.net + self.spared


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """A cause that was fitted, or rejected before the fit; its values and statistics are then the predicted ones."""

    candidate: Candidate  # the cause with its fitted values
    std: float  # standard deviation of its value
    # (N R ny,) Its whitened sensitivity less the projection on the parameters fitted beside it; empty if it was not
    # fitted
    fingerprint: np.ndarray
    gain: Gain  # its likelihood-ratio statistic, see `Gain`
    share: float  # its size, in units of the smallest size that matters
    # name -> change of each value that was estimated beside it, against the model without it; empty if not fitted
    moved: Mapping[str, float] = field(default_factory=dict)
    size: tuple[Gate, ...] = ()  # the gates on its size; it is `meaningful` if all passed
    enough: Gate | None = None  # the gate on its likelihood-ratio statistic; None if it was not fitted
    # factor by which correlated residuals of the final model reduce its statistic, or reduce its distance from the
    # leader (`acceptance.tempered`)
    inflation: float = 1.0
    check: KinematicCheck = KinematicCheck()  # the kinematic check
    given_up: Gate | None = None  # the gate that it failed before the fit; None if it was fitted
    waits: bool = False  # not fitted because little is predicted of it beside what others reached

    @property
    def effect(self) -> Effect:
        return self.candidate.attached.effect

    @property
    def decisive_gain(self) -> float:
        """The statistic that decides whether it is named: of a term, with the discrepancy that it makes unneeded."""
        return self.gain.total if self.effect.regressor else self.gain.net

    @property
    def meaningful(self) -> bool:
        """Return True if its size matters, and is clear and possible."""
        return self.given_up is None and all_passed(self.size)

    @property
    def not_refuted(self) -> tuple[Gate, ...]:
        """The gates of the kinematic check, and of being fitted at all.

        An instrument that the kinematics contain must be seen there: aerodynamics imitate a small fault of any reading.
        """
        before = () if self.given_up is None else (self.given_up,)
        must_be_seen = self.effect.traits.grounded or (self.effect.of_an_instrument and self.check.predicted > 0.0)
        check = self.check
        if not must_be_seen:
            return (*before, *check.gates)
        least = check.criteria.significance.chance
        seen = ask.PREDICTED_BY_KINEMATICS.of(check.predicted, least, "significance.chance")
        return (*before, *check.gates, seen, ask.KINEMATIC_GAIN.of(check.achieved, 0.0))

    @property
    def refuted(self) -> bool:
        """Return True if the kinematic check rejects it, or cannot see a cause that only the kinematics can separate
        from forces."""
        return not all_passed(self.not_refuted)

    @property
    def gates(self) -> tuple[Gate, ...]:
        """All gates on the cause alone."""
        return (*self.not_refuted, *self.size, *(() if self.enough is None else (self.enough,)))

    def is_of(self, other: Trial) -> bool:
        """Return True if it is of the same cause in the same records; it may have been fitted beside others."""
        one = self.candidate
        same = other.candidate
        return one.name == same.name and one.attached.records == same.attached.records

    @property
    def confirmed(self) -> bool:
        """Return True if the kinematic check finds it with this size."""
        return self.check.confirmed


@dataclass(frozen=True, eq=False, kw_only=True)
class Round:
    """One round of the search."""

    candidates: tuple[Candidate, ...]  # all candidates, by predicted net score statistic
    trials: tuple[Trial, ...]  # the fitted ones, best first
    equivalents: tuple[Trial, ...]  # the trials that are equivalent to the first
    named: bool  # whether the first trial was named
    # name of a candidate that was not fitted -> its gates
    screened: Mapping[str, tuple[Gate, ...]] = field(default_factory=dict)
    # the gates on accepting the first trial, by what was missing before and after it
    accepted_by: tuple[Gate, ...] = ()
    refused_by: tuple[Gate, ...] = ()  # the gates by which the first trial was refused for good, after it was named
    # name of an alternative -> its gate for being in one ambiguity set with the first trial
    ranked: Mapping[str, Gate] = field(default_factory=dict)
    # names of causes that are predicted to reach a name, and for which no place was left
    waiting: frozenset[str] = frozenset()
    # name -> smallest detectable size; only in the first round
    detectable: Mapping[str, float] = field(default_factory=dict)

    @property
    def doubt(self) -> str:
        """Why the first trial was not accepted; "" if it was."""
        return next((gate.gate for gate in self.accepted_by if not gate.passed), "")

    def decisions(self, number: int) -> tuple[Decision, ...]:
        """The decisions on all candidates of this round, which has this `number`."""
        tried = [self._decision(trial, number) for trial in self.trials]
        seen = {one.cause for one in tried}
        others = [
            Decision(cause=name, round=number, outcome=NOT_TRIED, gates=failed)
            for name, failed in self.screened.items()
            if name not in seen
        ]
        return (*tried, *others)

    def _decision(self, trial: Trial, number: int) -> Decision:
        name = trial.candidate.name
        leads = trial is self.trials[0]
        first = () if leads or name not in self.ranked else (self.ranked[name],)
        asked = (*trial.gates, *first, *((*self.accepted_by, *self.refused_by) if leads else ()))
        outcome = IN_A_SET if any(one.is_of(trial) for one in self.equivalents) else REFUSED
        against = [one.candidate.name for one in self.equivalents] if leads else [self.trials[0].candidate.name]
        return Decision(
            cause=name,
            round=number,
            outcome=NAMED if leads and self.named else outcome,
            gates=asked,
            against=tuple(dict.fromkeys(against)),
            statistic=trial.gain.raw,
        )

    @property
    def leader(self) -> Trial:
        """The trial that explains most, whether it was named or not. Raises ValueError if the round fitted no cause."""
        if not self.trials:
            raise ValueError("this round fitted no cause")
        return self.trials[0]

    @property
    def rivals(self) -> tuple[Trial, ...]:
        """The other trials, best first."""
        return self.trials[1:]


def refused_rounds(rounds: Sequence[Round]) -> tuple[Round, ...]:
    """The rounds of a set that was refused; one that passes its own gates is refused for those that do not."""
    failed = [one.leader.candidate.name for one in rounds if one.doubt]
    of_set = (ask.NONE_REFUSED.of(len(failed), 0.0, where=f" ({', '.join(failed)})"),)
    return tuple(
        replace(one, named=False, refused_by=one.refused_by if one.doubt or not one.named else of_set) for one in rounds
    )
