"""Everything that a file of named arrays holds, and the table that it makes: what is read, how, and what is not read.

A reader lists all that its file has, each under the path where it stands, as numbers or with the reason why it is none.
Nothing is left out without a reason, and nothing takes the place of another of the same name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError, unknown
from casid.records.table import RawTable
from casid.records.time_names import time_column

_ASKED = 4  # places that a question names
_WIDEST = 16  # columns of a matrix beside a time, such as positions, attitudes, quaternions
# attributes by which files say what their numbers mean (conventions of CF, NetCDF and HDF5 in practice)
_UNITS = ("units", "unit", "Units", "Unit")
_FILLS = ("_FillValue", "missing_value")


@dataclass(frozen=True, eq=False, kw_only=True)
class Item:
    """One array of a file, or what stands in the place of one."""

    path: str  # where it stands, as "/raw/q" or "std.q"; unlike every other path of the file
    name: str  # the last part of that
    values: np.ndarray = field(default_factory=lambda: np.empty(0))  # numbers, of any shape
    why: str = ""  # the reason where it is not read
    unit: str = ""  # that the file states beside it
    how: str = ""  # what was made of its numbers
    clock: bool = False  # whether it has dates or times of day


def item_of(path: str, name: str, value: Any, attributes: Mapping[str, Any] | None = None) -> Item:
    """Read one value of a file with its attributes; one that is no series of numbers gets the reason."""
    array, why = _numbers(value)
    if array is None:
        return Item(path=path, name=name, why=why)
    if array.dtype.kind == "M":
        there = array[~np.isnat(array)]
        begins = there.min() if len(there) else np.datetime64(0, "ns")
        values = (array - begins) / np.timedelta64(1, "ns")  # NaN where there is no time
        date = datetime.fromtimestamp(begins.astype("datetime64[us]").astype(int) * 1e-6, UTC)
        how = f"dates, counted in s from the first, {date.isoformat(timespec='milliseconds')}"
        return Item(path=path, name=name, values=values * 1e-9, unit="s", how=how, clock=True)
    if array.dtype.kind == "m":
        seconds = np.where(np.isnat(array), np.nan, array / np.timedelta64(1, "ns") * 1e-9)
        return Item(path=path, name=name, values=seconds, unit="s", how="durations in s")
    return _by_attributes(Item(path=path, name=name, values=array), attributes or {})


def _numbers(value: Any) -> tuple[np.ndarray | None, str]:
    """Numbers or times of a value, or None and the reason."""
    if hasattr(value, "tocsc"):
        return None, "a sparse matrix"
    if isinstance(value, (str, bytes)):
        return None, "text"
    array = np.asarray(value)
    kind = array.dtype.kind
    reasons = {"c": "complex numbers", "U": "text", "S": "text", "V": "a structure", "O": "a cell array or objects"}
    if kind in reasons:
        return None, reasons[kind]
    if array.size == 0:
        return None, "empty"
    if array.size == 1:
        one = array.reshape(-1)[0]
        return None, f"one value, {one:.6g}" if kind in "fiu" else f"one value, {one}"
    if array.ndim - sum(length == 1 for length in array.shape) > 2:
        return None, f"an array of {array.ndim} dimensions, {array.shape}"
    if kind not in "fiubMm":
        return None, f"of the type {array.dtype}"
    return array.astype(f"{array.dtype.kind}8[ns]") if kind in "Mm" else array, ""


def _by_attributes(item: Item, attributes: Mapping[str, Any]) -> Item:
    """Numbers as their attributes say: a mark of missing samples, a scale, an offset and a unit."""
    values = item.values
    how = []
    missing = np.zeros(values.shape, dtype=bool)
    for key in _FILLS:
        if key in attributes:
            mark = _one_number(attributes[key])
            if mark is None:
                return replace(item, why=f"its attribute {key} is no number")
            # a mark may be of another precision than the numbers
            with np.errstate(over="ignore"):
                missing |= (values.astype(float) == mark) | (values.astype(np.float32) == np.float32(mark))
            how.append(f"{mark:g} is a missing sample ({key})")
    numbers = values.astype(float)
    for key, said in (("scale_factor", "times"), ("add_offset", "plus")):
        if key in attributes:
            number = _one_number(attributes[key])
            if number is None or not np.isfinite(number):
                return replace(item, why=f"its attribute {key} is no number")
            numbers = numbers * number if key == "scale_factor" else numbers + number
            how.append(f"{said} {number:.10g} ({key})")
    unit = next((text_of(attributes[key]) for key in _UNITS if key in attributes), "")
    if " since " in unit:  # of a time: "seconds since 1970-01-01"
        how.append(unit)
        unit = unit.partition(" since ")[0]
    return replace(item, values=np.where(missing, np.nan, numbers), unit=unit, how=", ".join(how))


def _one_number(value: Any) -> float | None:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return None
    return float(array.reshape(-1)[0]) if array.size == 1 else None


def text_of(value: Any) -> str:
    """The text of an attribute; "" where it is none."""
    array = np.asarray(value)
    one = array.reshape(-1)[0] if array.size == 1 else ""
    text = one.decode("utf-8", "replace") if isinstance(one, bytes) else str(one) if isinstance(one, str) else ""
    return text.strip()


def fields_of(item: Any, path: str, between: str) -> Iterator[tuple[str, str, Any]]:
    """Path, name and values of the fields of an array of numpy's structures, also of structures in them."""
    for name in item.dtype.names:
        inner = f"{path}{between}{name}"
        if item[name].dtype.names:
            yield from fields_of(item[name], inner, between)
        else:
            yield inner, name, item[name]


def table_of(path: Path, items: Sequence[Item], variable: str | None, time: str) -> RawTable:
    """Make a table of all items: one vector per channel, of the length of the time or of most of them, and the columns
    of matrices as long; or the one matrix of a file without vectors. `variable` takes one array or one group."""
    items = list(items) if variable is None else _below(path, items, variable)
    unread = {one.path: one.why for one in items if one.why}
    there = [replace(one, values=np.squeeze(one.values)) for one in items if not one.why]
    vectors = [one for one in there if one.values.ndim == 1]
    matrices = [one for one in there if one.values.ndim == 2]
    names = [one.name for one in vectors]
    timed = time in names or time_column(names, range(len(names))) is not None or any(one.clock for one in vectors)
    if len(matrices) == 1 and not timed:
        return _of_matrix(path, matrices[0], unread | {one.path: "a vector beside the matrix" for one in vectors})
    if not vectors or (matrices and not timed):
        held = ", ".join(f"'{one.path}'" for one in matrices) or "none"
        said = "".join(f"; '{name}' is not read: {why}" for name, why in list(unread.items())[:5])
        raise InputError(
            f"{path}: expected one matrix, or one vector per channel with '{time}' among them; matrices in the file: "
            f"{held}; name one as 'variable' in a column map{said}"
        )
    length = _length(path, vectors, time)
    columns = list[Item]()
    for one in there:
        columns += _columns(one, length)
    unread |= {one.path: one.why for one in columns if one.why}
    return of_columns(path, [one for one in columns if not one.why], unread)


def of_columns(path: Path, columns: Sequence[Item], unread: Mapping[str, str]) -> RawTable:
    """Make a table of vectors of one length."""
    return RawTable(
        source=str(path),
        names=tuple(one.name for one in columns),
        values=np.stack([np.asarray(one.values, dtype=float) for one in columns], axis=1),
        paths=tuple(one.path for one in columns),
        units={i: one.unit for i, one in enumerate(columns) if one.unit},
        how={i: one.how for i, one in enumerate(columns) if one.how},
        clocks=frozenset(i for i, one in enumerate(columns) if one.clock),
        unread=dict(unread),
    )


def _below(path: Path, items: Sequence[Item], variable: str) -> list[Item]:
    """The one array or the arrays of a group that a map names."""
    name = variable.strip("/")
    found = [one for one in items if one.path.strip("/") == name]
    found = found or [one for one in items if one.path.lstrip("/").startswith((f"{name}/", f"{name}."))]
    if not found:
        raise unknown("variable", variable, [one.path for one in items], str(path))
    if found[0].why and len(found) == 1:
        raise InputError(f"{path}: variable '{variable}' is not read: {found[0].why}")
    return found


def _of_matrix(path: Path, one: Item, unread: Mapping[str, str]) -> RawTable:
    """A matrix whose columns have no names."""
    matrix = np.asarray(one.values, dtype=float)
    if matrix.shape[0] < matrix.shape[1]:
        raise InputError(f"{path}: '{one.path}' has shape {matrix.shape}; expected samples in rows: transpose it")
    return RawTable(source=str(path), names=None, values=matrix, unread=dict(unread))


def _length(path: Path, vectors: Sequence[Item], time: str) -> int:
    """Samples of the time, or of most vectors where no time is known. Raises InputError where there are several times,
    of other lengths."""
    names = [one.name for one in vectors]
    at = time_column(names, range(len(names)))
    asked = time if time in names or at is None else names[at]
    lengths = {one.path: len(one.values) for one in vectors if time in (one.path, one.path.strip("/"))}
    lengths = lengths or {one.path: len(one.values) for one in vectors if one.name == asked}
    unlike = {length: where for where, length in reversed(lengths.items())}
    if len(unlike) > 1:
        said = " and ".join(f"'{where}' ({length} samples)" for length, where in list(unlike.items())[:_ASKED])
        raise InputError(
            f"{path}: '{asked}' stands as {said}; say which is meant: --map t={next(iter(unlike.values()))}, or "
            'variable = "GROUP" in a column map'
        )
    counted = Counter(lengths.values() or [len(one.values) for one in vectors])
    return max(counted, key=lambda n: (counted[n], n))


def _columns(one: Item, length: int) -> list[Item]:
    """A vector, or the columns of a matrix, which are called "rate[1]", "rate[2]"; without numbers where it has another
    length."""
    values = one.values
    if values.ndim == 1:
        why = f"it has {len(values)} samples, the others have {length}"
        return [one if len(values) == length else replace(one, why=why)]
    values = values if len(values) == length else values.T
    if len(values) != length or values.shape[1] > _WIDEST:
        why = f"a matrix of {one.values.shape}, beside {length} samples"
        return [replace(one, why=why)]
    numbers = range(values.shape[1])
    return [
        replace(one, path=f"{one.path}[{i + 1}]", name=f"{one.name}[{i + 1}]", values=values[:, i]) for i in numbers
    ]
