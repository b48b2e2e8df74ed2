"""Logs of a Crazyflie's SD card: a head that describes events and their variables, then the events themselves.

Format as in `tools/usdlog` of the firmware, versions 1 and 2. Variables as the firmware calls them; its body axes point
forward, left and up, its pitch is nose up.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import loaded
from casid.records.log import Series, lost, of_log
from casid.records.table import RawTable
from casid.signals import DEGREE, GRAVITY

MAGICS = (b"\xbc\x01\x00", b"\xbc\x02\x00")
_STAMP = {1: ("<HI", 1e-3), 2: ("<HQ", 1e-6)}  # version -> event and stamp, seconds in its unit
# channel -> (variable, factor), of several the first one that is there
_VARIABLES: Mapping[str, tuple[tuple[str, float], ...]] = {
    "p": (("gyro.x", DEGREE), ("stateEstimateZ.rateRoll", 1e-3)),
    "q": (("gyro.y", -DEGREE), ("stateEstimateZ.ratePitch", -1e-3)),
    "r": (("gyro.z", -DEGREE), ("stateEstimateZ.rateYaw", -1e-3)),
    "ax": (("acc.x", GRAVITY),),
    "ay": (("acc.y", -GRAVITY),),
    "az": (("acc.z", -GRAVITY),),
    "phi": (("stateEstimate.roll", DEGREE), ("stabilizer.roll", DEGREE)),
    "theta": (("stateEstimate.pitch", DEGREE), ("stabilizer.pitch", DEGREE)),
    "psi": (("stateEstimate.yaw", -DEGREE), ("stabilizer.yaw", -DEGREE)),
    "north": (("stateEstimate.x", 1.0),),
    "east": (("stateEstimate.y", -1.0),),
    "altitude": (("stateEstimate.z", 1.0),),
    "v_north": (("stateEstimate.vx", 1.0),),
    "v_east": (("stateEstimate.vy", -1.0),),
    "v_down": (("stateEstimate.vz", -1.0),),
    "battery": (("pm.vbat", 1.0), ("pm.vbatMV", 1e-3)),
    **{f"m{i}": ((f"motor.m{i}", 1.0), (f"pwm.m{i}_pwm", 1.0)) for i in range(1, 5)},
}


def read_crazyflie(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a log of a Crazyflie's SD card, on the clock of its rates. Motors are the firmware's commands."""
    found = loaded(path, lambda: _events(path.read_bytes()))
    series: dict[str, Series] = {}
    for channel, several in _VARIABLES.items():
        for name, factor in several:
            if name in found:
                stamps, values = found[name]
                series[channel] = stamps, factor * values
                break
    if "psi" in series:
        series["psi"] = series["psi"][0], np.unwrap(series["psi"][1])
    if not {"p", "phi", "m1"} & series.keys():
        raise InputError(f"{path}: a log of a Crazyflie without gyro, attitude and motors; it has {', '.join(found)}")
    known = {name for several in _VARIABLES.values() for name, _ in several}
    series |= {name: one for name, one in found.items() if name not in known}
    return of_log(path, series, None, ("a log of a Crazyflie", *lost(series)))


def _events(data: bytes) -> dict[str, Any]:
    """Stamps [s] and samples of every variable. A log that ends within an event ends before it."""
    version, kinds = struct.unpack_from("<HH", data, 1)
    if data[0] != 0xBC or version not in _STAMP:
        raise ValueError(f"it begins with {data[:3].hex()}, which is no version that is known")
    at = 5
    described = dict[int, tuple[str, tuple[str, ...]]]()
    for _ in range(kinds):
        event = struct.unpack_from("<H", data, at)[0]
        _, at = _name(data, at + 2)
        layout = "<"
        names = []
        count = struct.unpack_from("<H", data, at)[0]
        at += 2
        for _ in range(count):
            text, at = _name(data, at)  # "gyro.x(f)"
            layout = layout + text[-2]
            names = [*names, text[:-3]]
        described[event] = layout, tuple(names)
    head, second = _STAMP[version]
    rows = dict[int, list[tuple[Any, ...]]]()
    while at + struct.calcsize(head) <= len(data) - 4:  # a checksum ends the file
        event, stamp = struct.unpack_from(head, data, at)
        at += struct.calcsize(head)
        if event not in described or at + struct.calcsize(described[event][0]) > len(data) - 4:
            break
        layout = described[event][0]
        rows.setdefault(event, []).append((stamp * second, *struct.unpack_from(layout, data, at)))
        at += struct.calcsize(layout)
    found: dict[str, Any] = {}
    for event, some in rows.items():
        table = np.array(some, dtype=float)
        found |= {name: (table[:, 0], table[:, i + 1]) for i, name in enumerate(described[event][1])}
    return found


def _name(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode("ascii"), end + 1
