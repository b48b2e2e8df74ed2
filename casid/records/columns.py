"""From the columns of a table to channels in SI: names, units, column map. Names are checked, never guessed."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from casid.errors import InputError, unknown
from casid.records.column_map import ColumnMap, ColumnTerm
from casid.records.table import RawTable, shown
from casid.signals import CHANNELS, is_control, label_of, si_factor, with_suffix

_HEADER = re.compile(r"([^\[\]()]*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")
_CLOSE = 0.8


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """Channels of a table in SI, (N,) each with `t` among them, where each stands in the file, which of them have a
    stated unit, and remarks."""

    channels: Mapping[str, np.ndarray]
    places: Mapping[str, str]
    stated: frozenset[str]
    notes: tuple[str, ...]


def split_header(header: str) -> tuple[str, str]:
    """Name and unit of a column header, "" when there is none: `alpha [deg]`, `alpha (deg)` and `alpha_deg` alike."""
    match = _HEADER.fullmatch(header.strip())
    if not match:
        return header.strip(), ""
    unit = (match[2] or match[3] or "").strip()
    return (match[1], unit) if unit else with_suffix(match[1])


def channels_of(table: RawTable, column_map: ColumnMap, own: Collection[str] = ()) -> Columns:
    """Channels of a table: what the map says, and every other named column under its own name; `own` names those of a
    system that is no aircraft, where nothing is nearly a channel of one.

    Raises InputError for a name that is nearly that of an absent channel and for two columns of one name. Also for a
    unit that is unknown or does not fit, text where a number belongs, and a column of the map that is not there.
    """
    if table.names is None and not column_map.columns:
        raise InputError(
            f"{table.source}: its {table.values.shape[1]} columns have no names; say which is which with a column map, "
            "e.g. --map t=1 --map alpha=12:deg"
        )
    headers = [split_header(name) for name in table.names or ()]
    _check_duplicates(table, headers)
    channels: dict[str, np.ndarray] = {}
    places: dict[str, str] = {}
    stated = {name for name, unit in headers if unit}
    used: set[int] = set()
    for channel, terms in column_map.columns.items():
        indices = [_find(table, headers, term, channel) for term in terms]
        named = {headers[i][0] for i in indices} if headers else set()
        if not own:
            _check_target(channel, named, f"{table.source}: column map")
        parts = zip(terms, indices, strict=True)
        columns = [term.weight * _converted(table, headers, i, channel, term.unit) for term, i in parts]
        channels[channel] = np.sum(columns, axis=0) if len(columns) > 1 else columns[0]
        places[channel] = f"{', '.join(table.column(i) for i in indices)} (mapped to '{channel}')"
        used.update(indices)
        whole = all(term.unit or (headers and headers[i][1]) for term, i in zip(terms, indices, strict=True))
        stated = stated | {channel} if whole else stated - {channel}
    notes: list[str] = []
    extras: list[str] = []
    rest = [i for i in range(len(headers)) if i not in used]
    absent = set() if own else set(CHANNELS) - set(channels) - {headers[i][0] for i in rest}
    for index in rest:
        name = headers[index][0]
        if name in channels:
            notes.append(f"{table.column(index)} is left out: the column map takes '{name}' from elsewhere")
        elif name in CHANNELS or name in own:
            channels[name], places[name] = _converted(table, headers, index, name), table.column(index)
        else:
            _add_extra(table, headers, index, channels, places, absent, notes, extras, mapped=bool(column_map.columns))
    if extras:
        one = len(extras) == 1
        is_none = (
            "is no channel that casid knows; kept as it is"
            if one
            else "are no channels that casid knows; kept as they are"
        )
        notes.append(f"{', '.join(extras)} {is_none}")
    return Columns(channels=channels, places=places, stated=frozenset(stated & channels.keys()), notes=tuple(notes))


def _check_duplicates(table: RawTable, headers: list[tuple[str, str]]) -> None:
    first: dict[str, int] = {}
    for index, (name, _) in enumerate(headers):
        if name and name in first:
            raise InputError(
                f"{table.source}: header: columns {first[name] + 1} and {index + 1} are both called '{name}'; "
                "rename or remove one"
            )
        first[name] = index


def _find(table: RawTable, headers: list[tuple[str, str]], term: ColumnTerm, channel: str) -> int:
    """Index of the column that a term of the map speaks of."""
    count = table.values.shape[1]
    where = f"{table.source}: column map of '{channel}'"
    if isinstance(term.column, int):
        if not 1 <= term.column <= count:
            raise InputError(f"{where}: there is no column {term.column}; the file has columns 1 to {count}")
        return term.column - 1
    if table.names is None:
        raise InputError(f"{where}: '{term.column}' is a name, but the columns have none; give a number, 1 to {count}")
    names = [name for name, _ in headers]
    for pool in (names, list(table.names)):
        if term.column in pool:
            return pool.index(term.column)
    raise unknown("column", term.column, [n for n in names if n], where)


def _check_target(channel: str, columns: set[str], where: str) -> None:
    """A channel of the map that casid does not know must not be a slip; a column mapped to its own name is meant."""
    if channel in CHANNELS or channel in columns:
        return
    near = _near(channel, set(CHANNELS))
    if near:
        raise InputError(f"{where}: unknown channel '{channel}'; did you mean '{near}'?")
    lost = sorted(columns & set(CHANNELS))
    if lost:
        raise InputError(
            f"{where}: '{lost[0]}' would become '{channel}', which is no channel, and be lost; the left side names the "
            f"channel, as in {lost[0]}={channel}"
        )


def _converted(table: RawTable, headers: list[tuple[str, str]], index: int, channel: str, unit: str = "") -> np.ndarray:
    """(N,) a column in SI. A unit may stand in the map or in the header; both must agree."""
    where = f"{table.source}: {table.column(index)}"
    if index in table.text:
        row, cell = table.text[index]
        hint = "write a decimal point" if re.fullmatch(r"[+-]?\d+,\d+", cell) else "repair it, or leave it empty"
        if row == 0 and len(table.text) > 1:
            hint = f"delete a row of units, and write them in the header, like '{channel} [{cell}]', or in --map"
        raise InputError(f"{table.place(row)}, {table.column(index)}: {shown(cell)} is not a number; {hint}")
    written = headers[index][1] if headers else ""
    if unit and written and unit != written:
        raise InputError(f"{where}: the column map says [{unit}], the header says [{written}]; remove one of the two")
    unit = unit or written
    values = table.values[:, index]
    infinite = np.flatnonzero(np.isinf(values))
    if len(infinite):
        raise InputError(
            f"{table.place(infinite[0])}, {table.column(index)}: the value is infinite; "
            "repair it, or leave the cell empty if the sample is missing"
        )
    return values * (si_factor(unit, channel, where) if unit else 1.0)


def _add_extra(
    table: RawTable,
    headers: list[tuple[str, str]],
    index: int,
    channels: dict[str, np.ndarray],
    places: dict[str, str],
    absent: set[str],
    notes: list[str],
    extras: list[str],
    *,
    mapped: bool = False,
) -> None:
    """Keep a column that is no channel casid knows, or say what is wrong with it."""
    name = headers[index][0]
    place = table.column(index)
    if not name:
        if np.array_equal(table.values[:, index], np.arange(len(table.values)) + table.values[0, index]):
            notes.append(f"column {index + 1} has no name and counts the rows; left out")
            return
        if index in table.text or not np.isnan(table.values[:, index]).all():
            raise InputError(f"{table.source}: header: column {index + 1} has no name; name or remove it")
        return
    near = _near(name, absent)
    if near and (not mapped or _same_letters(name, near)):
        raise InputError(
            f"{table.source}: header: unknown channel '{name}'; did you mean '{near}'? Rename it, or say what it is: "
            f"--map {near}={name}, or --map {name}={name} to keep it as it is"
        )
    try:
        channels[name] = _converted(table, headers, index, name)
    except InputError as error:
        notes.append(f"{place} is left out: {str(error).removeprefix(f'{table.source}: ')}")
        return
    places[name] = place
    if not is_control(name):
        extras.append(f"'{name}'" + (f" (nearest: '{near}')" if near else ""))


def _same_letters(name: str, channel: str) -> bool:
    plain = [re.sub(r"[\W_]", "", text).lower() for text in (name, channel, label_of(channel))]
    return plain[0] in plain[1:]


def _near(name: str, absent: set[str]) -> str | None:
    """The absent channel that `name` spells in another way, or nearly."""
    name = re.sub(r"\s*[(\[].*$", "", name)  # a unit in broken brackets
    for channel in sorted(absent):
        if channel == name or _same_letters(name, channel):
            return channel
    close = get_close_matches(name.lower(), [c.lower() for c in sorted(absent)], n=1, cutoff=_CLOSE)
    return next((c for c in sorted(absent) if close and c.lower() == close[0]), None)
