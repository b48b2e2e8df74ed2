"""Which steps of a naming are kept: the model that predicts the held-out records best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from casid.diagnosis.decision import Gate
from casid.diagnosis.evidence.evidence import Evidence, is_sure, weigh
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, without
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.judging.held_out import best_on_held, gains_by_kinematics, held_gains, judge_on, predicted_on
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.naming.baseline import Baseline
from casid.diagnosis.naming.naming import Naming
from casid.diagnosis.naming.trials import required_gain
from casid.native.processors import side_by_side
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Kept:
    """The model that is best on the held-out records.

    fit, evidence        of it, in the fitted records
    held_fit, held_calm  of it and of the baseline, in the others
    structure            the terms put in beforehand of which the records are sure, which together gained
    structure_gain       log likelihood per held-out sample; None where there is none
    gains                the same of turbulence and of every named round
    gates                by name, what the effects of its steps had to pass on the held-out records
    """

    evidence: Evidence
    held_fit: FlightFit
    held_calm: FlightFit
    structure: list[Attached]
    structure_gain: float | None
    gains: list[float | None]
    gates: Mapping[str, Gate]

    @property
    def fit(self) -> FlightFit:
        return self.evidence.fit

    def has_all(self, naming: Naming) -> bool:
        """Whether every cause that stands in the naming's last fit is in it."""
        named = {round_.leader.effect.key for round_ in naming.named}
        standing = {one.effect.key for one in naming.evidence.fit.attached}
        return named & standing <= {one.effect.key for one in self.fit.attached}

    def with_effects(self, nuisance: Sequence[Attached]) -> FlightFit:
        """The fit with further effects."""
        return fit(self.fit.flight, [*self.fit.attached, *nuisance], self.fit.noise, self.fit)


def keep(held: Sequence[Record], begun: Baseline, naming: Naming) -> Kept:
    """The steps of a naming that `held` records bear out, without terms of the structure of which none is sure."""
    named, turbulence = naming.named, begun.turbulence
    coloured, flight = turbulence.named, begun.calm.flight
    steps = [begun.structured, *([begun.start] if coloured else []), *(r.fitted for r in named)]
    criteria = naming.criteria
    spare = [r.leader.gain.net - required_gain(r.leader.effect, criteria) for r in named]
    spare = [*([turbulence.gain - criteria.turbulence.gain] if coloured else []), *spare]
    on_held = side_by_side(lambda step: predicted_on(held, step), steps)
    held_calm = predicted_on(held, begun.calm) if begun.structure else on_held[0]
    moving = kinematics.gusts(flight, turbulence.sigma, length=turbulence.length) if coloured else {}
    gains = gains_by_kinematics(flight, held, steps, held_gains(on_held), [r.leader for r in named], moving)
    final, held_final, gates = best_on_held(held, steps, on_held, gains, spare)
    evidence = naming.evidence if final is naming.evidence.fit else weigh(final)
    structure = [*begun.structure, *_put_in_later(begun, final)]
    unsure = {one.name for one in structure if not is_sure(evidence, one.name)}
    if unsure:  # a term that these records do not determine takes any size
        final = without(final, unsure)
        evidence, held_final = weigh(final), judge_on(held, final)
    return Kept(
        evidence=evidence,
        held_fit=held_final,
        held_calm=held_calm.fit,
        structure=[one for one in structure if one.name not in unsure],
        structure_gain=held_gains([held_calm, on_held[0]])[0],
        gains=gains if coloured else [None, *gains],
        gates=gates,
    )


def _put_in_later(begun: Baseline, final: FlightFit) -> list[Attached]:
    """Nuisance errors of instruments that were put in for what was named."""
    before = {one.name for one in begun.structure}
    return [one for one in final.attached if one.nuisance and one.name not in before]
