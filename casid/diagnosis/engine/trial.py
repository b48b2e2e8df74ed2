"""Result of one round of the search: the candidates, the fitted ones, and their likelihood-ratio statistics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from casid.diagnosis.cause import IN_A_SET, NAMED, NOT_TRIED, REFUSED, Decision, Gate, all_passed
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.kinematics.check import KinematicCheck
from casid.model.effect import Effect


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Likelihood-ratio statistic of a cause, with its corrections in the order in which they are applied.

    Attributes
    ----------
    raw
        Decrease of the deviance with the cause and all values fitted. The model discrepancy has the scale that is left
        beside the cause.
    price
        Selection penalty for the places, shapes and records that were tried; subtracted in `net`.
    spared
        Statistic of the model discrepancy that the cause makes unnecessary; added in `total`.
    exact
        The statistic without model discrepancy. It is an independent second value and part of no sum.
    """

    raw: float
    price: float
    spared: float
    exact: float

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
    """A cause that was fitted, or rejected before the fit; its values and statistics are then the predicted ones.

    Attributes
    ----------
    candidate
        The cause with its fitted values.
    std
        Standard deviation of its value.
    fingerprint
        (N R ny,) Its whitened sensitivity less the projection on the parameters fitted beside it; empty if it was not
        fitted.
    gain
        Its likelihood-ratio statistic, see `Gain`.
    share
        Its size, in units of the smallest size that matters.
    size
        The gates on its size; it is `meaningful` if all passed.
    enough
        The gate on its likelihood-ratio statistic; None if it was not fitted.
    inflation
        Factor by which correlated residuals of the final model reduce its statistic, or reduce its distance from the
        leader (`acceptance.tempered`).
    check
        The kinematic check.
    given_up
        The gate that it failed before the fit; None if it was fitted.
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
    def decisive_gain(self) -> float:
        """The statistic that decides whether it is named: of a term, with the discrepancy that it makes unneeded."""
        return self.gain.total if self.effect.regressor else self.gain.net

    @property
    def meaningful(self) -> bool:
        """Whether its size matters, and is clear and possible."""
        return self.given_up is None and all_passed(self.size)

    @property
    def not_refuted(self) -> tuple[Gate, ...]:
        """The gates of the kinematic check, and of being fitted at all.

        An instrument that the kinematics contain must be seen there: aerodynamics imitate a small fault of any reading.
        """
        before = () if self.given_up is None else (self.given_up,)
        must_be_seen = self.effect.grounded or (self.effect.of_an_instrument and self.check.predicted > 0.0)
        return (*before, *self.check.gates, *(self.check.must_be_seen if must_be_seen else ()))

    @property
    def refuted(self) -> bool:
        """Whether the kinematic check rejects it, or cannot see a cause that only the kinematics can separate from
        forces.
        """
        return not all_passed(self.not_refuted)

    @property
    def gates(self) -> tuple[Gate, ...]:
        """All gates on the cause alone."""
        return (*self.not_refuted, *self.size, *(() if self.enough is None else (self.enough,)))

    @property
    def confirmed(self) -> bool:
        """Whether the kinematic check finds it with this size."""
        return self.check.confirmed


@dataclass(frozen=True, eq=False, kw_only=True)
class Round:
    """One round of the search.

    Attributes
    ----------
    candidates
        All candidates, by predicted net score statistic.
    trials
        The fitted ones, best first.
    equivalents
        The trials that are equivalent to the first.
    named
        Whether the first trial was named.
    screened
        Name of a candidate that was not fitted -> its gates.
    accepted_by
        The gates on accepting the first trial, by what was missing before and after it.
    ranked
        Name of an alternative -> its gate for being in one ambiguity set with the first trial.
    detectable
        Name -> smallest detectable size; only in the first round.
    """

    candidates: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    equivalents: tuple[Trial, ...]
    named: bool
    screened: Mapping[str, tuple[Gate, ...]] = field(default_factory=dict)
    accepted_by: tuple[Gate, ...] = ()
    ranked: Mapping[str, Gate] = field(default_factory=dict)
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
            Decision(cause=name, round=number, outcome=NOT_TRIED, gates=gates)
            for name, gates in self.screened.items()
            if name not in seen
        ]
        return (*tried, *others)

    def _decision(self, trial: Trial, number: int) -> Decision:
        name, leads = trial.candidate.name, trial is self.trials[0]
        first = () if leads or name not in self.ranked else (self.ranked[name],)
        gates = (*trial.gates, *first, *(self.accepted_by if leads else ()))
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
        """The trial that explains most, whether it was named or not. Raises ValueError if the round fitted no cause."""
        if not self.trials:
            raise ValueError("this round fitted no cause")
        return self.trials[0]

    @property
    def rivals(self) -> tuple[Trial, ...]:
        """The other trials, best first."""
        return self.trials[1:]
