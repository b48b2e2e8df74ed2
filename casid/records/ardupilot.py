"""ArduPilot DataFlash logs of planes, copters and VTOL (.bin, .log): what is measured, and what the filter estimates.

Messages and fields as in "Onboard Message Log Messages" of the ArduPilot documentation: IMU, ATT, XKQ, ARSP, BARO,
GPS, XKF2, AOA, BAT, AETR, RCOU, EV, STAT and PARM. Body axes point forward, right and down, as here.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import library, loaded
from casid.records.log import EARTH, Series, attitude, lost, of_log
from casid.records.table import RawTable
from casid.signals import DEGREE

Rows = Mapping[str, list[dict[str, Any]]]  # message -> its fields, each time that it is there

_WANTED = ("IMU", "ATT", "XKQ", "NKQ", "ARSP", "BARO", "GPS", "XKF2", "NKF2", "AOA", "AETR", "RCOU", "PARM")
_WANTED += ("BAT", "CURR", "EV", "STAT")
_OF_THE_LOG = ("FMT", "FMTU", "UNIT", "MULT", "MSG", "VER")  # which describe the log itself
TEXT = b"FMT,"
_INSTANCE = ("I", "C", "Instance", "Inst")  # fields that number sensors and filters; the first one counts
_FUNCTIONS = {4: "delta_a_command", 19: "delta_e_command", 21: "delta_r_command", 70: "throttle"}  # SERVOn_FUNCTION
_FUNCTIONS |= {33 + i: f"m{i + 1}" for i in range(8)} | {82 + i: f"m{i + 9}" for i in range(4)}
# of EV
_LANDED = 18
_NOT_LANDED = 28
_BOTH = (_LANDED, _NOT_LANDED)
_FULL = 4500.0  # of AETR: a surface command at its end
_SEA_LEVEL = 101325.0  # Pa


def read_ardupilot(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a DataFlash log, binary or as text, on the clock of its inertial unit; needs the extra `ardupilot`.
    Surfaces are normalised commands, motors ``m1``, ``m2`` ..., as in `read_ulog`. `notes` say what is an estimate of
    the autopilot and what is lost."""
    reader = library("pymavlink.DFReader", path, "ardupilot")

    def load() -> tuple[dict[str, list[dict[str, Any]]], dict[str, str]]:
        if path.stat().st_size == 0:
            raise ValueError("the file is empty")
        with path.open("rb") as file:
            kind = reader.DFReader_text if file.read(len(TEXT)) == TEXT else reader.DFReader_binary
        rows: dict[str, list[dict[str, Any]]] = {}
        unread: dict[str, str] = {}
        log = kind.__new__(kind)
        try:
            with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # where it prints damaged messages
                log.__init__(str(path), zero_time_base=True)
                while (message := log.recv_match(type=list(_WANTED))) is not None:
                    fields = message.to_dict()
                    others = [name for name in _INSTANCE if fields.get(name)]
                    if not others:
                        rows.setdefault(message.get_type(), []).append(fields)
                        continue
                    unread[f"{message.get_type()}[{fields[others[0]]}]"] = "of another unit than the first"
            unread |= _of_no_channel(log)
        finally:  # it leaves the file open, also where it fails
            for opened in ("data_map", "filehandle"):
                if hasattr(log, opened):
                    getattr(log, opened).close()
        return rows, unread

    return table_of_messages(path, *loaded(path, load))


def _of_no_channel(log: Any) -> dict[str, str]:
    """Messages that the log has and of which no channel is made."""
    counts = log.counts if isinstance(log.counts, dict) else dict(enumerate(log.counts))
    names = {key if isinstance(key, str) else log.formats[key].name for key, count in counts.items() if count}
    skipped = sorted(names - {*_WANTED, *_OF_THE_LOG})
    return dict.fromkeys(skipped, "no channel is made of this message")


def table_of_messages(
    path: Path,
    rows: Rows,
    unread: Mapping[str, str],
    notes: tuple[str, ...] = (),
    log: str = "an ArduPilot log",
) -> RawTable:
    """Table of messages as DataFlash names them and their fields. Raises InputError where none is of a motion."""
    found = dict[str, Series]()
    said = list[str]()
    for part in (_inertial, _attitude, _barometer, _ground, _air, _inputs):
        part(rows, found, said)
    if not {"p", "phi"} & found.keys():
        held = ", ".join(sorted(rows))
        raise InputError(f"{path}: no messages of an aircraft's motion; expected IMU or ATT, among {held or 'none'}")
    return of_log(path, found, _flying(rows), (f"{log} of a {said[0]}", *said[1:], *notes, *lost(found)), unread)


def _fields(rows: Rows, messages: str, channels: Mapping[str, str], size: float = 1.0) -> dict[str, Series]:
    """Channels that are fields of a message, the first one there of `messages` with blanks between them, of `size` in
    SI each; none where no message has all of them."""
    for message in messages.split():
        kept = [row for row in rows.get(message, ()) if row.keys() >= {"TimeUS", *channels.values()}]
        if len(kept) > 1:
            t = np.array([row["TimeUS"] * 1e-6 for row in kept])
            later = np.append(True, np.diff(np.maximum.accumulate(t)) > 0.0)
            columns = {name: np.array([row[field] for row in kept], dtype=float) for name, field in channels.items()}
            return {name: (t[later], size * values[later]) for name, values in columns.items()}
    return {}


def _inertial(rows: Rows, found: dict[str, Series], notes: list[str]) -> None:
    found |= _fields(rows, "IMU", {"p": "GyrX", "q": "GyrY", "r": "GyrZ"})
    found |= _fields(rows, "IMU", {"ax": "AccX", "ay": "AccY", "az": "AccZ"})


def _attitude(rows: Rows, found: dict[str, Series], notes: list[str]) -> None:
    if turned := _fields(rows, "XKQ NKQ", {letter: f"Q{i}" for i, letter in enumerate("wxyz", 1)}):
        found |= attitude(turned["w"][0], np.stack([values for _, values in turned.values()], axis=1))
    elif angles := _fields(rows, "ATT", {"phi": "Roll", "theta": "Pitch", "psi": "Yaw"}, DEGREE):
        t, psi = angles["psi"]
        found |= angles | {"psi": (t, np.unwrap(psi))}


def _barometer(rows: Rows, found: dict[str, Series], notes: list[str]) -> None:
    """Pressure altitude, since the altitude of BARO is counted from where it was switched on."""
    if read := _fields(rows, "BARO", {"pressure": "Press"}):
        t, pressure = read["pressure"]
        found["altitude"] = t, (1.0 - (pressure / _SEA_LEVEL) ** (1.0 / 5.25588)) / 2.25577e-5
        notes.append("altitude is the pressure altitude of the standard atmosphere")


def _ground(rows: Rows, found: dict[str, Series], notes: list[str]) -> None:
    if read := _fields(rows, "GPS", {"speed": "Spd", "course": "GCrs", "v_down": "VZ"}):
        t, speed = read["speed"]
        course = np.radians(read["course"][1])
        found |= {"v_north": (t, speed * np.cos(course)), "v_east": (t, speed * np.sin(course))}
        found["v_down"] = read["v_down"]
    if place := _fields(rows, "GPS", {"latitude": "Lat", "longitude": "Lng"}, DEGREE):
        t, latitude = place["latitude"]
        longitude = place["longitude"][1]
        found["north"] = t, EARTH * (latitude - latitude[0])
        found["east"] = t, EARTH * np.cos(latitude[0]) * (longitude - longitude[0])
    found |= _fields(rows, "XKF2 NKF2", {"wind_north": "VWN", "wind_east": "VWE"})


def _air(rows: Rows, found: dict[str, Series], notes: list[str]) -> None:
    found |= _fields(rows, "ARSP", {"V": "Airspeed"})
    if "V" in found:
        t, V = found["V"]
        if "altitude" in found:
            found["V"] = t, V * (1.0 - 2.25577e-5 * np.interp(t, *found["altitude"])) ** (-0.5 * 4.25588)
            notes.append("V is the indicated airspeed over the root of the standard relative density at that altitude")
        else:
            notes.append("V is the indicated airspeed: without pressure it cannot be made true")
    found |= _fields(rows, "AOA", {"alpha_estimate": "AOA", "beta_estimate": "SSA"}, DEGREE)
    found |= _fields(rows, "BAT CURR", {"battery": "Volt"})


def _inputs(rows: Rows, found: dict[str, Series], notes: list[str]) -> None:
    """Read what went out to motors and servos; of surfaces rather the commands from -1 to 1 before the mixer."""
    out = _servos(rows, notes)
    found |= out
    rotors = any(name[0] == "m" for name in out)
    commands = {"delta_a_command": "Ail", "delta_e_command": "Elev", "delta_r_command": "Rudd", "throttle": "Thr"}
    for name, (t, command) in _fields(rows, "AETR", commands).items():
        found[name] = t, command / (100.0 if name == "throttle" else _FULL)
    surfaces = any(name.endswith("_command") for name in found)
    notes.insert(0, "VTOL" if rotors and surfaces else "multirotor" if rotors else "plane")


def _servos(rows: Rows, notes: list[str]) -> dict[str, Series]:
    """Commands by pulse widths and the parameters of the servos at the beginning; of several for one surface the first.
    Motors are from 0 to 1. A function that is changed in flight is reported."""
    parameters = dict[str, float]()
    changed = dict[str, str]()
    for row in rows.get("PARM", ()):
        name = row["Name"]
        value = row["Value"]
        if parameters.setdefault(name, value) != value and name.startswith("SERVO"):
            changed[name] = f"parameter {name} is changed from {parameters[name]:g} to {value:g} in flight"
    notes += changed.values()
    found: dict[str, Series] = {}
    for n in range(1, 17):
        name = _FUNCTIONS.get(int(parameters.get(f"SERVO{n}_FUNCTION", 0)))
        read = _fields(rows, "RCOU", {"pulse": f"C{n}"})
        if not read:
            continue
        t, pulse = read["pulse"]
        if name is None or name in found:
            if np.ptp(pulse) > 0.0:
                found[f"output_{n}"] = t, pulse  # a pulse width [us] of what nobody says what it moves
            continue
        motor = name.startswith("m")
        ends, usual = ("MOT_PWM", (1000.0, 1500.0, 2000.0)) if motor else (f"SERVO{n}", (1100.0, 1500.0, 1900.0))
        low, trim, high = (
            parameters.get(f"{ends}_{end}", value) for end, value in zip(("MIN", "TRIM", "MAX"), usual, strict=True)
        )
        sign = -1.0 if parameters.get(f"SERVO{n}_REVERSED", 0.0) and not motor else 1.0
        begin = low if motor or name == "throttle" else trim
        off = pulse - begin
        found[name] = t, sign * off / np.where(off > 0.0, max(high - begin, 1.0), max(begin - low, 1.0))
    return found


def _flying(rows: Rows) -> Series | None:
    """Read when the aircraft is in the air: of a plane by its own guess, of a copter by the events of its land
    detector."""
    if state := _fields(rows, "STAT", {"flies": "isFlying"}):
        t, flies = state["flies"]
        return t, flies > 0.0
    events = [(row["TimeUS"] * 1e-6, row["Id"] == _NOT_LANDED) for row in rows.get("EV", ()) if row.get("Id") in _BOTH]
    if not events:
        return None
    stamps, airborne = zip(*events, strict=True)
    return np.array([-np.inf, *stamps]), np.array([not airborne[0], *airborne])
