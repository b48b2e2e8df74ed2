"""Betaflight's blackbox: the main frames of the first log in a file.

Its body axes point forward, left and up; rates are in deg/s by the scale of its head, accelerations in units of 1 g.
"""

from __future__ import annotations

import logging
import struct
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import library, loaded
from casid.records.log import Series, lost, of_log
from casid.records.table import RawTable
from casid.signals import DEGREE, GRAVITY

MAGIC = b"H Product:Blackbox"
_MOTORS = 8
_ONE_G = 2048.0  # of the accelerometer where the head gives none


def read_betaflight(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a Betaflight blackbox log on the clock of its rates; needs the extra `betaflight`. Motors are ``m1``,
    ``m2`` ..., as the firmware commands them; every other field keeps its name."""
    orangebox = library("orangebox", path, "betaflight")

    def load() -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        if MAGIC not in path.read_bytes():  # which the parser looks for in every byte
            raise ValueError(f"it has no line '{MAGIC.decode()}'")
        logging.getLogger("orangebox").setLevel(logging.CRITICAL)
        parser = orangebox.Parser.load(str(path))
        names = list(parser.field_names)
        rows = [frame.data[: len(names)] for frame in parser.frames() if frame.type.value in "IP"]
        width = min(map(len, rows), default=0)
        kept = [[one if isinstance(one, (int, float)) else np.nan for one in row[:width]] for row in rows]
        table = np.array(kept, dtype=float)
        return dict(parser.headers), dict(zip(names, table.T, strict=False))

    heads, fields = loaded(path, load)
    if "time" not in fields or "gyroADC[0]" not in fields:
        raise InputError(f"{path}: a blackbox without time or gyro; it has {', '.join(fields) or 'no frames'}")
    stamps = fields.pop("time") * 1e-6
    rate = _number(heads.get("gyro_scale", heads.get("gyro.scale")), 1.0) * DEGREE
    force = GRAVITY / _number(heads.get("acc_1G"), _ONE_G)
    known = dict[str, tuple[str, float]]()
    for i, sign in enumerate((1.0, -1.0, -1.0)):
        known |= {f"gyroADC[{i}]": ("pqr"[i], sign * rate), f"accSmooth[{i}]": (f"a{'xyz'[i]}", sign * force)}
    known |= {f"motor[{i}]": (f"m{i + 1}", 1.0) for i in range(_MOTORS)}
    series: dict[str, Series] = {}
    for name, values in fields.items():
        channel, factor = known.get(name, (name, 1.0))
        series[channel] = stamps, factor * values
    return of_log(path, series, None, ("a Betaflight log of a multirotor", *lost(series)))


def _number(value: Any, usual: float) -> float:
    """A number of the head, which may be written as the four bytes of a float."""
    if isinstance(value, str) and value.lower().startswith("0x"):
        return float(struct.unpack(">f", int(value, 16).to_bytes(4, "big"))[0])
    if isinstance(value, int) and value > 1 << 24:
        return float(struct.unpack(">f", value.to_bytes(4, "big"))[0])
    return float(value) if isinstance(value, (int, float, str)) and str(value).strip() else usual
