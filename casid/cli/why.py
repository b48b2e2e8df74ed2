"""`casid why`: which gates a cause passed, and which it failed, in a diagnosis that was written."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from casid.cli.options import AsJson
from casid.diagnosis.cause import Trace, trace_of
from casid.records.limits import read_json, sound

_STATISTIC = "2 ln L is the likelihood-ratio statistic: 14 is 1000 times more probable."
_EXPECTED = "the folder of a diagnosis, or its diagnosis.json"


def why(
    out: Annotated[Path, Parameter(name="OUT")],
    cause: Annotated[str | None, Parameter(name="CAUSE")] = None,
    *target: Annotated[str, Parameter(name="TARGET")],
    as_json: AsJson = False,
) -> None:
    """Explain why a cause was named in a diagnosis, and why another one was not.

    Parameters
    ----------
    out
        Folder of a diagnosis, or its diagnosis.json.
    cause
        As "actuator_lag(delta_e)" or actuator_lag delta_e; a kind alone selects all its targets. Without it: the
        statements that the verdict rests on, and a sentence on every cause that was named or came nearest to it.
    target
        Target of the cause, where it is given as a word of its own.
    """
    path = out / "diagnosis.json" if out.is_dir() else out
    document = read_json(path, _EXPECTED)
    with sound(path, _EXPECTED):
        whole = trace_of(document)
        trace = whole if cause is None else whole.of(" ".join((cause, *target)))
        told = _told(trace, whole) if cause is not None else _summary(trace, document.get("claims", ()))
        text = json.dumps([one.to_dict() for one in trace.decisions], indent=1) if as_json else "\n".join(told)
    print(text)


def _summary(trace: Trace, claims: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Yield the claims, and one line for each cause."""
    for one in claims:
        because = f": {one['because']}" if one["because"] else ""  # of a claim that is not made
        yield f"{'stated' if one['said'] else 'not stated'}: {one['statement']}{because}"
    yield trace.summary()
    yield _STATISTIC


def _told(trace: Trace, whole: Trace) -> Iterator[str]:
    """Yield for each decision its reason as a sentence, and the comparisons that it was made of."""
    for one in trace.decisions:
        yield f"{one.title}. {whole.reason(one)}".strip()
        yield f"{one}\n"
    yield _STATISTIC
