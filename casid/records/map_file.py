"""A column map ready to fill in: what is known or likely of the columns of a file, and a table of the others."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

import numpy as np

from casid.records.column_map import ColumnMap, ColumnTerm
from casid.records.columns import Header, headers_of, near_channel
from casid.records.loggers import logger_of
from casid.records.table import RawTable
from casid.records.time_names import time_column
from casid.signals import CHANNELS, GRAVITY, SURFACES, is_unit, label_of, unit_of

# names of the field for a channel, without case and signs between the letters
_ALSO: Mapping[str, tuple[str, ...]] = {
    "V": ("tas", "vtas", "ktas", "vt", "airspeed", "trueairspeed", "vtrue"),
    "alpha": ("aoa", "alfa", "alphavane", "angleofattack"),
    "beta": ("aos", "ssa", "sideslip", "betavane"),
    "p": ("rollrate", "pb", "pbody", "wx", "gyrx", "gyrox", "omegax"),
    "q": ("pitchrate", "qb", "qbody", "wy", "gyry", "gyroy", "omegay"),
    "r": ("yawrate", "rb", "rbody", "wz", "gyrz", "gyroz", "omegaz"),
    "phi": ("roll", "bank", "rollangle", "bankangle"),
    "theta": ("pitch", "pitchangle", "pitchattitude"),
    "psi": ("yaw", "heading", "hdg", "trueheading", "headingtrue"),
    "ax": ("nx", "accx", "accelx", "xaccel", "longaccel"),
    "ay": ("ny", "accy", "accely", "yaccel", "lataccel", "latac"),
    "az": ("nz", "accz", "accelz", "zaccel", "normalaccel", "normaccel", "loadfactor"),
    "delta_e": ("elevator", "elev", "el", "de", "elevatorposition"),
    "delta_a": ("aileron", "ail", "da", "aileronposition"),
    "delta_r": ("rudder", "rud", "dr", "rudderposition"),
    "thrust": ("fn", "netthrust", "thrusttotal"),
    "altitude": ("alt", "hbaro", "baroalt", "pressurealtitude", "hp", "altmsl", "altb"),
    "rho": ("density", "airdensity"),
}
# names of matrices of three columns -> the channels of the columns
_OF_MATRICES: Mapping[str, tuple[str, str, str]] = {
    **dict.fromkeys(("rate", "rates", "gyro", "omega", "pqr", "angularrate", "angular_velocity"), ("p", "q", "r")),
    **dict.fromkeys(("attitude", "euler", "angles", "rpy"), ("phi", "theta", "psi")),
    **dict.fromkeys(("accel", "acc", "acceleration", "specific_force"), ("ax", "ay", "az")),
}
_THROW = 25.0  # deg at full command, which the file marks as a guess


def suggested_map(table: RawTable, given: ColumnMap) -> str:
    """The text of a column map of a table: lines of what is given, known or likely, and as comments what is missing and
    what each column holds."""
    headers = headers_of(table)
    known = given if (logger := logger_of([header.name for header in headers])) is None else logger[1].merged(given)
    lines = {channel: (_in_words(terms), "") for channel, terms in known.columns.items()}
    used = {term.column for terms in known.columns.values() for term in terms}
    leaves = [header.leaf for header in headers]
    time = time_column(leaves, range(len(headers)))
    for index, header in enumerate(headers):
        channel = _likely(header.leaf, lines, time == index) if leaves.count(header.leaf) == 1 else None
        if channel is None or header.name in used:
            continue
        lines[channel] = _column(table, index, channel, header.name, header.unit)
        used.add(header.name)
    for surface in SURFACES:
        if surface not in lines and f"{surface}_command" in leaves:
            guess = f"{_THROW:g} deg at full command is a guess: put the throw of your surface in"
            lines[surface] = [f"{surface}_command:deg*-{_THROW:g}"], guess
            used.add(f"{surface}_command")
    return "\n".join((*_head(table), *_written(lines), *_rest(table, headers, used))) + "\n"


def _head(table: RawTable) -> tuple[str, ...]:
    return (
        f"# Column map of {table.source}, to be given with --map.",
        '# CHANNEL = "COLUMN:UNIT*WEIGHT"; without a unit that of the header counts, or SI. # begins a comment.',
        "[columns]",
    )


def _written(lines: Mapping[str, tuple[list[str], str]]) -> list[str]:
    written = []
    for channel in (*CHANNELS, *(name for name in lines if name not in CHANNELS)):
        if channel in lines:
            column, remark = lines[channel]
            value = json.dumps(column if len(column) > 1 else column[0], ensure_ascii=False)
            written.append(f"{_key(channel)} = {value}" + (f"  # {remark}" if remark else ""))
        else:
            written.append(f'# {channel} = ""  # {label_of(channel)} [{unit_of(channel)}]')
    return written


def _rest(table: RawTable, headers: list[Header], used: set[str | int]) -> list[str]:
    """List the columns that no line uses, with their ranges."""
    lines = ["", "# Columns that no line above uses, from least to most:"]
    for index in range(table.values.shape[1]):
        name = headers[index].name if headers else str(index + 1)
        unit = headers[index].unit if headers else ""
        if name in used or not name:
            continue
        values = table.values[np.isfinite(table.values[:, index]), index]
        held = f"{values.min():.4g} to {values.max():.4g}" if len(values) else "no numbers"
        lines.append(f"# {name!r}" + (f" [{unit}]" if unit else "") + f": {held}")
    return lines if len(lines) > 2 else []


def _likely(name: str, taken: Mapping[str, object], is_time: bool) -> str | None:
    """The channel that a column may be, of those that no other column is."""
    absent = set(CHANNELS) - taken.keys()
    if is_time and "t" in absent:
        return "t"
    plain = re.sub(r"[\W_]", "", name).lower()
    column = re.fullmatch(r"(.*?)\[([123])\]", name)
    of_matrix = _OF_MATRICES.get(column[1].lower(), ()) if column else ()
    if column and of_matrix and of_matrix[int(column[2]) - 1] in absent:
        return of_matrix[int(column[2]) - 1]
    also = next((channel for channel, names in _ALSO.items() if plain in names and channel in absent), None)
    return also or (near_channel(name, absent) if name else None)


def _column(table: RawTable, index: int, channel: str, name: str, unit: str) -> tuple[list[str], str]:
    """Return how a map names a column, and a remark; an `az` that is positive in level flight is turned over."""
    remark = f"the unit [{unit}] is unknown" if unit and not is_unit(unit) else ""
    if channel == "az":
        middle = float(np.nanmedian(table.values[:, index])) if np.isfinite(table.values[:, index]).any() else np.nan
        name += ":g" if not unit and 0.3 < abs(middle) < 3.0 else ""
        if middle > 0.0:
            name += "*-1"
            remark = f"it is positive on average; az is about -{GRAVITY:.2f} m/s2 in level flight"
    return [name], remark


def _in_words(terms: tuple[ColumnTerm, ...]) -> list[str]:
    """Terms as a map has them."""
    return [
        f"{one.column}" + (f":{one.unit}" if one.unit else "") + (f"*{one.weight!r}" if one.weight != 1.0 else "")
        for one in terms
    ]


def _key(channel: str) -> str:
    return channel if re.fullmatch(r"[A-Za-z0-9_-]+", channel) else json.dumps(channel)
