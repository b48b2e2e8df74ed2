"""Open the answers of blind tests and score what was found.

A name is right when kind, target and term are those of the answer. A change of configuration is right when the named
coefficients are part of those that changed, or contain them: a step of 0.003 in Cm need not be seen. What cannot be
told from a cause (`indistinguishable_from`) belongs to its set; so does a cause that a group of values reproduces, and
that is told as the number which they have in common (`factors`). Causes that are true beside what was hidden are left
out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from problems.blind.case import LOADING, Answer, Hidden, family

Found = Mapping[str, Any]
# effects outside the catalogue that the catalogue can say in other words
OTHER_WORDS: Mapping[str, tuple[tuple[str, str, str | None], ...]] = {
    "rotor_gyroscope": (("aero_term", "Cm", "r"), ("aero_term", "Cn", "q")),
    "wing_bending": (("unsteady_aero", "CL", None), ("structural_mode", "q", None), ("structural_mode", "az", None)),
}
_OUTSIDE_AIRCRAFT = ("controls", "sensors", "air")  # families that leave the derivatives of the aircraft as they are
_NORMAL = 1.96  # 1-sigmas of a 95 % interval
ELSEWHERE = "same kind, elsewhere"
NOTHING, UNEXPLAINED, FAILED = "adequate", "unexplained", "failed"


@dataclass(frozen=True, kw_only=True)
class Score:
    """One set scored.

    named      kind of the strongest cause (the answer's, when that is in its set), ELSEWHERE when its kind is right but
               its target or term is not, or NOTHING, UNEXPLAINED, FAILED
    first      the answer is the strongest cause or in its set; `hits` of the hidden effects are among all causes
    same_family  the strongest cause is of the family of a hidden effect
    wrong      causes (with their sets) that are nothing of what is hidden
    described  outside the catalogue: every cause says the same in other words
    onsets     hidden onsets and how many lie in the stated interval
    sized      relative error and whether the 95 % interval has the size; None: not named by its own name
    values     numbers of the file that were told against flight, and how many of their 95 % intervals hold the truth;
               none where what is hidden changes the aircraft itself
    """

    answer: Answer
    verdict: str
    named: str
    first: bool
    hits: int
    same_family: bool
    wrong: int
    described: bool
    onsets: tuple[int, int]
    sized: tuple[float, bool] | None
    seconds: float
    values: tuple[int, int] = (0, 0)


def score(answer: Answer, found: Found) -> Score:
    """Score a shortened diagnosis (`problems.blind.solve.solve`)."""
    if "failed" in found:
        return Score(
            answer=answer,
            verdict=FAILED,
            named=FAILED,
            first=False,
            hits=0,
            same_family=False,
            wrong=0,
            described=False,
            onsets=(0, 0),
            sized=None,
            seconds=0.0,
        )
    hidden = answer.hidden
    told = sorted([*found["causes"], *_of_values(found)], key=lambda cause: -cause["statistic"])
    causes = [
        cause
        for cause in told
        if _among(answer.hidden, cause) or not _among(answer.besides, cause)  # what was hidden may look like a beside
    ]
    found = {**found, "causes": causes}
    strongest = list(_set(causes[0])) if causes else []
    first = any(same(one, other) for one in hidden for other in strongest)
    own = next((c for c in causes if hidden and same(hidden[0], c)), None)
    words = [any(_key(o) in OTHER_WORDS.get(h.kind, ()) for h in hidden for o in _set(c)) for c in causes]
    return Score(
        answer=answer,
        verdict=found["verdict"],
        named=_named(hidden, found, first),
        first=first,
        hits=sum(any(same(one, other) for c in causes for other in _set(c)) for one in hidden),
        same_family=any(_family(o) == _family_of(h) for o in strongest[:1] for h in hidden) or first,
        wrong=sum(not any(same(h, o) for h in hidden for o in _set(c)) for c in causes),
        described=bool(words) and all(words),
        onsets=_onsets(hidden, causes),
        sized=_sized(answer, own),
        seconds=sum(found["seconds"].values()),
        values=_values(answer, found["contradicted"]),
    )


def _of_values(found: Found) -> Iterator[Found]:
    """Causes that a group of values reproduces, and that are told as the number which these have in common."""
    records = list(dict.fromkeys(name for cause in found["causes"] for name in cause["records"]))
    for one in found.get("factors", ()):
        kind, _, place = one["cause"].removesuffix(")").partition("(")
        target, _, term = place.partition(":")
        if kind:
            said = {"kind": kind, "target": target, "term": term or None, "value": one["factor"]}
            yield {**one, **said, "records": records, "onset_s": None, "indistinguishable_from": []}


def _set(cause: Found) -> Iterator[Found]:
    yield cause
    yield from cause["indistinguishable_from"]


def _among(effects: Sequence[Hidden], cause: Found) -> bool:
    """Whether a cause, or one of its set, is one of these effects."""
    return any(same(one, other) for one in effects for other in _set(cause))


def _key(found: Found) -> tuple[str, str, str | None]:
    return found["kind"], found.get("target") or "", found.get("term")


def same(hidden: Hidden, found: Found) -> bool:
    """Whether a cause that was found is one that was hidden."""
    kind, target, term = _key(found)
    if kind != hidden.kind:
        return False
    if kind == "configuration_change":
        ours, theirs = set(hidden.target.split("+")), set(target.split("+"))
        return ours <= theirs or theirs <= ours
    return (target, term) == (hidden.target, hidden.term)


def _family(found: Found) -> str:
    return family(found["kind"], found.get("target") or "")


def _family_of(hidden: Hidden) -> str | None:
    try:
        return family(hidden.kind, hidden.target)
    except StopIteration:
        return None


def _named(hidden: tuple[Hidden, ...], found: Found, first: bool) -> str:
    if not found["causes"]:
        return NOTHING if found["verdict"] in (NOTHING, "values wrong") else UNEXPLAINED
    strongest = found["causes"][0]
    if first:
        return next(h.kind for h in hidden for o in _set(strongest) if same(h, o))
    return ELSEWHERE if any(h.kind == strongest["kind"] for h in hidden) else strongest["kind"]


def _onsets(hidden: tuple[Hidden, ...], causes: list[Found]) -> tuple[int, int]:
    """(onsets inside the stated interval, onsets) of hidden events that were named."""
    inside = total = 0
    for one in hidden:
        cause = next((c for c in causes if same(one, c)), None)
        if cause is None or not one.onset_s:
            continue
        stated = cause["onset_s"] or {}
        for record, onset in one.onset_s.items():
            if record in cause["records"]:
                total += 1
                low, high = stated.get(record, (1.0, 0.0))
                inside += low <= onset <= high
    return inside, total


def _values(answer: Answer, contradicted: list[Found]) -> tuple[int, int]:
    """(intervals that hold the truth, intervals) of the numbers of the file that were told against flight."""
    if any(_family_of(one) not in _OUTSIDE_AIRCRAFT for one in answer.hidden):
        return 0, 0
    told = [c for c in contradicted if c["parameter"] in answer.values and not c["impossible"]]
    off = [abs(c["flight"] - answer.values[c["parameter"]]) for c in told]
    return sum(error <= _NORMAL * c["std"] for error, c in zip(off, told, strict=True)), len(told)


def _sized(answer: Answer, own: Found | None) -> tuple[float, bool] | None:
    if own is None or not answer.hidden:
        return None
    one, value = answer.hidden[0], own["value"]
    fitted = {f"m{i}" for i in range(1, len(answer.conditions["durations_s"]))}  # the last record is held back
    if one.kind in LOADING and set(own["records"]) == fitted - set(one.records):
        value = -value  # the same difference, told of the other fitted records
    error = value - one.value
    return error / abs(one.value), abs(error) <= _NORMAL * own["std"]
