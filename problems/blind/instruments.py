"""Instruments as they are: what lies between a motion and its record, of which no aircraft file knows.

Every channel passes one anti-aliasing filter, is sampled by a clock that jitters, carries an offset, has noise of which
a part is slow, and is written in steps of its converter. Air data and attitude come at a part of the rate, with nothing
between. All of it is drawn from the seed of the set, none of it is large enough to be told as a fault by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.signal import bessel, lfilter, sosfilt, sosfilt_zi

from casid.records.record import Record
from casid.signals import SURFACES
from problems.jsbsim.airframe import RATE_HZ
from problems.jsbsim.flight import NOISE

_DEG = np.pi / 180.0
# Full range of each converter, in the channel's unit.
_RANGE: Mapping[str, float] = MappingProxyType(
    {
        "V": 300.0,
        **dict.fromkeys(("alpha", "beta"), 60.0 * _DEG),
        **dict.fromkeys(("p", "q", "r"), 200.0 * _DEG),
        **dict.fromkeys(("phi", "theta", "psi"), 360.0 * _DEG),
        **dict.fromkeys(("ax", "ay", "az"), 60.0),
        **dict.fromkeys(("pdot", "qdot", "rdot"), 1000.0 * _DEG),
        **dict.fromkeys(SURFACES, 60.0 * _DEG),
        "altitude": 10000.0,
    }
)
_SLOWLY = (
    "V",
    "alpha",
    "beta",
    "altitude",
    "phi",
    "theta",
    "psi",
)  # measured outputs that may come at a part of the rate


@dataclass(frozen=True, kw_only=True)
class Instruments:
    """One installation.

    corner    of the filter before sampling, of the sampling rate;  bits  of the converters
    jitter    1-sigma of the time of a sample, of the interval
    offset    largest offset of a channel, in 1-sigmas of its noise
    slow      part of the noise's variance with a correlation time of `memory_s`
    every     samples between readings of air data and attitude
    """

    corner: float
    bits: int
    jitter: float
    offset: float
    slow: float
    memory_s: float
    every: int

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Instruments:
        return cls(
            corner=float(np.round(rng.uniform(0.2, 0.4), 3)),
            bits=int(rng.choice((12, 14, 16))),
            jitter=float(np.round(rng.uniform(0.0, 0.05), 3)),
            offset=1.0,
            slow=float(np.round(rng.uniform(0.0, 0.5), 3)),
            memory_s=float(np.round(np.exp(rng.uniform(np.log(0.05), np.log(0.5))), 3)),
            every=int(rng.choice((1, 2, 5))),
        )

    def recorded(self, record: Record, rate_hz: float, noise: float, rng: np.random.Generator) -> Record:
        """What is written down of a record at the rate of the simulation; noise of `noise` times the usual 1-sigma."""
        every = round(RATE_HZ / rate_hz)
        nominal = record.t[::every]
        taken = np.clip(nominal + self.jitter / rate_hz * rng.standard_normal(len(nominal)), 0.0, record.t[-1])
        read = {}
        for name, values in record.channels.items():
            if name not in NOISE:
                continue
            sigma = NOISE[name] * (float(np.mean(values)) if name == "thrust" else 1.0)
            sampled = np.interp(taken, record.t, self._filtered(values, rate_hz))
            sampled = sampled + sigma * self.offset * rng.uniform(-1.0, 1.0)
            sampled = sampled + noise * sigma * self._noise(len(sampled), rate_hz, rng)
            if name in _RANGE:
                step = _RANGE[name] / 2**self.bits
                sampled = step * np.round(sampled / step)
            if name in _SLOWLY and self.every > 1:
                sampled = np.where(np.arange(len(sampled)) % self.every == 0, sampled, np.nan)
            read[name] = sampled
        return Record(name=record.name, t=np.round(nominal, 6), channels=read, source="simulated")

    def _filtered(self, values: np.ndarray, rate_hz: float) -> np.ndarray:
        """A second-order Bessel filter, the same for all channels, settled before the record begins."""
        sections = np.asarray(bessel(2, min(self.corner * rate_hz / (0.5 * RATE_HZ), 0.99), norm="mag", output="sos"))
        return sosfilt(sections, values, zi=sosfilt_zi(sections) * values[0])[0]

    def _noise(self, count: int, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
        """(count,) of unit variance."""
        stays = float(np.exp(-1.0 / (rate_hz * self.memory_s)))
        settled = int(np.ceil(10.0 * rate_hz * self.memory_s))
        driven = np.sqrt(1.0 - stays**2) * rng.standard_normal(count + settled)
        slowly = lfilter([1.0], [1.0, -stays], driven)[settled:]
        return np.sqrt(self.slow) * slowly + np.sqrt(1.0 - self.slow) * rng.standard_normal(count)
