"""The verdict: a table of conditions, and the sentences of a diagnosis.

The verdict is the first row of the table whose condition holds. No cause is named if the data are at fault, if the file
has impossible numbers, or if the extended model fails on the held-out records.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from casid.data_check.reading import Finding
from casid.diagnosis import sentences
from casid.diagnosis.cause import IN_A_SET, MINOR, NAMED, Cause, Trace, at_least, at_most
from casid.diagnosis.causes import minor_trials, still_missing, too_small
from casid.diagnosis.engine.acceptance import required_gain
from casid.diagnosis.engine.held_out import Kept, judge_on, with_events
from casid.diagnosis.engine.search import State
from casid.diagnosis.engine.size import missing_share
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_coloured_as_left, as_slow_as_left
from casid.diagnosis.given.budget import account_of, account_sentence, failure_sentence
from casid.diagnosis.given.contradicted import impossible
from casid.diagnosis.given.factors import Factor, borne_out
from casid.diagnosis.given.scope import Scope, out_of_sight
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.sentences import SLOW_NOISE, noted
from casid.errors import CasidError
from casid.model.plausible import Doubt
from casid.model.vocabulary import effect_title


def what_is_left(
    kept: Kept,
    state: State,
    left: Sequence[MissingInput],
    judged: tuple[tuple[Cause, ...], tuple[Cause, ...]],
) -> tuple[tuple[Cause, ...], list[MissingInput]]:
    """The minor causes and the latent inputs that no cause explains.

    Latent inputs are dropped if causes that are too small to matter explain them.

    Parameters
    ----------
    kept
        The model after the test on the held-out records.
    state
        The final state of the search.
    left
        Latent inputs in the fitted records.
    judged
        Named causes and minor ones so far.

    Returns
    -------
    minor
        The minor causes, with those added here.
    unexplained
        The latent inputs that remain.
    """
    (causes, minor), required = judged, state.baseline.required
    unexplained = _not_by_noise(kept.fit, still_missing(kept.evidence, left, causes, required), causes, required)
    seen = (*causes, *minor)
    small = too_small(state, seen, unexplained)
    nuisance = [trial.candidate.attached for trial in minor_trials(state, seen)][:1]
    if small and (not unexplained or _nothing_left_with(kept, nuisance, state, causes, required)):
        minor, unexplained = (*minor, *small), []
    if not unexplained:
        unexplained = _missing_on_held(kept, nuisance, causes, required)
    return minor, unexplained


def beside_slow_noise(
    kept: Kept, state: State, causes: Sequence[Cause], minor: Sequence[Cause]
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """The named and the minor causes, after a test with slow noise.

    The noise of each reading, and the instrument offsets, are made as slow and as large as the residuals with all
    causes allow. A cause with too small a statistic under that noise becomes minor. This is backward elimination: the
    weakest cause is dropped and the others are tested again without it.
    """
    if not causes or kept.fit.noise.colour:
        return tuple(causes), tuple(minor)
    slow, left = as_slow_as_left(kept.fit), list(causes)
    while left and slow.noise.slow:
        gains = [(_share_of_required(slow, state, cause), i) for i, cause in enumerate(left)]
        share, weakest = min(gains)
        gate = at_least("gain where noise is slow, of that for a name", share, 1.0, "naming.gain")
        one = replace(left[weakest], gates=(*left[weakest].gates, gate))
        if gate.passed:
            left[weakest] = one
            break
        del left[weakest]
        minor = (*minor, noted(one, SLOW_NOISE))
        others = [a for a in slow.attached if a.effect.key != (one.kind, one.target, one.term)]
        slow = fit(slow.flight, others, slow.noise, slow)
    return tuple(left), tuple(minor)


def _share_of_required(slow: FlightFit, state: State, cause: Cause) -> float:
    """Likelihood-ratio statistic of a cause, from its standard deviation, over that required for a name.

    It is infinite for a cause that is not a parameter of the fit, such as turbulence.
    """
    slots = {slot.name for slot in slow.slots}
    for one in slow.attached:
        if one.effect.key == (cause.kind, cause.target, cause.term) and one.name in slots:
            return (slow[one.name] / slow.std(one.name)) ** 2 / required_gain(one.effect, state.criteria)
    return np.inf


def _not_by_noise(
    fitted: FlightFit,
    unexplained: list[MissingInput],
    causes: Sequence[Cause],
    required: float,
    share: float | None = None,
) -> list[MissingInput]:
    """The unexplained inputs that remain if the noise is as slow as the residuals of the fit.

    If slow noise is taken for white noise, each of its readings counts as new information, and a latent input has a
    statistic by mistake. In turbulence the innovations may instead be coloured; an input must remain in both cases.
    """
    if not unexplained or fitted.noise.colour:
        return unexplained
    for in_its_noise in (as_slow_as_left, *((as_coloured_as_left,) if fitted.noise.coloured else ())):
        evidence = weigh(in_its_noise(fitted))
        unexplained = still_missing(evidence, missing_inputs(evidence), causes, required, share)
        if not unexplained:
            break
    return unexplained


def _missing_on_held(
    kept: Kept, nuisance: Sequence[Attached], causes: Sequence[Cause], required: float
) -> list[MissingInput]:
    """Latent inputs that only the held-out records show.

    Neither the model nor other derivatives may explain them, nor a `nuisance` cause that is too small to matter in the
    fitted records.
    """

    def missing(model: FlightFit, held: FlightFit) -> list[MissingInput]:
        held = with_events(held, model)
        share = kept.evidence.criteria.size.ambiguous
        evidence = weigh(fit(held.flight, held.attached, held.noise, held))
        found = still_missing(evidence, missing_inputs(evidence), causes, required, share)
        return _not_by_noise(evidence.fit, found, causes, required, share)

    found = missing(kept.fit, kept.held_fit)
    if found and nuisance:
        joint = kept.with_effects(nuisance)
        if not missing(joint, judge_on(kept.held_fit.flight.records, joint)):
            return []
    return found


def _nothing_left_with(
    kept: Kept, nuisance: Sequence[Attached], state: State, causes: Sequence[Cause], required: float
) -> bool:
    """Whether nothing is missing in the fitted records if `nuisance` causes are added to all that were named."""
    if not kept.has_all(state):
        return False
    evidence = weigh(kept.with_effects(nuisance))
    return not still_missing(evidence, missing_inputs(evidence), causes, required)


@dataclass(frozen=True, kw_only=True)
class Facts:
    """The facts that a verdict depends on.

    data_at_fault    the data have faults that could not be corrected
    file_impossible  the file has numbers that no aircraft can have
    fails            the extended model is far worse than the simulation as given on held-out records
    causes           causes were named
    unexplained      something enters that no cause explains
    contradicted     values of the file are inconsistent with flight
    """

    data_at_fault: bool = False
    file_impossible: bool = False
    fails: bool = False
    causes: bool = False
    unexplained: bool = False
    contradicted: bool = False


_TABLE: tuple[tuple[str, Callable[[Facts], bool]], ...] = (
    ("data at fault", lambda facts: facts.data_at_fault),
    ("values wrong", lambda facts: facts.file_impossible),
    ("unexplained", lambda facts: facts.fails),
    ("partly explained", lambda facts: facts.causes and facts.unexplained),
    ("explained", lambda facts: facts.causes),
    ("unexplained", lambda facts: facts.unexplained),
    ("values wrong", lambda facts: facts.contradicted),
)


def verdict_of(facts: Facts) -> str:
    """The verdict of the first row of the table that holds; "adequate" if none does."""
    return next((verdict for verdict, holds in _TABLE if holds(facts)), "adequate")


def concluded(found: Diagnosis, scope: Scope, data: Sequence[Finding], doubts: Sequence[Doubt]) -> Diagnosis:
    """The diagnosis with its verdict and sentences.

    Parameters
    ----------
    found
        The diagnosis with causes and latent inputs only.
    scope
        The scope of the records and what they contradict.
    data
        Findings of the data check.
    doubts
        Numbers of the file that appear impossible.

    Returns
    -------
    Diagnosis
        The complete diagnosis.
    """
    criteria, most = scope.flight.criteria.given, scope.flight.criteria.verdict.stated
    factors = _factors(found, scope)
    single = {name for one in factors for name in one.derivatives}
    against = tuple(one for one in scope.contradicted(found.aircraft, found.flight) if one.parameter not in single)
    cannot_be = tuple(map(impossible, borne_out(doubts, found.aircraft, found.flight)))
    at_fault = [one for one in data if one.handled == "reported"]
    mended = [one for one in data if one.handled != "reported"]
    failure = failure_sentence(found.budget, criteria)
    facts = Facts(
        data_at_fault=bool(at_fault),
        file_impossible=bool(cannot_be),
        fails=bool(failure),
        causes=bool(found.causes),
        unexplained=bool(found.unexplained),
        contradicted=bool(against or factors),
    )
    verdict, fitted, remark = verdict_of(facts), found.bare.batch.names, found.remark
    if facts.data_at_fault:
        found, against = _in_doubt(found, "the data are at fault"), cannot_be
        headline = sentences.data_at_fault(at_fault, most)
    elif facts.file_impossible:
        found, against = _in_doubt(found, "the aircraft file cannot be right"), (*cannot_be, *against)
        headline = sentences.file_impossible(cannot_be, most)
    elif facts.fails:
        found, headline = _in_doubt(found, "the extended model fails on held-out records"), failure
    elif facts.causes:
        headline = sentences.explained(found.causes, next(iter(found.unexplained), None), fitted)
    elif facts.unexplained:
        missing = found.unexplained[0]
        fit = next(v.fit for v in (found.extended, found.held_out_extended) if missing.concerns(v.records))
        headline = sentences.unexplained(missing, missing_share(fit, missing), fitted)
    elif facts.contradicted:
        headline = sentences.values_wrong(factors, against, most, remark)
    else:
        worth = sentences.refined(found.budget, criteria.refined)
        headline = sentences.adequate(remark, found.detectable_by_channel, worth)
    if verdict in ("explained", "partly explained", "unexplained") and facts.contradicted and not facts.fails:
        headline = f"{headline} {sentences.also_contradicted(factors, against, most)}"
    open_ = (*scope.not_judged(found.flight), *out_of_sight(found.bare.flight, found.detectable))
    account = account_of(found.budget, _contributions(found, mended, factors))
    parts = [
        account_sentence(found.budget, account, most),
        sentences.several(mended, most),
        headline,
        sentences.losses(found.budget, criteria.worse),
        sentences.left_open(open_, most),
    ]
    return replace(
        found,
        verdict=verdict,
        headline=headline,
        sentence=" ".join(part for part in parts if part),
        not_judged=open_,
        data=tuple(data),
        contradicted=against,
        factors=factors,
        account=account,
    )


def _factors(found: Diagnosis, scope: Scope) -> tuple[Factor, ...]:
    """Common factors of the groups with at least one derivative that is inconsistent with flight."""
    against = {one.parameter for one in scope.contradicted(found.aircraft, found.flight)}
    return tuple(one for one in scope.factors(found.aircraft, found.flight) if against & set(one.derivatives))


def _contributions(found: Diagnosis, mended: Sequence[Finding], factors: Sequence[Factor]) -> dict[str, list[str]]:
    """Step of the account -> what contributes to it, the largest first."""
    least, given = found.criteria.significance.sigmas, found.aircraft.derivatives
    single = {name for one in factors for name in one.derivatives}
    moved = {
        name: (one.value, one.std)
        for name, one in found.flight.items()
        if one.determined and given.get(name) and name not in single and not name.endswith("_0")
    }
    sigmas = {name: abs(value - given[name]) / std for name, (value, std) in moved.items() if std > 0.0}
    order = sorted(
        (name for name, size in sigmas.items() if size > least),
        key=lambda name: -sigmas[name],
    )
    return {
        "data": [f"{one.target}: {one.kind.removeprefix('data_')}" for one in mended],
        "values": [
            *(f"{one.row} times {one.factor:.2f}" for one in factors),
            *(f"{name} {100.0 * (moved[name][0] / given[name] - 1.0):+.0f} %" for name in order),
        ],
        "structure": [effect_title(*one.key) for one in found.causes],
        "unexplained": [one.place.words for one in found.unexplained],
    }


@contextmanager
def named_in_errors(data: Sequence[Finding], doubts: Sequence[Doubt], most: int) -> Iterator[None]:
    """A block whose errors also name the likely reasons.

    These are faults of the `data` that could not be corrected, and impossible numbers of the file (`doubts`); at most
    `most` of each kind are listed.
    """
    try:
        yield
    except CasidError as error:
        at_fault = [one for one in data if one.handled == "reported"]
        stated = f"; {sentences.several(at_fault, most)}" if at_fault else ""
        stated += f"; of the aircraft file: {sentences.several(doubts, most)}" if doubts else ""
        if not stated:
            raise
        raise type(error)(f"{error}{stated}") from None


def _in_doubt(found: Diagnosis, because: str) -> Diagnosis:
    """The diagnosis with all causes listed as minor, because of a fault of the data, the file or the extended model."""
    doubted = [replace(c, sentence=f"{c.sentence} In doubt, for {because}.") for c in found.causes]
    gate = at_most(because, 1.0, 0.0)
    decisions = tuple(
        replace(one, outcome=MINOR, gates=(*one.gates, gate)) if one.outcome in (NAMED, IN_A_SET) else one
        for one in found.trace.decisions
    )
    return replace(found, causes=(), minor=(*doubted, *found.minor), unexplained=(), trace=Trace(decisions=decisions))
