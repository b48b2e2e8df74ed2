"""The diagnosis from where the naming begins, by the score: explanations of the fit in calm and in moving air."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from scipy.special import expit

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.explanations.predictive import predicted
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.reading import PosteriorReading
from casid.diagnosis.explanations.refit import Explained, explain
from casid.diagnosis.flight.view import view_of
from casid.diagnosis.given.as_given import AsGiven
from casid.diagnosis.given.budget import budget_of
from casid.diagnosis.given.flight_values import flight_values
from casid.diagnosis.judging.extension import extended_aircraft
from casid.diagnosis.judging.held_out import held_gains, judge_on
from casid.diagnosis.judging.verdict import smallest_detectable, turbulence_cause
from casid.diagnosis.kinematics.kinematics import Turbulence, still_air
from casid.diagnosis.kinematics.stage import KinematicFindings
from casid.diagnosis.naming.baseline import Baseline
from casid.diagnosis.naming.round import Round
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.stages import Stages
from casid.model.aircraft import Aircraft
from casid.model.causes import turbulence as effect_of_turbulence
from casid.records.record import Record


def by_score(
    aircraft: Aircraft,
    begun: Baseline,
    found: KinematicFindings,
    given: AsGiven,
    held: Sequence[Record],
    stages: Stages,
) -> Diagnosis:
    """Name causes by the posterior over explanations, and judge the model that has them on `held` records."""
    criteria = begun.calm.criteria
    explained, turbulence, in_air = _explained(begun, criteria.priors, stages.begin)
    stages.begin("explanations, held-out records")
    lead, rivals = explained.lead, [one.fit for one in explained.rivals]
    explained = explained.with_held_out(*predicted(lead.fit, lead.own.keys(), rivals, held, explained.worths))
    reading = PosteriorReading(explained=explained, structure=tuple(begun.structure))
    stages.begin("held-out records")
    final, first = reading.fit, explained.first
    held_refitted, held_extended = (judge_on(held, one) for one in (begun.calm, final))
    (gain,) = held_gains([held_refitted, held_extended])
    stages.begin("verdict")
    causes = tuple(replace(one, held_out_gain=gain) for one in reading.causes)
    if turbulence.named:
        causes = (replace(turbulence_cause(turbulence, final.flight.aircraft, None), probability=in_air), *causes)
    verdict, sentence = reading.verdict(causes)
    candidates = explained.ranking
    before, after = (tuple(missing_inputs(weigh(one, discrepancy=False))) for one in (first, final))
    on_held = view_of(held_refitted), view_of(held_extended)
    stages.end()
    return Diagnosis(
        verdict=verdict,
        headline=sentence,
        sentence=sentence,
        flight=flight_values(weigh(final)),
        aircraft=aircraft,
        extended_aircraft=extended_aircraft(begun.calm.flight.aircraft, final, causes, reading.minor),
        causes=causes,
        minor=reading.minor,
        ranking=candidates[: criteria.numerics.naming.ranking],
        rounds=(Round(candidates=candidates, trials=(), equivalents=(), named=False),),
        as_given=given.fitted,
        refitted=view_of(begun.calm),
        extended=view_of(final),
        held_out_as_given=given.held,
        held_out_refitted=on_held[0],
        held_out_extended=on_held[1],
        budget=budget_of(given, *on_held),
        bare=first,
        missing_before=before,
        missing_after=after,
        unexplained=tuple(one for one, _ in reading.unexplained),
        kinematic=tuple(found.ranked),
        turbulence=turbulence,
        detectable=smallest_detectable(candidates, criteria.verdict),
        seconds=stages.seconds,
        explanations=reading.explanations,
        believed=reading.believed | ({effect_of_turbulence("").name: in_air} if begun.turbulence.named else {}),
        entered={one.station: p for one, p in reading.unexplained},
        nothing=explained.posterior.adequate,
        worths=explained.worths,
    )


def _explained(begun: Baseline, priors: Priors, begin: Callable[[str], None]) -> tuple[Explained, Turbulence, float]:
    """The posterior in the air as it moves by kinematics; in calm air where that explains as much with the same causes;
    and the probability that the air moves."""
    if not begun.turbulence.named:
        return explain(begun.structured, priors, begin), begun.turbulence, 0.0
    moving = explain(begun.start, priors, begin)
    begin("explanations, calm air")
    kinds = len({e.kind for e in begun.calm.flight.effects})
    gained = moving.posterior.best.log + priors.cause(kinds) - moving.lead.in_other_air(begun.structured, priors)
    in_air = float(expit(gained))
    if in_air > 0.5:
        return moving, begun.turbulence, in_air
    return explain(begun.structured, priors, begin), still_air(begun.calm.flight), in_air
