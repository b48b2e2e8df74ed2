"""Tables in files of other programs: MATLAB, numpy, HDF5, Parquet, Excel, MDF4."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError, check_known
from casid.records.clock import seconds_of
from casid.records.limits import MOST_CELLS
from casid.records.log import of_log
from casid.records.table import RawTable


def loaded(path: Path, load: Callable[[], dict[str, Any]]) -> dict[str, Any]:
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


def table_of(path: Path, arrays: Mapping[str, Any], variable: str | None, time: str) -> RawTable:
    """The table of named arrays: its one matrix, or one vector per channel; fields of structs count as arrays."""
    arrays = dict(_fields(arrays))
    numeric = {k: v for k, v in arrays.items() if isinstance(v, np.ndarray) and v.dtype.kind in "fiub" and v.size > 1}
    if variable is not None:
        check_known("variable", (variable,), numeric, str(path))
        numeric = {variable: numeric[variable]}
    vectors = {name: v.ravel() for name, v in numeric.items() if max(v.shape) == v.size}
    matrices = {name: v for name, v in numeric.items() if v.ndim == 2 and name not in vectors}
    if vectors and (time in vectors or not matrices):
        return _vectors(path, vectors, time)
    if len(matrices) != 1:
        held = ", ".join(matrices) or "none"
        raise InputError(
            f"{path}: expected one matrix, or one vector per channel with '{time}' among them; matrices in the file: "
            f"{held}; name one as 'variable' in a column map"
        )
    name, matrix = next(iter(matrices.items()))
    if matrix.shape[0] < matrix.shape[1]:
        raise InputError(f"{path}: '{name}' has shape {matrix.shape}; expected samples in rows: transpose it")
    return RawTable(source=str(path), names=None, values=matrix.astype(float))


def _fields(arrays: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Arrays by name, structs of MATLAB taken apart."""
    for name, value in arrays.items():
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            yield from _fields({field: value.reshape(-1)[0][field] for field in value.dtype.names})
        else:
            yield name, value


def _vectors(path: Path, vectors: Mapping[str, np.ndarray], time: str) -> RawTable:
    reference = time if time in vectors else next(iter(vectors))
    for name, values in vectors.items():
        if len(values) != len(vectors[reference]):
            raise InputError(
                f"{path}: variable '{name}' has {len(values)} samples, '{reference}' has {len(vectors[reference])}; "
                "all channels need the same"
            )
    values = np.stack([v.astype(float) for v in vectors.values()], axis=1)
    return RawTable(source=str(path), names=tuple(vectors), values=values)


def read_hdf5(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of an HDF5 file or a MATLAB 7.3 one: one vector per channel, or one matrix; needs the extra `hdf5`."""
    h5py = library("h5py", path, "hdf5")

    def load() -> dict[str, Any]:
        found: dict[str, Any] = {}

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and not name.startswith("#"):
                if item.external or item.is_virtual:
                    raise ValueError(f"'{name}' is in another file; copy it into this one")
                found[name.rsplit("/", 1)[-1]] = np.asarray(item)

        with h5py.File(path, "r") as file:
            file.visititems(visit)
            matlab = any("MATLAB_class" in item.attrs for item in file.values())
        # MATLAB writes columns first
        return {k: v.T if matlab and v.ndim == 2 else v for k, v in found.items()}

    return table_of(path, loaded(path, load), variable, time)


def read_excel(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a sheet of an .xlsx file, by default the first; needs the extra `excel`."""
    openpyxl = library("openpyxl", path, "excel")

    def load() -> dict[str, Any]:
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            sheets = {sheet.title: sheet for sheet in book.worksheets}
            name = variable if variable is not None else next(iter(sheets), "")
            rows = _rows(sheets[name]) if name in sheets else []
            return {"names": list(sheets), "name": name, "rows": rows}
        finally:
            book.close()

    book = loaded(path, load)
    name = book["name"]
    rows = book["rows"]
    sheets = book["names"]
    check_known("sheet", (name,), sheets, str(path))
    if len(rows) < 2:
        raise InputError(f"{path}: sheet '{name}' is empty; expected a row of channel names and rows of numbers")
    head, *body = rows
    values = np.full((len(body), len(head)), np.nan)
    text: dict[int, tuple[int, str]] = {}
    for i, row in enumerate(body):
        for j, cell in enumerate(row[: len(head)]):
            number = _number(cell)
            if number is None:
                text.setdefault(j, (i, str(cell)))
            else:
                values[i, j] = number
    names = tuple("" if cell is None else str(cell).strip() for cell in head)
    return RawTable(source=str(path), names=names, values=values, text=text)


def _rows(sheet: Any) -> list[tuple[Any, ...]]:
    """Rows of a sheet that are not empty. Raises ValueError where one lies so far off that it has too many cells."""
    found = []
    cells = 0
    for row in sheet.iter_rows(values_only=True):
        cells += len(row)
        if cells > MOST_CELLS:
            raise ValueError(f"its sheet has more than {MOST_CELLS / 1e6:.0f} million cells; delete what lies far off")
        if any(cell is not None for cell in row):
            found.append(row)
    return found


def read_mdf(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of an MDF4 measurement on the clock of its fastest channel; needs the extra `mdf`."""
    asammdf = library("asammdf", path, "mdf")

    def load() -> dict[str, Any]:
        with asammdf.MDF(path) as file:
            signals = [s for s in file.iter_channels(skip_master=True) if s.samples.dtype.kind in "fiub"]
            named = {f"{s.name} [{s.unit}]" if s.unit else s.name: (s.timestamps, s.samples) for s in signals}
        return {"signals": named}

    return of_log(path, loaded(path, load)["signals"])


def _number(cell: Any) -> float | None:
    """The number of a cell of a sheet; NaN where it is empty, None where it is text."""
    if cell is None:
        return np.nan
    if hasattr(cell, "timestamp"):
        return seconds_of(cell.isoformat())
    if isinstance(cell, (int, float)) and not isinstance(cell, bool):
        return float(cell)
    stripped = str(cell).strip()
    return np.nan if not stripped else seconds_of(stripped)


def library(module: str, path: Path, extra: str) -> Any:
    """A module of an extra; InputError where that is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise InputError(
            f"{path}: reading it needs {module.partition('.')[0]}; install it with: pip install 'casid[{extra}]', or "
            "save it as CSV"
        ) from None


def read_mat(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .mat file: its one matrix, without names, or one vector per channel, also as fields of a struct. scipy
    crashes with some forged flags in the header; see `limits.apart`."""
    from scipy.io import loadmat  # here, because few records are .mat and scipy.io is slow to import

    try:
        content = loaded(path, lambda: loadmat(str(path)))
    except NotImplementedError:  # version 7.3 is HDF5
        return read_hdf5(path, variable, time)
    return table_of(path, {k: v for k, v in content.items() if not k.startswith("__")}, variable, time)


def read_npz(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .npz file: its one matrix, without names, or one vector per channel. Pickled objects are refused."""

    def load() -> dict[str, Any]:
        # opened here: numpy leaves a damaged file open
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return dict(archive)

    return table_of(path, loaded(path, load), variable, time)


def read_parquet(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .parquet file; needs the extra `parquet`."""
    parquet = library("pyarrow.parquet", path, "parquet")

    def load() -> dict[str, Any]:
        content = parquet.read_table(path)
        return {name: content.column(name).to_numpy() for name in content.column_names}

    return table_of(path, loaded(path, load), variable, time)
