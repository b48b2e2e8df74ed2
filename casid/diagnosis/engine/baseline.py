"""The baseline of a search: noise, outliers, input timing, kinematics and expected structure.

Expected is what every real aircraft has and a linear aircraft file lacks: a parabolic drag polar, and the roll due to
yaw rate and the yaw due to roll rate that grow with lift (strip theory). These terms are no causes, but without them
causes would be misjudged. They are added before the search if the records require them, and listed under `minor`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.nuisance import demanded_offsets
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_inputs_run, in_colour, is_far, unread, without_outliers
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.kinematics.check import KinematicFindings, comes_near, judge_kinematics, no_kinematics
from casid.diagnosis.kinematics.turbulence import Turbulence, in_turbulence
from casid.diagnosis.time_limit import TimeIsUpError
from casid.model.causes.aerodynamics import aero_term
from casid.model.effect import Effect
from casid.model.path import aerodynamic_parameters

_EXPECTED = {
    "CD": ("alpha^2", "beta^2"),
    "CX": ("alpha^2", "beta^2"),
    "Cl": ("alpha*r",),
    "Cn": ("alpha*p",),
}


_KINEMATICS = "faults of instruments and turbulence by the kinematics"


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
        found = no_kinematics(refitted.flight)
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


def baseline_in_time(flight: Subject, known: Sequence[Attached], say: Callable[[str], None]) -> Baseline:
    """`baseline_of` as far as there is time, or until Ctrl-C: without time for the kinematics, or for a fit in
    turbulence, the air is taken to be calm."""
    calm = _refitted(flight, known, say)
    limit = calm.flight.limit
    found = None
    try:
        with limit.cutting():
            found = _kinematics_of(calm, known, say)
            return baseline_from(calm, found)
    except TimeIsUpError:
        pass
    if found is None or found.turbulence.named:  # the fit in turbulence takes long
        found = no_kinematics(calm.flight)
        limit.leave_out(_KINEMATICS)
    return baseline_from(calm, found)


def baseline_of(flight: Subject, known: Sequence[Attached], say: Callable[[str], None]) -> Baseline:
    """The baseline of a flight with the effects that its file has."""
    calm = _refitted(flight, known, say)
    return baseline_from(calm, _kinematics_of(calm, known, say))


def _refitted(flight: Subject, known: Sequence[Attached], say: Callable[[str], None]) -> FlightFit:
    """The re-estimated file.

    The noise is the one measured in the records. If neither the re-estimated file nor the kinematics come near the data
    under this noise, it is estimated with the model.
    """
    say("refit of the file")
    calm = fit(flight, known, flight.noise(), extent="settled")
    if is_far(calm, flight.criteria.parts.tenfold**2):
        without = unread(flight)
        if without.noise_by_fit and not comes_near(flight, known):
            flight = without
            calm = fit(without, known, without.noise(), extent="settled")
    return as_inputs_run(in_colour(without_outliers(calm)))


def _kinematics_of(calm: FlightFit, known: Sequence[Attached], say: Callable[[str], None]) -> KinematicFindings:
    """The result of the kinematic stage beside a re-estimated file."""
    say("kinematics")
    offsets = demanded_offsets(calm)
    found = judge_kinematics(calm.flight, known, offsets, calm)
    say("refit of the file")
    return found


def baseline_from(calm: FlightFit, found: KinematicFindings) -> Baseline:
    """The baseline of a re-estimated file and the result of its kinematic check."""
    structure = [*demanded_structure(calm), *found.nuisance]
    structured = calm
    moving = found.turbulence
    if structure:
        structured = in_colour(fit(calm.flight, [*calm.attached, *structure], calm.noise, calm))
    start = structured
    if moving.named:
        start = in_colour(in_turbulence(calm.flight, moving, structured))
    calm, structured = (one if one is start else one.lighter() for one in (calm, structured))  # rarely needed again
    return Baseline(calm=calm, structure=structure, structured=structured, start=start, kinematics=found)


def is_usual(effect: Effect) -> bool:
    """Return True if an effect is structure that every aircraft has."""
    return effect.regressor is not None and effect.regressor in _EXPECTED.get(effect.target, ())


def is_induced_drag(effect: Effect, value: float, fit: FlightFit) -> bool:
    """Return True if a drag term of alpha^2 is no larger than induced drag.

    The limit is CL_alpha^2 / (pi A e) with the aspect ratio A and the lowest Oswald factor e of real wings.
    """
    if (effect.target, effect.regressor) != ("CD", "alpha^2"):
        return False
    aircraft = fit.flight.aircraft
    lift = fit.derivatives.get("CL_alpha", aircraft.derivatives.get("CL_alpha", 0.0))
    aspect = aircraft.area / aircraft.moment_length_pitch**2
    return 0.0 <= value <= lift**2 / (np.pi * aspect * fit.criteria.parts.half)


def demanded_structure(base: FlightFit) -> list[Attached]:
    """Expected terms that the aircraft file lacks and that improve the fit significantly, with predicted values."""
    aircraft = base.flight.aircraft
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    present |= {(a.effect.target, a.effect.term or "") for a in base.attached}
    effects = [
        aero_term(coefficient, term)
        for coefficient in aircraft.coefficients
        for term in _EXPECTED.get(coefficient, ())
        if (coefficient, term) not in present
    ]
    judge = Screen(weigh(base, discrepancy=False))
    found = []
    everywhere = np.ones((1, len(base.batch.names)))
    for one in fingerprints(judge.evidence, effects):
        statistic, size, _, _ = judge.score([one], everywhere)
        if statistic > base.criteria.significance.search:
            found.append(Attached(effect=one.effect, values={"value": size}))
    return found
