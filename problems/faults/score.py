"""What a check made of a hidden fault."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from casid.data_check.reading import Finding
from casid.diagnosis.cause import Cause
from problems.faults.fault import GROUPS, DataFault
from problems.faults.visible import judged

OUTCOMES: tuple[str, ...] = ("found", "in its set", "refused", "missed", "wrong", "quiet", "false alarm")
RIGHT: tuple[str, ...] = ("found", "in its set", "refused", "quiet")
_ALIKE = ({"data_stuck", "data_dropout"},)  # a long hold is a short freeze


def score(fault: DataFault | None, findings: Sequence[Finding], had: Collection[str] = ()) -> str:
    """One of OUTCOMES; `had` are further records that have the fault, though it does not show in them.

    found       kind, target and records are right, the factor within 10 %, and it was handled
    in its set  it was reported with rivals, one of which (or itself) it is
    refused     something was reported at the right channel, nothing was changed
    wrong       anything was corrected or left out that had no fault, or called by another name
    """
    if fault is None:
        return "false alarm" if findings else "quiet"
    if not findings:
        return "missed"
    had = {*had, *fault.records}
    handled = [one for one in findings if one.handled != "reported"]
    strange = [one for one in handled if not _names(fault, one)]
    if strange:
        return "wrong"
    covered = {name for one in handled for name in one.target.split("+")}
    if covered >= set(fault.channels) and all(set(one.records) <= had for one in handled):
        return "found" if {r for one in handled for r in one.records} >= set(fault.records) else "wrong"
    sets = [pair for one in findings for pair in _set_of(one)]
    if any(kind == fault.kind and target == fault.target for kind, target in sets):
        return "in its set"
    touched = {name for one in findings for name in one.target.split("+")}
    if covered:
        return "in its set" if covered & set(fault.channels) else "wrong"
    return "refused" if touched & set(fault.channels) else "wrong"


def _names(fault: DataFault, finding: Finding) -> bool:
    """Whether a finding is the fault, or its part at one of its channels."""
    alike = finding.kind == fault.kind or any({finding.kind, fault.kind} <= kinds for kinds in _ALIKE)
    inside = set(finding.target.split("+")) <= set(fault.channels)
    if fault.kind == "data_unit" and finding.value is not None and fault.value is not None:
        return alike and inside and abs(finding.value / fault.value - 1.0) < 0.1
    return alike and inside


def _set_of(finding: Finding) -> Iterable[tuple[str, str]]:
    yield finding.kind, finding.target
    for other in finding.indistinguishable_from:
        yield str(other["kind"]), str(other["target"])


def score_causes(
    fault: DataFault | None,
    findings: Sequence[Finding],
    causes: Sequence[Cause],
    verdict: str,
    shows: DataFault | None,
    besides: Collection[tuple[str, str]] = (),
    not_judged: Collection[str] = (),
) -> str:
    """One of OUTCOMES of a whole diagnosis: a fault may be told as a finding of the data or as a cause.

    `shows` is the fault in the records that it shows in; where it shows in none, nothing need be said. `besides` are
    kind and target of causes that the same flight has without the fault, by name or in a set: a real one has some.
    `not_judged` is what was said to be so; a fault there is refused where nothing is named.
    """
    own = [one for one in causes if any(pair in besides for pair in _all(one))]
    causes = [one for one in causes if one not in own or fault and any(_is(fault, *p, not_judged) for p in _all(one))]
    if fault is None:
        return "false alarm" if findings or causes else "quiet"
    told = {(one.kind, one.target) for one in causes}
    sets = {pair for one in causes for pair in _all(one)}
    of_data = score(shows or fault, findings, fault.records)
    if of_data in ("found", "in its set", "refused"):
        return "wrong" if causes else of_data
    wanted = {pair for pair in sets if _is(fault, *pair, not_judged)}
    if told and told <= wanted:
        return "found"
    if wanted:
        return "in its set" if len(told) == 1 else "wrong"
    if told or of_data == "wrong":
        return "wrong"
    if not judged(fault.channels, not_judged):
        return "refused"
    if shows is None:
        return "quiet"
    if verdict == "adequate":
        return "wrong"
    return "refused" if verdict in ("unexplained", "partly explained", "data at fault") else "missed"


def _all(cause: Cause) -> list[tuple[str, str]]:
    """Kind and target of a cause and of what the data do not tell from it."""
    return [(cause.kind, cause.target), *((str(o["kind"]), str(o["target"])) for o in cause.indistinguishable_from)]


def _is(fault: DataFault, kind: str, target: str, not_judged: Collection[str]) -> bool:
    """Whether a cause is the fault; of a group of instruments those count that were judged."""
    if fault.kind == "thrust_scale":
        return (kind, target) == (fault.kind, "")
    if kind != fault.kind:
        return False
    group = judged(fault.channels, not_judged)
    return target == fault.target or (bool(group) and group == judged(GROUPS.get(target, (target,)), not_judged))
