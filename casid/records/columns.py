"""Turn the columns of a table into channels in SI: names, units, column map. Names are checked, never guessed."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from casid.errors import InputError, unknown
from casid.records.column_map import ColumnMap, ColumnTerm
from casid.records.loggers import logger_of
from casid.records.table import RawTable, shown
from casid.signals import CHANNELS, is_control, label_of, same_unit, si_factor, with_suffix

_HEADER = re.compile(r"([^\[\]()]*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")
_CLOSE = 0.8
ROW = "row"  # in a map: the number of the row
# names of a column of time, without signs between the letters; the likeliest first
_TIMES = ("t", "time", "timestamp", "timeus", "timems", "timesec", "times", "elapsedtime", "reltime", "relativetime")
_TIMES += ("timeelapsed", "timestampsample", "irigtime", "irig", "utctime", "utc", "gpstime", "lcltime", "localtime")
_TIMES += ("datetime", "datetimeutc", "zeit", "zeitstempel", "uhrzeit", "tempo", "temps", "tod", "offsettime")
_TIMES += ("sessiontime", "systemtime", "timestartup", "sampletimefine", "timeseconds", "xvalue", "timeutc")


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """Channels of a table in SI, (N,) each with `t` among them, where each stands in the file, which of them have a
    stated unit, and remarks."""

    channels: Mapping[str, np.ndarray]
    places: Mapping[str, str]
    stated: Mapping[str, str]
    notes: tuple[str, ...]


def split_header(header: str) -> tuple[str, str]:
    """Name and unit of a column header, "" when there is none: `alpha [deg]`, `alpha (deg)` and `alpha_deg` alike. A
    number right behind the name, `xyz[1]`, is no unit."""
    match = _HEADER.fullmatch(header.strip())
    if not match or re.fullmatch(r".*\S[\[(]\d+[\])]", header.strip()):
        return header.strip(), ""
    unit = (match[2] or match[3] or "").strip()
    return (match[1], unit) if unit else with_suffix(match[1])


def channels_of(table: RawTable, column_map: ColumnMap, own: Collection[str] = ()) -> Columns:
    """Channels of a table: those of the map, and every other named column under its own name; `own` are those of a
    system that is no aircraft. Raises InputError for names nearly those of absent channels, two columns of one name, a
    unit that is unknown or does not fit, text where a number belongs, and a mapped column that is not there."""
    if table.names is None and not column_map.columns:
        raise InputError(
            f"{table.source}: its {table.values.shape[1]} columns have no names; say which is which with a column map, "
            "e.g. --map t=1 --map alpha=12:deg"
        )
    headers = headers_of(table)
    notes: list[str] = []
    if not own and (logger := logger_of([name for name, _ in headers])):
        notes.append(f"columns as {logger[0]} names them: {', '.join(logger[1].columns)}")
        column_map = logger[1].merged(column_map)
    channels, places, stated, used = _mapped(table, headers, column_map, checked=not own)
    rest = [i for i in range(len(headers)) if i not in used]
    known = {headers[i][0] for i in rest} | channels.keys()
    absent = set() if own else set(CHANNELS) - known
    time = None if known & {"t", *own} else time_column([name for name, _ in headers], rest)
    slips: dict[str, str] = {}
    extras: list[int] = []
    for index in rest:
        name, unit = headers[index]
        if index == time:
            notes.append(f"{table.column(index)} is taken as t, the time")
            name = "t"
        if name in channels:
            notes.append(f"{table.column(index)} is left out: the column map takes '{name}' from elsewhere")
        elif name in CHANNELS or name in own:
            channels[name], places[name] = _converted(table, headers, index, name), table.column(index)
            stated |= {name: unit} if unit else {}
        elif not name:
            notes += _nameless(table, index)
        elif (near := near_channel(name, absent)) and (not column_map.columns or _same_letters(name, near)):
            slips.setdefault(near, name)
        else:
            extras.append(index)
    _check_slips(table, slips)
    texts = [index for index in extras if index in table.text and np.isnan(table.values[:, index]).all()]
    if texts:
        notes.append(f"columns of text are left out: {', '.join(repr(headers[i][0]) for i in texts)}")
    for index in (one for one in extras if one not in texts):
        name = headers[index][0]
        try:
            channels[name], places[name] = _converted(table, headers, index, name), table.column(index)
        except InputError as error:
            notes.append(f"{table.column(index)} is left out: {str(error).removeprefix(f'{table.source}: ')}")
    notes += _of_extras([name for i in extras if (name := headers[i][0]) in channels and not is_control(name)], absent)
    last = {name: i for i, (name, _) in enumerate(headers)}
    return Columns(
        channels=dict(sorted(channels.items(), key=lambda one: last.get(one[0], -1))),
        places=places,
        stated=stated,
        notes=tuple(notes),
    )


def _mapped(
    table: RawTable, headers: list[tuple[str, str]], column_map: ColumnMap, *, checked: bool
) -> tuple[dict[str, np.ndarray], dict[str, str], dict[str, str], set[int]]:
    """Channels of a map, where each stands in the file, those with a stated unit, and the columns that it uses."""
    channels: dict[str, np.ndarray] = {}
    places: dict[str, str] = {}
    stated: dict[str, str] = {}
    used: set[int] = set()
    for channel, terms in column_map.columns.items():
        found = [_find(table, headers, term, channel) for term in terms]
        if found[0] is None:  # rows at a steady rate
            channels[channel] = terms[0].weight * np.arange(len(table.values), dtype=float)
            places[channel] = "the number of the row"
            continue
        indices = [i for i in found if i is not None]
        named = {headers[i][0] for i in indices} if headers else set()
        if checked:
            _check_target(channel, named, f"{table.source}: column map")
        parts = list(zip(terms, indices, strict=True))
        columns = [term.weight * _converted(table, headers, i, channel, term.unit) for term, i in parts]
        channels[channel] = np.sum(columns, axis=0) if len(columns) > 1 else columns[0]
        places[channel] = f"{', '.join(table.column(i) for i in indices)} (mapped to '{channel}')"
        used.update(indices)
        units = [term.unit or (headers[i][1] if headers else "") for term, i in parts]
        if all(units):
            stated[channel] = units[0]
    return channels, places, stated, used


def time_column(names: Sequence[str], among: Iterable[int]) -> int | None:
    """The column that is called as loggers call time, the likeliest name first; None where there is none."""
    plain = {i: re.sub(r"[\W_]", "", names[i]).lower() for i in among}
    found = [(_TIMES.index(name), i) for i, name in plain.items() if name in _TIMES]
    return min(found)[1] if found else None


def _nameless(table: RawTable, index: int) -> list[str]:
    """Say that a column without a name counts the rows, or raise InputError where it holds anything else."""
    values = table.values[:, index]
    if np.array_equal(values, np.arange(len(values)) + values[0]):
        return [f"column {index + 1} has no name and counts the rows; left out"]
    if index in table.text or not np.isnan(values).all():
        raise InputError(f"{table.source}: header: column {index + 1} has no name; name or remove it")
    return []


def _check_slips(table: RawTable, slips: Mapping[str, str]) -> None:
    """Raise InputError that names every column whose name is nearly that of a channel."""
    if not slips:
        return
    quoted = {near: f"'{near}={name}'" if " " in name else f"{near}={name}" for near, name in slips.items()}
    options = " ".join(quoted.values())
    if len(slips) == 1:
        near, name = next(iter(slips.items()))
        raise InputError(
            f"{table.source}: header: unknown channel '{name}'; did you mean '{near}'? Rename it, or say what it is: "
            f"--map {options}, or --map {quoted[near].replace(near, name, 1)} to keep it as it is"
        )
    said = ", ".join(f"'{name}' ('{near}'?)" for near, name in slips.items())
    raise InputError(
        f"{table.source}: header: unknown channels {said}; rename them, or say what they are: --map {options}; "
        f"casid check {table.source} --write-map map.toml writes such a map"
    )


def _of_extras(names: Sequence[str], absent: set[str]) -> list[str]:
    """Say which columns are no channels."""
    if not names:
        return []
    near = {name: near_channel(name, absent) for name in names}
    said = ", ".join(f"'{name}'" + (f" (nearest: '{near[name]}')" if near[name] else "") for name in names)
    return [
        f"{said} {'is no channel' if len(names) == 1 else 'are no channels'} that casid knows; kept as "
        f"{'it is' if len(names) == 1 else 'they are'}"
    ]


def headers_of(table: RawTable) -> list[tuple[str, str]]:
    """Name and unit of every column, none where columns have no names. No name is used twice: a second column that
    casid does not know gets a number. InputError for a channel that is given twice."""
    first: dict[str, int] = {}
    found = []
    for index, (name, unit) in enumerate(map(split_header, table.names or ())):
        if name and name in first:
            if name in CHANNELS:
                raise InputError(
                    f"{table.source}: header: columns {first[name] + 1} and {index + 1} are both called '{name}'; "
                    "rename or remove one"
                )
            name = f"{name}_{index + 1}"
        first[name] = index
        found.append((name, unit))
    return found


def _find(table: RawTable, headers: list[tuple[str, str]], term: ColumnTerm, channel: str) -> int | None:
    """Index of the column that a term of the map names; None for the number of the row."""
    count = table.values.shape[1]
    where = f"{table.source}: column map of '{channel}'"
    if isinstance(term.column, int):
        if not 1 <= term.column <= count:
            raise InputError(f"{where}: there is no column {term.column}; the file has columns 1 to {count}")
        return term.column - 1
    if term.column == ROW and ROW not in {name for name, _ in headers}:
        return None
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
    near = near_channel(channel, set(CHANNELS))
    if near:
        raise InputError(f"{where}: unknown channel '{channel}'; did you mean '{near}'?")
    lost = sorted(columns & set(CHANNELS))
    if lost:
        raise InputError(
            f"{where}: '{lost[0]}' would become '{channel}', which is no channel, and be lost; the left side names the "
            f"channel, as in {lost[0]}={channel}"
        )


def _converted(table: RawTable, headers: list[tuple[str, str]], index: int, channel: str, unit: str = "") -> np.ndarray:
    """(N,) a column in SI. A unit may be given in the map or in the header; both must agree."""
    where = f"{table.source}: {table.column(index)}"
    if index in table.text:
        row, cell = table.text[index]
        hint = "write a decimal point" if re.fullmatch(r"[+-]?\d+,\d+", cell) else "repair it, or leave it empty"
        if row == 0 and len(table.text) > 1:
            hint = f"delete a row of units, and write them in the header, like '{channel} [{cell}]', or in --map"
        raise InputError(f"{table.place(row)}, {table.column(index)}: {shown(cell)} is not a number; {hint}")
    written = headers[index][1] if headers else ""
    if unit and written and same_unit(unit, written) is False:
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


def _same_letters(name: str, channel: str) -> bool:
    plain = [re.sub(r"[\W_]", "", text).lower() for text in (name, channel, label_of(channel))]
    return plain[0] in plain[1:]


def near_channel(name: str, absent: set[str]) -> str | None:
    """The absent channel that `name` spells in another way, or nearly."""
    name = re.sub(r"\s*[(\[].*$", "", name)  # a unit in broken brackets
    for channel in sorted(absent):
        if channel == name or _same_letters(name, channel):
            return channel
    close = get_close_matches(name.lower(), [c.lower() for c in sorted(absent)], n=1, cutoff=_CLOSE)
    return next((c for c in sorted(absent) if close and c.lower() == close[0]), None)
