"""A hypothesis: the effects that are added to the aircraft file, with their sizes and records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from casid.filtering.innovations import NoiseModel
from casid.model.effect import Effect
from casid.model.station import control


class Sizes(Protocol):
    """Interface that measures causes and latent inputs beside a fit, in units of the smallest size that matters."""

    def share_of(self, fit: Any, one: Attached) -> float: ...
    def missing_share(self, fit: Any, missing: Any) -> float: ...


@dataclass(frozen=True, kw_only=True)
class Attached:
    """An effect with its values.

    values    "value" and the further parameters of the effect
    onsets    record -> onset [s], for a timed effect
    records   names of the records in which it acts; empty for all
    passes    whether noise of the recorded input passes through it. It does not during a trial: an effect that smooths
              the record leads to smaller predicted noise whether it is the cause or not
    nuisance  whether it was added before the search as too small to matter; its prior has that size
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
        """Whether it acts in a record."""
        if self.effect.timed:
            return record in self.onsets
        return not self.records or record in self.records

    def in_record(self, record: str) -> dict[str, float]:
        """The values that the functions of the effect take for this record."""
        return dict(self.values) | ({"onset": self.onsets[record]} if self.effect.timed else {})

    @property
    def passes_noise(self) -> bool:
        """Whether noise of the recorded input is changed by the effect; not for an effect that acts in some records
        only.
        """
        return self.passes and self.effect.noise is not None and not self.records

    @property
    def numeric(self) -> tuple[str, ...]:
        """The values that are estimated with finite differences, because they enter a time series and not the symbolic
        model.
        """
        return () if self.effect.symbolic else tuple(self.values)

    def with_values(self, values: Mapping[str, float]) -> Attached:
        """With other values. An event that becomes longer begins earlier, because the data determine its middle."""
        extent, onsets = self.effect.extent, self.onsets
        if extent is not None and extent in values:
            longer = values[extent] - self.values[extent]
            onsets = {record: onset - 0.5 * longer for record, onset in onsets.items()}
        return replace(self, values=dict(self.values) | dict(values), onsets=onsets)


def acting_noise(noise: NoiseModel, attached: Sequence[Attached], dt: float) -> NoiseModel:
    """The noise model with noise of recorded inputs as changed by the attached effects that it passes through."""
    inputs, coloured = dict(noise.inputs), dict(noise.coloured)
    for one in attached:
        station = control(one.effect.target)
        if one.passes_noise and one.effect.noise is not None and station in inputs:
            coloured[station] = one.effect.noise(inputs.pop(station), dt, one.values)
    return replace(noise, inputs=inputs, coloured=coloured)


def station_series(
    one: Attached, names: Sequence[str], t: np.ndarray, known: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Port -> (N, R) time history that an attached effect adds there."""
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
    """(N, R, nw) Time histories that the attached effects add at the disturbances."""
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
    """(N, R, ny) Readings of instruments with the attached effects, if the model has the output `output`."""
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
