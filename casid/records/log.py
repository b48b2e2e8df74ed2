"""Logs of autopilots: series of several rates, put on one clock, and cut to what was flown.

Measured outputs of a slower rate keep their own samples, each at the nearest time of the clock, and are missing in
between: straight lines would be samples that nobody took. What drives a model, and what no model knows, is joined by
straight lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from casid.errors import InputError
from casid.records.checks import INPUTS, LONG_GAP, MIN_DURATION
from casid.records.quaternions import euler_angles
from casid.records.table import RawTable
from casid.signals import CHANNELS, is_control, unit_of

Series = tuple[np.ndarray, np.ndarray]  # stamps [s] and values

_MEASURED = frozenset(CHANNELS) - frozenset(INPUTS) - {"t", "throttle"}
_SAME_RATE = 0.9  # of the clock's samples, from which a channel has its rate
EARTH = 6.371e6  # m: mean radius
_GAP = 5.0  # median steps of a series: a longer pause stays a gap
_PART = 0.5  # of the log that an input must cover

COMMANDS = "surfaces are commands from -1 to 1 (1: roll to the right, nose up, nose right), with lag and delay of the "
COMMANDS += "servos before they act; the throw makes them surfaces: --map delta_e=delta_e_command:deg*-25"
ESTIMATED = "phi, theta and psi are estimates of the autopilot's filter, not measurements of their own"


def lost(found: Iterable[str]) -> tuple[str, ...]:
    """List what a log of an autopilot does not measure."""
    found = set(found)
    notes = []
    if "phi" in found:
        notes.append(ESTIMATED)
    if "wind_north" in found:
        notes.append("wind_north and wind_east are estimates of the autopilot's filter; no model takes them")
    if any(name.endswith("_command") for name in found):
        vanes = "; the autopilot's estimates are kept as alpha_estimate and beta_estimate"
        vanes = vanes if "alpha_estimate" in found else ""
        notes.append(f"alpha and beta are not measured{vanes}: vanes and upwash cannot be judged")
        notes.append("thrust is not measured, and throttle is no thrust: drag and propulsion cannot be told apart")
        notes.append(COMMANDS)
        if "V" not in found:
            notes.append("there is no airspeed sensor: V is lost, and dynamic pressure with it")
    return tuple(notes)


def drives(name: str) -> bool:
    """Tell whether a channel of a log drives a model: surfaces and their commands, rotors, thrust, density."""
    name = _bare(name)
    return name in INPUTS or is_control(name) or name == "throttle"


def _bare(name: str) -> str:
    return name.partition(" [")[0]


def of_log(
    path: Path,
    series: Mapping[str, Series],
    flying: Series | None = None,
    notes: tuple[str, ...] = (),
    unread: Mapping[str, str] | None = None,
    how: Mapping[str, str] | None = None,
) -> RawTable:
    """The table of a log on the clock of its rates, or of its fastest channel, while all that drives a model was
    recorded and, by `flying`, the aircraft was in the air. Pauses stay gaps."""
    series, notes = _whole(series, notes)
    if not series:
        raise InputError(f"{path}: no channel has two samples; expected time series")
    clock = _clock(series)
    start = clock[0]
    all_rows = len(clock)
    inputs, notes = _inputs(series, clock, notes)
    begin = max([clock[0], *(stamps[0] for stamps, _ in inputs.values())])
    end = min([clock[-1], *(stamps[-1] for stamps, _ in inputs.values())])
    clock = clock[(clock >= begin) & (clock <= end)]
    if len(clock) < 2:
        raise InputError(f"{path}: what drives a model has no time in common: {', '.join(inputs)}")
    paused = np.any([_in_pause(stamps, clock, LONG_GAP) for stamps, _ in inputs.values()], axis=0) if inputs else False
    if np.any(paused):
        notes += (f"{int(np.sum(paused))} rows are left out in which an input pauses for more than {LONG_GAP:g} s",)
    airborne, said = _airborne(clock, flying)
    kept = airborne & ~np.asarray(paused)
    start = start if said else clock[0]  # times of a log of which the ground is cut stay those of the log
    clock = clock[kept] if np.sum(kept) > 1 else clock
    if said:
        cut = (
            f"{clock[0] - start:.5g} to {clock[-1] - start:.5g} s of the log are taken, {len(clock)} of {all_rows} rows"
        )
        notes += (f"{cut}: {said}",)
    columns = [clock - start, *(_on(clock, name, one) for name, one in series.items())]
    names = ("t", *(f"{name} [{unit_of(name)}]" if unit_of(name) else name for name in series))
    return RawTable(
        source=str(path),
        names=names,
        values=np.stack(columns, axis=1),
        notes=notes,
        unread=dict(unread or {}),
        how={i: how[name] for i, name in enumerate(series, 1) if how and name in how},
        grounded=bool(said and airborne.all()),
    )


def _whole(series: Mapping[str, Series], notes: tuple[str, ...]) -> tuple[dict[str, Series], tuple[str, ...]]:
    """Series with stamps that increase and two samples at least."""
    kept = dict[str, Series]()
    empty = []
    for name, (stamps, values) in series.items():
        stamps = np.asarray(stamps, float)
        values = np.asarray(values, float)
        if len(stamps):
            latest = np.maximum.accumulate(stamps)
            later = np.append(True, np.diff(latest) > 0.0) & np.isfinite(stamps)
            stamps = stamps[later]
            values = values[later]
        if drives(name):
            there = np.isfinite(values)
            stamps = stamps[there]
            values = values[there]
        if len(stamps) > 1 and np.isfinite(values).any():
            kept[name] = stamps, values
        else:
            empty.append(name)
    return kept, (*notes, f"no samples of {', '.join(empty)}") if empty else notes


def _clock(series: Mapping[str, Series]) -> np.ndarray:
    """Stamps of the rates; of a log without rates those of its fastest channel."""
    if "p" in series:
        return series["p"][0]
    known = {name: one for name, one in series.items() if name in CHANNELS} or series
    return max((stamps for stamps, _ in known.values()), key=len)


def _inputs(
    series: dict[str, Series], clock: np.ndarray, notes: tuple[str, ...]
) -> tuple[dict[str, Series], tuple[str, ...]]:
    """Return what drives a model; an input of less than half of the log is taken out of `series`, with a note."""
    found = {name: one for name, one in series.items() if drives(name)}
    for name, (stamps, _) in list(found.items()):
        if min(stamps[-1], clock[-1]) - max(stamps[0], clock[0]) < _PART * (clock[-1] - clock[0]):
            del found[name], series[name]
            notes += (f"{name} was recorded in less than half of the log and is left out",)
    return found, notes


def _airborne(clock: np.ndarray, flying: Series | None) -> tuple[np.ndarray, str]:
    """(N,) True while flying, and a remark."""
    everywhere = np.ones(len(clock), dtype=bool)
    if flying is None or not len(flying[0]):
        return everywhere, ""
    stamps, state = flying
    at = np.clip(np.searchsorted(stamps, clock, side="right") - 1, 0, len(stamps) - 1)
    airborne = np.asarray(state, bool)[at]
    if airborne.all():
        return everywhere, ""
    if np.sum(airborne) * (clock[-1] - clock[0]) / len(clock) < MIN_DURATION:
        return everywhere, "by its log the aircraft stays on the ground"
    return airborne, "the rest is on the ground"


def _on(clock: np.ndarray, name: str, one: Series) -> np.ndarray:
    """(N,) a series on a clock, NaN where it has no sample."""
    stamps, values = one
    measured = _bare(name) in _MEASURED
    outside = np.nan if measured or not drives(name) else None
    column = np.interp(clock, stamps, values, left=outside, right=outside)
    if drives(name):
        return column
    missing = _in_pause(stamps, clock)
    if measured and len(stamps) < _SAME_RATE * len(clock):
        missing = missing | ~nearest_rows(clock, stamps)
    return np.where(missing, np.nan, column)


def _in_pause(stamps: np.ndarray, clock: np.ndarray, least: float = 0.0) -> np.ndarray:
    """(N,) True inside a pause of a series that is longer than usual, and than `least` [s]."""
    steps = np.diff(stamps)
    before = np.clip(np.searchsorted(stamps, clock, side="right") - 1, 0, len(stamps) - 2)
    return (steps > max(_GAP * np.median(steps), least))[before] & ~np.isin(clock, stamps)


def nearest_rows(clock: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """(N,) True at the time of a clock that is nearest to one of the stamps."""
    after = np.clip(np.searchsorted(clock, stamps), 1, len(clock) - 1)
    nearest = np.where(stamps - clock[after - 1] < clock[after] - stamps, after - 1, after)
    at = np.zeros(len(clock), dtype=bool)
    at[nearest[(stamps >= clock[0]) & (stamps <= clock[-1])]] = True
    return at


def first_of(sources: Iterable[dict[str, Series] | None]) -> dict[str, Series]:
    """Return, of several sources of the same channels, the first of those with the most samples."""
    return max(filter(None, sources), key=lambda one: max(len(stamps) for stamps, _ in one.values()), default={})


def attitude(stamps: np.ndarray, quaternion: np.ndarray) -> dict[str, Series]:
    """Euler angles of (N, 4) quaternions; those that are no unit quaternion within a part in a hundred are left out."""
    good = np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) < 0.01
    angles = euler_angles(quaternion[good])
    return {name: (stamps[good], angles[:, i]) for i, name in enumerate(("phi", "theta", "psi"))}
