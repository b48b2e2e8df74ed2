"""The verdict as it opens the report: the worst that holds, with what is wrong in data and values, what the held-out
records say against it, and what was not judged."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from casid.diagnosis.criteria import GivenCriteria
from casid.diagnosis.data.finding import Finding
from casid.diagnosis.decision import IN_A_SET, MINOR, NAMED, Trace, at_most
from casid.diagnosis.given.account import account_of, account_sentence, failure_sentence
from casid.diagnosis.given.budget import Budget
from casid.diagnosis.given.contradicted import Contradiction, impossible
from casid.diagnosis.given.factors import Factor, borne_out
from casid.diagnosis.given.not_judged import NotJudged, out_of_sight
from casid.diagnosis.given.reach import Reach
from casid.diagnosis.result import Diagnosis
from casid.errors import CasidError
from casid.model.plausible import Doubt
from casid.model.vocabulary import effect_title


def concluded(found: Diagnosis, reach: Reach, data: Sequence[Finding], doubts: Sequence[Doubt]) -> Diagnosis:
    """The diagnosis with the worst verdict that holds, from one that causes and unknown inputs give alone.

    Where the `data` are at fault, or the file has numbers in `doubts`, no cause is named.

    data at fault > unexplained > partly explained > explained > values wrong > adequate
    """
    criteria, most = reach.flight.criteria.given, reach.flight.criteria.verdict.stated
    against, factors = reach.contradicted(found.aircraft, found.flight), _factors(found, reach)
    single = {name for one in factors for name in one.derivatives}
    against = tuple(one for one in against if one.parameter not in single)
    doubts = borne_out(doubts, found.aircraft, found.flight)
    open_ = (*reach.not_judged(found.flight), *out_of_sight(found.bare.flight, found.detectable))
    at_fault = [one for one in data if one.handled == "reported"]
    mended = [one for one in data if one.handled != "reported"]
    verdict, headline = found.verdict, found.headline
    cannot_be = tuple(map(impossible, doubts))
    if at_fault:
        found, against = _in_doubt(found, "the data are at fault"), cannot_be
        verdict, headline = "data at fault", f"{_several(at_fault, most)} Until that is mended nothing else is certain."
    elif cannot_be:
        found, against = _in_doubt(found, "the aircraft file cannot be right"), (*cannot_be, *against)
        stated = [replace(one, sentence=f"Aircraft file: {one.sentence}") for one in cannot_be]
        verdict, headline = "values wrong", f"{_several(stated, most)} Until that is mended nothing else is certain."
    elif fails := failure_sentence(found.budget, criteria):
        found = _in_doubt(found, "the extended model fails on held-out records")
        verdict, headline = "unexplained", fails
    elif verdict == "adequate" and (against or factors):
        verdict, headline = "values wrong", _values_wrong(factors, against, most, found.remark)
    elif against or factors:
        headline = f"{headline} {_also_contradicted(factors, against, most)}"
    elif verdict == "adequate":
        headline = f"{headline}{found.remark}{_would_have_shown(found)}{_refined(found.budget, criteria)}"
    account = account_of(found.budget, _contributions(found, mended, factors))
    opening = account_sentence(found.budget, account, most)
    parts = [opening, _several(mended, most), headline, _losses(found.budget, criteria), _left_open(open_, most)]
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


def _factors(found: Diagnosis, reach: Reach) -> tuple[Factor, ...]:
    """Common factors of groups of which flight contradicts a member."""
    against = {one.parameter for one in reach.contradicted(found.aircraft, found.flight)}
    return tuple(one for one in reach.factors(found.aircraft, found.flight) if against & set(one.derivatives))


def _contributions(found: Diagnosis, mended: Sequence[Finding], factors: Sequence[Factor]) -> dict[str, list[str]]:
    """Step of the account -> what contributes to it, the largest first."""
    by, given = found.criteria.given, found.aircraft.derivatives
    single = {name for one in factors for name in one.derivatives}
    moved = {
        name: (one.value, one.std)
        for name, one in found.flight.items()
        if one.determined and given.get(name) and name not in single and not name.endswith("_0")
    }
    sigmas = {name: abs(value - given[name]) / std for name, (value, std) in moved.items() if std > 0.0}
    order = sorted((name for name, size in sigmas.items() if size > by.sigmas), key=lambda name: -sigmas[name])
    return {
        "data": [f"{one.target}: {one.kind.removeprefix('data_')}" for one in mended],
        "values": [
            *(f"{one.row} times {one.factor:.2f}" for one in factors),
            *(f"{name} {100.0 * (moved[name][0] / given[name] - 1.0):+.0f} %" for name in order),
        ],
        "structure": [effect_title(*one.key) for one in found.causes],
        "unexplained": [one.place.words for one in found.unexplained],
    }


def _would_have_shown(found: Diagnosis) -> str:
    """The smallest faults of instruments that would have shown: of each kind that of the channel that hides most."""
    told = []
    for kind, unit, name in (("delay", "s", "delay"), ("lag", "s", "lag"), ("scale", "1", "scale error")):
        sizes = {channel: by[kind] for channel, by in found.detectable_by_channel.items() if kind in by}
        seen = {channel: size for channel, size in sizes.items() if math.isfinite(size)}
        if seen:
            channel = max(seen, key=lambda one: seen[one])
            size = f"{100.0 * seen[channel]:.2g} %" if unit == "1" else f"{seen[channel]:.2g} {unit}"
            told.append(f"a {name} of {channel} under {size}")
    return f" What would not show here: {', '.join(told)}." if told else ""


@contextmanager
def named_in_errors(data: Sequence[Finding], doubts: Sequence[Doubt], most: int) -> Iterator[None]:
    """A block whose errors name why they are likely: faults of the `data` that could not be mended, and the numbers of
    the file that cannot be; `most` of a kind."""
    try:
        yield
    except CasidError as error:
        at_fault = [one for one in data if one.handled == "reported"]
        stated = f"; {_several(at_fault, most)}" if at_fault else ""
        stated += f"; of the aircraft file: {_several(doubts, most)}" if doubts else ""
        if not stated:
            raise
        raise type(error)(f"{error}{stated}") from None


def _in_doubt(found: Diagnosis, because: str) -> Diagnosis:
    """Causes are none while data or file are at fault; what was found stands under minor."""
    doubted = [replace(c, sentence=f"{c.sentence} In doubt, for {because}.") for c in found.causes]
    gate = at_most(because, 1.0, 0.0)
    decisions = tuple(
        replace(one, outcome=MINOR, gates=(*one.gates, gate)) if one.outcome in (NAMED, IN_A_SET) else one
        for one in found.trace.decisions
    )
    return replace(found, causes=(), minor=(*doubted, *found.minor), unexplained=(), trace=Trace(decisions=decisions))


def _several(all_of_them: Sequence[Finding | Contradiction | Doubt | Factor], most: int) -> str:
    """The sentences of the first, `most` of them, and how many more there are."""
    stated = " ".join(one.sentence for one in all_of_them[:most])
    more = len(all_of_them) - most
    return f"{stated} And {more} more." if more > 0 else stated


def _values_wrong(factors: Sequence[Factor], contradicted: Sequence[Contradiction], most: int, remark: str) -> str:
    return f"The structure is right, but {_against(factors, contradicted, most)}{remark}"


def _also_contradicted(factors: Sequence[Factor], contradicted: Sequence[Contradiction], most: int) -> str:
    return f"Besides, {_against(factors, contradicted, most)}"


def _against(factors: Sequence[Factor], contradicted: Sequence[Contradiction], most: int) -> str:
    """Common factors, then the numbers that are inconsistent with flight one by one."""
    counted = ((len(factors), "group{} of derivatives"), (len(contradicted), "number{}"))
    said = " and ".join(f"{'a' if n == 1 else n} {what.format('' if n == 1 else 's')}" for n, what in counted if n)
    verb = "is" if len(factors) + len(contradicted) == 1 else "are"
    return f"{said} of the file {verb} inconsistent with flight. {_several([*factors, *contradicted], most)}"


def _refined(budget: Budget, criteria: GivenCriteria) -> str:
    """What values within their stated uncertainty are worth."""
    steps = budget.together
    if not steps.data_mended > criteria.refined * steps.structure:
        return ""
    return (
        f" Its values, refitted within what the file states of them, take the error on "
        f"{', '.join(budget.records)} from {steps.data_mended:.2g} to {steps.structure:.2g} times the noise."
    )


def _losses(budget: Budget, criteria: GivenCriteria) -> str:
    """Channels that the best model simulates worse than the file as given on held-out records, worst first."""
    lost = {
        name: steps.structure / steps.as_given
        for name, steps in budget.channels.items()
        if steps.structure > criteria.worse * steps.as_given and steps.structure > criteria.above_noise
    }
    if not lost:
        return ""
    stated = ", ".join(f"{name} ({100.0 * (lost[name] - 1.0):+.0f} %)" for name in sorted(lost, key=lambda o: -lost[o]))
    return f"Open-loop simulation of {', '.join(budget.records)}, which no fit has seen, gets worse in {stated}."


def _left_open(not_judged: Sequence[NotJudged], most: int) -> str:
    if not not_judged:
        return ""
    stated = "; ".join(f"{one.what} ({one.because})" for one in not_judged[:most])
    more = len(not_judged) - most
    return f"Not judged: {stated}{f'; and {more} more' if more > 0 else ''}."
