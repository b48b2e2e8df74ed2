"""The baseline from which causes are named, and the naming with what it shows of the baseline itself."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.flight.colour import in_colour
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, from_elsewhere
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.input_timing import as_inputs_run
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.kinematics import Turbulence
from casid.diagnosis.kinematics.stage import KinematicFindings, without_turbulence
from casid.diagnosis.naming.branches import best_branch
from casid.diagnosis.naming.naming import Naming, name_causes
from casid.diagnosis.naming.structure import demanded_offsets, demanded_structure


@dataclass(frozen=True, eq=False, kw_only=True)
class Baseline:
    """Where the naming begins: the baseline in calm air, terms that its structure demands and nuisance errors of
    instruments, the fit with these, and the same in the air as it moves."""

    calm: FlightFit
    structure: list[Attached]
    structured: FlightFit
    start: FlightFit
    turbulence: Turbulence

    @property
    def required(self) -> float:
        """What the rough model of turbulence leaves to others."""
        return self.turbulence.criteria.left * self.turbulence.gain if self.turbulence.named else 0.0

    def without_causes(self, named: Collection[tuple[str, str, str | None]]) -> FlightFit:
        """The model before any cause: one of the structure may have been `named` as one."""
        of_structure = any(one.effect.key in named for one in self.structure)
        return self.calm if of_structure and not self.turbulence.named else self.start


def baseline(calm: FlightFit, turbulence: Turbulence, nuisance: Sequence[Attached]) -> Baseline:
    structure = [*demanded_structure(calm), *nuisance]
    structured = in_colour(fit(calm.flight, [*calm.attached, *structure], calm.noise, calm)) if structure else calm
    start = in_colour(kinematics.in_turbulence(calm.flight, turbulence, structured)) if turbulence.named else structured
    return Baseline(calm=calm, structure=structure, structured=structured, start=start, turbulence=turbulence)


def named(
    begun: Baseline, found: KinematicFindings, known: Sequence[Attached], report: Callable[[str], None]
) -> tuple[Baseline, Naming]:
    """The naming, and where it began: with inputs that run otherwise between samples, if they show to beside what was
    named. Without turbulence, if that is not there any more; and from another minimum of the baseline, if nothing could
    be named that far from the data."""
    flight, skews = begun.calm.flight, [one for one in found.nuisance if one.effect.late]
    effects = flight.effects
    by_kinematics = found.evidence, found.ranked
    naming = name_causes(weigh(begun.start), effects, *by_kinematics, begun.required, report)
    naming = best_branch(naming, effects, begun.required, report)
    share = as_inputs_run(naming.evidence.fit, named=True).flight.held
    if share != flight.held:
        flight = flight.with_inputs_held(share)
        again = fit(flight, begun.calm.attached, flight.noise(), begun.calm, iterations=20)
        nuisance = [] if begun.turbulence.named else [*demanded_offsets(again), *skews]
        begun = baseline(again, begun.turbulence, nuisance)
        naming = name_causes(weigh(begun.start), effects, *by_kinematics, begun.required, report)
    if begun.turbulence.named:
        calm_air = without_turbulence(flight, known, naming.evidence.fit.attached, begun.turbulence)
        if calm_air is not None:
            begun = replace(begun, start=begun.structured, turbulence=kinematics.still_air(flight))
            naming = name_causes(weigh(begun.start), effects, *calm_air, begun.required, report)
    elif not naming.named and (other := from_elsewhere(begun.calm)) is not None:
        again = baseline(other, begun.turbulence, [*demanded_offsets(other), *skews])
        second = name_causes(weigh(again.start), effects, *by_kinematics, again.required, report)
        if second.named:
            return again, second
    return begun, naming
