"""Flight records from arrays and data frames in memory, with every check that a file gets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from casid.arguments import given
from casid.errors import InputError, unknown
from casid.records.column_map import ColumnMap
from casid.records.columns import split_header
from casid.records.readers import record_of_table
from casid.records.record import Record
from casid.records.table import RawTable
from casid.signals import CHANNELS, SURFACES

if TYPE_CHECKING:
    from pandas import DataFrame


Hold = str | Mapping[str, str]


def record_of_arrays(name: str, t: Any, channels: Mapping[str, Any], units: Mapping[str, str], hold: Hold) -> Record:
    """The record of a time and of channels, (N,) each; see `Record.from_arrays`."""
    where = f"record '{name}'"
    if not isinstance(channels, Mapping):
        raise InputError(f"{where}: channels is {given(channels)}; expected a table like {{'alpha': alpha}}")
    if "t" in channels:
        raise InputError(f"{where}: 't' is given twice, as the time and as a channel; leave one out")
    plain = Record(name=name, t=t, channels={f"_{k}": v for k, v in channels.items()})  # shapes and kinds
    columns = {"t": plain.t} | {k: plain[f"_{k}"] for k in channels}
    return _checked(name, columns, units, hold)


def record_of_frame(name: str, frame: DataFrame, units: Mapping[str, str], hold: Hold) -> Record:
    """The record of a data frame; see `Record.from_frame`."""
    where = f"record '{name}'"
    if not hasattr(frame, "columns") or not hasattr(frame, "index"):
        raise InputError(f"{where}: from_frame takes a pandas DataFrame, got {given(frame)}")
    if frame.index.name is not None and split_header(str(frame.index.name))[0] == "t":
        frame = frame.reset_index()
    columns = {}
    for header in frame.columns:
        column = frame[header]
        if getattr(column, "ndim", 1) != 1:
            raise InputError(f"{where}: two columns are called '{header}'; rename or remove one")
        try:
            columns[str(header)] = column.to_numpy(dtype=float, na_value=np.nan)
        except (TypeError, ValueError):
            raise InputError(f"{where}: column '{header}' is of {column.dtype}; expected numbers") from None
    if not len(frame):
        raise InputError(f"{where}: the data frame has no rows")
    return _checked(name, columns, units, hold)


def _checked(name: str, columns: Mapping[str, np.ndarray], units: Mapping[str, str], hold: Hold) -> Record:
    where = f"record '{name}'"
    if not isinstance(units, Mapping):
        raise InputError(f"{where}: units is {given(units)}; expected a table like {{'alpha': 'deg'}}")
    bare = {header: split_header(header) for header in columns}
    for channel, unit in units.items():
        if channel not in {n for n, _ in bare.values()}:
            raise unknown("channel", str(channel), [n for n, _ in bare.values()], f"{where}: units")
        if not isinstance(unit, str):
            raise InputError(f"{where}: units: '{channel}' is {given(unit)}; expected a unit in quotes, like 'deg'")
    headers = [_header(*bare[header], units, where) for header in columns]
    table = RawTable(source=where, names=tuple(headers), values=np.stack(list(columns.values()), axis=1), hold=hold)
    names = [name for name, _ in bare.values()]
    # without a control surface it is no aircraft's record: names mean what the user's own model says
    own = () if any(name in SURFACES for name in names) else tuple(n for n in names if n != "t")
    record = record_of_table(table, name, ColumnMap(), own)
    familiar = [n for n in own if n in CHANNELS]
    if not familiar:
        return record
    return record.with_notes(
        f"no control surface: taken as the record of a system other than an aircraft, with {', '.join(familiar)} of "
        "its own"
    )


def _header(name: str, written: str, units: Mapping[str, str], where: str) -> str:
    """Name and unit of a column, as a file has them."""
    unit = units.get(name, written)
    if written and unit != written:
        raise InputError(f"{where}: the unit of '{name}' is [{written}] in its name and '{unit}' in units; remove one")
    return f"{name} [{unit}]" if unit else name
