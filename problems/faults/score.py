"""What a check made of a hidden fault."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from casid.diagnosis.cause import Cause
from casid.diagnosis.data.finding import Finding
from problems.faults.fault import DataFault

OUTCOMES: tuple[str, ...] = ("found", "in its set", "refused", "missed", "wrong", "quiet", "false alarm")
RIGHT: tuple[str, ...] = ("found", "in its set", "refused", "quiet")
_ALIKE = ({"data_stuck", "data_dropout"},)  # a long hold is a short freeze
_AXES = {
    "longitudinal motion": ("V", "alpha", "q", "theta", "ax", "az", "qdot", "delta_e", "thrust"),
    "lateral motion": ("beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot", "delta_a", "delta_r"),
}


def score(fault: DataFault | None, findings: Sequence[Finding]) -> str:
    """One of OUTCOMES.

    found       kind, target and records are right, the factor within 10 %, and it was handled
    in its set  it was reported with rivals, one of which (or itself) it is
    refused     something was reported at the right channel, nothing was changed
    wrong       anything was corrected or left out that had no fault, or called by another name
    """
    if fault is None:
        return "false alarm" if findings else "quiet"
    if not findings:
        return "missed"
    handled = [one for one in findings if one.handled != "reported"]
    strange = [one for one in handled if not _names(fault, one)]
    if strange:
        return "wrong"
    covered = {name for one in handled for name in one.target.split("+")}
    if covered >= set(fault.channels) and all(set(one.records) <= set(fault.records) for one in handled):
        return "found" if {r for one in handled for r in one.records} == set(fault.records) else "wrong"
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
    besides: Collection[tuple[str, str]] = (),
    not_judged: Collection[str] = (),
) -> str:
    """One of OUTCOMES of a whole diagnosis: a fault may be told as a finding of the data or as a cause.

    `besides` are kind and target of causes that the same flight has without the fault: a real one has its own.
    `not_judged` is what was said to be so; a fault there is refused where nothing is named.
    """
    causes = [one for one in causes if (one.kind, one.target) not in besides]
    if fault is None:
        return "false alarm" if findings or causes else "quiet"
    told = {(one.kind, one.target) for one in causes}
    sets = told | {(str(o["kind"]), str(o["target"])) for one in causes for o in one.indistinguishable_from}
    of_data = score(fault, findings)
    if of_data in ("found", "in its set", "refused"):
        return "wrong" if causes else of_data
    wanted = {(fault.kind, "" if fault.kind == "thrust_scale" else fault.target)}
    if told == wanted:
        return "found"
    if wanted & sets:
        return "in its set" if len(told) == 1 else "wrong"
    if told or of_data == "wrong":
        return "wrong"
    if any(fault.target in _AXES.get(what, ()) for what in not_judged):
        return "refused"
    if verdict == "adequate":
        return "wrong"
    return "refused" if verdict in ("unexplained", "partly explained", "data at fault") else "missed"
