"""What kinematics say before any aerodynamics: which instrument or air cause shows, and is the air turbulent?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casid.diagnosis.engine.onsets import at_peak
from casid.diagnosis.engine.size import plausible
from casid.diagnosis.engine.structure import SKEWED, demanded_skews
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.missing_input import drifts
from casid.diagnosis.evidence.screening import Candidate, screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_slow_as_left, is_far
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.kinematics import Turbulence, gusts
from casid.model.effect import Effect


@dataclass(frozen=True, eq=False, kw_only=True)
class KinematicFindings:
    """What the stage hands on.

    evidence, ranked  with forces free, in the air as it moves, and its ranking of instrument and air causes; None where
                      the records cannot free the forces
    turbulence        whether the air moves
    nuisance            errors of instruments that are too small to matter, to be put in beforehand. None in turbulence,
                      where they stand for what the air does
    """

    evidence: Evidence | None
    ranked: list[Candidate]
    turbulence: Turbulence
    nuisance: list[Attached]


def judge_kinematics(
    flight: Flight, known: Sequence[Attached], offsets: Sequence[Attached], refitted: FlightFit
) -> KinematicFindings:
    """What kinematics find with effects that are `known`, the small `offsets` of instruments of a baseline, and the
    skews between instruments that the kinematics demand themselves. Air that moves must move the aircraft, too, by its
    file `refitted` in calm air."""
    if not kinematics.available(flight):
        return KinematicFindings(
            evidence=None, ranked=[], turbulence=kinematics.still_air(flight), nuisance=list(offsets)
        )
    of_the_file, nuisance = [one for one in known if one.effect.kinematic], list[Attached]()
    calm = kinematics.reconstruct(flight, of_the_file)
    turbulent = kinematics.turbulence(flight, calm)
    if turbulent.named:
        turbulent = _with_faults(flight, turbulent, calm, _observable(flight, of_the_file))
    if turbulent.named and not moves_the_aircraft(turbulent, refitted):
        turbulent = kinematics.still_air(flight)
    if turbulent.named:
        moving = kinematics.gusts(flight, turbulent.sigma, length=turbulent.length)
        found = kinematics.reconstruct(flight, of_the_file, moving, calm)
    else:
        found = kinematics.again(calm, [*of_the_file, *offsets]) if offsets else calm
        skews = _leading_skews(flight, found)
        found = kinematics.again(found, [*found.attached, *skews]) if skews else found
        nuisance = [*offsets, *skews]
    evidence = weigh(found, discrepancy=False)
    ranked = screen(evidence, _observable(flight, found.attached))
    return KinematicFindings(evidence=evidence, ranked=ranked, turbulence=turbulent, nuisance=nuisance)


def _leading_skews(flight: Flight, found: FlightFit) -> list[Attached]:
    """Skews that explain more than any cause elsewhere does: a vane that stands metres off has some of them, too."""
    skews, gained = demanded_skews(found)
    if not skews:
        return []
    elsewhere = [e for e in _observable(flight, found.attached) if e.target not in SKEWED]
    return skews if gained > max(c.net for c in screen(weigh(found, discrepancy=False), elsewhere)) else []


def comes_near(flight: Flight, known: Sequence[Attached]) -> bool:
    """Whether kinematics come near the data with one cause at most. Then the noise is as it was read, and what a model
    leaves is that cause, or wrong in its aerodynamics."""
    if not kinematics.available(flight):
        return False
    far, tried = flight.criteria.noise.far_from_causes, flight.criteria.numerics.naming.trials
    calm = kinematics.reconstruct(flight, [one for one in known if one.effect.kinematic])
    if not is_far(calm, far):
        return True
    ranked = screen(weigh(calm, discrepancy=False), _observable(flight, calm.attached))[:tried]
    with_one = (kinematics.again(calm, [*calm.attached, one.attached]) for one in ranked if plausible(one.attached))
    return any(not is_far(found, far) for found in with_one)


def without_turbulence(
    flight: Flight, known: Sequence[Attached], attached: Sequence[Attached], turbulent: Turbulence
) -> tuple[Evidence, list[Candidate]] | None:
    """Kinematic evidence in calm air and its ranking, as of `judge_kinematics`, when of what it said there,
    `turbulent`, little is left beside the causes that were named in it, `attached`. Moving air imitates faults until
    they are found. None when there is."""
    found = [one for one in attached if one.effect.kinematic]
    before = [one for one in known if one.effect.kinematic]
    if len(found) == len(before):
        return None
    left = kinematics.turbulence(flight, kinematics.reconstruct(flight, found))
    if left.named or left.gain > turbulent.criteria.rival * turbulent.gain:
        return None
    evidence = weigh(kinematics.reconstruct(flight, before), discrepancy=False)
    return evidence, screen(evidence, _observable(flight, before))


def _observable(flight: Flight, known: Sequence[Attached]) -> list[Effect]:
    """Causes of which kinematics know, but for those that are `known`."""
    taken = {one.effect.key for one in known}
    return [e for e in flight.effects if e.kinematic and e.key not in taken]


def _with_faults(flight: Flight, turbulent: Turbulence, calm: FlightFit, effects: Sequence[Effect]) -> Turbulence:
    """Turbulence beside what looks like it until it is in the model: instrument faults, discrete gusts, a shear.

    Moving air imitates any fault, and faults may imitate much of moving air. They are faults when together they leave
    no turbulence, or when they explain more in moving air than it does beside them; and one drifting instrument that
    gains more than all moving air is one. Small offsets of all instruments are in the model throughout.
    """
    moving = kinematics.gusts(flight, turbulent.sigma, length=turbulent.length)
    criteria = flight.criteria

    def moved(faulty: FlightFit) -> float:
        air = kinematics.reconstruct(flight, faulty.attached, moving, faulty)
        return kinematics.with_offsets(air).deviance

    faulty, evidence = calm, weigh(kinematics.with_offsets(calm), discrepancy=False)
    if drifts(evidence)[0].gain > criteria.turbulence.one_reading * turbulent.gain:
        return kinematics.still_air(flight)
    in_moving_air = [moved(calm)]
    for _ in range(criteria.numerics.turbulence.repairs):
        taken = {a.effect.key for a in faulty.attached}
        ranked = [c for c in screen(evidence, [e for e in effects if e.key not in taken]) if plausible(c.attached)]
        if not ranked or ranked[0].net < criteria.turbulence.rival * (evidence.deviance - in_moving_air[-1]):
            break
        other = kinematics.reconstruct(flight, [*faulty.attached, ranked[0].attached], start=faulty)
        if ranked[0].attached.effect.timed:
            other = at_peak(weigh(other, discrepancy=False), free="effects")[0].fit
        rested = weigh(kinematics.with_offsets(other), discrepancy=False)
        if evidence.deviance - rested.deviance < criteria.kinematics.confirmed * ranked[0].net:
            break  # it does not keep what it promised: turbulence looks like an instrument fault too
        faulty, evidence = other, rested
        in_moving_air.append(moved(faulty))
    if faulty is calm:
        return turbulent
    other_air = kinematics.turbulence(flight, faulty)
    return turbulent if other_air.named and in_moving_air[0] - in_moving_air[-1] < other_air.gain else other_air


def moves_the_aircraft(turbulent: Turbulence, refitted: FlightFit) -> bool:
    """Whether moving air explains more than slow noise of all readings, as much as it must gain of kinematics, by the
    file `refitted` in calm air. Air of the same strength and scale as in kinematics; it rolls the aircraft, too."""
    flight = refitted.flight
    if refitted.noise.colour:  # noise as the fit leaves it: its level has taken in whatever the air does
        return True
    air = gusts(flight, turbulent.sigma, {"dCl": 1.0}, turbulent.length)
    moving = fit(flight, refitted.attached, flight.noise(air), refitted, tolerance=2.0)
    gain = as_slow_as_left(refitted).deviance - as_slow_as_left(moving).deviance
    return gain > turbulent.criteria.gain
