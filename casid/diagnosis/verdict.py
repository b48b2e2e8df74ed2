"""The verdict: a table of conditions, and the sentences of a diagnosis.

The verdict is the first row of the table whose condition holds. No cause is named if the data are at fault, if the file
has impossible numbers, or if the extended model fails on the held-out records.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from casid.diagnosis import sentences
from casid.diagnosis.data.finding import Finding
from casid.diagnosis.decision import IN_A_SET, MINOR, NAMED, Trace, at_most
from casid.diagnosis.engine.size import missing_share
from casid.diagnosis.given.account import account_of, account_sentence, failure_sentence
from casid.diagnosis.given.contradicted import impossible
from casid.diagnosis.given.factors import Factor, borne_out
from casid.diagnosis.given.not_judged import out_of_sight
from casid.diagnosis.given.reach import Reach
from casid.diagnosis.result import Diagnosis
from casid.errors import CasidError
from casid.model.plausible import Doubt
from casid.model.vocabulary import effect_title


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


def concluded(found: Diagnosis, reach: Reach, data: Sequence[Finding], doubts: Sequence[Doubt]) -> Diagnosis:
    """The diagnosis with its verdict and sentences.

    Parameters
    ----------
    found
        The diagnosis with causes and latent inputs only.
    reach
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
    criteria, most = reach.flight.criteria.given, reach.flight.criteria.verdict.stated
    factors = _factors(found, reach)
    single = {name for one in factors for name in one.derivatives}
    against = tuple(one for one in reach.contradicted(found.aircraft, found.flight) if one.parameter not in single)
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
    open_ = (*reach.not_judged(found.flight), *out_of_sight(found.bare.flight, found.detectable))
    account = account_of(found.budget, _contributions(found, mended, factors))
    parts = [
        account_sentence(found.budget, account, most),
        sentences.several(mended, most),
        headline,
        sentences.losses(found.budget, criteria.worse, criteria.above_noise),
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


def _factors(found: Diagnosis, reach: Reach) -> tuple[Factor, ...]:
    """Common factors of the groups with at least one derivative that is inconsistent with flight."""
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
