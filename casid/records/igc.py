"""Flight recorders of gliding (.igc): fixes of the GNSS, pressure altitude, and what a recorder adds to each fix.

Format as in "Technical Specification for GNSS Flight Recorders" of the FAI, appendix A: records B, H and I.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import loaded
from casid.records.limits import read_bytes
from casid.records.log import EARTH
from casid.records.table import RawTable

_FIX = re.compile(
    r"B(\d\d)(\d\d)(\d\d)(\d\d)(\d{5})([NS])(\d{3})(\d{5})([EW])([AV])(-\d{4}|\d{5})(-\d{4}|\d{5})", re.ASCII
)
_ADDED = re.compile(r"(\d\d)(\d\d)([A-Z]{3})", re.ASCII)
_DAY = 86400.0  # s
# code of an addition -> channel and unit
_KNOWN = {"TAS": ("V", "km/h"), "HDT": ("psi", "deg")}
_PARTS = {"LAD", "LOD", "TDS"}  # further digits of latitude, longitude and time


def read_igc(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of the fixes of a flight recorder. Position is from the first fix; a fix without altitude (V) has none."""
    lines = loaded(path, lambda: read_bytes(path).decode("latin-1").splitlines())
    added = {
        code: slice(int(first) - 1, int(last))
        for line in lines
        if line.startswith("I")
        for first, last, code in _ADDED.findall(line[3:])
    }
    fixes = [(line, found) for line in lines if (found := _FIX.match(line))]
    if len(fixes) < 2:
        raise InputError(
            f"{path}: {len(fixes)} fixes (lines that begin with B) in it; expected a flight of an .igc file"
        )
    columns = _columns(fixes, added)
    unread = {name: "no number" for name, values in columns.items() if np.isnan(values).all()}
    kept = {name: values for name, values in columns.items() if name not in unread}
    skipped = sum(line.startswith("B") for line in lines) - len(fixes)
    notes = ("fixes of a flight recorder: altitude is that of the pressure, north and east are from the first fix",)
    notes += (f"{skipped} fixes are damaged and left out",) if skipped else ()
    values = np.stack(list(kept.values()), axis=1)
    return RawTable(source=str(path), names=tuple(kept), values=values, notes=notes, unread=unread)


def _columns(fixes: Sequence[tuple[str, re.Match[str]]], added: Mapping[str, slice]) -> dict[str, np.ndarray]:
    """Header -> (N,) numbers."""
    more = {code: np.array([_number(line[at]) for line, _ in fixes]) for code, at in added.items()}
    digits = {code: 10.0 ** (at.stop - at.start) for code, at in added.items()}
    nothing = np.zeros(len(fixes))
    part = {code: more[code] / digits[code] if code in more else nothing for code in _PARTS}
    g: Any = np.array([found.groups() for _, found in fixes]).T
    t = 3600.0 * g[0].astype(float) + 60.0 * g[1].astype(float) + g[2].astype(float) + np.nan_to_num(part["TDS"])
    t = t + _DAY * np.cumsum(np.diff(t, prepend=t[0]) < -0.5 * _DAY)
    latitude = _angle(g[3], g[4], np.nan_to_num(part["LAD"])) * np.where(g[5] == "N", 1.0, -1.0)
    longitude = _angle(g[6], g[7], np.nan_to_num(part["LOD"])) * np.where(g[8] == "E", 1.0, -1.0)
    pressure, gnss = g[10].astype(float), g[11].astype(float)
    measured = np.any(pressure != 0.0)
    columns = {
        "t [s]": t - t[0],
        "altitude [m]": pressure if measured else np.full(len(fixes), np.nan),
        "altitude_gnss [m]": np.where(g[9] == "A", gnss, np.nan),
        "north [m]": EARTH * (latitude - latitude[0]),
        "east [m]": EARTH * np.cos(latitude[0]) * (longitude - longitude[0]),
    }
    for code, values in more.items():
        if code not in _PARTS:
            channel, unit = _KNOWN.get(code, (f"igc_{code}", ""))
            values = np.degrees(np.unwrap(np.radians(values))) if channel == "psi" else values
            columns[f"{channel} [{unit}]" if unit else channel] = values
    return columns


def _angle(degrees: np.ndarray, minutes: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N,) [rad] of degrees and thousandths of minutes, and the part of a thousandth."""
    return np.radians(degrees.astype(float) + (minutes.astype(float) + part) / 60_000.0)


def _number(text: str) -> float:
    return float(text) if re.fullmatch(r"-?\d+", text, re.ASCII) else np.nan
