"""Draw a fault of the data from a seed: where, in which records, how large."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from casid.diagnosis.given.scope import axes_that_tell
from casid.records.record import Record
from casid.signals import SURFACES
from problems.faults.fault import DataFault

Rng = np.random.Generator
_DEG = float(np.pi / 180.0)
_SIGNED = ("alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az", *SURFACES)
_UNITS: tuple[tuple[str, str, float], ...] = (
    ("V", "kt", 1852.0 / 3600.0),
    ("V", "ft/s", 0.3048),
    ("V", "km/h", 1.0 / 3.6),
    ("alpha", "deg", _DEG),
    ("beta", "deg", _DEG),
    ("theta", "deg", _DEG),
    ("phi", "deg", _DEG),
    ("p", "deg/s", _DEG),
    ("q", "deg/s", _DEG),
    ("r", "deg/s", _DEG),
    ("p+q+r", "deg/s", _DEG),
    ("qdot", "deg/s2", _DEG),
    ("az", "g", 9.80665),
    ("ax+ay+az", "g", 9.80665),
    ("ax+ay+az", "ft/s2", 0.3048),
    ("altitude", "ft", 0.3048),
    ("rho", "slug/ft3", 515.3788184),
    ("thrust", "kN", 1000.0),
    ("delta_e", "deg", _DEG),
    ("+".join(SURFACES), "deg", _DEG),
    ("t", "ms", 1e-3),
    ("t", "stretched", 5.0),
    ("t", "stretched", 2.0),
)
_SWAPS = ("alpha+beta", "p+r", "q+r", "phi+theta", "ax+az", "ay+az", "delta_a+delta_r", "delta_e+delta_a")
_MOVING = ("alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az", "V")
_AXES = {"delta_e": "longitudinal", "delta_a": "lateral", "delta_r": "lateral"}
CLEAN = "clean"


def _has(records: Sequence[Record], names: Sequence[str]) -> bool:
    return all(name == "t" or all(_moves(r, name) for r in records) for name in names) and _moved(records, names)


def _there(records: Sequence[Record], names: Sequence[str]) -> bool:
    return all(name == "t" or all(name in record for record in records) for name in names)


def _moved(records: Sequence[Record], names: Sequence[str]) -> bool:
    """Whether the surfaces among `names` move what the records can tell of: of one that rests nothing can be told."""
    judged = axes_that_tell(records).name
    return not any(name in records[0] and judged not in ("full", axis) for name, axis in _AXES.items() if name in names)


def _moves(record: Record, name: str) -> bool:
    return (
        name in record
        and bool(np.isfinite(record[name]).any())
        and float(np.nanmax(record[name])) != float(np.nanmin(record[name]))
    )


def _scope(rng: Rng, records: Sequence[Record]) -> tuple[str, ...]:
    """One record or all of them."""
    names = tuple(record.name for record in records)
    return names if rng.random() < 0.5 else (str(rng.choice(names)),)


def _choose(rng: Rng, able: Sequence) -> object:
    return able[int(rng.integers(len(able)))]


def _sign(rng: Rng, records: Sequence[Record]) -> DataFault:
    able = [name for name in _SIGNED if _has(records, (name,))]
    return DataFault(kind="data_sign", target=str(_choose(rng, able)), records=_scope(rng, records), value=-1.0)


def _unit(rng: Rng, records: Sequence[Record]) -> DataFault:
    able = [row for row in _UNITS if _there(records, row[0].split("+")) and _moved(records, row[0].split("+"))]
    target, unit, value = able[int(rng.integers(len(able)))]
    return DataFault(kind="data_unit", target=target, records=_scope(rng, records), value=value, unit=unit)


def _swap(rng: Rng, records: Sequence[Record]) -> DataFault:
    able = [pair for pair in _SWAPS if _has(records, pair.split("+"))]
    return DataFault(kind="data_swap", target=str(_choose(rng, able)), records=_scope(rng, records))


def _held(rng: Rng, record: Record, count: int, seconds: float) -> tuple[tuple[float, float], ...]:
    starts = np.sort(rng.uniform(record.t[0] + 1.0, record.t[-1] - seconds - 1.0, count))
    return tuple((float(s), float(s) + seconds) for s in starts)


def _stuck(rng: Rng, records: Sequence[Record]) -> DataFault:
    able = [name for name in _MOVING if _has(records, (name,))]
    record = records[int(rng.integers(len(records)))]
    begin = (
        record.t[0] - 1.0
        if rng.random() < 0.4 and len(records) > 1
        else record.t[0] + rng.uniform(0.2, 0.7) * record.duration
    )
    stretch = ((float(begin), float(record.t[-1]) + 1.0),)
    return DataFault(
        kind="data_stuck", target=str(_choose(rng, able)), records=(record.name,), intervals={record.name: stretch}
    )


def _dropout(rng: Rng, records: Sequence[Record]) -> DataFault:
    able = [name for name in _MOVING if _has(records, (name,))]
    groups = [*able, *(["V+alpha+beta"] * 3 if _has(records, ("V", "alpha", "beta")) else [])]
    seconds, count = float(rng.uniform(0.3, 0.8)), int(rng.integers(4, 9))
    chosen = _scope(rng, records)
    intervals = {r.name: _held(rng, r, count, seconds) for r in records if r.name in chosen}
    return DataFault(kind="data_dropout", target=str(_choose(rng, groups)), records=chosen, intervals=intervals)


def _clipped(rng: Rng, records: Sequence[Record]) -> DataFault:
    able = [name for name in ("alpha", "beta", "p", "q", "r", "ay", "az") if _has(records, (name,))]
    share = float(rng.uniform(0.3, 0.7))
    return DataFault(kind="data_clipped", target=str(_choose(rng, able)), records=_scope(rng, records), value=share)


def _spikes(rng: Rng, records: Sequence[Record]) -> DataFault:
    able = [name for name in (*_MOVING, "qdot") if _has(records, (name,))]
    code = "code" if rng.random() < 0.3 else None
    share = float(rng.uniform(0.003, 0.01))
    target = str(_choose(rng, able))
    return DataFault(kind="data_spikes", target=target, records=_scope(rng, records), value=share, term=code)


def _delay(rng: Rng, records: Sequence[Record]) -> DataFault:
    target = str(rng.choice(("air_data", "attitude", "inertial", "surfaces")))
    return DataFault(
        kind="sensor_delay",
        target=target,
        records=tuple(r.name for r in records),
        value=float(rng.uniform(0.08, 0.2)),
    )


def _drift(rng: Rng, records: Sequence[Record]) -> DataFault:
    target = str(rng.choice(("air_data", "attitude", "inertial", "surfaces")))
    value = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.005, 0.015))
    return DataFault(kind="clock_drift", target=target, records=tuple(r.name for r in records), value=value)


def _tilt(rng: Rng, records: Sequence[Record]) -> DataFault:
    return DataFault(
        kind="sensor_misalignment",
        target="inertial",
        term=str(rng.choice(("x", "y", "z"))),
        records=tuple(r.name for r in records),
        value=float(rng.choice((-1.0, 1.0)) * rng.uniform(2.0, 5.0) * _DEG),
    )


def _position(rng: Rng, records: Sequence[Record]) -> DataFault:
    target, term, size = [("V", "alpha", 40.0), ("alpha", "beta", 0.2), ("beta", "alpha", 0.2)][int(rng.integers(3))]
    return DataFault(
        kind="position_error",
        target=target,
        term=term,
        records=tuple(r.name for r in records),
        value=float(rng.choice((-1.0, 1.0)) * rng.uniform(0.7, 1.3) * size),
    )


def _thrust(rng: Rng, records: Sequence[Record]) -> DataFault:
    value = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.2, 0.35))
    return DataFault(kind="thrust_scale", target="thrust", records=tuple(r.name for r in records), value=value)


# what the check finds by itself
CHECKED: Mapping[str, Callable[[Rng, Sequence[Record]], DataFault]] = {
    "data_sign": _sign,
    "data_unit": _unit,
    "data_swap": _swap,
    "data_stuck": _stuck,
    "data_dropout": _dropout,
    "data_clipped": _clipped,
    "data_spikes": _spikes,
}
# what the diagnosis names; the check must not take it for anything else
DIAGNOSED: Mapping[str, Callable[[Rng, Sequence[Record]], DataFault]] = {
    "sensor_delay": _delay,
    "clock_drift": _drift,
    "sensor_misalignment": _tilt,
    "position_error": _position,
    "thrust_scale": _thrust,
}


def draw(kind: str, seed: int, records: Sequence[Record]) -> DataFault | None:
    """The fault of a kind and a seed in some records; None where it cannot be in them."""
    rng = np.random.default_rng([seed, *map(ord, kind)])
    maker = CHECKED.get(kind) or DIAGNOSED[kind]
    fault = maker(rng, records)
    return None if fault.kind == "thrust_scale" and "thrust" not in records[0] else fault
