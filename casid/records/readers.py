"""Flight records from files, and back: CSV, text columns, .mat, .npz, .parquet."""

from __future__ import annotations

import csv
import glob
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from casid.errors import InputError, unknown
from casid.records.arrays import read_mat, read_npz, read_parquet
from casid.records.checks import channel_notes, check_channel, check_surfaces, check_time, time_notes
from casid.records.column_map import ColumnMap
from casid.records.columns import channels_of, split_header
from casid.records.record import Record
from casid.records.table import Table, read_columns, read_csv
from casid.signals import CHANNELS

_TEXT: Mapping[str, Callable[[Path], Table]] = MappingProxyType(
    {".csv": read_csv, ".asc": read_columns, ".txt": read_columns, ".dat": read_columns}
)
_BINARY: Mapping[str, Callable[[Path, str | None, str], Table]] = MappingProxyType(
    {".mat": read_mat, ".npz": read_npz, ".parquet": read_parquet}
)


def read_record(path: str | Path, column_map: ColumnMap | str | Path | None = None) -> Record:
    """The flight record of one file, in SI units and radians; its name is the file's name without ending.

    A header may carry a unit, `alpha [deg]`; without one it is SI. `column_map`, or the TOML file of one, says which
    column of a foreign file is which channel. `t` and at least one surface must be there. An empty cell or nan in a
    measured output is a missing sample; columns that casid does not know are kept. `record.notes` holds remarks.

    Raises InputError, in one line with file, row, column and value, for everything else: text in a number, a ragged
    row, time that runs back, gaps in an input, degrees in a radian column, a name that is nearly that of a channel, a
    record under 3 s or 50 samples.
    """
    path = Path(path)
    if not isinstance(column_map, ColumnMap):
        column_map = ColumnMap.read(column_map) if column_map else ColumnMap()
    with np.errstate(all="ignore"):  # absurd numbers overflow on the way to the check that refuses them
        return _checked(_read_table(path, column_map), path, column_map)


def read_records(
    paths: str | Path | Iterable[str | Path], column_map: ColumnMap | str | Path | None = None
) -> list[Record]:
    """Records of files and of patterns like `flight/m*.csv`, each pattern in alphabetical order.

    Records of one name from different folders are told apart as `folder/name`. Raises InputError when a pattern
    matches nothing or a file is given twice, and as `read_record`.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    files = [file for item in given for file in _matches(item)]
    if not files:
        raise InputError("no record was given; expected at least one file or pattern, like flight/m*.csv")
    for file in files:
        if sum(file.resolve() == other.resolve() for other in files) > 1:
            raise InputError(f"{file}: given twice; each record may take part once")
    if not isinstance(column_map, ColumnMap) and column_map:
        column_map = ColumnMap.read(column_map)
    records = [read_record(file, column_map) for file in files]
    stems = [file.stem for file in files]
    return [
        record
        if stems.count(file.stem) == 1
        else replace(record, name="/".join((*file.resolve().parts[-2:-1], file.stem)))
        for record, file in zip(records, files, strict=True)
    ]


def write_record(record: Record, path: str | Path) -> None:
    """Write a record as CSV that `read_record` reads back exactly: SI units, an empty cell for a missing sample.

    Raises InputError when `path` is not .csv or cannot be written, or a channel's name cannot stand in a header.
    """
    path = Path(path)
    if path.suffix.lower() != ".csv":
        raise InputError(f"{path}: records are written as .csv; got '{path.suffix}'")
    for name in record.channels:
        if name in ("", "t") or split_header(name) != (name, "") or not name.isprintable():
            raise InputError(f"record '{record.name}': channel '{name}' cannot stand in a header; rename it")
    columns = [["" if np.isnan(v) else repr(v) for v in record[name].tolist()] for name in ("t", *record.channels)]
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            if record.hold != "linear":
                file.write(f"# hold: {record.hold}\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(("t", *record.channels))
            writer.writerows(zip(*columns, strict=True))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _matches(item: str | Path) -> list[Path]:
    if Path(item).exists():
        return [Path(item)]
    found = [Path(name) for name in sorted(glob.glob(str(item)))]
    if not found:
        raise InputError(f"{item}: no such file, and no file matches it as a pattern")
    return found


def _read_table(path: Path, column_map: ColumnMap) -> Table:
    ending = path.suffix.lower()
    if ending in _TEXT:
        return _TEXT[ending](path)
    if ending not in _BINARY:
        raise unknown("file type", path.suffix, (*_TEXT, *_BINARY), str(path))
    terms = column_map.columns.get("t", ())
    time = terms[0].column if terms else "t"
    return _BINARY[ending](path, column_map.variable, str(time))


def _checked(table: Table, path: Path, column_map: ColumnMap) -> Record:
    columns = channels_of(table, column_map)
    channels = dict(columns.channels)
    notes = list(columns.notes)
    if "t" not in channels:
        raise InputError(f"{path}: no column 't', the time in s; name it so, or map it with --map t=COLUMN:unit")
    t = channels.pop("t")
    check_time(t, table.place, columns.places["t"], str(path))
    for name in list(channels):
        if name in CHANNELS:
            check_channel(name, channels[name], table.place, columns.places[name])
        if np.isnan(channels[name]).all():
            notes.append(f"{name}: has no sample at all and is left out")
            del channels[name]
    check_surfaces(channels, str(path))
    notes += time_notes(t)
    for name, values in channels.items():
        notes += channel_notes(name, values)
    return Record(
        name=path.stem, t=t, channels=channels, hold=table.hold or "linear", source=str(path), notes=tuple(notes)
    )
