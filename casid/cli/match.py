"""`casid match`: proof of match, flight against simulation by the tolerances of a standard."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from casid.acceptance.match import proof_of_match
from casid.acceptance.proof import ProofOfMatch
from casid.cli.options import AsJson, Axes, Files, Flag, Folder, Maps, Records, aircraft_of, records_of, require_words
from casid.cli.results import tell
from casid.errors import InputError
from casid.report.folder import provenance, write_provenance
from casid.report.match_page import write_match
from casid.report.pdf import print_to_pdf


def match(
    *records: Records,
    aircraft: Files,
    diagnosis: Path | None = None,
    tolerances: str = "part60",
    tests: Annotated[list[str] | None, Parameter(name="--test", consume_multiple=True, negative="")] = None,
    closed_loop: Flag = False,
    axes: Axes | None = None,
    maps: Maps | None = None,
    out: Folder | None = None,
    pdf: Flag = False,
    as_json: AsJson = False,
) -> int:
    """Prove that a simulation matches flight by the tolerances of a standard, or find where it does not.

    Flies every test of the table whose manoeuvre a record shows, from the measured state and with the inputs of flight.
    With an extended aircraft, each part that it has and the given one lacks is taken out in turn: which tolerances it
    costs is reported. The status is 0 when the last aircraft passes every test, and 1 when it does not.
    With --out also DIR/match.html, one test per printed page, DIR/match.json and DIR/match_figures.

    Parameters
    ----------
    aircraft
        The aircraft file (TOML), followed by the extended one where there is one.
    diagnosis
        Folder that casid diagnose wrote for this aircraft. Its extended.toml is the extended aircraft; each test states
        whether its record was fitted; and a test that is out of tolerance as given gets a rationale.
    tolerances
        part60, or a TOML file of one's own.
    tests
        Ids of tests, like 2.c.10; with a time, like 2.c.4=12:30, of one record [s]. Default: every test whose manoeuvre
        is found.
    closed_loop
        Let small corrections of the surfaces follow the measured attitude; their size is reported.
    axes
        Default: what the surfaces allow and the aircraft has aerodynamics of.
    pdf
        Print the page to DIR/match.pdf, by the Chromium, Chrome or Edge that is installed.
    """
    require_words(records, "RECORD", "match RECORD ... --aircraft FILE [EXTENDED]")
    if len(aircraft) > 2:
        raise InputError(f"--aircraft: {len(aircraft)} files; expected the given one, and the extended one behind it")
    if diagnosis is not None and len(aircraft) == 1:
        aircraft = [*aircraft, str(diagnosis / "extended.toml")]
    if pdf and out is None:
        raise InputError("--pdf: there is no folder for match.pdf; give --out DIR")
    files = [aircraft_of(file) for file in aircraft]
    read = records_of(records, maps, flown_by=files)
    proof = proof_of_match(
        files[0],
        read,
        extended=files[1] if len(files) > 1 else None,
        diagnosis=diagnosis,
        tolerances=tolerances,
        tests=None if tests is None else dict(map(_test, tests)),
        axes=axes,
        closed_loop=closed_loop,
    )
    tell("match", proof, out, as_json, partial(_write_page, pdf=pdf))
    if out is not None and not as_json:
        print(f"page: {out / 'match.html'}")
    return 0 if proof.passed else 1


def _test(text: str) -> tuple[str, tuple[float, float] | None]:
    """The id of a test and its time, of "2.c.4" or "2.c.4=12:30"."""
    name, given, time = text.partition("=")
    if not given:
        return name, None
    try:
        start, end = map(float, time.split(":"))
    except ValueError:
        raise InputError(f"--test {text}: the time is '{time}'; expected START:END in s, like {name}=12:30") from None
    return name, (start, end)


def _write_page(proof: ProofOfMatch, folder: Path, pdf: bool) -> None:
    write_provenance(provenance(), folder / "run.json")
    write_match(proof, folder)
    if pdf:
        print_to_pdf(folder / "match.html", folder / "match.pdf")
