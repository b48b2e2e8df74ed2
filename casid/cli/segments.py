"""`casid segments`: the manoeuvres in a long log."""

from __future__ import annotations

import json
import math
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from casid.cli.options import AsJson, Begin, End, Folder, Maps, records_of, require_words
from casid.diagnosis.document import NextStep
from casid.frames import Rows
from casid.records.readers import write_record
from casid.records.record import Record
from casid.records.segments import Segment
from casid.records.segments import segments as found_in
from casid.report.data_pages import segment_figure
from casid.report.estimate_figures import file_name
from casid.report.folder import whole_folder
from casid.report.result_page import BAD, Answer, in_numbers, write_result
from casid.signals import DEGREE, for_a_person, unit_of


def segments(
    *logs: Annotated[str, Parameter(name="LOG")],
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
    out: Folder | None = None,
    as_json: AsJson = False,
) -> int:
    """Find the manoeuvres in long logs, by the excitation of each axis.

    Prints a table. The status is 0, and 1 when no log has a manoeuvre. With --out every manoeuvre is written as
    DIR/LOG_1.csv and so on, beside DIR/segments.json and the page DIR/segments.html.

    Parameters
    ----------
    logs
        Files, or patterns like 'logs/*.bin'.
    """
    require_words(logs, "LOG", "segments LOG ... [--out DIR]")
    records = records_of(logs, maps, span=(begin, end))
    found = {record.name: found_in(record) for record in records}
    answer = answer_of(found, out)
    text = json.dumps(_document(found), indent=1)
    if out is not None:
        with whole_folder(out) as folder:
            _write(records, found, folder, answer)
            (folder / "segments.json").write_text(text + "\n", encoding="utf-8")
    print(text if as_json else f"{answer}\n\n{_table(found)}")
    return 0 if any(found.values()) else 1


def _document(found: Mapping[str, Sequence[Segment]]) -> dict[str, Any]:
    logs = {name: [one.to_dict() for one in some] for name, some in found.items()}
    return {"schema": "casid.segments/1", "logs": logs}


def _write(records: Sequence[Record], found: Mapping[str, Sequence[Segment]], folder: Path, answer: Answer) -> None:
    for record in records:
        for number, one in enumerate(found[record.name], 1):
            name = f"{file_name(record.name)}_{number}"
            write_record(record.between(one.start, one.stop, name), folder / f"{name}.csv")
    parts = [*(segment_figure(record, found[record.name]) for record in records), in_numbers(_table(found))]
    write_result(folder, "segments", f"Manoeuvres in {', '.join(found)}", answer, parts)


def answer_of(found: Mapping[str, Sequence[Segment]], out: Path | None = None) -> Answer:
    """Return how many manoeuvres were found, of which axes, and what to do with them."""
    every = [one for some in found.values() for one in some]
    axes = Counter("+".join(one.axes) for one in every)
    told = ", ".join(f"{count} {name}" for name, count in axes.most_common())
    logs = f"{len(found)} log{'s' * (len(found) != 1)}"
    idle = [name for name, some in found.items() if not some]
    if not every:
        return Answer(badge="Nothing found", sentence=f"No manoeuvre stands out in {logs}.", colour=BAD)
    seconds = math.fsum(one.stop - one.start for one in every)
    first = next(name for name, some in found.items() if some)
    command = f"casid diagnose {shlex.quote(f'{out}/*.csv')} --aircraft FILE"
    step = NextStep(text="Diagnose the simulation with the manoeuvres alone:", command=command)
    return Answer(
        badge=f"{len(every)} manoeuvres" if len(every) > 1 else "1 manoeuvre",
        sentence=f"{told}: {seconds:.0f} s of {logs}. Each is a record of its own, {file_name(first)}_1.csv and so on.",
        points=tuple(f"{name}: no manoeuvre stands out." for name in idle),
        next=(step,) if out else (),
    )


def _table(found: Mapping[str, Sequence[Segment]]) -> str:
    """One line for each manoeuvre, angles in degrees."""
    rows = []
    for name, some in found.items():
        if not some:
            rows.append((name, None, None, None, "no manoeuvre stands out", None, None))
        for number, one in enumerate(some, 1):
            surfaces = ", ".join(f"{s} {for_a_person(unit_of(s))[0] * rms:.2g}" for s, rms in one.surfaces.items())
            rates = ", ".join(f"{r} {span / DEGREE:.3g}" for r, span in one.rates.items())
            rows.append((name, number, one.start, one.stop, "+".join(one.axes), surfaces, rates))
    heads = {"log": "", "no": "d", "from s": ".2f", "to s": ".2f", "axes": ""}
    heads |= {"surface r.m.s. deg (command: of 1)": "", "rate range deg/s": ""}
    return Rows(heads=heads, rows=rows).text()
