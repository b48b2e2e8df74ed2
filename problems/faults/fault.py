"""A hidden fault of the data, and the record that has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from casid.model.operators import delay
from casid.records.noise import high_band_sigma
from casid.records.record import Record
from casid.signals import GRAVITY, SURFACES, unit_of

GROUPS: Mapping[str, tuple[str, ...]] = {
    "inertial": ("p", "q", "r", "ax", "ay", "az", "pdot", "qdot", "rdot"),
    "attitude": ("phi", "theta", "psi"),
    "air_data": ("V", "alpha", "beta"),
    "surfaces": SURFACES,
}


@dataclass(frozen=True, kw_only=True)
class DataFault:
    """One fault, in the vocabulary of findings.

    value      true over recorded number of a unit; level of a rail or frozen value; seconds, radians or a factor
    records    that have it
    intervals  record -> stretches [s] concerned
    """

    kind: str
    target: str
    records: tuple[str, ...]
    value: float | None = None
    term: str | None = None
    unit: str | None = None
    intervals: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        return GROUPS.get(self.target) or tuple(self.target.split("+"))

    def put_into(self, record: Record, seed: int) -> Record:
        """The record as an instrument or a recorder with this fault writes it."""
        if self.record_is_healthy(record):
            return record
        return _MAKERS[self.kind](self, record, np.random.default_rng([seed, 11]))

    def record_is_healthy(self, record: Record) -> bool:
        return record.name not in self.records


def with_fault(fault: DataFault | None, records: Sequence[Record], seed: int) -> list[Record]:
    """All records, some with the fault."""
    return [record if fault is None else fault.put_into(record, seed + j) for j, record in enumerate(records)]


def _each(fault: DataFault, record: Record, change) -> Record:
    return record.with_channels(**{n: change(record[n]) for n in fault.channels if n in record})


_STEPS = 0.2  # levels over samples below which a channel is one of steps


def _as_recorded(changed: np.ndarray, healthy: np.ndarray) -> np.ndarray:
    """What an instrument reads, in the steps of the recorder behind it where the healthy channel has such."""
    levels = np.unique(healthy[np.isfinite(healthy)])
    if len(levels) < 2 or len(levels) > _STEPS * len(healthy):
        return changed
    gaps = np.diff(levels)
    step = float(gaps[gaps > 1e-6 * (levels[-1] - levels[0])].min())
    return levels[0] + step * np.round((changed - levels[0]) / step)


def _sign(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    return _each(fault, record, lambda x: -x)


def _unit(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    """A header that states a unit states that in which the numbers are read."""
    assert fault.value is not None
    if fault.target == "t":
        return replace(record, t=record.t / fault.value)
    changed = _each(fault, record, lambda x: x / fault.value)
    stated = {n: unit_of(n) for n in fault.channels if n in record.stated}
    return replace(changed, stated={**record.stated, **stated}) if stated else changed


def _swap(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    a, b = fault.channels
    return record.with_channels(**{a: record[b], b: record[a]})


def _inside(fault: DataFault, record: Record) -> np.ndarray:
    at = np.zeros(len(record), dtype=bool)
    for low, high in fault.intervals[record.name]:
        at |= (record.t >= low) & (record.t <= high)
    return at


def _hold(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    at = _inside(fault, record)
    last = np.maximum.accumulate(np.where(~at, np.arange(len(at)), 0))
    return _each(fault, record, lambda x: x[last])


def _clip(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    """Both rails are as far from the middle as the value says, as a part of the range."""
    share = fault.value or 1.0

    def clipped(x: np.ndarray) -> np.ndarray:
        low, middle, high = np.nanmin(x), np.nanmedian(x), np.nanmax(x)
        return np.clip(x, middle - share * (middle - low), middle + share * (high - middle))

    return _each(fault, record, clipped)


def _spikes(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    """Outliers of 0.6 to 2 times the range, or 25 times the noise where that is more; or codes. `value` is the part of
    the samples."""
    count = max(2, round((fault.value or 0.01) * len(record)))
    at = rng.choice(np.arange(20, len(record) - 20), count, replace=False)

    def spiked(x: np.ndarray) -> np.ndarray:
        y = x.copy()
        if fault.term == "code":
            y[at] = -999.0
        else:
            size = max(float(np.nanmax(x) - np.nanmin(x)), 25.0 * high_band_sigma(x))
            y[at] += rng.choice([-1.0, 1.0], count) * rng.uniform(0.6, 2.0, count) * size
        return y

    return _each(fault, record, spiked)


def _late(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    assert fault.value is not None
    late = _each(fault, record, lambda x: _as_recorded(delay(record.t, x, fault.value or 0.0), x))
    return late.between(record.t[0] + abs(fault.value), np.inf)  # what was before the record is not known


def _drifting(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    """A clock that gains `value` seconds a second: the reading comes later and later."""
    t = record.t
    true = t[0] + (t - t[0]) / (1.0 + (fault.value or 0.0))
    return _each(fault, record, lambda x: _as_recorded(np.interp(true, t, x), x))


def _tilted(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    """The inertial unit turned about a body axis by `value` [rad]: what it reads is along its own axes."""
    axis, angle = "xyz".index(fault.term or "y"), fault.value or 0.0
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    changed = {}
    for names in (("p", "q", "r"), ("ax", "ay", "az"), ("pdot", "qdot", "rdot")):
        if all(name in record for name in names):
            a, b = record[names[i]], record[names[j]]
            changed[names[i]] = _as_recorded(np.cos(angle) * a + np.sin(angle) * b, a)
            changed[names[j]] = _as_recorded(np.cos(angle) * b - np.sin(angle) * a, b)
    return record.with_channels(**changed)


def _position(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    """The reading depends on another air datum: V [m/s] or angle [rad] by `value` times its deviation."""
    other = record[fault.term or "alpha"]
    size = (fault.value or 0.0) * (other - np.nanmedian(other))
    reading = record[fault.target]
    return record.with_channels(**{fault.target: _as_recorded(reading + size, reading)})


def _thrust(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    return record.with_channels(thrust=record["thrust"] * (1.0 + (fault.value or 0.0)))


def _without_gravity(fault: DataFault, record: Record, rng: np.random.Generator) -> Record:
    return record.with_channels(**{fault.target: record[fault.target] + GRAVITY})


_MAKERS = {
    "data_sign": _sign,
    "data_gravity": _without_gravity,
    "data_unit": _unit,
    "data_swap": _swap,
    "data_stuck": _hold,
    "data_dropout": _hold,
    "data_clipped": _clip,
    "data_spikes": _spikes,
    "sensor_delay": _late,
    "clock_drift": _drifting,
    "sensor_misalignment": _tilted,
    "position_error": _position,
    "thrust_scale": _thrust,
}
