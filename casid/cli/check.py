"""`casid check`: faults of the records, before anything is estimated from them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from casid.cli.options import AsJson, Begin, End, Files, Folder, Maps, Records, between, require_words, say_notes
from casid.cli.results import tell
from casid.data_check.check import DataFindings, channels_of
from casid.data_check.check import check as checked
from casid.errors import InputError
from casid.keeping import whole_file
from casid.model.aircraft import Aircraft
from casid.records.column_map import ColumnMap
from casid.records.map_file import suggested_map
from casid.records.readers import files_of, read_each, read_table


def check(
    *records: Records,
    aircraft: Path | None = None,
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
    believe: Files | None = None,
    write_map: Path | None = None,
    out: Folder | None = None,
    as_json: AsJson = False,
) -> int:
    """Check flight records by physics that needs no aerodynamics: signs, units, swapped, frozen or clipped channels.

    Prints every finding, impossible numbers of the aircraft file, and a table of the channels. A file that cannot
    be read is reported, and the others are checked. The status is 0 when nothing is wrong and 1 when something is.
    With --out also DIR/check.html, a page with suspected channels as a picture, and DIR/check.json.

    Parameters
    ----------
    aircraft
        The aircraft file (TOML): weight, trim and signs of derivatives are compared too.
    believe
        Channels that are right as recorded: what they contradict is explained otherwise.
    write_map
        Write a column map (TOML) of the first record to this file, to be filled in: known and likely columns, and as
        comments the missing channels and the other columns. The records are then read by it.
    """
    require_words(records, "RECORD", "check RECORD ... [--aircraft FILE]")
    channels_of(believe or False, "--believe")
    file = None if aircraft is None else Aircraft.read(aircraft)
    columns = ColumnMap.from_options(maps or [])
    if write_map is not None:
        columns = _written_map(write_map, files_of(records)[0], columns)
    read, refused = read_each(list(records), columns, between=between(begin, end))
    if not read:
        raise next(iter(refused.values()))
    say_notes(read)
    found = replace(
        checked(read, file, undo=believe or False), unread={str(one): str(error) for one, error in refused.items()}
    )
    tell("check", found, out, as_json, _write_page)
    return 0 if found.clean else 1


def _write_page(found: DataFindings, folder: Path) -> None:
    from casid.report.data_pages import write_check  # here, as figures are a third of the time of a check

    write_check(found, folder)


def _written_map(target: Path, record: Path, given: ColumnMap) -> ColumnMap:
    """The column map of a record, written to a file."""
    if target.suffix.lower() != ".toml":
        raise InputError(f"--write-map {target}: column maps are TOML; name the file so")
    if target.exists():
        raise InputError(f"--write-map {target}: is there already; choose another name, or give it with --map")
    text = suggested_map(read_table(record, given), given)
    with whole_file(target) as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(f"{target}: written; look it over, fill in what is missing, and give it with --map {target}", file=sys.stderr)
    return ColumnMap.read(target)
