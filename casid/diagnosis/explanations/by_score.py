"""The diagnosis from where the naming begins, by the score: explanations of the fit in calm and in moving air."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.evidence.screening import Candidate, screen
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.reading import Reading
from casid.diagnosis.explanations.refit import Explained, explain
from casid.diagnosis.flight.evaluation import Fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.view import view_of
from casid.diagnosis.judging.extension import extended_aircraft
from casid.diagnosis.judging.held_out import held_gains, judge_on
from casid.diagnosis.judging.verdict import smallest_detectable, turbulence_cause
from casid.diagnosis.kinematics.kinematics import Turbulence, still_air
from casid.diagnosis.result import Round
from casid.model.effects import catalogue
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Begun:
    """Where the naming begins: the file refitted in calm air, with structure that is demanded put in, and the same in
    the air as it moves, `start`, where that is `turbulence`."""

    calm: Fit
    structure: Sequence[Attached]
    structured: Fit
    start: Fit
    turbulence: Turbulence


@dataclass(frozen=True, eq=False, kw_only=True)
class Scored:
    """What the score adds to a diagnosis: its fields by name, the extended model, and where it began."""

    fields: dict[str, Any]
    extended: Fit
    held_refitted: Fit
    held_extended: Fit
    extended_file: Any


def by_score(begun: Begun, held: Sequence[Record], begin: Callable[[str], None]) -> Scored:
    """Name causes by the posterior over explanations, and judge the model that has them on `held` records."""
    priors = Priors()
    explained, turbulence = _explained(begun, priors, begin)
    reading = Reading(explained=explained, priors=priors, structure=tuple(begun.structure))
    begin("held-out records")
    final = reading.fit
    held_refitted, held_extended = (judge_on(held, one) for one in (begun.calm, final))
    (gain,) = held_gains([held_refitted, held_extended])
    begin("verdict")
    causes = tuple(replace(one, held_out_gain=gain) for one in reading.causes)
    if turbulence.named:
        causes = (turbulence_cause(turbulence, final.flight.aircraft, None), *causes)
    verdict, sentence = reading.verdict(causes)
    candidates = _ranking(explained)
    first = explained.first.fit
    unexplained = reading.unexplained
    fields = {
        "verdict": verdict,
        "sentence": sentence,
        "causes": causes,
        "minor": reading.minor,
        "ranking": candidates[:40],
        "rounds": (Round(candidates=candidates, trials=(), equivalents=(), named=False),),
        "bare": first,
        "missing_before": tuple(missing_inputs(weigh(first, discrepancy=False))),
        "missing_after": tuple(missing_inputs(weigh(final, discrepancy=False))),
        "unexplained": tuple(one for one, _ in unexplained),
        "entered": {one.station: p for one, p in unexplained},
        "explanations": reading.explanations,
        "believed": reading.believed,
        "turbulence": turbulence,
        "detectable": smallest_detectable(candidates),
        "refitted": view_of(begun.calm),
        "extended": view_of(final),
    }
    return Scored(
        fields=fields,
        extended=final,
        held_refitted=held_refitted,
        held_extended=held_extended,
        extended_file=extended_aircraft(begun.calm.flight.aircraft, final, causes, reading.minor),
    )


def _explained(begun: Begun, priors: Priors, begin: Callable[[str], None]) -> tuple[Explained, Turbulence]:
    """The posterior in the air that explains more, moving or calm, all else that is wrong being named in either."""
    calm = explain(begun.structured, priors, begin)
    if not begun.turbulence.named:
        return calm, begun.turbulence
    moving = explain(begun.start, priors, begin)
    kinds = len({e.kind for e in catalogue(begun.calm.flight.aircraft, begun.calm.flight.outputs)})
    if moving.posterior.best.log + priors.cause(kinds) > calm.posterior.best.log:
        return moving, begun.turbulence
    return calm, still_air(begun.calm.flight)


def _ranking(explained: Explained) -> tuple[Candidate, ...]:
    first = explained.first.fit
    there = {one.effect.key for one in first.attached}
    every = catalogue(first.flight.aircraft, first.flight.outputs)
    return tuple(screen(weigh(first), [e for e in every if e.key not in there]))
