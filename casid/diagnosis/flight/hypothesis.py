"""A hypothesis: which effects, in which records and of which size, are added to the aircraft of the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from casid.filtering.innovations import NoiseModel
from casid.model.effect import Effect
from casid.model.station import control


class Sizes(Protocol):
    """What measures the sizes of causes and of missing inputs beside a fit, in units of what matters."""

    def share_of(self, fit: Any, one: Attached) -> float: ...
    def missing_share(self, fit: Any, missing: Any) -> float: ...


@dataclass(frozen=True, kw_only=True)
class Attached:
    """An effect with its values.

    values   "value" and the further parameters of the effect
    onsets   record -> onset [s], for a timed effect
    records  names of the records that have it; empty: all
    passes   whether noise of the recorded input passes through it. Not while it is tried: what smooths the record
             predicts with less noise, whether it is the cause or not
    nuisance   whether it was put in beforehand as too small to matter, and is known to be about that small at most
    """

    effect: Effect
    values: Mapping[str, float]
    onsets: Mapping[str, float] = field(default_factory=dict)
    records: tuple[str, ...] = ()
    passes: bool = True
    nuisance: bool = False

    @property
    def name(self) -> str:
        return self.effect.name

    def concerns(self, record: str) -> bool:
        if self.effect.timed:
            return record in self.onsets
        return not self.records or record in self.records

    def in_record(self, record: str) -> dict[str, float]:
        """Values that the effect's functions take for this record."""
        return dict(self.values) | ({"onset": self.onsets[record]} if self.effect.timed else {})

    @property
    def passes_noise(self) -> bool:
        """Whether noise of the recorded input is another one behind it; what is in some records only leaves it."""
        return self.passes and self.effect.noise is not None and not self.records

    @property
    def numeric(self) -> tuple[str, ...]:
        """Values that are estimated by differences, because they enter a time series and not the symbols."""
        return () if self.effect.symbolic else tuple(self.values)

    def with_values(self, values: Mapping[str, float]) -> Attached:
        """With other values; an event that takes longer begins earlier: what the data tell of it is its middle."""
        extent, onsets = self.effect.extent, self.onsets
        if extent is not None and extent in values:
            longer = values[extent] - self.values[extent]
            onsets = {record: onset - 0.5 * longer for record, onset in onsets.items()}
        return replace(self, values=dict(self.values) | dict(values), onsets=onsets)


def acting_noise(noise: NoiseModel, attached: Sequence[Attached], dt: float) -> NoiseModel:
    """What noise of recorded inputs is behind the attached effects that it passes."""
    inputs, coloured = dict(noise.inputs), dict(noise.coloured)
    for one in attached:
        station = control(one.effect.target)
        if one.passes_noise and one.effect.noise is not None and station in inputs:
            coloured[station] = one.effect.noise(inputs.pop(station), dt, one.values)
    return replace(noise, inputs=inputs, coloured=coloured)


def station_series(
    one: Attached, names: Sequence[str], t: np.ndarray, known: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Station -> (N, R) time history that an attached effect puts on it."""
    found: dict[str, np.ndarray] = {}
    for j, record in enumerate(names):
        if one.effect.series is not None and one.concerns(record):
            here = {name: series[:, j] for name, series in known.items()}
            for station, series in one.effect.series(t[:, j], here, one.in_record(record)).items():
                found.setdefault(station, np.zeros(t.shape))[:, j] = series
    return found


def disturbance_series(
    attached: Sequence[Attached],
    names: Sequence[str],
    t: np.ndarray,
    known: Mapping[str, np.ndarray],
    disturbances: Sequence[str],
) -> np.ndarray:
    """(N, R, nw) time histories that attached effects put on the disturbance stations."""
    W = np.zeros((*t.shape, len(disturbances)))
    for one in attached:
        for station, series in station_series(one, names, t, known).items():
            W[..., disturbances.index(station)] += series
    return W


def readings(
    attached: Sequence[Attached],
    names: Sequence[str],
    t: np.ndarray,
    output: np.ndarray,
    outputs: Sequence[str],
    known: Mapping[str, np.ndarray],
) -> np.ndarray:
    """(N, R, ny) what instruments with attached output effects read when the model's output is `output`."""
    read = output.copy()
    for one in attached:
        if one.effect.output is None:
            continue
        for j, record in enumerate(names):
            if one.concerns(record):
                here = {name: series[:, j] for name, series in known.items()}
                here |= {name: read[:, j, i] for i, name in enumerate(outputs)}
                for channel, series in one.effect.output(t[:, j], here, one.in_record(record)).items():
                    if channel in outputs:
                        read[:, j, outputs.index(channel)] = series
    return read
