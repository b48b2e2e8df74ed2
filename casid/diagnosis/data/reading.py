"""One way to read a record: which channel is which, and by what factor. The alternatives compete as readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from casid.diagnosis.data.smooth import Smooth
from casid.model.dynamics import standard_density


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How what was recorded is taken.

    factor  channel -> SI value over recorded number
    source  channel -> the column that holds it, where it is another one
    time    seconds in a unit of the time column
    """

    factor: Mapping[str, float] = field(default_factory=dict)
    source: Mapping[str, str] = field(default_factory=dict)
    time: float = 1.0

    def then(self, other: Reading) -> Reading:
        """This reading, with another one of what it gives: both corrections, one after the other."""
        names = {*self.source, *other.source}
        source = {n: self.source.get(other.source.get(n, n), other.source.get(n, n)) for n in names}
        scaled = {*self.factor, *other.factor, *names}
        factor = {n: other.factor.get(n, 1.0) * self.factor.get(other.source.get(n, n), 1.0) for n in scaled}
        return Reading(factor=factor, source=source, time=self.time * other.time)

    @property
    def channels(self) -> frozenset[str]:
        """Channels that it takes otherwise than recorded."""
        return frozenset((*self.factor, *self.source))


AS_RECORDED = Reading()


class Read:
    """A smooth record under a reading. Channels that are not there are zero where a relation allows that."""

    def __init__(self, record: Smooth, reading: Reading = AS_RECORDED) -> None:
        self._record, self._reading = record, reading

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
        return self._reading.factor.get(name, 1.0) * self._record.values[source]

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
