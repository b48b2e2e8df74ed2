"""The verdict: a table of conditions, and the sentences of a diagnosis.

The verdict is the first row of the table whose condition holds. No cause is named if the data are at fault, if the file
has impossible numbers, or if the extended model fails on the held-out records.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from casid.data_check.reading import Finding
from casid.diagnosis import sentences
from casid.diagnosis.cause import IN_A_SET, MINOR, NAMED, Trace, at_most
from casid.diagnosis.engine.size import missing_share
from casid.diagnosis.given.budget import account_of, account_sentence, failure_sentence
from casid.diagnosis.given.contradicted import Contradiction, Factor, impossible
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.result import Diagnosis
from casid.errors import CasidError
from casid.model.plausible import Doubt


@dataclass(frozen=True, kw_only=True)
class Facts:
    """The facts that a verdict depends on.

    data_at_fault    the data have faults that could not be corrected
    file_impossible  the file has numbers that no aircraft can have
    fails            the extended model is far worse than the simulation as given on held-out records
    causes           causes were named
    costs            the error on held-out records is larger with the causes than without them
    unexplained      something enters that no cause explains
    contradicted     values of the file are inconsistent with flight
    """

    data_at_fault: bool = False
    file_impossible: bool = False
    fails: bool = False
    causes: bool = False
    costs: bool = False
    unexplained: bool = False
    contradicted: bool = False


_TABLE: tuple[tuple[str, Callable[[Facts], bool]], ...] = (
    ("data at fault", lambda facts: facts.data_at_fault),
    ("values wrong", lambda facts: facts.file_impossible),
    ("unexplained", lambda facts: facts.fails),
    ("partly explained", lambda facts: facts.causes and (facts.unexplained or facts.costs)),
    ("explained", lambda facts: facts.causes),
    ("unexplained", lambda facts: facts.unexplained),
    ("values wrong", lambda facts: facts.contradicted),
)


def verdict_of(facts: Facts) -> str:
    """The verdict of the first row of the table that holds; "adequate" if none does."""
    return next((verdict for verdict, holds in _TABLE if holds(facts)), "adequate")


def concluded(
    found: Diagnosis,
    against: Sequence[Contradiction],
    factors: Sequence[Factor] = (),
    not_judged: Sequence[NotJudged] = (),
    data: Sequence[Finding] = (),
    doubts: Sequence[Doubt] = (),
) -> Diagnosis:
    """The diagnosis with its verdict and sentences.

    Parameters
    ----------
    found
        The diagnosis with causes and latent inputs only.
    against
        Numbers of the file or model that are inconsistent with the records.
    factors
        Common factors of groups of numbers. One without any number in `against` is left out, and the numbers of the
        others are not reported one by one.
    not_judged
        What the records leave open.
    data
        Findings of the data check.
    doubts
        Numbers of the file that are impossible.

    Returns
    -------
    Diagnosis
        The complete diagnosis.
    """
    criteria, most = found.criteria.given, found.criteria.numerics.naming.listed
    names = {one.parameter for one in against}
    factors = tuple(one for one in factors if names & set(one.derivatives))
    single = {name for one in factors for name in one.derivatives}
    against = tuple(one for one in against if one.parameter not in single)
    cannot_be = tuple(map(impossible, doubts))
    at_fault = [one for one in data if one.handled == "reported"]
    mended = [one for one in data if one.handled != "reported"]
    failure = failure_sentence(found.budget, criteria)
    cost = sentences.cost(found.budget, criteria.refined) if found.causes else ""
    facts = Facts(
        data_at_fault=bool(at_fault),
        file_impossible=bool(cannot_be),
        fails=bool(failure),
        causes=bool(found.causes),
        costs=bool(cost),
        unexplained=bool(found.unexplained),
        contradicted=bool(against or factors),
    )
    wrong = sentences.contradicted(factors, against, most, found.part)
    if facts.data_at_fault:
        found, against, factors = _in_doubt(found, "the data are at fault"), cannot_be, ()
        headline = sentences.data_at_fault(at_fault, most)
    elif facts.file_impossible:
        found, against = _in_doubt(found, "the aircraft file cannot be right"), (*cannot_be, *against)
        headline = sentences.file_impossible(cannot_be, most)
    elif facts.fails:
        found, headline = _in_doubt(found, "the extended model fails on held-out records"), failure
    else:
        headline = _headline(found, facts, wrong)
    account = account_of(found.budget, _contributions(found, mended, factors))
    parts = [
        account_sentence(found.budget, account, most),
        sentences.several(mended, most),
        headline,
        cost,
        sentences.losses(found.budget, criteria.worse),
        sentences.left_open(not_judged, most),
    ]
    return replace(
        found,
        verdict=verdict_of(facts),
        headline=headline,
        sentence=" ".join(part for part in parts if part),
        not_judged=tuple(not_judged),
        data=tuple(data),
        contradicted=against,
        factors=factors,
        account=account,
    )


def _headline(found: Diagnosis, facts: Facts, wrong: str) -> str:
    """The sentences of a verdict that nothing puts in doubt; `wrong` is the clause of contradicted numbers."""
    missing, fitted = next(iter(found.unexplained), None), found.bare.batch.names
    if facts.causes:
        said = sentences.explained(found.causes, missing, fitted)
    elif missing is not None:
        fit = next(v.fit for v in (found.extended, found.held_out_extended) if missing.concerns(v.records))
        said = sentences.unexplained(missing, missing_share(fit, missing), fitted)
    elif facts.contradicted:
        return f"The structure is right, but {wrong}{found.remark}"
    else:
        worth = sentences.refined(found.budget, found.criteria.given.refined)
        return sentences.adequate(found.remark, found.detectable_by_channel, worth)
    return f"{said} Besides, {wrong}" if facts.contradicted else said


def _contributions(found: Diagnosis, mended: Sequence[Finding], factors: Sequence[Factor]) -> dict[str, list[str]]:
    """Step of the account -> what contributes to it, the largest first."""
    least, given = found.criteria.significance.sigmas, found.part.told
    single = {name for one in factors for name in one.derivatives}
    moved = {
        name: (one.value, one.std)
        for name, one in found.flight.items()
        if one.determined and given.get(name) and name not in single
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
        "structure": [one.title for one in found.causes],
        "unexplained": [one.words for one in found.unexplained],
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
    gate = at_most(because, 1.0, 0.0)
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
