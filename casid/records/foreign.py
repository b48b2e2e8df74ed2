"""Tables in files of other programs: numpy, Parquet, Excel, MDF4; see also `hdf5` and `mat`."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from casid.errors import InputError, check_known
from casid.records.columns import numbered
from casid.records.items import Item, fields_of, item_of, table_of
from casid.records.limits import MOST_CELLS
from casid.records.log import of_log
from casid.records.table import RawTable, table_of_lines

Made = TypeVar("Made")


def loaded(path: Path, load: Callable[[], Made]) -> Made:
    """Return what `load` returns; whatever it raises becomes an InputError."""
    if not path.is_file():
        raise InputError(f"{path}: cannot be read: no such file")
    try:
        return load()
    except MemoryError:
        raise
    except Exception as error:  # a damaged file makes these libraries raise some twenty unrelated types
        if isinstance(error, NotImplementedError) and path.suffix.lower() == ".mat":
            raise  # of version 7.3, which is HDF5
        fault = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: not a readable {path.suffix} file: {fault[:120]}") from None


def read_excel(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a sheet of an .xlsx file, by default the first; needs the extra `excel`."""
    openpyxl = library("openpyxl", path, "excel")

    def load() -> tuple[list[str], str, list[str]]:
        sheets, name, rows = _sheet(openpyxl, path, variable, data_only=True)
        if any(None in row for row in rows):  # a formula that no program has evaluated has no value
            _, _, formulas = _sheet(openpyxl, path, variable, data_only=False)
            pairs = zip(rows, formulas, strict=True)
            rows = [[b if a is None else a for a, b in zip(*pair, strict=True)] for pair in pairs]
        return sheets, name, _lines(rows)

    sheets, name, lines = loaded(path, load)
    check_known("sheet", (name,), sheets, str(path))
    if sum(map(bool, lines)) < 2:
        raise InputError(f"{path}: sheet '{name}' is empty; expected a row of channel names and rows of numbers")
    unread = {f"sheet '{one}'": "another sheet; a map takes it by variable" for one in sheets if one != name}
    return replace(table_of_lines(path, lines, delimiters="\t"), unread=unread)


def _sheet(
    openpyxl: Any, path: Path, variable: str | None, *, data_only: bool
) -> tuple[list[str], str, list[Sequence[Any]]]:
    """Names of the sheets, the name of one, and its rows. Raises ValueError where a row lies so far off that the sheet
    has too many cells."""
    book = openpyxl.load_workbook(path, read_only=True, data_only=data_only)
    try:
        sheets = {sheet.title: sheet for sheet in book.worksheets}
        name = variable if variable is not None else next(iter(sheets), "")
        rows = list[Sequence[Any]]()
        cells = 0
        for row in sheets[name].iter_rows(values_only=True) if name in sheets else ():
            cells += len(row)
            if cells > MOST_CELLS:
                most = f"{MOST_CELLS / 1e6:.0f} million cells"
                raise ValueError(f"its sheet has more than {most}; delete what lies far off")
            rows.append(row)
        return list(sheets), name, rows
    finally:
        book.close()


def _lines(rows: Sequence[Sequence[Any]]) -> list[str]:
    """Rows of a sheet as lines of text of one width, an empty row as ""."""
    texts = [[_text(cell) for cell in row] for row in rows]
    width = max((i for row in texts for i, cell in enumerate(row, 1) if cell), default=0)
    padded = [[*row[:width], *[""] * (width - len(row))] for row in texts]
    return ["\t".join(row) if any(row) else "" for row in padded]


def _text(cell: Any) -> str:
    """Return what a cell of a sheet holds as text, by which its number is the same again."""
    if cell is None:
        return ""
    return cell.isoformat() if hasattr(cell, "isoformat") else " ".join(str(cell).replace('"', "'").split())


def read_mdf(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of an MDF4 measurement on the clock of its fastest channel; needs the extra `mdf`."""
    asammdf = library("asammdf", path, "mdf")

    def load() -> list[tuple[Any, Item]]:
        with asammdf.MDF(path) as file:
            signals = list(file.iter_channels(skip_master=True))
            names = numbered([f"{s.name} [{s.unit}]" if s.unit else s.name for s in signals])
            return [(s.timestamps, item_of(name, s.name, s.samples)) for name, s in zip(names, signals, strict=True)]

    read = loaded(path, load)
    series = {one.path: (stamps, one.values) for stamps, one in read if not one.why}
    return of_log(path, series, unread={one.path: one.why for _, one in read if one.why})


def library(module: str, path: Path, extra: str) -> Any:
    """A module of an extra; InputError where that is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise InputError(
            f"{path}: reading it needs {module.partition('.')[0]}; install it with: pip install 'casid[{extra}]', or "
            "save it as CSV"
        ) from None


def read_npz(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .npz file: its one matrix, without names, or one vector per channel. Pickled objects are not read."""
    return table_of(path, loaded(path, lambda: list(_entries(path))), variable, time)


def _entries(path: Path) -> Iterator[Item]:
    """All arrays of a file; numpy's own reader takes the last of two entries of one name."""
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        names = [entry.filename.removesuffix(".npy") for entry in entries]
        for entry, name, unlike in zip(entries, names, numbered(names), strict=True):
            with archive.open(entry) as file:
                yield from _entry(file, entry.filename, name, unlike)


def _entry(file: Any, filename: str, name: str, path: str) -> list[Item]:
    """The array of an entry, or the columns of its structures."""
    if not filename.endswith(".npy"):
        return [Item(path=path, name=name, why="no array of numpy")]
    try:
        array = np.lib.format.read_array(file, allow_pickle=False)
    except ValueError as error:
        if "allow_pickle" in str(error):
            return [Item(path=path, name=name, why="pickled objects")]
        raise
    if array.dtype.names:
        return [item_of(inner, leaf, values) for inner, leaf, values in fields_of(array, path, ".")]
    return [item_of(path, name, array)]


def read_parquet(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .parquet file, also of columns within columns; a column's metadata may state its unit, scale and mark
    of a missing sample. Needs the extra `parquet`."""
    parquet = library("pyarrow.parquet", path, "parquet")
    arrow = library("pyarrow", path, "parquet")

    def load() -> list[Item]:
        content = parquet.read_table(path)
        named = zip(content.schema, numbered(content.column_names), content.columns, strict=True)
        return [one for field, unlike, column in named for one in _of_arrow(arrow.types, field, unlike, column)]

    return table_of(path, loaded(path, load), variable, time)


def _of_arrow(types: Any, field: Any, path: str, column: Any) -> list[Item]:
    """A column of Arrow, or those within it."""
    kind = column.type
    if types.is_dictionary(kind):
        column = column.cast(kind.value_type)
        kind = column.type
    if types.is_struct(kind):
        inner = zip(kind, column.flatten(), strict=True)
        return [one for sub, part in inner for one in _of_arrow(types, sub, f"{path}.{sub.name}", part)]
    why = "text" if types.is_string(kind) or types.is_large_string(kind) else ""
    why = why or ("lists" if types.is_nested(kind) else "no value at all" if types.is_null(kind) else "")
    if why:
        return [Item(path=path, name=field.name, why=why)]
    if types.is_time(kind):
        unit = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
        ticks = column.cast("int64" if types.is_time64(kind) else "int32").cast("int64").to_numpy()
        return [Item(path=path, name=field.name, values=ticks * unit, unit="s", how="times of day in s", clock=True)]
    if types.is_decimal(kind):
        column = column.cast("float64")
    elif types.is_boolean(kind):
        column = column.cast("int8")
    attributes = {key.decode("utf-8", "replace"): value for key, value in (field.metadata or {}).items()}
    return [item_of(path, field.name, column.to_numpy(), attributes)]
