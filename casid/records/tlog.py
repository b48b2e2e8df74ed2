"""Telemetry logs of MAVLink (.tlog): what a ground station received of an aircraft, as messages of ArduPilot's logs.

Fields and units as in the common message set of MAVLink. A message is at the time of the autopilot where it has one,
else at that of its arrival.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.ardupilot import table_of_messages
from casid.records.foreign import library, loaded
from casid.records.table import RawTable
from casid.signals import DEGREE, GRAVITY

_ARDUPILOT = 3  # of HEARTBEAT.autopilot
_ON_GROUND = 1  # of EXTENDED_SYS_STATE.landed_state
_AXES = "xyz"

Row = dict[str, Any]


def _inertial(m: Mapping[str, Any], share: float = 1.0, g: float = 1.0) -> Row:
    """Rates in a `share` of rad/s, and accelerations in that of `g` [m/s2]."""
    rates = {f"Gyr{axis.upper()}": m[f"{axis}gyro"] * share for axis in _AXES}
    return rates | {f"Acc{axis.upper()}": m[f"{axis}acc"] * share * g for axis in _AXES}


_in_thousandths = partial(_inertial, share=1e-3, g=GRAVITY)


def _over_ground(m: Mapping[str, Any]) -> Row:
    north = m["vx"] * 0.01
    east = m["vy"] * 0.01
    course = np.arctan2(east, north) / DEGREE
    place = {"Lat": m["lat"] * 1e-7, "Lng": m["lon"] * 1e-7}
    return place | {"Spd": float(np.hypot(north, east)), "GCrs": float(course), "VZ": m["vz"] * 0.01}


def _angles(m: Mapping[str, Any]) -> Row:
    return {name.capitalize(): m[name] / DEGREE for name in ("roll", "pitch", "yaw")}


# message of MAVLink -> that of DataFlash, and its fields; of several for one the first that the log has counts
_MEANING: Mapping[str, tuple[str, Callable[[Mapping[str, Any]], Row]]] = {
    "HIGHRES_IMU": ("IMU", _inertial),
    "SCALED_IMU": ("IMU", _in_thousandths),
    "RAW_IMU": ("IMU", _in_thousandths),  # of ArduPilot alone
    "ATTITUDE": ("ATT", _angles),
    "ATTITUDE_QUATERNION": ("XKQ", lambda m: {f"Q{i}": m[f"q{i}"] for i in range(1, 5)}),
    "SCALED_PRESSURE": ("BARO", lambda m: {"Press": m["press_abs"] * 100.0}),
    "GLOBAL_POSITION_INT": ("GPS", _over_ground),
    "VFR_HUD": ("ARSP", lambda m: {"Airspeed": m["airspeed"]}),
    "AOA_SSA": ("AOA", lambda m: {"AOA": m["AOA"], "SSA": m["SSA"]}),
    "SYS_STATUS": ("BAT", lambda m: {"Volt": m["voltage_battery"] * 1e-3}),
    "SERVO_OUTPUT_RAW": ("RCOU", lambda m: {f"C{i}": m.get(f"servo{i}_raw", 0) for i in range(1, 17)}),
    "PARAM_VALUE": ("PARM", lambda m: {"Name": m["param_id"], "Value": m["param_value"]}),
    "EXTENDED_SYS_STATE": ("STAT", lambda m: {"isFlying": float(m["landed_state"] > _ON_GROUND)}),
}
_OF_THE_LINK = ("HEARTBEAT", "BAD_DATA", "STATUSTEXT", "TIMESYNC", "SYSTEM_TIME")


def read_tlog(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a telemetry log, of the first aircraft in it; needs the extra `ardupilot`."""
    mavutil = library("pymavlink.mavutil", path, "ardupilot")

    def load() -> tuple[dict[tuple[int, str], list[Row]], dict[int, int]]:
        if path.stat().st_size == 0:
            raise ValueError("the file is empty")
        found: dict[tuple[int, str], list[Row]] = {}
        autopilots: dict[int, int] = {}
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # where it prints damaged messages
            log = mavutil.mavlogfile(str(path), notimestamps=False)
            try:
                while (message := log.recv_msg()) is not None:
                    name = message.get_type()
                    system = message.get_srcSystem()
                    fields = message.to_dict()
                    if name == "HEARTBEAT":
                        autopilots.setdefault(system, fields["autopilot"])
                    arrived = float(message._timestamp)
                    found.setdefault((system, name), []).append({**fields, "arrived": arrived})
            finally:
                log.close()
        return found, autopilots

    return _table(path, *loaded(path, load))


def _table(path: Path, found: Mapping[tuple[int, str], list[Row]], autopilots: Mapping[int, int]) -> RawTable:
    flown = [system for system, name in found if name in ("ATTITUDE", "ATTITUDE_QUATERNION")]
    if not flown:
        held = ", ".join(sorted({name for _, name in found})[:8])
        raise InputError(f"{path}: no attitude of an aircraft among its messages; it has {held or 'none'}")
    own = {name: rows for (system, name), rows in found.items() if system == flown[0]}
    unread = {
        f"system {system}": "another aircraft, or the ground station" for system, _ in found if system != flown[0]
    }
    unread |= dict.fromkeys(sorted(own.keys() - {*_MEANING, *_OF_THE_LINK}), "no channel is made of this message")
    rows = dict[str, list[Row]]()
    for name, (message, made) in _MEANING.items():
        if name not in own:
            continue
        if message in rows:
            unread[name] = f"{message} is taken of another message"
        elif name == "RAW_IMU" and autopilots.get(flown[0]) != _ARDUPILOT:
            unread[name] = "its numbers have no unit"
        else:
            rows[message] = _timed(own[name], made)
    notes = ["its rates are those of the link, and what was lost on the way is missing"]
    if "IMU" not in rows and "ATTITUDE" in own:  # the filter's rates stand for those of the gyros
        rows["IMU"] = _timed(
            own["ATTITUDE"], lambda m: {"GyrX": m["rollspeed"], "GyrY": m["pitchspeed"], "GyrZ": m["yawspeed"]}
        )
        notes.append("p, q and r are those of the autopilot's filter (ATTITUDE)")
    if "ARSP" in rows:
        notes.append("V is of the airspeed of VFR_HUD, which is an estimate where there is no sensor")
    return table_of_messages(path, rows, unread, tuple(notes), "a telemetry log of MAVLink")


def _timed(rows: list[Row], made: Callable[[Mapping[str, Any]], Row]) -> list[Row]:
    """Messages of DataFlash that are made of those of MAVLink, with their times."""
    return [{"TimeUS": t, **made(m)} for t, m in zip(_stamps(rows), rows, strict=True)]


def _stamps(rows: list[Row]) -> list[float]:
    """Times [us] of messages: of the autopilot, put on the clock of arrivals, where they have one."""
    arrived = np.array([row["arrived"] for row in rows]) * 1e6
    booted = np.array([_boot(row) for row in rows])
    return (booted + np.median(arrived - booted) if np.isfinite(booted).all() else arrived).tolist()


def _boot(row: Row) -> float:
    """Time [us] since the autopilot began; NaN of a message that does not say."""
    return float(row["time_boot_ms"]) * 1e3 if "time_boot_ms" in row else float(row.get("time_usec", np.nan))
