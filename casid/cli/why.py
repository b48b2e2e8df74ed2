"""`casid why`: which gates a cause passed, and which it failed, in a diagnosis that was written."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from casid.cli.options import AsJson
from casid.diagnosis.cause import Trace, trace_of
from casid.errors import InputError


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
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; expected the folder of a diagnosis") from None
    except ValueError:
        raise InputError(f"{path}: no JSON; expected the diagnosis.json of a diagnosis") from None
    whole = trace_of(document)
    trace = whole if cause is None else whole.of(" ".join((cause, *target)))
    if as_json:
        print(json.dumps([one.to_dict() for one in trace.decisions], indent=1))
    else:
        for one in document.get("claims", ()) if cause is None else ():
            print(f"{'stated' if one['said'] else 'not stated'}: {one['statement']}{_because(one)}")
        print(trace.summary() if cause is None else "\n".join(_told(trace, whole)))
        print("2 ln L is the likelihood-ratio statistic: 14 is 1000 times more probable.")


def _told(trace: Trace, whole: Trace) -> Iterator[str]:
    """Yield for each decision its reason as a sentence, and the comparisons that it was made of."""
    for one in trace.decisions:
        yield f"{one.title}. {whole.reason(one)}".strip()
        yield f"{one}\n"


def _because(claim: Mapping[str, str]) -> str:
    """The reason why a claim is not made; empty if it is."""
    return f": {claim['because']}" if claim["because"] else ""
