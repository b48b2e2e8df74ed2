"""One way to read a record: which channel is which, and by what factor. The alternatives compete as readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from casid.data_check.criteria import DataCriteria
from casid.keeping import by_fields
from casid.model.dynamics import standard_density
from casid.model.measured_force import external_force
from casid.records.checks import INPUTS
from casid.records.record import Record
from casid.signals import EXTERNAL_FORCE, FORCE_POINT, GRAVITY

_ANGLES = ("psi",)
FORCES = ("ax", "ay", "az")
FEWEST_KNOWN = 20  # samples of smoothed series, some three windows of six: fewer judge no level and no relation


@dataclass(frozen=True, eq=False, kw_only=True)
class Smooth:
    """Smoothed channels of a record."""

    name: str
    t: np.ndarray
    # values, rates: channel -> (N,) mean over a Hann window, and its slope per second of the record's time
    values: Mapping[str, np.ndarray]
    rates: Mapping[str, np.ndarray]
    known: Mapping[str, np.ndarray]  # channel -> (N,) whether enough samples of the window are there
    independent: float  # number of independent samples of a smoothed series: windows in the record
    density: float | None = None  # [kg/m3] where neither density nor altitude is recorded; None where it is unknown

    def __contains__(self, channel: str) -> bool:
        return channel in self.values

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])


def smooth(record: Record, window: float, criteria: DataCriteria, density: float | None = None) -> Smooth:
    """The record on a uniform grid of its median interval, every channel by a mean over a `window` [s]."""
    dt = record.dt
    count = max(criteria.fewest, min(round(window / dt), len(record) // criteria.fewest)) | 1
    weights = np.hanning(count + 2)[1:-1]
    weights /= weights.sum()
    t = np.arange(record.t[0], record.t[-1] + 0.5 * dt, dt)
    values = dict[str, np.ndarray]()
    rates = dict[str, np.ndarray]()
    known = dict[str, np.ndarray]()
    for name, series in record.channels.items():
        good = np.isfinite(series)
        if good.sum() < max(criteria.fewest, len(series) // 10) or len(t) < 2 * count:
            continue
        there = np.unwrap(series[good]) if name in _ANGLES else series[good]
        even = np.interp(t, record.t[good], there)
        values[name] = np.convolve(np.pad(even, count // 2, mode="edge"), weights, mode="valid")
        rates[name] = np.gradient(values[name], dt)
        own = max(dt, float(np.median(np.diff(record.t[good]))))  # of a slower channel
        nearest = np.abs(t - record.t[good][_nearest(record.t[good], t)]) < 0.75 * own
        known[name] = np.ones(len(t), dtype=bool) if name in INPUTS else _share(nearest, count) >= criteria.resolved
        known[name][: count // 2] = False
        known[name][len(t) - count // 2 :] = False
    every = slice(None, None, max(1, count // criteria.fewest))
    kept = ({name: series[every] for name, series in table.items()} for table in (values, rates, known))
    values, rates, known = kept
    independent = max(2.0, len(t) / count)
    return Smooth(
        name=record.name,
        t=t[every],
        values=values,
        rates=rates,
        known=known,
        independent=independent,
        density=density,
    )


def _nearest(sorted_times: np.ndarray, t: np.ndarray) -> np.ndarray:
    after = np.clip(np.searchsorted(sorted_times, t), 1, len(sorted_times) - 1)
    return np.where(t - sorted_times[after - 1] < sorted_times[after] - t, after - 1, after)


def _share(there: np.ndarray, count: int) -> np.ndarray:
    return np.convolve(there.astype(float), np.ones(count) / count, mode="same")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Rules by which recorded numbers become SI values: factors, offsets, columns, unit of time, and place of a
    sensor."""

    factor: Mapping[str, float] = field(default_factory=dict)  # channel -> SI value over recorded number
    offset: Mapping[str, float] = field(default_factory=dict)  # channel -> what is added to that
    # channel -> the column that holds it, where it is another one
    source: Mapping[str, str] = field(default_factory=dict)
    time: float = 1.0  # seconds in a unit of the time column
    # of the accelerometer from the c.g. [m], whose part of the readings is taken off
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: bool = True  # whether accelerometers sense it; else it is taken off what they read

    def then(self, other: Reading) -> Reading:
        """This reading, with another one of what it gives: both corrections, one after the other."""
        names = {*self.source, *other.source}
        source = {n: self.source.get(other.source.get(n, n), other.source.get(n, n)) for n in names}
        scaled = {*self.factor, *other.factor, *names}
        factor = {n: other.factor.get(n, 1.0) * self.factor.get(other.source.get(n, n), 1.0) for n in scaled}
        moved = {*self.offset, *other.offset, *(names if self.offset else ())}
        before = {n: other.factor.get(n, 1.0) * self.offset.get(other.source.get(n, n), 0.0) for n in moved}
        offset = {n: before[n] + other.offset.get(n, 0.0) for n in moved}
        x, y, z = (a + b for a, b in zip(self.place, other.place, strict=True))
        return Reading(
            factor=factor,
            offset=offset,
            source=source,
            time=self.time * other.time,
            place=(x, y, z),
            gravity=self.gravity and other.gravity,
        )

    def of(self, name: str, recorded: np.ndarray) -> np.ndarray:
        """The channel in SI, from the numbers of its column."""
        return self.factor.get(name, 1.0) * recorded + self.offset.get(name, 0.0)

    @property
    def channels(self) -> frozenset[str]:
        """Channels that it takes otherwise than recorded."""
        forces = FORCES if any(self.place) or not self.gravity else ()
        return frozenset((*self.factor, *self.offset, *self.source, *forces))

    def felt(self, name: str, values: np.ndarray, phi: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(N,) the specific force where accelerations without gravity are recorded; other channels as they are."""
        if self.gravity or name not in FORCES:
            return values
        down = {"ax": -np.sin(theta), "ay": np.sin(phi) * np.cos(theta), "az": np.cos(phi) * np.cos(theta)}
        return values - GRAVITY * down[name]


AS_RECORDED = Reading()


class Read:
    """A smooth record under a reading. Channels that are not there are zero where a relation allows that."""

    def __init__(self, record: Smooth, reading: Reading = AS_RECORDED) -> None:
        self._record = record
        self._reading = reading

    @property
    def recorded(self) -> Mapping[str, np.ndarray]:
        """Channels of the record itself."""
        return self._record.values

    def has(self, *names: str) -> bool:
        return all(self._recorded(name) or (name == "rho" and self._density_known) for name in names)

    def _recorded(self, name: str) -> bool:
        return self._reading.source.get(name, name) in self._record

    @property
    def _density_known(self) -> bool:
        return self._recorded("altitude") or self._record.density is not None

    def value(self, name: str) -> np.ndarray:
        """(N,) in SI; zero of a channel that is not recorded, but for a density that is known otherwise."""
        source = self._reading.source.get(name, name)
        if source not in self._record:
            return self._density() if name == "rho" and self._density_known else np.zeros(len(self._record.t))
        values = self._reading.of(name, self._record.values[source])
        if not self._reading.gravity and name in FORCES:
            values = self._reading.felt(name, values, self.value("phi"), self.value("theta"))
        if name in FORCES and any(self._reading.place):
            return values - np.asarray(self._reading.place) @ self.levers()[:, FORCES.index(name)]
        return values

    def _density(self) -> np.ndarray:
        """(N,) of the standard atmosphere at the recorded altitude, or that of the trim."""
        if self._recorded("altitude"):
            return np.asarray(standard_density(self.value("altitude")), dtype=float)
        return np.full(len(self._record.t), self._record.density)

    def rate(self, name: str) -> np.ndarray:
        """(N,) per second."""
        source = self._reading.source.get(name, name)
        return self._reading.factor.get(name, 1.0) / self._reading.time * self._record.rates[source]

    def known(self, *names: str) -> np.ndarray:
        """(N,) whether the samples of all of the recorded ones among `names` are there."""
        sources = {self._reading.source.get(name, name) for name in names} | set(names)  # as many as before a swap
        masks = [self._record.known[source] for source in sources if source in self._record]
        return np.logical_and.reduce(masks) if masks else np.ones(len(self._record.t), dtype=bool)

    @property
    def name(self) -> str:
        return self._record.name

    def pulled(self) -> tuple[list[Any], list[Any]]:
        """(N,) each: the recorded external force along body axes [N], and its moment about the c.g. [N m]; else 0."""
        there = {name: self.value(name) for name in (*EXTERNAL_FORCE, *FORCE_POINT) if self._recorded(name)}
        return external_force(there)

    def made(self, name: str, mass: float) -> np.ndarray:
        """(N,) the part of a specific force that is not made by a recorded external force."""
        return self.value(name) - self.pulled()[0][FORCES.index(name)] / mass

    def levers(self) -> np.ndarray:
        """(3, 3, N) what an accelerometer 1 m from the c.g. senses of the rotation: axes of the place, and of force."""
        p, q, r = (self.value(name) for name in "pqr")
        still = np.zeros(len(p))
        a, b, c = (self.rate(name) if self._recorded(name) else still for name in "pqr")
        return np.array(
            [
                [-q * q - r * r, p * q + c, p * r - b],
                [p * q - c, -p * p - r * r, q * r + a],
                [p * r + b, q * r - a, -p * p - q * q],
            ]
        )

    @property
    def independent(self) -> float:
        return self._record.independent

    @property
    def step(self) -> float:
        """Sampling interval [s]."""
        return float(self._record.t[1] - self._record.t[0]) * self._reading.time

    @property
    def duration(self) -> float:
        return self._record.duration * self._reading.time


Handled = Literal["excluded", "corrected", "reported"]


OF_THE_FILE = ("file_sign",)  # kinds of explanations that are values of the aircraft file


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A fault of the data.

    Attributes
    ----------
    kind, target
        Of the vocabulary, `data_stuck` of `beta`.
    records
        Names of those that have it.
    intervals_s
        Record -> intervals [s] that are concerned; empty: the whole record.
    term
        Of axes the convention found, "FLU".
    value, std
        Its size with 1-sigma in `unit`, where it has one: the factor of a wrong unit.
    handled
        "excluded": these samples take no part; "corrected": the data are judged as they should read; "reported":
        neither can be done, so that nothing which rests on them can be judged.
    odds
        Of a sign, a unit or a swap against records that are well, 1e6 to 1 at most; None of samples.
    indistinguishable_from
        Kind and target of other faults that explain these data as well.

    Examples
    --------
    >>> import casid as cs
    >>> record = cs.read_record("casid/cli/demo/m1.csv")
    >>> beta = record["beta"].copy()
    >>> beta[300:600] = beta[300]  # the vane freezes for six seconds
    >>> found = cs.check([record.with_channels(beta=beta)])
    >>> found.findings[0].kind, found.findings[0].target
    ('data_stuck', 'beta')
    """

    in_json: ClassVar[str] = (
        "kind target term records intervals_s value std unit handled odds sentence indistinguishable_from"
    )

    kind: str
    target: str
    records: tuple[str, ...]
    intervals_s: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    term: str | None = None
    value: float | None = None
    std: float | None = None
    unit: str | None = None
    handled: Handled
    sentence: str
    odds: float | None = None
    indistinguishable_from: tuple[Mapping[str, str], ...] = ()
    title: str = ""  # in a few words, where others are as good an explanation

    @property
    def puts_in_doubt(self) -> bool:
        """Return True if nothing that rests on these data can be judged.

        Data for which a value of the aircraft file is as good an explanation are judged by that value. A channel that a
        filter corrects in steps is as near to the motion as it was; its rate alone tells nothing.
        """
        of_the_file = any(one["kind"] in OF_THE_FILE for one in self.indistinguishable_from)
        return self.handled == "reported" and not of_the_file and self.kind != "data_steps"

    to_dict = by_fields
