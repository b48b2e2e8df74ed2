"""What kinematics, which know no aerodynamics, say of a cause of the size that the full model finds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.criteria import KinematicCriteria
from casid.diagnosis.decision import Gate, all_passed, at_least, at_most
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.fingerprints import fingerprints, history, prints_of
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics import kinematics
from casid.errors import InputError


@dataclass(frozen=True, kw_only=True)
class KinematicCheck:
    """Drop of the kinematic deviance that a cause of the size found in the full model should make, and the drop that it
    makes; both zero of a cause that kinematics know nothing of.

    The size that kinematics find is (1 + achieved / predicted) / 2 of the cause's, with a 1-sigma of 1 /
    sqrt(predicted). What that means is by the `criteria`.
    """

    predicted: float = 0.0
    achieved: float = 0.0
    criteria: KinematicCriteria = KinematicCriteria()

    @property
    def judges(self) -> bool:
        """Whether kinematics could see it."""
        return self.predicted > self.criteria.seen

    @property
    def gates(self) -> tuple[Gate, ...]:
        """What a cause that kinematics can see must pass: they find enough of it, or do not contradict its size."""
        by = self.criteria
        if self.judges:
            fits = at_most("contradicted size", self._contradiction, by.contradiction, "kinematics.contradiction")
            found = self.achieved / self.predicted
            return (at_least("found by kinematics", found, by.refuted, "kinematics.refuted", [fits]),)
        if self.predicted <= by.faintly_seen:
            return ()
        agree = at_least("kinematic gain", self.achieved, 0.0)
        return (at_most("opposed by kinematics", self._contradiction, by.opposed, "kinematics.opposed", [agree]),)

    @property
    def must_be_seen(self) -> tuple[Gate, ...]:
        """What a cause must pass that only kinematics tell from forces."""
        return (
            at_least("predicted kinematic gain", self.predicted, self.criteria.faintly_seen, "kinematics.faintly_seen"),
            at_least("kinematic gain", self.achieved, 0.0),
        )

    @property
    def refuted(self) -> bool:
        """Whether they clearly do not find it, or find less than half of the little that they should see."""
        return not all_passed(self.gates)

    @property
    def confirmed(self) -> bool:
        """Whether they find it, of about the same size."""
        larger = self._elsewhere and self.achieved > self.criteria.larger * self.predicted
        return self.judges and self.achieved > self.criteria.confirmed * self.predicted and not larger

    @property
    def smaller(self) -> bool:
        """Whether they find it of a smaller size."""
        return self.achieved < self.predicted

    @property
    def doubtful(self) -> bool:
        """Whether they could see it, and do not find it of its size."""
        return self.judges and not self.confirmed

    @property
    def gain(self) -> float:
        """Drop of their deviance at the size that they find; none of what they cannot judge."""
        return (self.predicted + self.achieved) ** 2 / (4.0 * self.predicted) if self.judges else 0.0

    @property
    def _elsewhere(self) -> bool:
        """Whether the size by kinematics is clearly another one."""
        return self.judges and self._contradiction > self.criteria.contradiction

    @property
    def _contradiction(self) -> float:
        """Chi-square of the size by kinematics against that of the full model."""
        return (self.predicted - self.achieved) ** 2 / (4.0 * self.predicted)


def kinematic_check(kinematic: Evidence | None, one: Attached) -> KinematicCheck:
    """The check of a fitted cause; without kinematic evidence, or of moving air that is a process, none."""
    effect = one.effect
    if kinematic is None or not effect.kinematic or effect.stochastic:
        return KinematicCheck()
    if not effect.linear:
        return _fitted_check(kinematic.fit, one)
    size, judge, names = one.values["value"], Screen(kinematic), kinematic.fit.batch.names
    if effect.timed:
        parts = prints_of(kinematic, effect, [history(kinematic.fit, one.with_values({"value": 1.0}))])
    else:
        further = {key: v for key, v in one.values.items() if key != "value"}
        parts = fingerprints(kinematic, [replace(effect, grid=(further,))])
    left, match, _ = judge.projected(parts, np.array([[float(one.concerns(name)) for name in names]]))
    return KinematicCheck(
        predicted=size**2 * left,
        achieved=2.0 * size * match - size**2 * left,
        criteria=kinematic.criteria.kinematics,
    )


def _fitted_check(without: FlightFit, one: Attached) -> KinematicCheck:
    """The check of an effect that is not linear in its size, fitted to the kinematics from the size of the full model
    on. No tangent at zero predicts what a long delay does to a reading."""
    try:
        found = kinematics.again(without, [*without.attached, one])
    except InputError:  # of that size it makes readings that no motion can have: they cannot judge it
        return KinematicCheck(criteria=without.criteria.kinematics)
    size, gain, criteria = one.values["value"], without.deviance - found.deviance, without.criteria.kinematics
    part = found[one.name] / size
    if gain <= 0.0:
        # where it stays, its 1-sigma says nothing: the deviance may be as flat all the way to zero
        stays = part > criteria.smallest_part
        predicted = -gain / part**2 if stays else (size / found.std(one.name)) ** 2
        return KinematicCheck(predicted=predicted, achieved=-predicted, criteria=criteria)
    predicted = gain / part**2
    return KinematicCheck(predicted=predicted, achieved=predicted * (2.0 * part - 1.0), criteria=criteria)


def worth_fitting(kinematic: Evidence | None, one: Attached) -> Gate | None:
    """What a cause must pass before it is fitted: kinematics find enough of it at half of its predicted size, the
    smallest that is tried. With x times that size they expect x^2 `predicted` and get x (achieved + predicted) -
    x^2 predicted: what is refuted at one half is refuted at any larger size. None where they cannot judge it."""
    if one.effect.timed or not one.effect.linear:
        return None
    whole = kinematic_check(kinematic, one)
    by = whole.criteria
    predicted = by.smallest_part**2 * whole.predicted
    achieved = by.smallest_part * (whole.achieved + whole.predicted) - predicted
    if predicted <= by.seen:
        return None
    return at_least("found by kinematics at half its size", achieved / predicted, by.refuted, "kinematics.refuted")
