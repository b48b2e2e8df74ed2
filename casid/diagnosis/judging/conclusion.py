"""The verdict as it opens the report: the worst that holds, with what is wrong in data and values, what the held-out
records say against it, and what was not judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from casid.diagnosis.criteria import GivenCriteria
from casid.diagnosis.data.finding import Finding
from casid.diagnosis.decision import IN_A_SET, MINOR, NAMED, Trace, at_most
from casid.diagnosis.given.budget import Budget
from casid.diagnosis.given.contradicted import Contradiction, impossible
from casid.diagnosis.given.not_judged import NotJudged, out_of_sight
from casid.diagnosis.given.reach import Reach
from casid.diagnosis.result import Diagnosis
from casid.errors import CasidError
from casid.model.plausible import Doubt

_NOTHING_MORE = "in these records."  # ends what an adequate model is told by, by rules and by score


def concluded(found: Diagnosis, reach: Reach, data: Sequence[Finding], doubts: Sequence[Doubt]) -> Diagnosis:
    """The diagnosis with the worst verdict that holds, from one that causes and unknown inputs give alone.

    Where the `data` are at fault, or the file has numbers in `doubts`, no cause is named.

    data at fault > unexplained > partly explained > explained > values wrong > adequate
    """
    criteria, most = reach.flight.criteria.given, reach.flight.criteria.verdict.stated
    against = reach.contradicted(found.aircraft, found.flight)
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
    elif verdict == "adequate" and against:
        verdict, headline = "values wrong", f"{_values_wrong(against, most)}{headline.partition(_NOTHING_MORE)[2]}"
    elif against:
        headline = f"{headline} {_also_contradicted(against, most)}"
    elif verdict == "adequate":
        headline = f"{headline}{_refined(found.budget, criteria)}"
    parts = [_several(mended, most), headline, _losses(found.budget, criteria), _left_open(open_, most)]
    return replace(
        found,
        verdict=verdict,
        headline=headline,
        sentence=" ".join(part for part in parts if part),
        not_judged=open_,
        data=tuple(data),
        contradicted=against,
    )


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


def _several(all_of_them: Sequence[Finding | Contradiction | Doubt], most: int) -> str:
    """The sentences of the first, `most` of them, and how many more there are."""
    stated = " ".join(one.sentence for one in all_of_them[:most])
    more = len(all_of_them) - most
    return f"{stated} And {more} more." if more > 0 else stated


def _values_wrong(contradicted: Sequence[Contradiction], most: int) -> str:
    return f"The structure is right, but {_against(contradicted)} {_several(contradicted, most)}"


def _also_contradicted(contradicted: Sequence[Contradiction], most: int) -> str:
    return f"Besides, {_against(contradicted)} {_several(contradicted, most)}"


def _against(contradicted: Sequence[Contradiction]) -> str:
    few, stand = ("a number", "stands") if len(contradicted) == 1 else (f"{len(contradicted)} numbers", "stand")
    return f"{few} of the file {stand} against flight."


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
