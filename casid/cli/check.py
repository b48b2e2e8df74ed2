"""`casid check`: what is wrong with the data, before anything is believed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from casid.cli.options import AsJson, Folder, Maps, records_of
from casid.diagnosis.data.check import check as checked
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.report.check_page import write_check
from casid.report.folder import whole_folder


def check(
    *records: Annotated[str, Parameter(name="RECORD")],
    aircraft: Path | None = None,
    maps: Maps | None = None,
    out: Folder | None = None,
    as_json: AsJson = False,
) -> int:
    """Check flight records by physics that needs no aerodynamics: signs, units, swapped, frozen or clipped channels.

    Prints a table of the channels, every finding, and numbers of the aircraft file that cannot be. The status is 0 when
    nothing is wrong and 1 when something is.
    With --out also DIR/check.html, a page with suspected channels as a picture, and DIR/check.json.

    Parameters
    ----------
    records
        Files, or patterns like 'flight/m*.csv'.
    aircraft
        The aircraft file (TOML): weight, trim and signs of derivatives are compared too.
    maps
        Column map: alpha=ALCG:deg, or a TOML file.
    out
        Folder for the page.
    as_json
        Print the findings as JSON and nothing else.
    """
    if not records:
        raise InputError("RECORD is missing; expected: check RECORD ... [--aircraft FILE]")
    file = None if aircraft is None else Aircraft.read(aircraft)
    found = checked(records_of(records, maps or []), file)
    text = json.dumps(found.to_dict(), indent=1)
    if out is not None:
        with whole_folder(out) as folder:
            write_check(found, folder)
            (folder / "check.json").write_text(text + "\n", encoding="utf-8")
    print(text if as_json else found)
    return 0 if found.clean else 1
