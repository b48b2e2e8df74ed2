"""The causes of a search, tested once more: on the held-out records, beside slow noise, and for what is left over."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from casid.diagnosis import comparisons as ask
from casid.diagnosis import sentences
from casid.diagnosis.cause import NAMED, REFUSED, Cause, Decision, Trace
from casid.diagnosis.causes import cause_of, causes_of, minor_trials, still_missing, too_small, trace_of_search
from casid.diagnosis.diagnosed import DiagnosedAircraft, DiagnosedSystem
from casid.diagnosis.engine.acceptance import tempered
from casid.diagnosis.engine.baseline import Baseline, is_usual
from casid.diagnosis.engine.held_out import Kept, judge_on, keep, with_events
from casid.diagnosis.engine.probability import Probabilities, other_explanations, probabilities
from casid.diagnosis.engine.search import State
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.evidence.size import missing_size
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_coloured_as_left, as_slow_as_left, view_of
from casid.diagnosis.given.as_given import AsGiven
from casid.diagnosis.given.budget import BudgetSteps, budget_of
from casid.diagnosis.given.contradicted import FlightValue, flight_values
from casid.diagnosis.given.scope import NotJudged, part_of_a_fitted_record
from casid.diagnosis.kinematics.turbulence import in_other_air
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.time_limit import Stages
from casid.records.record import Record

_SLOW = "slow noise in place of what is missing"


def what_is_left(
    kept: Kept,
    state: State,
    left: Sequence[MissingInput],
    judged: tuple[tuple[Cause, ...], tuple[Cause, ...]],
) -> tuple[tuple[Cause, ...], list[MissingInput]]:
    """The minor causes and the latent inputs that no cause explains.

    Latent inputs that were `left` are dropped if causes that are too small to matter explain them; these are added to
    the minor ones among those `judged`.
    """
    (causes, minor), begun, required = judged, state.baseline, state.baseline.required
    unexplained = _not_by_noise(kept.fit, still_missing(kept.evidence, left, causes, required), causes, begun)
    seen = (*causes, *minor)
    small = too_small(state, seen, unexplained)
    nuisance = [trial.candidate.attached for trial in minor_trials(state, seen)][:1]
    if small and (not unexplained or _nothing_left_with(kept, nuisance, state, causes, required)):
        minor = (*minor, *small)
        unexplained = []
    if not unexplained:
        unexplained = _missing_on_held(kept, nuisance, causes, begun)
    return minor, list(kept.fit.flight.sizes.told_at(kept.fit, unexplained))


def drifting(fitted: FlightFit, missing: Sequence[MissingInput]) -> set[str]:
    """Readings at which a drift is missing that matters as a bias of its size would."""
    by = fitted.criteria
    drifts = [m for m in missing if m.place.kind == "reading" and m.gain > by.missing]
    return {m.place.name for m in drifts if missing_size(fitted, m) > 1.0}


def traced(kept: Kept, left: Sequence[MissingInput], unexplained: Sequence[MissingInput], of_causes: Trace) -> Trace:
    """The decisions on causes, and on the ports where the final model lacks something: unexplained, or why not."""
    told = {m.station for m in unexplained}
    found = list(of_causes.decisions)
    for m in left:
        known = m.place.name in kept.fit.flight.unknown
        asked = (
            ask.INPUT_GAIN.of(m.gain, kept.evidence.criteria.missing, "parts.third"),
            ask.MATTERS.of(missing_size(kept.fit, m), 1.0, "size.share"),
            ask.LEFT.of(m.station in told, 1.0),
            *((ask.RECORDED.failed(),) if known else ()),
        )
        outcome = NAMED if m.station in told else REFUSED
        found.append(Decision(cause=m.station, round=0, outcome=outcome, gates=asked))
    return Trace(decisions=tuple(found))


def too_small_or_refused(fitted: FlightFit, causes: Sequence[Cause]) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """Divide the causes that are not named into those that are too small to matter, and those that another gate
    refused.

    Structure that is expected of an aircraft and part of the final model is among the first.
    """
    there = {one.effect.key for one in fitted.attached}
    usual = {one.key for one in causes if one.key in there and (is_usual(one.effect) or one.effect.traits.expected)}
    small = [one.share < 1.0 or one.key in usual for one in causes]
    first, second = (tuple(c for c, is_ in zip(causes, small, strict=True) if is_ is side) for side in (True, False))
    return first, second


def _not_by_noise(
    fitted: FlightFit,
    unexplained: list[MissingInput],
    causes: Sequence[Cause],
    begun: Baseline,
    share: float | None = None,
) -> list[MissingInput]:
    """The unexplained inputs that remain if the noise is as slow as the residuals of the fit.

    If slow noise is taken for white noise, each of its readings counts as new information, and a latent input has a
    statistic by mistake. In turbulence the innovations may instead be coloured; an input must remain in both cases.
    """
    if not unexplained or fitted.noise.colour or begun.fixed:
        return unexplained
    if fitted.flight.limit.is_over:
        fitted.flight.limit.leave_out(_SLOW)
        return unexplained
    slow = partial(as_slow_as_left, drifting=drifting(fitted, unexplained))
    for in_its_noise in (slow, *((as_coloured_as_left,) if fitted.noise.coloured else ())):
        evidence = weigh(in_its_noise(fitted))
        unexplained = still_missing(evidence, missing_inputs(evidence), causes, begun.required, share)
        if not unexplained:
            break
    return unexplained


def _missing_on_held(
    kept: Kept, nuisance: Sequence[Attached], causes: Sequence[Cause], begun: Baseline
) -> list[MissingInput]:
    """Latent inputs that only the held-out records show.

    Neither the model nor other derivatives may explain them, nor a `nuisance` cause that is too small to matter in the
    fitted records.
    """

    def missing(held: FlightFit) -> list[MissingInput]:
        share = kept.evidence.criteria.size.ambiguous
        evidence = weigh(fit(held.flight, held.attached, held.noise, held))
        found = still_missing(evidence, missing_inputs(evidence), causes, begun.required, share)
        return _not_by_noise(evidence.fit, found, causes, begun, share)

    found = missing(kept.held_fit)
    if found and nuisance:
        joint = kept.with_effects(nuisance)
        if not missing(with_events(judge_on(kept.held_fit.flight.records, joint), joint)):
            return []
    return found


def _nothing_left_with(
    kept: Kept, nuisance: Sequence[Attached], state: State, causes: Sequence[Cause], required: float
) -> bool:
    """Return True if nothing is missing in the fitted records once `nuisance` causes are beside all that were named."""
    if not kept.has_all(state):
        return False
    evidence = weigh(kept.with_effects(nuisance))
    return not still_missing(evidence, missing_inputs(evidence), causes, required)


def _last_tests(
    kept: Kept, state: State, left: Sequence[MissingInput], steps: BudgetSteps
) -> tuple[Probabilities, tuple[Cause, ...], tuple[Cause, ...], list[MissingInput]]:
    """Probabilities of the named causes, the minor and the refused ones, and the latent inputs that remain.

    Where nothing is named, a cause too small to matter is, if values alone do not account for the error: `steps`."""
    causes, minor = causes_of(state, kept, left)
    refined = state.criteria.parts.clearly
    alone = ask.VALUES_ALONE.of(steps.values / max(steps.structure, steps.floor), refined, "parts.half")
    if not causes and alone.passed:
        causes, minor = causes_of(state, kept, left, (alone,))
    minor, unexplained = what_is_left(kept, state, left, (causes, minor))
    minor, refused = too_small_or_refused(kept.fit, minor)
    return probabilities(causes, unexplained, state, left), minor, refused, unexplained


# of the final model, the named and the minor causes, and the values by the records
ByFit = Callable[
    [Kept, Sequence[Cause], Sequence[Cause], Mapping[str, FlightValue]], DiagnosedAircraft | DiagnosedSystem
]


def judged(
    state: State,
    given: AsGiven,
    held: Sequence[Record],
    diagnosed: ByFit,
    stages: Stages,
) -> Diagnosis:
    """The causes and latent inputs of a search, tested on the held-out records, without verdict and sentences."""
    begun = state.baseline
    criteria = state.criteria
    limit = state.baseline.flight.limit
    state = replace(state, rounds=tempered(state.rounds, state.evidence))
    stages.begin("held-out records")
    kept = keep(held, state)
    stages.begin("missing inputs")
    left = state.missing if kept.evidence is state.evidence else tuple(missing_inputs(kept.evidence))
    exact = _missing_in(kept.fit)
    stages.begin("verdict")
    fits = begun.calm, kept.fit, kept.held_calm, kept.held_fit
    refitted, extended, held_refitted, held_extended = map(view_of, fits)
    budget = budget_of(given, held_refitted, held_extended, extended)
    belief, minor, refused, unexplained = _last_tests(kept, state, left, budget.together)
    causes = belief.causes
    faint = belief.faint and (cause_of(belief.faint[0], state).sentence, belief.faint[1])
    bare = begun.without_causes({c.key for c in causes})
    air = in_other_air(kept.fit).lighter(filtered=False) if kept.fit.noise.coloured else None  # its values are asked
    flight = flight_values(kept.evidence, air, other_explanations(state, kept.fit, belief.there))
    first = exact if kept.fit is bare else _missing_in(bare)
    added = diagnosed(kept, causes, (*minor, *refused), flight)
    stages.end()
    return Diagnosis(
        remark=sentences.remarks(minor, faint),
        diagnosed=added,
        causes=causes,
        minor=minor,
        not_tried=tuple(NotJudged(what=what, because=limit.because) for what in limit.left_out),
        ranking=state.rounds[0].candidates[: criteria.numerics.naming.ranking] if state.rounds else (),
        rounds=state.rounds,
        as_given=given.fitted,
        refitted=refitted,
        extended=extended,
        held_out_as_given=given.held,
        held_out_refitted=held_refitted,
        held_out_extended=held_extended,
        budget=budget,
        flight=flight,
        bare=bare,
        missing_before=tuple(first),
        missing_after=tuple(exact),
        unexplained=tuple(unexplained),
        kinematic=tuple(begun.kinematics.ranked),
        turbulence=begun.turbulence,
        detectable=state.rounds[0].detectable if state.rounds else {},
        seconds=stages.seconds,
        seconds_of_processor=stages.of_processor,
        held_out_is_new=part_of_a_fitted_record(held, begun.flight.records),
        explanations=() if limit.left_out else belief.explanations,  # they assume that the catalogue was tried
        believed=belief.there,
        entered={} if limit.left_out else belief.entered,
        nothing=None if limit.left_out else belief.nothing,
        trace=traced(kept, left, unexplained, trace_of_search(state, causes, minor, refused)),
    )


def _missing_in(fitted: FlightFit) -> list[MissingInput]:
    """The latent inputs beside a model whose structure is taken as exact."""
    return missing_inputs(weigh(fitted, discrepancy=False))
