"""`casid convert`: a foreign record as a flight record in SI units and radians."""

from __future__ import annotations

from pathlib import Path

from casid.cli.options import Maps
from casid.errors import InputError
from casid.records.column_map import ColumnMap
from casid.records.readers import read_record, write_record


def convert(source: Path, target: Path, *, maps: Maps | None = None) -> None:
    """Convert a record of any readable format to a flight record (CSV), in SI units and radians.

    Parameters
    ----------
    source
        The record to read.
    target
        The file to write, ending in .csv.
    maps
        Column map: alpha=ALCG:deg, or a TOML file.
    """
    if target.suffix.lower() != ".csv":
        raise InputError(f"{target}: records are written as .csv; name the target so")
    if target.resolve() == source.resolve():
        raise InputError(f"{target}: is the source itself; name another target")
    record = read_record(source, ColumnMap.from_options(list(maps or [])))
    write_record(record, target)
    for note in record.notes:
        print(f"note: {note}")
    print(f"{target}: {len(record)} samples, {record.t[-1] - record.t[0]:.6g} s, {', '.join(record.channels)}")
