"""`casid convert`: foreign records as flight records in SI units and radians."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from casid.cli.options import Begin, End, Maps, between
from casid.errors import InputError
from casid.records.column_map import ColumnMap
from casid.records.readers import files_of, read_each, write_record
from casid.records.record import Record
from casid.report.estimate_figures import file_name


def convert(
    *paths: Annotated[str, Parameter(name="SOURCE ... TARGET")],
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
) -> int:
    """Convert records of any readable format to flight records (CSV), in SI units and radians.

    TARGET is a file that ends in .csv, for one record, or a folder: then every record is written to it as NAME.csv. A
    source that cannot be read is reported, the others are converted, and the status is 1.

    Parameters
    ----------
    paths
        The records to read, or patterns like 'logs/*', and behind them the file or folder to write to.
    """
    if len(paths) < 2:
        raise InputError("SOURCE or TARGET is missing; expected: convert SOURCE ... TARGET.csv, or a folder as target")
    *sources, last = paths
    target = Path(last)
    files = files_of(sources)
    one = target.suffix.lower() == ".csv"
    if one and len(files) > 1:
        raise InputError(f"{target}: {len(files)} records are to be converted; name a folder as the target")
    if not one and (target.suffix or target.is_file()) and not target.is_dir():
        raise InputError(f"{target}: records are written as .csv; name the target so, or a folder")
    read, refused = read_each(files, ColumnMap.from_options(maps or []), between=between(begin, end))
    if not read:
        raise next(iter(refused.values()))
    _write({target: read[0]} if one else _named(read, target), {file.resolve() for file in files})
    for file, error in refused.items():
        print(f"{file}: not converted: {error}", file=sys.stderr)
    return 1 if refused else 0


def _named(records: list[Record], folder: Path) -> dict[Path, Record]:
    """File -> record; InputError when two would have one name."""
    targets = {folder / f"{file_name(record.name)}.csv": record for record in records}
    if len(targets) < len(records):
        raise InputError(f"{folder}: two records would be written to one file; convert them one by one")
    return targets


def _write(targets: Mapping[Path, Record], sources: set[Path]) -> None:
    for target in targets:
        if target.resolve() in sources:
            raise InputError(f"{target}: is a source itself; name another target")
    for target, record in targets.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        write_record(record, target)
        for note in record.notes:
            print(f"note: {record.name}: {note}")
        print(f"{target}: {len(record)} samples, {record.duration:.6g} s, {', '.join(record.channels)}")
