"""The verdict: a table of conditions on the facts, and the account of a diagnosis.

The verdict is the first row of the table whose condition holds. No cause is named if the data are at fault, if the file
has impossible numbers, or if the extended model fails on the held-out records. Nothing is fitted here.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace

from casid.data_check.reading import Finding
from casid.diagnosis import claims, sentences
from casid.diagnosis import comparisons as ask
from casid.diagnosis.cause import IN_A_SET, MINOR, NAMED, REFUSED, Cause, Decision, Trace
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.size import missing_share
from casid.diagnosis.facts import Facts, changed_values, determined_pairs
from casid.diagnosis.flight.noise import Following
from casid.diagnosis.given.contradicted import Contradiction, impossible
from casid.diagnosis.given.factors import Factor
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.result import Diagnosis
from casid.model.plausible import Doubt

_TABLE: tuple[tuple[str, Callable[[Facts], object]], ...] = (
    ("data at fault", lambda facts: facts.at_fault),
    ("values wrong", lambda facts: facts.impossible),
    ("unexplained", sentences.failure),
    ("partly explained", lambda facts: facts.causes and (claims.left_over(facts) or sentences.cost(facts))),
    ("explained", lambda facts: facts.causes),
    ("unexplained", lambda facts: facts.unexplained),
    ("adequate", lambda facts: claims.adequate(facts) and not (facts.contradicted or facts.factors)),
    ("partly explained", claims.left_over),
    ("unexplained", claims.no_better),
    ("values wrong", lambda facts: True),
)


def verdict_of(facts: Facts) -> str:
    """The verdict of the first row of the table that holds."""
    return next(verdict for verdict, holds in _TABLE if holds(facts))


def concluded(
    found: Diagnosis,
    against: Sequence[Contradiction],
    factors: Sequence[Factor] = (),
    not_judged: Sequence[NotJudged] = (),
    data: Sequence[Finding] = (),
    doubts: Sequence[Doubt] = (),
) -> Diagnosis:
    """The diagnosis that was `found`, with its verdict and sentences.

    A common factor without any number `against` the records is left out, and the numbers of the others are not reported
    one by one. `doubts` are numbers of the file that are impossible.
    """
    found = replace(found, causes=tuple(_or_the_data(one, data) for one in found.causes))
    facts = facts_of(found, against, factors, not_judged, data, doubts)
    verdict = verdict_of(facts)
    account = claims.account(facts)
    if facts.at_fault:
        found = _in_doubt(found, "the data are at fault")
        doubted = True
    elif facts.impossible:
        found = _in_doubt(found, "the aircraft file cannot be right")
        doubted = True
    elif sentences.failure(facts):
        found = _in_doubt(found, "the extended model fails on held-out records")
        doubted = True
    else:
        doubted = False
    if claims.grown(facts):
        found = replace(found, diagnosed=found.diagnosed.kept)
    factors = claims.told_factors(facts)
    alike = [of_values(one.cause, one.statistic, one.derivatives, found.criteria) for one in factors if one.cause]
    alike += [] if found.following is None else [of_air(found.following, found.criteria)]
    return replace(
        found,
        verdict=verdict,
        headline=sentences.headline(facts, found),
        sentence=sentences.whole(facts, account, found),
        opening=f"{sentences.flown(facts)} {sentences.accounted(facts, account)}".strip(),
        values_told=sentences.values(facts, sum(one.determined for one in found.flight.values())),
        causes=found.causes if doubted else facts.causes,
        minor=found.minor if doubted else facts.minor,
        nothing=claims.nothing_missing(found.nothing, facts),
        explanations=claims.explanations(found.explanations, facts),
        believed={name: claims.probability(p, facts) for name, p in found.believed.items()},
        not_judged=facts.not_judged,
        data=tuple(data),
        contradicted=(*facts.impossible, *(() if claims.no_values(facts) else facts.contradicted)),
        factors=factors,
        trace=Trace(decisions=(*alike, *of_data(data), *found.trace.decisions)),
        moved=facts.moved,
        combinations=facts.combinations,
        claims=claims.claims_of(facts),
        account=account,
    )


def facts_of(
    found: Diagnosis,
    against: Sequence[Contradiction],
    factors: Sequence[Factor],
    not_judged: Sequence[NotJudged],
    data: Sequence[Finding],
    doubts: Sequence[Doubt],
) -> Facts:
    """The facts of a diagnosis, of its comparison with the values as given, and of the data check."""
    names = {one.parameter for one in against}
    factors = tuple(one for one in factors if names & set(one.derivatives))
    single = {name for one in factors for name in one.derivatives}
    causes = {(one.kind, one.target) for one in found.causes}
    fit = found.extended.fit
    given = found.diagnosed.values
    criteria = found.criteria
    changed = changed_values(fit, given, found.flight, criteria.parts.tenth)
    facts = Facts(
        source=found.diagnosed.source,
        witness=found.diagnosed.witness,
        budget=found.budget,
        criteria=criteria.parts,
        listed=criteria.numerics.naming.trials,
        at_fault=tuple(one for one in data if one.puts_in_doubt and not _is_told_by(one, causes)),
        corrected=tuple(one for one in data if one.handled != "reported"),
        impossible=tuple(map(impossible, doubts)),
        causes=found.causes,
        unexplained=tuple(_unexplained(found)),
        contradicted=tuple(one for one in against if one.parameter not in single),
        factors=factors,
        changed=changed,
        combinations=determined_pairs(fit, changed, given, criteria.parts),
        not_judged=(*found.not_tried, *not_judged),
        turbulent=found.turbulence.records if found.turbulence.named else (),
    )
    attached = {one.effect.key for one in fit.attached}
    minor = tuple(one for one in found.minor if one.key in attached or claims.visible(one))
    return replace(facts, causes=tuple(claims.stated(one, facts) for one in found.causes), minor=minor)


def _is_told_by(finding: Finding, named: Collection[tuple[str, str]]) -> bool:
    """Return True if nothing was corrected, and one of the `named` causes, (kind, target), explains as much."""
    others = {(one["kind"], one["target"]) for one in finding.indistinguishable_from}
    return finding.handled == "reported" and not others.isdisjoint(named)


def _or_the_data(cause: Cause, data: Sequence[Finding]) -> Cause:
    """The cause with the faults of the data that explain the same, and for which nothing was corrected, in its set."""
    others = [
        {
            "kind": one.kind,
            "target": one.target,
            "term": one.term,
            "title": one.title,
            "value": one.value,
            "unit": one.unit,
            "gain": cause.statistic,
            "probability": None,
        }
        for one in data
        if _is_told_by(one, {(cause.kind, cause.target)})
    ]
    return replace(cause, indistinguishable_from=(*cause.indistinguishable_from, *others)) if others else cause


def of_data(findings: Sequence[Finding]) -> tuple[Decision, ...]:
    """The decisions on the faults of the data that were found; they were made before the first round."""
    return tuple(
        Decision(
            cause=f"{one.kind}({one.target})",
            round=0,
            outcome=NAMED,
            gates=() if one.odds is None else (ask.ODDS.of(one.odds, 1.0),),
            against=tuple(f"{rival['kind']}({rival['target']})" for rival in one.indistinguishable_from),
        )
        for one in findings
    )


def of_values(cause: str, statistic: float, values: tuple[str, ...], criteria: Criteria) -> Decision:
    """The decision on a cause that values reproduce: it is listed with them, for no record separates them."""
    gate = ask.COMMON.of(statistic, criteria.significance.chance, "significance.chance")
    return Decision(cause=cause, round=0, outcome=IN_A_SET, gates=(gate,), against=values)


def of_air(one: Following, criteria: Criteria) -> Decision:
    """The decision on what was taken for moving air and follows an input: it is named if that is no chance."""
    gate = ask.FOLLOWS_INPUTS.of(one.statistic, criteria.missing, "parts.third")
    name = f"follows({one.input}:{one.output})"
    outcome = NAMED if gate.passed else REFUSED
    return Decision(cause=name, round=0, outcome=outcome, gates=(gate,))


def _unexplained(found: Diagnosis) -> Iterator[str]:
    """Sentences of what no cause explains, strongest first."""
    fitted = found.bare.batch.names
    for missing in found.unexplained:
        if found.causes:
            yield sentences.missing_beside(missing, fitted)
        else:
            fit = next(v.fit for v in (found.extended, found.held_out_extended) if missing.concerns(v.records))
            yield sentences.unexplained(missing, missing_share(fit, missing), fitted, found.no_cause)
    if found.following is not None and of_air(found.following, found.criteria).outcome == NAMED:
        yield sentences.no_air(found.following)


def _in_doubt(found: Diagnosis, because: str) -> Diagnosis:
    """The diagnosis with all causes listed as minor, because of a fault of the data, the file or the extended model.

    Their probabilities assumed that there is no such fault, and are withdrawn as well.
    """
    doubted = [
        replace(
            c,
            sentence=f"{c.sentence} In doubt, for {because}.",
            indistinguishable_from=tuple({**one, "probability": None} for one in c.indistinguishable_from),
            probability=None,
            alone=None,
            log_odds=None,
        )
        for c in found.causes
    ]
    gate = ask.DATA_AT_FAULT.failed(f": {because}")
    decisions = tuple(
        replace(one, outcome=MINOR, gates=(*one.gates, gate)) if one.outcome in (NAMED, IN_A_SET) else one
        for one in found.trace.decisions
    )
    return replace(
        found,
        causes=(),
        minor=(*doubted, *found.minor),
        unexplained=(),
        explanations=(),
        believed={},
        entered={},
        nothing=None,
        trace=Trace(decisions=decisions),
    )
