"""MATLAB: arrays, structures within structures, and signals that are structures of data, unit and rate.

A signal is a structure with a field of numbers called data, values or signal, and beside it nothing but its unit, rate,
description and the like.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import library, loaded
from casid.records.items import Item, item_of, of_columns, table_of, text_of
from casid.records.limits import MOST_CELLS
from casid.records.log import nearest_rows
from casid.records.table import RawTable

_DATA = ("data", "values", "value", "signal")
_UNIT = ("unit", "units")
_RATE = ("rate", "samplerate", "fs", "sample_rate")
_MOST = 50  # structures in an array of them
_DEEPEST = 20  # structures within structures
_OPAQUE = ("s0", "s1", "s2", "arr")  # fields by which scipy describes an object
_MATLAB_TEXT = b"char"


def read_mat(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a .mat file: its one matrix, without names, or one vector per channel, also as fields of structures, and
    signals of several rates. Version 7.3 needs the extra `hdf5`. scipy crashes with some forged flags in the header;
    see `limits.apart`."""
    from scipy.io import loadmat  # here, because few records are .mat and scipy.io is slow to import

    try:
        content = loaded(path, lambda: loadmat(str(path)))
    except NotImplementedError:  # version 7.3 is HDF5
        content = _of_version_7_3(path)
    items = list[Item]()
    rates = dict[str, float]()
    for name, value in content.items():
        if not name.startswith(("__", "#")):
            items += _items(value, name, name, rates)
    if variable is None and rates and rates.keys() == {one.path for one in items if not one.why}:
        return _of_rates(path, items, rates)
    return table_of(path, items, variable, time)


def _items(value: Any, path: str, name: str, rates: dict[str, float]) -> list[Item]:
    """List the content of a variable, under "group.field"; adds the rate [Hz] of a signal to `rates`."""
    fields = _fields(value)
    if fields is None or path.count(".") > _DEEPEST:
        many = getattr(getattr(value, "dtype", None), "names", None)
        if many and 1 < value.size <= _MOST and path.count(".") <= _DEEPEST:
            # such as the signals of a Simulink structure with time
            each = [(f"({i + 1})", value.reshape(-1)[i : i + 1]) for i in range(value.size)]
            return [one for i, part in each for one in _items(part, f"{path}{i}", f"{name}{i}", rates)]
        return [Item(path=path, name=name, why="structures or objects") if many else item_of(path, name, value)]
    lower = {key.lower(): one for key, one in fields.items()}
    data = next((key for key in _DATA if key in lower and _is_series(lower[key])), None)
    others = [one for key, one in lower.items() if key != data]
    if data is None or any(_fields(one) is not None or _is_series(one) for one in others):
        return [one for key, inner in fields.items() for one in _items(inner, f"{path}.{key}", key, rates)]
    unit = next((text for key in _UNIT if (text := text_of(lower.get(key)))), "")
    signal = replace(item_of(path, name, lower[data]), unit=unit)
    rate = next((_number(lower[key]) for key in _RATE if key in lower), None)
    if rate is not None and not signal.why:
        if not (np.isfinite(rate) and rate > 0.0):
            return [Item(path=path, name=name, why=f"its rate is {rate:g}; expected samples a second")]
        rates[path] = rate
    return [signal]


def _fields(value: Any) -> Mapping[str, Any] | None:
    """Fields of one structure; None of anything else."""
    if isinstance(value, Mapping):
        return value
    if isinstance(value, np.ndarray) and value.dtype.names not in (None, _OPAQUE) and value.size == 1:
        one = value.reshape(-1)[0]
        return {field: one[field] for field in value.dtype.names}
    return None


def _is_series(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size > 1


def _number(value: Any) -> float:
    array = np.asarray(value)
    return float(array.reshape(-1)[0]) if array.size == 1 and array.dtype.kind in "fiu" else np.nan


def _of_rates(path: Path, items: Sequence[Item], rates: Mapping[str, float]) -> RawTable:
    """Signals that begin together at rates of their own, on the clock of the fastest: a slower one has its own samples
    and is missing between them."""
    fastest = max(rates.values())
    signals = {one.path: one for one in items if not one.why}
    unlike = [one.path for one in signals.values() if np.squeeze(one.values).ndim != 1]
    if unlike:
        raise InputError(f"{path}: '{unlike[0]}' has a rate and is no vector; expected one number a sample")
    longest = max(np.size(one.values) / rates[name] for name, one in signals.items())
    if longest * fastest > MOST_CELLS:
        raise InputError(f"{path}: signals of {longest:.4g} s on a clock of {fastest:.4g} Hz are too many samples")
    clock = np.arange(int(longest * fastest + 1e-9)) / fastest
    columns = [Item(path="t", name="t", values=clock, unit="s", how=f"of samples at {fastest:g} Hz")]
    for name, one in signals.items():
        stamps = np.arange(np.size(one.values)) / rates[name]
        column = np.where(nearest_rows(clock, stamps), np.interp(clock, stamps, np.ravel(one.values)), np.nan)
        how = ", ".join(part for part in (one.how, f"at {rates[name]:g} Hz") if part)
        columns.append(replace(one, values=column, how=how))
    table = of_columns(path, columns, {one.path: one.why for one in items if one.why})
    listed = ", ".join(f"{rate:g}" for rate in sorted(set(rates.values())))
    said = f"signals at {listed} Hz, taken to begin together, are put on the clock of {fastest:g} Hz"
    return replace(table, notes=(said,))


def _of_version_7_3(path: Path) -> dict[str, Any]:
    """Variables of a .mat file of version 7.3, structures as tables, arrays with samples in rows as MATLAB has them."""
    h5py = library("h5py", path, "hdf5")

    def taken(item: Any, depth: int) -> Any:
        kind = item.attrs.get("MATLAB_class", b"")
        if isinstance(item, h5py.Group):
            if "MATLAB_sparse" in item.attrs:
                return _Sparse()
            return {} if depth > _DEEPEST else {name: taken(item[name], depth + 1) for name in item}
        if "MATLAB_empty" in item.attrs or item.shape is None:
            return np.empty(0)
        if "MATLAB_object_decode" in item.attrs:  # numbers that say where the object is, such as a timeseries
            return np.empty(2, dtype=object)
        if item.external or item.is_virtual:
            raise ValueError(f"'{item.name}' is in another file; copy it into this one")
        values = np.asarray(item).T
        if kind == _MATLAB_TEXT:
            return "".join(map(chr, values.ravel().tolist()))
        if values.dtype.names == ("real", "imag"):
            return values["real"] + 1j * values["imag"]
        return values

    def load() -> dict[str, Any]:
        with h5py.File(path, "r") as file:
            return {name: taken(file[name], 0) for name in file if not name.startswith("#")}

    return loaded(path, load)


class _Sparse:
    """A sparse matrix, which is not read."""

    def tocsc(self) -> None:
        """Be known as scipy's sparse matrices are."""
