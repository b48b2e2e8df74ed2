"""What a round of naming found: the candidates, those that were fitted, and what each of them gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.flight.evaluation import FlightFit
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
    fit
        The whole fit, kept of a round's leader only.
    fingerprint
        Its whitened sensitivity, projected off the derivatives fitted beside it; none when refuted at once.
    gain
        What it gains, see `Gain`.
    where
        (N, R) part of the gain that is made at each sample; empty when refuted at once.
    share
        Its size in units of the smallest that matters; `meaningful` when it matters and is plausible.
    inflation
        Factor by which its gain, or where another leads what it is behind that, counts for less than it seems beside
        what the last model leaves (`naming.tempering`).
    check
        What kinematics say of it; `given_up` when they refuted it, or it could not fly, before it was fitted.
    """

    candidate: Candidate
    std: float
    fit: FlightFit | None
    fingerprint: np.ndarray
    gain: Gain
    where: np.ndarray
    meaningful: bool
    share: float
    inflation: float = 1.0
    check: KinematicCheck = KinematicCheck()
    given_up: bool = False

    @property
    def effect(self) -> Effect:
        return self.candidate.attached.effect

    @property
    def refuted(self) -> bool:
        """Whether kinematics contradict it, or do not see what they alone tell from forces."""
        return self.given_up or self.check.refuted or (self.effect.grounded and not self.check.seen)

    @property
    def confirmed(self) -> bool:
        """Whether kinematics find it with this size."""
        return self.check.confirmed


@dataclass(frozen=True, eq=False, kw_only=True)
class Round:
    """One round of naming: all candidates by predicted net gain, what was fitted of them, best first, which trials are
    equivalent to the first, and why the first was not accepted, "" if it was.

    detectable  name -> smallest size that would show; of the first round
    """

    candidates: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    equivalents: tuple[Trial, ...]
    named: bool
    doubt: str = ""
    detectable: Mapping[str, float] = field(default_factory=dict)

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

    @property
    def fitted(self) -> FlightFit:
        """The fit with the named cause. Raises ValueError for a round that named none."""
        if self.leader.fit is None:
            raise ValueError("this round named no cause")
        return self.leader.fit
