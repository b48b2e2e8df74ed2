"""Checks of a record as it comes from a file: what cannot be used is an error, what a person should know is a note."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from casid.errors import InputError, printable
from casid.records.clock import LONGEST_STEP, UNITS, from_first, on_one_clock
from casid.records.column_map import ColumnMap
from casid.records.columns import channels_of
from casid.records.noise import time_scale
from casid.records.quaternions import ANGLES, with_attitude
from casid.records.table import RawTable, rows_of
from casid.signals import (
    CHANNELS,
    DEGREE,
    EXTERNAL_FORCE,
    FLIGHT_LIMITS,
    FORCE_POINT,
    RADIAN_LIMITS,
    SURFACES,
    is_control,
    label_of,
    unit_of,
)

INPUTS = (*SURFACES, "thrust", "rho", *EXTERNAL_FORCE, *FORCE_POINT)
MIN_SAMPLES = 50
MIN_DURATION = 3.0  # s: from here on a record of any motion is taken
MIN_PERIODS = 3.0  # of the motion: a shorter record is taken that has as many
LONG_GAP = 1.0  # s: a longer pause parts a record

_MOVING = ("p", "q", "r", "alpha", "beta", "phi", "theta", "ay", "az")  # channels that show the motion's time scale
_NINES = (99.0, 999.0, 9999.0, 99999.0)  # usual marks of a missing sample, of either sign

TURNS = ("phi", "theta", "psi")  # they may go on where they pass a full turn, or hang upside down
_DOUBTFUL = 0.7  # rad: 40 deg of alpha, beta or a surface
_PITOT = ("V", "qbar")
_JITTER = 0.01
GAP = 1.5  # sampling intervals: a longer step of time is a gap
_MANY_MISSING = 0.2
_SLOW = 0.5  # s
_USUAL_STEP = 0.02  # s

_OF_WINGS = (*SURFACES, *(f"{surface}_command" for surface in SURFACES))

Place = Callable[[int], str]  # sample -> file, row and column, for a message


def check_time(t: np.ndarray, place: Place, source: str, *, aircraft: bool) -> None:
    """Time must be complete, strictly increasing and, of an aircraft, of 50 samples at least; else InputError."""
    missing = np.flatnonzero(np.isnan(t))
    if len(missing):
        raise InputError(f"{place(missing[0])}: the time stamp is missing; fill it in or remove the row")
    wrong = np.flatnonzero(np.diff(t) <= 0.0)
    if len(wrong):
        row = int(wrong[0]) + 1
        fault = "repeats" if t[row] == t[row - 1] else "runs back"
        raise InputError(
            f"{place(row)}: time {fault}, {t[row]:.10g} s after {t[row - 1]:.10g} s; "
            "remove the row, or split the file there"
        )
    if aircraft and len(t) < MIN_SAMPLES:
        raise InputError(
            f"{source}: {len(t)} samples are too few to identify anything; expected at least {MIN_SAMPLES}"
        )


def _check_unit_of_time(t: np.ndarray, column: str, source: str) -> None:
    """Raise InputError, which asks for the unit, where steps in s are longer than any measurement's."""
    steps = np.diff(t[np.isfinite(t)])
    step = float(np.median(steps)) if len(steps) else 0.0
    if step < LONGEST_STEP:
        return
    unit = min(UNITS, key=lambda one: abs(np.log(step * UNITS[one] / _USUAL_STEP)))
    raise InputError(
        f"{source}: {column}: its steps are {step:.6g}, and no unit is stated; in {unit} they are "
        f"{step * UNITS[unit]:.4g} s: write the header as 't [{unit}]', or --map t=COLUMN:{unit}; in s, as 't [s]'"
    )


def check_length(t: np.ndarray, channels: Mapping[str, np.ndarray], source: str) -> None:
    """A record must be longer than 3 s, or hold three periods of its motion; else InputError. A light model aircraft
    moves in tenths of a second."""
    seconds = float(t[-1] - t[0])
    if seconds >= MIN_DURATION:
        return
    moving = [channels[name] for name in _MOVING if name in channels]
    periods = [2.0 * np.pi * scale for scale in (time_scale(t, values) for values in moving) if np.isfinite(scale)]
    period = min(periods, default=np.inf)
    if seconds >= MIN_PERIODS * period:
        return
    motion = f"a period of its motion is {period:.2g} s" if np.isfinite(period) else "it shows no motion"
    raise InputError(
        f"{source}: {len(t)} samples in {seconds:.4g} s are too short to identify anything: {motion}; expected "
        f"{MIN_PERIODS:.0f} periods, or {MIN_DURATION:.0f} s (time is in s: write the header as 't [ms]' if it is not)"
    )


def check_channel(name: str, values: np.ndarray, place: Place, limited: bool) -> None:
    """Refuse values that cannot be, with the row: an input with gaps, degrees in a radian column, no airspeed.
    `limited`: sizes are judged by what aircraft do; not where the unit is stated, which is accepted."""
    missing = np.flatnonzero(np.isnan(values))
    if name in INPUTS and len(missing):
        raise InputError(
            f"{place(missing[0])}: the sample of an input is missing (nan), {len(missing)} in all; "
            "an input must be complete: fill the gaps, or cut the record there"
        )
    too_large = np.flatnonzero(~(np.abs(values) < 1e150) & ~np.isnan(values))
    if len(too_large):
        raise InputError(f"{place(too_large[0])}: {values[too_large[0]]:.6g} is too large; repair it")
    beyond = np.flatnonzero(np.abs(values) > RADIAN_LIMITS.get(name, np.inf))
    if len(beyond):
        value = values[beyond[0]]
        unit = unit_of(name)
        degrees = unit.replace("rad", "deg")
        code = next((v for v in values[beyond] if _is_code(v, RADIAN_LIMITS[name])), None)
        if code is not None:
            at = np.flatnonzero(values == code)
            number = code if _is_nines(code) else code / DEGREE
            remedy = "fill the gaps, or cut the record there" if name in INPUTS else "leave the cells empty"
            raise InputError(f"{place(at[0])}: {number:.6g} marks a missing sample, {len(at)} in all; {remedy}")
        if limited:
            raise InputError(
                f"{place(beyond[0])}: {value:.6g} {unit} is {np.degrees(value):.4g} {degrees}, too large for "
                f"{label_of(name)}; if the file has {degrees}, write the header as '{name} [{degrees}]' or map the "
                f"column with --map {name}=COLUMN:{degrees}; if it has {unit}, as '{name} [{unit}]'; else repair the "
                "value"
            )
    absurd = np.flatnonzero(np.abs(values) > FLIGHT_LIMITS.get(name, np.inf))
    if limited and len(absurd):
        missing_sample = "repair the value" if name in INPUTS else "leave the cell empty if the sample is missing"
        raise InputError(
            f"{place(absurd[0])}: {values[absurd[0]]:.6g} {unit_of(name)} is no {label_of(name)} of an "
            f"aircraft; {missing_sample}, or write the header as '{name} [UNIT]' if the unit is another"
        )
    not_positive = np.flatnonzero(values <= 0.0)
    if name == "rho" and len(not_positive):
        first = not_positive[0]
        raise InputError(f"{place(first)}: {label_of(name)} must be positive, got {values[first]:.6g}; fill the gap")


def airborne(name: str, values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Readings of a pitot tube without those that are not positive, as on the ground, and a remark."""
    still = values <= 0.0
    if name not in _PITOT or not still.any():
        return values, []
    count = int(np.sum(still))
    least = float(values[still].min())
    said = f"{name}: {count} samples are not positive, down to {least:.4g} {unit_of(name)}, as on the ground"
    return np.where(still, np.nan, values), [f"{said}; they are taken as missing"]


def _is_nines(value: float) -> bool:
    return any(abs(abs(value) - nines) < 1e-6 * nines for nines in _NINES)


def _is_code(value: float, limit: float) -> bool:
    """Return True if a value [rad] beyond a limit is -999 or the like, as recorded or in degrees, and so no angle in
    either. In degrees that a header names it has been converted already."""
    return (_is_nines(value) and abs(value) * DEGREE > limit) or _is_nines(value / DEGREE)


def time_notes(t: np.ndarray) -> list[str]:
    """Remarks on the sampling: dropped rows, jitter."""
    steps = np.diff(t)
    dt = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP * dt)
    regular = steps[steps <= GAP * dt]
    notes = []
    if dt > _SLOW:
        notes.append(f"time: one sample every {dt:.4g} s; if the time is in ms, write the header as 't [ms]'")
    if len(gaps):
        longest = int(np.argmax(steps))
        advice = "split the record there" if steps[longest] > LONG_GAP else "inputs are interpolated across"
        notes.append(
            f"time: rows are missing in {len(gaps)} place(s), the longest gap is {steps[longest]:.4g} s "
            f"after t = {t[longest]:.6g} s; {advice}"
        )
    spread = float(np.max(np.abs(regular - dt)))
    if spread > _JITTER * dt:
        notes.append(f"time: sampling is not uniform, {dt:.4g} s with deviations up to {spread:.2g} s")
    return notes


def channel_notes(name: str, values: np.ndarray, stated: bool) -> list[str]:
    """Remarks on one channel: constant, a unit that looks wrong."""
    good = values[~np.isnan(values)]
    notes = []
    if unit_of(name) and np.all(good == good[0]):
        what = "nothing can be identified from it" if name in SURFACES else "it may not be measured at all"
        notes.append(f"{name}: constant at {good[0]:.6g}; {what}" if name not in ("thrust", "rho") else "")
    largest = float(np.max(np.abs(good)))
    if not stated and name in ("alpha", "beta", *SURFACES) and largest > _DOUBTFUL:
        notes.append(f"{name}: reaches {largest:.3g} rad ({np.degrees(largest):.0f} deg); is the column in degrees?")
    if stated and name not in TURNS and largest > RADIAN_LIMITS.get(name, np.inf):
        notes.append(f"{name}: reaches {largest:.3g} {unit_of(name)}, accepted since its unit is stated")
    middle = float(np.median(good))
    if name == "az" and 0.5 < abs(middle) < 2.0:
        notes.append(f"az: about {middle:.3g} m/s2; if the file is in g, write the header as 'az [g]'")
    if name == "az" and middle > 5.0:
        notes.append(f"az: about {middle:+.3g} m/s2; z points down, so that level flight has -9.81")
    return [note for note in notes if note]


def missing_notes(channels: Mapping[str, np.ndarray], own: Collection[str]) -> list[str]:
    """The channels of which many samples are missing, in one line."""
    shares = {name: float(np.isnan(values).mean()) for name, values in channels.items() if name not in own}
    many = [f"{name} {100 * share:.0f} %" for name, share in shares.items() if share > _MANY_MISSING]
    return [f"samples are missing: {', '.join(many)}"] if many else []


def checked_fields(
    table: RawTable,
    record_name: str,
    column_map: ColumnMap,
    own: Collection[str] = (),
    between: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """The fields of a `Record` of a table, checked: InputError for values that cannot be used, notes for remarks."""
    columns = channels_of(table, column_map, own)
    channels = dict(columns.channels)
    notes = [*table.notes, *columns.notes]
    if "t" not in channels:
        raise InputError(
            f"{table.source}: no column 't', the time in s; name it so, or map it with --map t=COLUMN:unit; rows at a "
            f"steady rate of 50 Hz are --map t=row*0.02{'; ' * bool(columns.contents.note)}{columns.contents.note}"
        )
    channels["t"], counted = from_first(channels["t"], "t" in columns.stated)
    if not own and "t" not in columns.stated and not counted:
        _check_unit_of_time(channels["t"], columns.places["t"], table.source)
    same = (table.values[1:] == table.values[:-1]) | (np.isnan(table.values[1:]) & np.isnan(table.values[:-1]))
    copied = np.append(False, (np.diff(channels["t"]) == 0.0) & same.all(axis=1))
    if copied.any():
        table, channels = _rows(table, channels, np.flatnonzero(~copied))
        notes.append(f"{int(np.sum(copied))} rows are copies of the row before, and are left out")
    if between is not None:
        table, channels = _rows(table, channels, _rows_between(channels["t"], *between, table.source))
    t = channels.pop("t")
    channels, slower = on_one_clock(t, channels, INPUTS)
    notes += [counted, *slower] if counted else slower
    check_time(t, _in_column(table, columns.places["t"]), table.source, aircraft=not own)
    channels, turned, said = with_attitude(t, channels) if not own else (channels, "", "")
    notes += [said] if said else []
    of_angles = dict.fromkeys(ANGLES, turned) if turned else {}
    places = {**columns.places, **of_angles}
    empty = list[str]()
    still = table.grounded
    aircraft = any(map(is_control, channels)) and not own
    hovers = any(is_control(name) and name not in _OF_WINGS for name in channels)
    for name in list(channels):
        if name in CHANNELS and name not in own:
            limited = aircraft and name not in columns.stated
            check_channel(name, channels[name], _in_column(table, places[name]), limited)
            channels[name], grounded = airborne(name, channels[name])
            notes += grounded
            still = still or (bool(grounded) and not hovers and np.isnan(channels[name]).all())
        if np.isnan(channels[name]).all():
            notes.append(f"{name}: has no sample at all and is left out")
            empty.append(name)
            del channels[name]
    if aircraft:
        check_length(t, channels, table.source)
    elif not own:
        notes.append("no control surface: signs, units and kinematics can be checked, and no aerodynamics identified")
    notes += [*time_notes(t), *missing_notes(channels, own)]
    for name in (one for one in channels if one not in own):
        notes += channel_notes(name, channels[name], name in columns.stated)
    return {
        "name": record_name,
        "t": t,
        "channels": channels,
        "hold": table.hold or "linear",
        "source": table.source,
        "notes": tuple(map(printable, notes)),
        "empty": tuple(empty),
        "grounded": bool(still),
        "stated": {name: unit for name, unit in columns.stated.items() if name in channels},
        "contents": replace(columns.contents, read={**columns.contents.read, **of_angles}),
    }


def _in_column(table: RawTable, column: str) -> Place:
    return lambda row: f"{table.place(row)}, {column}"


def _rows_between(t: np.ndarray, begin: float, end: float, source: str) -> np.ndarray:
    """The rows from one time to another; InputError where there are none."""
    rows = np.flatnonzero((t >= begin) & (t < end))
    if not len(rows):
        span = f"{np.nanmin(t):g} to {np.nanmax(t):g} s" if np.isfinite(t).any() else "no time at all"
        asked = f"from {begin:g} s on" if np.isinf(end) else f"before {end:g} s" if np.isinf(begin) else ""
        asked = asked or f"from {begin:g} to {end:g} s"
        raise InputError(f"{source}: no row {asked}; the file has {span}")
    return rows


def _rows(table: RawTable, channels: Mapping[str, np.ndarray], rows: np.ndarray) -> tuple[RawTable, dict[str, Any]]:
    return rows_of(table, rows), {name: values[rows] for name, values in channels.items()}
