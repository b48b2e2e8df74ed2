"""The kinematic check of a cause: whether the kinematics, which contain no aerodynamics, agree with its fitted size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casid.diagnosis import comparisons as ask
from casid.diagnosis import gates
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.fingerprints import print_of
from casid.diagnosis.evidence.missing_input import drifts
from casid.diagnosis.evidence.nuisance import SKEWED, demanded_skews
from casid.diagnosis.evidence.onsets import at_peak
from casid.diagnosis.evidence.screening import Candidate, Screen, screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_slow_as_left, is_far
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.gates import is_possible
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.turbulence import Turbulence, gusts, still_air, turbulence
from casid.errors import InputError
from casid.model.effect import Effect


@dataclass(frozen=True, kw_only=True)
class KinematicCheck:
    """Predicted and achieved decrease of the kinematic deviance by a cause of the size found in the full model.

    Both are zero for a cause that does not affect the kinematics. According to the kinematics the size is (1 + achieved
    / predicted) / 2 of the fitted one, with a standard deviation of 1 / sqrt(predicted) of it.
    """

    predicted: float = 0.0  # decrease of the deviance if the fitted size is correct
    achieved: float = 0.0  # decrease of the deviance with the measured readings
    criteria: Criteria = Criteria()  # the thresholds

    @property
    def judges(self) -> bool:
        """Return True if the cause is clearly visible in the kinematics."""
        return self.predicted > self.criteria.significance.search

    @property
    def gates(self) -> tuple[Gate, ...]:
        """The gates on a cause that is visible: the kinematics find enough of it, or do not contradict its size."""
        return gates.seen_by_kinematics(self.predicted, self.achieved, self.criteria)

    @property
    def refuted(self) -> bool:
        """Return True if the kinematics reject the cause: they do not find it, or oppose one that is only faintly
        visible."""
        return not all_passed(self.gates)

    @property
    def confirmed(self) -> bool:
        """Return True if the kinematics find the cause with about the same size: most of it, or what their noise
        leaves."""
        if not self.judges:
            return False
        least = self.criteria.parts.most
        apart = gates.contradiction(self.predicted, self.achieved)
        larger = self._elsewhere and least * self.achieved > self.predicted
        by_noise = self.achieved > 0.0 and apart <= self.criteria.significance.chance
        return (self.achieved > least * self.predicted or by_noise) and not larger

    @property
    def smaller(self) -> bool:
        """Return True if the kinematics find a smaller size."""
        return self.achieved < self.predicted

    @property
    def doubtful(self) -> bool:
        """Return True if the cause is visible but not found with its size."""
        return self.judges and not self.confirmed

    @property
    def gain(self) -> float:
        """Decrease of the kinematic deviance at the size that the kinematics find; zero for a cause that they cannot
        judge.
        """
        return (self.predicted + self.achieved) ** 2 / (4.0 * self.predicted) if self.judges else 0.0

    @property
    def _elsewhere(self) -> bool:
        """Return True if the size according to the kinematics is clearly different."""
        return self.judges and gates.contradiction(self.predicted, self.achieved) > self.criteria.significance.search


def kinematic_check(kinematic: Evidence | None, one: Attached) -> KinematicCheck:
    """The check of a fitted cause.

    It is empty without kinematic evidence, for a cause that does not affect the kinematics, and for turbulence.
    """
    effect = one.effect
    if kinematic is None or not effect.kinematic or effect.stochastic:
        return KinematicCheck()
    if not effect.linear:
        return _fitted_check(kinematic.fit, one)
    size, (print_, keep) = one.values["value"], print_of(kinematic, one)
    left, match, _ = Screen(kinematic).projected([print_], keep[None])
    return KinematicCheck(
        predicted=size**2 * left,
        achieved=2.0 * size * match - size**2 * left,
        criteria=kinematic.criteria,
    )


def _fitted_check(without: FlightFit, one: Attached) -> KinematicCheck:
    """The check of an effect that is not linear in its size, by a fit of the kinematics that starts at the fitted size.

    A linearisation at zero cannot predict the effect of a long delay on a reading.
    """
    try:
        found = kinematics.again(without, [*without.attached, one])
    except InputError:  # at this size no motion agrees with the readings, and the kinematics cannot judge
        return KinematicCheck(criteria=without.criteria)
    size = one.values["value"]
    gain = without.deviance - found.deviance
    criteria = without.criteria
    part = found[one.name] / size
    if gain <= 0.0:
        # If the size stays, its 1-sigma is no measure: the deviance may be just as insensitive down to zero.
        stays = part > criteria.parts.half
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
    part = whole.criteria.parts.half
    predicted = part**2 * whole.predicted
    achieved = part * (whole.achieved + whole.predicted) - predicted
    if predicted <= whole.criteria.significance.search:
        return None
    return ask.WORTH_FITTING.of(achieved / predicted, whole.criteria.parts.third, "parts.third")


@dataclass(frozen=True, eq=False, kw_only=True)
class KinematicFindings:
    """Result of the kinematic stage."""

    # evidence with forces left free, in turbulence if there is any; None if the records do not allow that
    evidence: Evidence | None
    ranked: list[Candidate]  # instrument and air causes, ranked with this evidence
    turbulence: Turbulence  # whether the air is turbulent
    # small errors of instruments to be added before the search; empty in turbulence, which they would imitate
    nuisance: list[Attached]


def no_kinematics(subject: Subject, offsets: Sequence[Attached] = ()) -> KinematicFindings:
    """The result without a kinematic stage, with small `offsets` of instruments."""
    return KinematicFindings(evidence=None, ranked=[], turbulence=still_air(subject), nuisance=list(offsets))


def judge_kinematics(
    flight: Subject, known: Sequence[Attached], offsets: Sequence[Attached], refitted: FlightFit
) -> KinematicFindings:
    """Run the kinematic stage, with the effects `known` by the file and small `offsets` of instruments.

    Turbulence must also move the aircraft according to the `refitted` file in calm air.
    """
    if not kinematics.available(flight):
        return no_kinematics(flight, offsets)
    of_the_file = [one for one in known if one.effect.kinematic]
    nuisance = list[Attached]()
    calm = kinematics.reconstruct(flight, of_the_file)
    turbulent = turbulence(flight, calm)
    if turbulent.named:
        turbulent = _with_faults(flight, turbulent, calm, _observable(flight, of_the_file))
    if turbulent.named and not moves_the_aircraft(turbulent, refitted):
        turbulent = still_air(flight)
    if turbulent.named:
        moving = gusts(flight, turbulent.sigma, length=turbulent.length)
        found = kinematics.reconstruct(flight, of_the_file, moving, calm)
    else:
        found = kinematics.again(calm, [*of_the_file, *offsets]) if offsets else calm
        skews = _leading_skews(flight, found)
        found = kinematics.again(found, [*found.attached, *skews]) if skews else found
        nuisance = [*offsets, *skews]
    evidence = weigh(found, discrepancy=False)
    ranked = screen(evidence, _observable(flight, found.attached))
    return KinematicFindings(evidence=evidence, ranked=ranked, turbulence=turbulent, nuisance=nuisance)


def _leading_skews(flight: Subject, found: FlightFit) -> list[Attached]:
    """Skews between instruments if they explain more than any other cause; a vane far from its stated position imitates
    some.
    """
    skews, gained = demanded_skews(found)
    if not skews:
        return []
    elsewhere = [e for e in _observable(flight, found.attached) if e.target not in SKEWED]
    return skews if gained > max(c.net for c in screen(weigh(found, discrepancy=False), elsewhere)) else []


def comes_near(flight: Subject, known: Sequence[Attached]) -> bool:
    """Return True if the kinematics come near the data with at most one cause.

    If so, the measured noise is correct, and what a model leaves is that cause or an error of its aerodynamics.
    """
    if not kinematics.available(flight):
        return False
    far = flight.criteria.significance.chance
    tried = flight.criteria.numerics.naming.trials
    calm = kinematics.reconstruct(flight, [one for one in known if one.effect.kinematic])
    if not is_far(calm, far):
        return True
    ranked = screen(weigh(calm, discrepancy=False), _observable(flight, calm.attached))[:tried]
    with_one = (kinematics.again(calm, [*calm.attached, one.attached]) for one in ranked if is_possible(one.attached))
    return any(not is_far(found, far) for found in with_one)


def without_turbulence(
    flight: Subject, known: Sequence[Attached], attached: Sequence[Attached], turbulent: Turbulence
) -> tuple[Evidence, list[Candidate]] | None:
    """Kinematic evidence in calm air with its ranking, if the named causes explain what was taken for turbulence.

    Turbulence can imitate faults until these are found. None if too much of the turbulence remains.
    """
    found = [one for one in attached if one.effect.kinematic]
    before = [one for one in known if one.effect.kinematic]
    if len(found) == len(before):
        return None
    left = turbulence(flight, kinematics.reconstruct(flight, found))
    if left.named or left.gain > flight.criteria.parts.third * turbulent.gain:
        return None
    evidence = weigh(kinematics.reconstruct(flight, before), discrepancy=False)
    return evidence, screen(evidence, _observable(flight, before))


def _observable(flight: Subject, known: Sequence[Attached]) -> list[Effect]:
    """Causes that affect the kinematics and are not `known`."""
    taken = {one.effect.key for one in known}
    return [e for e in flight.effects if e.kinematic and e.key not in taken]


def _with_faults(flight: Subject, turbulent: Turbulence, calm: FlightFit, effects: Sequence[Effect]) -> Turbulence:
    """The turbulence after a test against faults that look like it: instrument faults, discrete gusts, a shear.

    Turbulence can imitate any fault, and faults can imitate much of turbulence. Faults are preferred if they leave no
    turbulence together, or if they explain more in turbulence than it explains beside them. The air is calm if the
    drift of one reading has a much larger statistic than turbulence. Small offsets of all instruments are always in the
    model.
    """
    moving = gusts(flight, turbulent.sigma, length=turbulent.length)
    criteria = flight.criteria

    def moved(faulty: FlightFit) -> float:
        """Deviance of the reconstruction with these faults in turbulence."""
        air = kinematics.reconstruct(flight, faulty.attached, moving, faulty)
        return kinematics.with_offsets(air).deviance

    faulty = calm
    evidence = weigh(kinematics.with_offsets(calm), discrepancy=False)
    if drifts(evidence)[0].gain > criteria.parts.clearly * turbulent.gain:
        return still_air(flight)
    in_moving_air = [moved(calm)]
    for _ in range(criteria.numerics.naming.trials):
        taken = {a.effect.key for a in faulty.attached}
        ranked = [c for c in screen(evidence, [e for e in effects if e.key not in taken]) if is_possible(c.attached)]
        if not ranked or ranked[0].net < criteria.parts.third * (evidence.deviance - in_moving_air[-1]):
            break
        other = kinematics.reconstruct(flight, [*faulty.attached, ranked[0].attached], start=faulty)
        if ranked[0].attached.effect.timed:
            other = at_peak(weigh(other, discrepancy=False), free="effects")[0].fit
        rested = weigh(kinematics.with_offsets(other), discrepancy=False)
        if evidence.deviance - rested.deviance < criteria.parts.most * ranked[0].net:
            break  # the fit does not confirm the prediction: turbulence also resembles an instrument fault
        faulty = other
        evidence = rested
        in_moving_air.append(moved(faulty))
    if faulty is calm:
        return turbulent
    other_air = turbulence(flight, faulty)
    return turbulent if other_air.named and in_moving_air[0] - in_moving_air[-1] < other_air.gain else other_air


def moves_the_aircraft(turbulent: Turbulence, refitted: FlightFit) -> bool:
    """Return True if turbulence also explains the motion of the full model, `refitted` in calm air.

    Turbulence has the strength and scale found in the kinematics, and rolls the aircraft too. It must explain more than
    slow noise of all readings does, by the same statistic that the kinematics require.
    """
    flight = refitted.flight
    if refitted.noise.colour:  # noise estimated with the model already includes the effect of the air
        return True
    air = gusts(flight, turbulent.sigma, {"dCl": 1.0}, turbulent.length)
    moving = fit(flight, refitted.attached, flight.noise(air), refitted, extent="rough")
    calm = as_slow_as_left(refitted).deviance
    least = turbulent.criteria.missing
    # none is a case of slow noise: where turbulence explains as much without it, it does so beside it
    return calm - moving.deviance > least or calm - as_slow_as_left(moving).deviance > least
