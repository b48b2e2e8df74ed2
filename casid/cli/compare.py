"""`casid compare`: two diagnoses over each other, or many flights against one aircraft file."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from casid.acceptance.compared import Comparison, compare_diagnoses
from casid.acceptance.fleet import Fleet, compare_flights
from casid.cli.options import AsJson, Begin, End, Folder, Maps, aircraft_of, called_by, records_of, require_words
from casid.cli.results import tell
from casid.data_check.check import check
from casid.diagnosis.document import Called, NextStep
from casid.errors import InputError
from casid.report.compare_page import bars_of_diagnoses, bars_of_flights, table_of_flights, tables_of_diagnoses
from casid.report.result_page import BAD, GOOD, Answer, write_result


def compare(
    *compared: Annotated[str, Parameter(name="OUT")],
    aircraft: Path | None = None,
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
    out: Folder | None = None,
    as_json: AsJson = False,
) -> int:
    """Compare two diagnoses, or all flights of an aircraft with each other.

    Two folders of casid diagnose: errors by channel and by record, causes, and values, over each other; such as before
    and after a change of the file. The status is 1 when the second is worse: its simulation as given is further from
    flight by more than a tenth, or a cause is named in it alone.
    Records with --aircraft: a row for each, flown as given, with the faults of its data and the values that are others
    than in the other flights. The status is 1 when something changed or a record has a fault.
    With --out also the page DIR/compare.html, and DIR/compare.json.

    Parameters
    ----------
    compared
        Two folders, or records or patterns like 'flight/*.csv' with --aircraft.
    aircraft
        The aircraft file (TOML) that the records are flown by.
    """
    if aircraft is None:
        if len(compared) != 2:
            raise InputError(
                f"compare: {len(compared)} folders; expected two of casid diagnose, or records with --aircraft FILE"
            )
        diagnoses = compare_diagnoses(*compared)
        tell("compare", diagnoses, out, as_json, _write_diagnoses)
        return 1 if diagnoses.worse else 0
    require_words(compared, "RECORD", "compare RECORD ... --aircraft FILE")
    file = aircraft_of(aircraft)
    records = records_of(compared, maps, span=(begin, end))
    findings = check(records, file).findings
    faults = {r.name: [one.sentence for one in findings if r.name in one.records] for r in records}
    flights = compare_flights(file, records, faults)
    called = called_by(compared, maps, aircraft, out or Path())  # for the page, which there is with a folder alone
    tell("compare", flights, out, as_json, partial(_write_flights, called=called))
    return 1 if flights.changed else 0


def _write_diagnoses(found: Comparison, folder: Path) -> None:
    answer = Answer(
        badge="Worse" if found.worse else "Not worse",
        sentence=found.sentence,
        points=found.points,
        colour=BAD if found.worse else GOOD,
    )
    parts = [bars_of_diagnoses(found), *tables_of_diagnoses(found)]
    write_result(folder, "compare", f"Comparison of diagnoses: {found.names[0]}, then {found.names[1]}", answer, parts)


def _write_flights(found: Fleet, folder: Path, called: Called) -> None:
    step = NextStep(
        text="Name the causes, record by record:",
        command=f"casid diagnose {called.records} --aircraft {called.aircraft} --out {called.inside('diagnosis')}",
    )
    answer = Answer(
        badge="Changed" if found.changed else "The same",
        sentence=found.sentence,
        next=(step,),
    )
    parts = [bars_of_flights(found), table_of_flights(found)]
    write_result(folder, "compare", f"{len(found.flights)} flights of {found.aircraft}", answer, parts)
