"""The kinematic check of a cause: whether the kinematics, which contain no aerodynamics, agree with its fitted size."""

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
    """Predicted and achieved decrease of the kinematic deviance by a cause of the size found in the full model.

    Both are zero for a cause that does not affect the kinematics. According to the kinematics the size is (1 + achieved
    / predicted) / 2 of the fitted one, with a standard deviation of 1 / sqrt(predicted) of it.

    Attributes
    ----------
    predicted
        Decrease of the deviance if the fitted size is correct.
    achieved
        Decrease of the deviance with the measured readings.
    criteria
        The thresholds.
    """

    predicted: float = 0.0
    achieved: float = 0.0
    criteria: KinematicCriteria = KinematicCriteria()

    @property
    def judges(self) -> bool:
        """Whether the cause is clearly visible in the kinematics."""
        return self.predicted > self.criteria.seen

    @property
    def gates(self) -> tuple[Gate, ...]:
        """The gates on a cause that is visible: the kinematics find enough of it, or do not contradict its size."""
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
        """The gates on a cause that only the kinematics can separate from forces."""
        return (
            at_least("predicted kinematic gain", self.predicted, self.criteria.faintly_seen, "kinematics.faintly_seen"),
            at_least("kinematic gain", self.achieved, 0.0),
        )

    @property
    def refuted(self) -> bool:
        """Whether the kinematics reject the cause: they do not find it, or oppose one that is only faintly visible."""
        return not all_passed(self.gates)

    @property
    def confirmed(self) -> bool:
        """Whether the kinematics find the cause with about the same size."""
        larger = self._elsewhere and self.achieved > self.criteria.larger * self.predicted
        return self.judges and self.achieved > self.criteria.confirmed * self.predicted and not larger

    @property
    def smaller(self) -> bool:
        """Whether the kinematics find a smaller size."""
        return self.achieved < self.predicted

    @property
    def doubtful(self) -> bool:
        """Whether the cause is visible but not found with its size."""
        return self.judges and not self.confirmed

    @property
    def gain(self) -> float:
        """Decrease of the kinematic deviance at the size that the kinematics find; zero for a cause that they cannot
        judge.
        """
        return (self.predicted + self.achieved) ** 2 / (4.0 * self.predicted) if self.judges else 0.0

    @property
    def _elsewhere(self) -> bool:
        """Whether the size according to the kinematics is clearly different."""
        return self.judges and self._contradiction > self.criteria.contradiction

    @property
    def _contradiction(self) -> float:
        """Chi-square between the sizes according to the kinematics and to the full model."""
        return (self.predicted - self.achieved) ** 2 / (4.0 * self.predicted)


def kinematic_check(kinematic: Evidence | None, one: Attached) -> KinematicCheck:
    """The check of a fitted cause.

    It is empty without kinematic evidence, for a cause that does not affect the kinematics, and for turbulence.
    """
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
    """The check of an effect that is not linear in its size, by a fit of the kinematics that starts at the fitted size.

    A linearisation at zero cannot predict the effect of a long delay on a reading.
    """
    try:
        found = kinematics.again(without, [*without.attached, one])
    except InputError:  # at this size no motion agrees with the readings, and the kinematics cannot judge
        return KinematicCheck(criteria=without.criteria.kinematics)
    size, gain, criteria = one.values["value"], without.deviance - found.deviance, without.criteria.kinematics
    part = found[one.name] / size
    if gain <= 0.0:
        # If the size stays, its 1-sigma is no measure: the deviance may be just as insensitive down to zero.
        stays = part > criteria.smallest_part
        predicted = -gain / part**2 if stays else (size / found.std(one.name)) ** 2
        return KinematicCheck(predicted=predicted, achieved=-predicted, criteria=criteria)
    predicted = gain / part**2
    return KinematicCheck(predicted=predicted, achieved=predicted * (2.0 * part - 1.0), criteria=criteria)


def worth_fitting(kinematic: Evidence | None, one: Attached) -> Gate | None:
    """The gate on a cause before it is fitted: the kinematics find enough of it at half of its predicted size.

    Half is the smallest part that is tried. At x times the predicted size the kinematics predict x^2 `predicted` and
    achieve x (achieved + predicted) - x^2 predicted. A cause that is rejected at one half is therefore rejected at any
    larger size. The result is None if the kinematics cannot judge the cause.
    """
    if one.effect.timed or not one.effect.linear:
        return None
    whole = kinematic_check(kinematic, one)
    by = whole.criteria
    predicted = by.smallest_part**2 * whole.predicted
    achieved = by.smallest_part * (whole.achieved + whole.predicted) - predicted
    if predicted <= by.seen:
        return None
    return at_least("found by kinematics at half its size", achieved / predicted, by.refuted, "kinematics.refuted")
