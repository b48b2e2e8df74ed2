"""The diagnosis from where the naming begins, by rules: causes one by one, kept where held-out records agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from casid.diagnosis.cause import Cause
from casid.diagnosis.decision import IN_A_SET, MINOR, NAMED, REFUSED, Decision, Trace, merged
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.flight.view import view_of
from casid.diagnosis.given.as_given import AsGiven
from casid.diagnosis.given.budget import budget_of
from casid.diagnosis.given.flight_values import flight_values
from casid.diagnosis.judging.belief import Believed, believed
from casid.diagnosis.judging.extension import extended_aircraft
from casid.diagnosis.judging.kept import Kept, keep
from casid.diagnosis.judging.left import beside_slow_noise, what_is_left
from casid.diagnosis.judging.verdict import causes_of, verdict_of
from casid.diagnosis.kinematics.stage import KinematicFindings
from casid.diagnosis.naming.baseline import Baseline, named
from casid.diagnosis.naming.naming import Naming
from casid.diagnosis.naming.tempering import tempered
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.stages import Stages
from casid.model.aircraft import Aircraft
from casid.model.effects import effect_of
from casid.records.record import Record


def by_rules(
    aircraft: Aircraft,
    begun: Baseline,
    found: KinematicFindings,
    given: AsGiven,
    held: Sequence[Record],
    stages: Stages,
) -> Diagnosis:
    """Name causes one after the other, by rules about what each gains, and judge the model that has them on `held`."""
    criteria, known = begun.calm.criteria, begun.calm.attached
    begun, naming = named(begun, found, known, stages.begin)
    naming = tempered(naming)
    stages.begin("held-out records")
    kept = keep(held, begun, naming)
    stages.begin("missing inputs")
    left = naming.missing if kept.evidence is naming.evidence else tuple(missing_inputs(kept.evidence))
    exact = missing_inputs(weigh(kept.fit, discrepancy=False))
    stages.begin("verdict")
    minor, unexplained, belief = _told(begun, naming, kept, left)
    causes = belief.causes
    verdict, sentence, remark = verdict_of(causes, minor, unexplained, naming, kept.fit)
    bare = begun.without_causes({(c.kind, c.target, c.term) for c in causes})
    first = exact if kept.fit is bare else missing_inputs(weigh(bare, discrepancy=False))
    refitted, extended, held_refitted, held_extended = map(
        view_of, (begun.calm, kept.fit, kept.held_calm, kept.held_fit)
    )
    extended_file = extended_aircraft(begun.calm.flight.aircraft, kept.fit, causes, minor)
    stages.end()
    return Diagnosis(
        verdict=verdict,
        headline=sentence,
        sentence=sentence,
        remark=remark,
        aircraft=aircraft,
        extended_aircraft=extended_file,
        causes=causes,
        minor=minor,
        ranking=naming.rounds[0].candidates[: criteria.numerics.naming.ranking],
        rounds=naming.rounds,
        as_given=given.fitted,
        refitted=refitted,
        extended=extended,
        held_out_as_given=given.held,
        held_out_refitted=held_refitted,
        held_out_extended=held_extended,
        budget=budget_of(given, held_refitted, held_extended),
        flight=flight_values(kept.evidence),
        bare=bare,
        missing_before=tuple(first),
        missing_after=tuple(exact),
        unexplained=tuple(unexplained),
        kinematic=tuple(found.ranked),
        turbulence=begun.turbulence,
        detectable=naming.rounds[0].detectable,
        seconds=stages.seconds,
        explanations=belief.explanations,
        believed=belief.there,
        entered=belief.entered,
        nothing=belief.nothing,
        trace=_trace(naming, causes, minor),
    )


def _trace(naming: Naming, causes: Sequence[Cause], minor: Sequence[Cause]) -> Trace:
    """The decisions of all rounds, with what the verdict required of the causes that these named."""
    final, small = {one.key: one for one in causes}, {one.key: one for one in minor}
    alike = {(o["kind"], o["target"], o["term"]) for one in causes for o in one.indistinguishable_from}
    found, told = [], set[tuple[str, str, str | None]]()
    for number, round_ in enumerate(naming.rounds, 1):
        keys = {trial.candidate.name: trial.effect.key for trial in round_.trials}
        for one in round_.decisions(number):
            key = keys.get(one.cause)
            if one.outcome == NAMED and key is not None:
                cause = final.get(key) or small.get(key)
                told.add(key)
                outcome = NAMED if key in final else MINOR if key in small else REFUSED
                one = replace(one, outcome=outcome, gates=(*one.gates, *(cause.gates if cause else ())))
            elif one.outcome == IN_A_SET and key not in alike:
                one = replace(one, outcome=REFUSED)
            found.append(one)
    before = [one for one in (*causes, *minor) if one.gates and one.key not in told]
    put_in = [
        Decision(cause=effect_of(one).name, round=0, outcome=NAMED if one.key in final else MINOR, gates=one.gates)
        for one in before
    ]
    return Trace(decisions=merged([*put_in, *found]))


def _told(
    begun: Baseline, naming: Naming, kept: Kept, left: Sequence[MissingInput]
) -> tuple[tuple[Cause, ...], list[MissingInput], Believed]:
    """(minor, unexplained, causes with their probabilities); `left` are the missing inputs of the kept model."""
    required = begun.required
    causes, minor = causes_of(naming, kept, begun.turbulence, required, left)
    causes, minor = beside_slow_noise(kept, naming, causes, minor)
    minor, unexplained = what_is_left(kept, naming, left, (causes, minor), required)
    return minor, unexplained, believed(causes, unexplained, naming, left)
