"""Turn the columns of a table into channels in SI: names, units, column map. Names are checked, never guessed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from casid.errors import InputError, unknown
from casid.records.column_map import ColumnMap, ColumnTerm
from casid.records.contents import Contents
from casid.records.loggers import logger_of
from casid.records.table import RawTable, shown
from casid.records.time_names import time_column, time_named
from casid.signals import CHANNELS, is_control, label_of, same_unit, si_factor, unit_of, with_suffix

_HEADER = re.compile(r"([^\[\]()]*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")
_CLOSE = 0.8
_ASKED = 4  # channels that a question names
_OTHER_WORDS = ("attitude", "latitude")  # which are no slips of altitude
ROW = "row"  # in a map: the number of the row


@dataclass(frozen=True, kw_only=True)
class Header:
    """The header of a column."""

    name: str  # unlike that of every other column
    unit: str  # that the file states, or ""
    leaf: str  # the name, which other columns of the file may have too
    place: str  # by which a map finds it, unlike that of every other column


@dataclass(frozen=True, eq=False, kw_only=True)
class _Read:
    """A channel as it is read: samples (N,) in SI, where it stands in the file, its stated unit or "", and how."""

    values: np.ndarray
    place: str
    unit: str
    how: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """Channels of a table in SI, (N,) each with `t` among them, where each stands in the file, which of them have a
    stated unit, remarks, and what was read and what was not."""

    channels: Mapping[str, np.ndarray]
    places: Mapping[str, str]
    stated: Mapping[str, str]
    notes: tuple[str, ...]
    contents: Contents


FORMULA = "=+-@"  # begins what a spreadsheet evaluates: a name with it is written behind an apostrophe


def split_header(header: str) -> tuple[str, str]:
    """Name and unit of a column header, "" when there is none: `alpha [deg]`, `alpha (deg)` and `alpha_deg` alike. A
    number right behind the name, `xyz[1]`, is no unit. What cannot be printed is left out."""
    header = "".join(c if c.isprintable() else " " * c.isspace() for c in header).strip()
    header = header[1:] if header[:1] == "'" and header[1:2] in tuple(FORMULA) else header
    match = _HEADER.fullmatch(header)
    if not match or re.fullmatch(r".*\S[\[(]\d+[\])]", header):
        return header, ""
    unit = (match[2] or match[3] or "").strip()
    return (match[1], unit) if unit else with_suffix(match[1])


def channels_of(table: RawTable, column_map: ColumnMap, own: Collection[str] = ()) -> Columns:
    """Channels of a table: those of the map, and every other named column under its own name; `own` are those of a
    system that is no aircraft. Raises InputError for names nearly those of absent channels, two columns of one name, a
    unit that is unknown or does not fit, a channel that cannot be read, and a mapped column that is not there."""
    if table.names is None and not column_map.columns:
        raise InputError(
            f"{table.source}: its {table.values.shape[1]} columns have no names; say which is which with a column map, "
            "e.g. --map t=1 --map alpha=12:deg"
        )
    headers = headers_of(table)
    notes: list[str] = []
    logger = None if own else logger_of([header.name for header in headers])
    if logger is not None:
        notes.append(f"columns as {logger[0]} names them: {', '.join(logger[1].columns)}")
        column_map = logger[1].merged(column_map)
    channels, used = _mapped(table, headers, column_map, checked=not own)
    rest = [i for i in range(len(headers)) if i not in used]
    known = {headers[i].leaf for i in rest} | channels.keys()
    absent = set() if own else set(CHANNELS) - known
    time = None if known & {"t", *own} else _time(table, headers, rest)
    unread = dict(table.unread)
    unread |= _of_one_name(table, headers, rest, known={*CHANNELS, *own}, time=time, taken=channels)
    rest = [i for i in rest if headers[i].place not in unread]
    slips: dict[str, str] = {}
    extras: list[int] = []
    leaves = [headers[i].leaf for i in rest]
    for index in rest:
        header = headers[index]
        name = header.leaf if leaves.count(header.leaf) == 1 else header.name
        if index == time:
            notes.append(f"{table.column(index)} is taken as t, the time")
            name = "t"
        if header.leaf in channels:
            unread[header.place] = f"the column map takes '{header.leaf}' from elsewhere"
        elif name in CHANNELS or name in own:
            channels[name] = _read(table, headers, index, name)
        elif not name:
            unread |= _nameless(table, index)
        elif (near := near_channel(header.leaf, absent)) and (
            not column_map.columns or (logger is None and _same_letters(name, near))
        ):
            slips.setdefault(near, name)
        else:
            extras.append(index)
    _check_slips(table, slips)
    for index in extras:
        name = headers[index].name
        if index in table.text and np.isnan(table.values[:, index]).all():
            unread[headers[index].place] = "text"
            continue
        try:
            channels[name] = _read(table, headers, index, name)
        except InputError as error:
            why = str(error).removeprefix(f"{table.source}: ").removeprefix(f"{table.column(index)}: ")
            unread[headers[index].place] = why
    _check_unread(table, channels, {*CHANNELS, *own})
    further = [name for i in extras if (name := headers[i].name) in channels]
    notes += _of_extras([name for name in further if not is_control(name)], absent)
    contents = Contents(read={name: one.how for name, one in channels.items()}, unread=unread)
    last = {header.name: i for i, header in enumerate(headers)}
    return Columns(
        channels={name: channels[name].values for name in sorted(channels, key=lambda one: last.get(one, -1))},
        places={name: one.place for name, one in channels.items()},
        stated={name: one.unit for name, one in channels.items() if one.unit and name not in further},
        notes=(*notes, contents.note) if contents.note else tuple(notes),
        contents=contents,
    )


def _mapped(
    table: RawTable, headers: Sequence[Header], column_map: ColumnMap, *, checked: bool
) -> tuple[dict[str, _Read], set[int]]:
    """Channels of a map, and the columns that it uses."""
    channels: dict[str, _Read] = {}
    used: set[int] = set()
    for channel, terms in column_map.columns.items():
        found = [_find(table, headers, term, channel) for term in terms]
        if found[0] is None:  # rows at a steady rate
            weight = terms[0].weight
            rows = weight * np.arange(len(table.values), dtype=float)
            how = f"the number of the row, times {weight:g}"
            channels[channel] = _Read(values=rows, place="the number of the row", unit="", how=how)
            continue
        indices = [i for i in found if i is not None]
        if checked:
            named = {headers[i].leaf for i in indices} if headers else set()
            _check_target(channel, named, f"{table.source}: column map")
        used.update(indices)
        parts = [_read(table, headers, i, channel, term.unit) for term, i in zip(terms, indices, strict=True)]
        columns = [term.weight * part.values for term, part in zip(terms, parts, strict=True)]
        weights = ["" if term.weight == 1.0 else f", weight {term.weight:g}" for term in terms]
        channels[channel] = _Read(
            values=np.sum(columns, axis=0) if len(columns) > 1 else columns[0],
            place=f"{', '.join(part.place for part in parts)} (mapped to '{channel}')",
            unit=parts[0].unit if all(part.unit for part in parts) else "",
            how="; plus ".join(f"{part.how}{weight}" for part, weight in zip(parts, weights, strict=True)),
        )
    return channels, used


def _time(table: RawTable, headers: Sequence[Header], among: Sequence[int]) -> int | None:
    """The column that is called as loggers call time, or the only one of dates or clocks."""
    named = time_column([header.leaf for header in headers], among)
    clocks = [i for i in among if i in table.clocks]
    return clocks[0] if named is None and len(clocks) == 1 else named


def _of_one_name(
    table: RawTable,
    headers: Sequence[Header],
    among: Sequence[int],
    *,
    known: Collection[str],
    time: int | None,
    taken: Collection[str],
) -> dict[str, str]:
    """Columns that repeat another one of the same name, with the reason why they are not read. Raises InputError that
    asks which one is meant, where they differ, of channels and of the time that no map takes from elsewhere."""
    several = dict[str, list[int]]()
    for index in among:
        several.setdefault(headers[index].leaf, []).append(index)
    same = dict[str, str]()
    asked = list[tuple[str, list[int]]]()
    for leaf, indices in several.items():
        is_time = time in indices
        if len(indices) < 2 or not (leaf in known or is_time) or leaf in taken:
            continue
        one, *others = indices
        for other in others:
            same_numbers = np.array_equal(*table.values.T[[one, other]], equal_nan=True)
            if same_numbers and headers[one].unit == headers[other].unit:
                same[headers[other].place] = f"the same as '{headers[one].place}'"
        if any(headers[other].place not in same for other in others):
            asked.append(("t" if is_time else leaf, indices))
    if asked:
        named = [(leaf, [f"'{headers[i].name}'" for i in found]) for leaf, found in asked[:_ASKED]]
        said = "; ".join(f"{leaf} stands as {_listed(names)}" for leaf, names in named)
        write = " ".join(f"--map {leaf}={_quoted(headers[found[0]].name)}" for leaf, found in asked[:_ASKED])
        other = f"--map {asked[0][0]}={_quoted(headers[asked[0][1][1]].name)}"
        more = f" and so do {len(asked) - _ASKED} more" if len(asked) > _ASKED else ""
        group = ', or variable = "GROUP" in a column map' if table.paths else ""
        raise InputError(f"{table.source}: {said}{more}; say which is meant: {write}, or {other}{group}")
    return same


def _listed(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}"


def _quoted(name: str) -> str:
    return f"'{name}'" if re.search(r"[\s#()\[\]]", name) else name


def _how(table: RawTable, index: int, unit: str, channel: str) -> str:
    """Describe where a channel is in the file, its unit, and the conversion of its numbers."""
    made = f"; {table.how[index]}" if index in table.how else ""
    if unit:
        factor = _factor(unit, channel)
        return f"{table.column(index)}{made}; [{unit}]" + (f", times {factor:.10g}" if factor != 1.0 else "")
    assumed = unit_of(channel)
    return f"{table.column(index)}{made}" + (f"; in {assumed}, as no unit is stated" if assumed else "; as it stands")


def _check_unread(table: RawTable, channels: Collection[str], known: Collection[str]) -> None:
    """Raise InputError for a channel that the file has and that cannot be read. A single value is no time history."""
    for path, why in table.unread.items():
        leaf = split_header(re.split(r"[/.]", path.partition("#")[0])[-1])[0]
        if leaf in known and leaf not in channels and not why.startswith(("one value", "empty")):
            raise InputError(
                f"{table.source}: '{path}' is not read: {why}; expected real numbers, one a sample; write it so, or "
                f"give {leaf} another column: --map {leaf}=COLUMN"
            )


def _nameless(table: RawTable, index: int) -> dict[str, str]:
    """Say that a column without a name counts the rows, or raise InputError where it holds anything else."""
    values = table.values[:, index]
    if np.array_equal(values, np.arange(len(values)) + values[0]):
        return {f"column {index + 1}": "it has no name and counts the rows"}
    if index in table.text or not np.isnan(values).all():
        raise InputError(f"{table.source}: header: column {index + 1} has no name; name or remove it")
    return {}


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


def headers_of(table: RawTable) -> list[Header]:
    """Headers of all columns, none where columns have no names. Columns of one name have those of their paths, or get
    numbers: "x", "x#2". Raises InputError where name and attribute of a column state different units."""
    parted = [split_header(name) for name in table.names or ()]
    leaves = [name for name, _ in parted]
    unlike = table.paths or numbered(leaves)
    found = []
    for index, (leaf, unit) in enumerate(parted):
        beside = table.units.get(index, "")
        if beside and unit and same_unit(beside, unit) is False:
            raise InputError(
                f"{table.source}: {table.column(index)}: its name says [{unit}], its attribute [{beside}]; remove one"
            )
        named = time_named(leaf)
        unit = beside or unit or (named[1] if named else "")
        alone = leaves.count(leaf) == 1
        name, place = (leaf, table.path(index)) if alone else (unlike[index], unlike[index])
        found.append(Header(name=name, unit=unit, leaf=leaf, place=place))
    return found


def numbered(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of which none stands twice: "q", then "q#2"."""
    seen = Counter[str]()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name}#{seen[name]}" if name and seen[name] > 1 else name)
    return tuple(found)


def _find(table: RawTable, headers: Sequence[Header], term: ColumnTerm, channel: str) -> int | None:
    """Index of the column that a term of the map speaks of; None for the number of the row."""
    count = table.values.shape[1]
    where = f"{table.source}: column map of '{channel}'"
    if isinstance(term.column, int):
        if not 1 <= term.column <= count:
            raise InputError(f"{where}: there is no column {term.column}; the file has columns 1 to {count}")
        return term.column - 1
    if term.column == ROW and ROW not in {header.leaf for header in headers}:
        return None
    if table.names is None:
        raise InputError(f"{where}: '{term.column}' is a name, but the columns have none; give a number, 1 to {count}")
    names = [header.name for header in headers]
    for pool in (names, table.paths, [header.leaf for header in headers], list(table.names)):
        found = [i for i, name in enumerate(pool) if name == term.column]
        if len(found) > 1:
            listed = _listed(f"'{names[i]}'" for i in found)
            raise InputError(f"{where}: '{term.column}' stands as {listed}; name one of them")
        if found:
            return found[0]
    why = next((why for path, why in table.unread.items() if term.column in (path, path.rsplit("/")[-1])), "")
    if why:
        raise InputError(f"{where}: '{term.column}' is not read: {why}; expected real numbers, one a sample")
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


def _read(table: RawTable, headers: Sequence[Header], index: int, channel: str, unit: str = "") -> _Read:
    """A column in SI. A unit may stand in the map or in the header; both must agree."""
    place = table.column(index)
    where = f"{table.source}: {place}"
    if index in table.text:
        row, cell = table.text[index]
        hint = "write a decimal point" if re.fullmatch(r"[+-]?\d+,\d+", cell) else "repair it, or leave it empty"
        if row == 0 and len(table.text) > 1:
            hint = f"delete a row of units, and write them in the header, like '{channel} [{cell}]', or in --map"
        raise InputError(f"{table.place(row)}, {place}: {shown(cell)} is not a number; {hint}")
    written = headers[index].unit if headers else ""
    if unit and written and same_unit(unit, written) is False:
        raise InputError(f"{where}: the column map says [{unit}], the header says [{written}]; remove one of the two")
    unit = unit or written
    values = table.values[:, index]
    infinite = np.flatnonzero(np.isinf(values))
    if len(infinite):
        raise InputError(
            f"{table.place(infinite[0])}, {place}: the value is infinite; "
            "repair it, or leave the cell empty if the sample is missing"
        )
    values = values * (_factor(unit, channel, where) if unit else 1.0)
    return _Read(values=values, place=place, unit=unit, how=_how(table, index, unit, channel))


def _factor(unit: str, channel: str, where: str = "") -> float:
    """Return `si_factor`; g is a gram of a mass that casid does not know."""
    gram = unit == "g" and channel not in CHANNELS and "mass" in channel.lower()
    return 1e-3 if gram else si_factor(unit, channel, where)


def _same_letters(name: str, channel: str) -> bool:
    plain = [re.sub(r"[\W_]", "", text).lower() for text in (name, channel, label_of(channel))]
    return plain[0] in plain[1:]


def near_channel(name: str, absent: set[str]) -> str | None:
    """The absent channel that `name` spells in another way, or nearly."""
    if re.search(r"\[\d+\]$", name):  # of an array
        return None
    name = re.sub(r"\s*[(\[].*$", "", name)  # a unit in broken brackets
    for channel in sorted(absent):
        if channel == name or _same_letters(name, channel):
            return channel
    if name.lower() in _OTHER_WORDS:
        return None
    close = get_close_matches(name.lower(), [c.lower() for c in sorted(absent)], n=1, cutoff=_CLOSE)
    return next((c for c in sorted(absent) if close and c.lower() == close[0]), None)
