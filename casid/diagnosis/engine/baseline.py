"""The baseline of a search: noise, outliers, input timing, kinematics and expected structure."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.structure import demanded_offsets, demanded_structure
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight, of_aircraft
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_inputs_run, in_colour, is_far, unread, without_outliers
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.kinematics.check import KinematicFindings, comes_near, judge_kinematics
from casid.diagnosis.kinematics.turbulence import Turbulence, in_turbulence, still_air


@dataclass(frozen=True, eq=False, kw_only=True)
class Baseline:
    """The model without any cause."""

    calm: FlightFit  # the re-estimated file, in calm air
    # terms that every aircraft has and the records require, and nuisance errors of instruments
    structure: list[Attached]
    structured: FlightFit  # the fit with these
    start: FlightFit  # the same, with turbulence if the kinematics require it
    kinematics: KinematicFindings  # result of the kinematic check of instruments and air
    fixed: bool = False  # whether noise, input timing and turbulence are final, and not examined by the search

    @classmethod
    def alone(cls, refitted: FlightFit) -> Baseline:
        """The baseline of a re-estimated model without kinematics, expected structure or turbulence."""
        still = still_air(refitted.flight)
        found = KinematicFindings(evidence=None, ranked=[], turbulence=still, nuisance=[])
        return cls(calm=refitted, structure=[], structured=refitted, start=refitted, kinematics=found, fixed=True)

    @property
    def flight(self) -> Subject:
        return self.calm.flight

    @property
    def criteria(self) -> Criteria:
        return self.calm.criteria

    @property
    def turbulence(self) -> Turbulence:
        return self.kinematics.turbulence

    @property
    def required(self) -> float:
        """The part of the statistic of turbulence that counts as misfit of its approximate shape, not as evidence."""
        return self.criteria.naming.approximate * self.turbulence.gain if self.turbulence.named else 0.0

    def without_causes(self, named: Collection[tuple[str, str, str | None]]) -> FlightFit:
        """The model without any cause. A structure term that was `named` as a cause is not part of it."""
        of_structure = any(one.effect.key in named for one in self.structure)
        return self.calm if of_structure and not self.turbulence.named else self.start


def baseline_of(flight: Flight, known: Sequence[Attached], say: Callable[[str], None]) -> Baseline:
    """The baseline of a flight with the effects that its file has.

    The noise is the one measured in the records. If neither the re-estimated file nor the kinematics come near the data
    under this noise, it is estimated with the model.
    """
    say("refit of the file")
    calm = fit(flight, known, flight.noise(), extent="first")
    if is_far(calm, flight.criteria.given.fails**2):
        without = unread(flight)
        if without.noise_by_fit and not comes_near(flight, known):
            flight, calm = without, fit(without, known, without.noise(), extent="first")
    calm = as_inputs_run(in_colour(without_outliers(calm)))
    say("kinematics")
    offsets = demanded_offsets(calm)
    calm.forget()
    found = judge_kinematics(of_aircraft(calm.flight), known, offsets, calm)
    say("refit of the file")
    return baseline_from(calm, found)


def baseline_from(calm: FlightFit, found: KinematicFindings) -> Baseline:
    """The baseline of a re-estimated file and the result of its kinematic check."""
    structure = [*demanded_structure(calm), *found.nuisance]
    structured = in_colour(fit(calm.flight, [*calm.attached, *structure], calm.noise, calm)) if structure else calm
    start, moving = structured, found.turbulence
    if moving.named:
        for one in (calm, structured):
            one.forget()
        start = in_colour(in_turbulence(of_aircraft(calm.flight), moving, structured))
    calm, structured = (one if one is start else one.lighter() for one in (calm, structured))  # rarely needed again
    return Baseline(calm=calm, structure=structure, structured=structured, start=start, kinematics=found)
