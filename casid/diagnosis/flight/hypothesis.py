"""A hypothesis: the effects that are added to the aircraft file, with their sizes and records, and its slopes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from casid.diagnosis.criteria import PartCriteria
from casid.diagnosis.flight.subject import Subject
from casid.filtering.innovations import Batch, Linear, NoiseModel, ParameterFunctions, inject
from casid.filtering.kalman import Filter
from casid.model import operators
from casid.model.aircraft import Aircraft
from casid.model.causes.instruments import sensor_bias
from casid.model.effect import Effect
from casid.model.effect_value import EffectValue
from casid.model.station import control
from casid.model.system import Model
from casid.model.terms import Term, derivative_term
from casid.model.usual_derivatives import NOTABLE_DERIVATIVES, USUAL_DERIVATIVES

OFFSET = "bias_"  # prefix of the parameter of a channel's offset


def prior(flight: Subject, model: Model, names: Sequence[str | None]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and inverse variance of the fitted parameters; effects and unnamed parameters have no prior."""
    mean = np.zeros(len(names))
    weight = np.zeros(len(names))
    of_the_file = flight.model().parameters
    for i, name in enumerate(names):
        if name in of_the_file:
            mean[i] = model.nominal[name]
            weight[i] = flight.prior_std(model, name) ** -2.0
    return mean, weight


def smallest_stated_std(coefficient: str, criteria: PartCriteria | None = None) -> float:
    """Smallest prior standard deviation of a derivative; a relative uncertainty means nothing near zero."""
    known = criteria or PartCriteria()
    return known.tenth * NOTABLE_DERIVATIVES[coefficient]


def derivative_std(flight: Subject, model: Model, name: str) -> float:
    """Prior standard deviation of a derivative or offset.

    It is the one that the file states. A derivative that the file has at zero has the usual size of that derivative. If
    neither is known, the prior is wide, and wider still for a regressor that moves little in these records. The offset
    of an instrument is as large as a bias that matters.
    """
    if name.startswith(OFFSET):
        channel = name.removeprefix(OFFSET)
        return float(sensor_bias(channel).smallest_that_matters(flight.aircraft) or np.inf)
    wide = flight.criteria.data.outlying
    size = abs(model.nominal[name])
    if name in flight.aircraft.knots:
        return model.prior_std.get(name, wide * max(size, NOTABLE_DERIVATIVES[flight.aircraft.knots[name]]))
    coefficient, term = derivative_term(name)
    smallest = NOTABLE_DERIVATIVES[coefficient]
    if name in model.prior_std:
        return max(model.prior_std[name], smallest_stated_std(coefficient, flight.criteria.parts))
    usual = USUAL_DERIVATIVES.get(name)
    if size == 0.0 and usual is not None:
        return usual * _as_in_the_file(flight.aircraft, term)
    if size > 0.0 or not term.factors:
        return wide * max(size, smallest)
    moves = max(flight.regressors(model).variation(term), flight.criteria.noise.smallest)
    return wide * smallest * max(1.0, flight.criteria.parts.tenth / moves)


def _as_in_the_file(aircraft: Aircraft, term: Term) -> float:
    """Factor of a derivative by a rate, if the file does not use half of a reference length to make rates
    dimensionless.
    """
    lengths = {
        "p": (aircraft.moment_length_lateral, aircraft.rate_length_lateral),
        "q": (aircraft.moment_length_pitch, aircraft.rate_length_pitch),
        "r": (aircraft.moment_length_lateral, aircraft.rate_length_lateral),
    }
    length, made_with = lengths.get(term.name, (2.0, 1.0))
    return 0.5 * length / made_with


@dataclass(frozen=True, kw_only=True)
class Attached:
    """An effect with its values."""

    effect: Effect
    values: Mapping[str, float]  # "value" and the further parameters of the effect
    onsets: Mapping[str, float] = field(default_factory=dict)  # record -> onset [s], for a timed effect
    records: tuple[str, ...] = ()  # names of the records in which it acts; empty for all
    # whether noise of the recorded input passes through it. It does not during a trial: an effect that smooths the
    # record leads to smaller predicted noise whether it is the cause or not
    passes: bool = True
    nuisance: bool = False  # whether it was added before the search as too small to matter; its prior has that size

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def entry(self) -> EffectValue:
        """The effect with its values as an entry of an aircraft file, which any model takes too."""
        effect = self.effect
        sizes = effect.in_words(self.values)
        return EffectValue(
            kind=effect.kind,
            target=effect.target,
            term=effect.term,
            value=sizes.pop("value"),
            records=self.records,
            onset_s={record: (at, at) for record, at in self.onsets.items()} or None,
            parameters=sizes,
        )

    def concerns(self, record: str) -> bool:
        """Return True if it acts in a record."""
        if self.effect.timed:
            return record in self.onsets
        return not self.records or record in self.records

    def in_record(self, record: str) -> dict[str, float]:
        """The values that the functions of the effect take for this record."""
        return dict(self.values) | ({"onset": self.onsets[record]} if self.effect.timed else {})

    @property
    def passes_noise(self) -> bool:
        """Return True if noise of the recorded input is changed by the effect; False for an effect that acts in some
        records only."""
        return self.passes and self.effect.forms.noise is not None and not self.records

    @property
    def numeric(self) -> tuple[str, ...]:
        """The values that are estimated with finite differences, because they enter a time series and not the symbolic
        model.
        """
        return () if self.effect.symbolic else tuple(self.values)

    def along(self, key: str) -> Attached:
        """Return a copy with a value whose imaginary part carries the derivative of all that is made of it."""
        size: Any = complex(self.values[key], operators.IMAGINARY)
        return self.with_values({key: size})

    def with_values(self, values: Mapping[str, float]) -> Attached:
        """Return a copy with other values. An event that becomes longer begins earlier, because the data determine its
        middle."""
        extent = self.effect.event.extent
        onsets = self.onsets
        if extent is not None and extent in values:
            longer = values[extent] - self.values[extent]
            onsets = {record: onset - 0.5 * longer for record, onset in onsets.items()}
        return replace(self, values=dict(self.values) | dict(values), onsets=onsets)


def acting_noise(noise: NoiseModel, attached: Sequence[Attached], dt: float) -> NoiseModel:
    """The noise model with noise of recorded inputs as changed by the attached effects that it passes through."""
    inputs = dict(noise.inputs)
    coloured = dict(noise.coloured)
    for one in attached:
        station = control(one.effect.target)
        if one.passes_noise and one.effect.forms.noise is not None and station in inputs:
            coloured[station] = one.effect.forms.noise(inputs.pop(station), dt, one.values)
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
                found.setdefault(station, np.zeros(t.shape, dtype=series.dtype))[:, j] = series
    return found


def disturbance_series(
    attached: Sequence[Attached],
    names: Sequence[str],
    t: np.ndarray,
    known: Mapping[str, np.ndarray],
    disturbances: Sequence[str],
) -> np.ndarray:
    """(N, R, nw) Time histories that the attached effects add at the disturbances."""
    added = [pair for one in attached for pair in station_series(one, names, t, known).items()]
    W = np.zeros((*t.shape, len(disturbances)), dtype=np.result_type(float, *(series for _, series in added)))
    for station, series in added:
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
    moved = any(np.iscomplexobj(value) for one in attached for value in one.values.values())
    read = output.astype(complex if moved else float)
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


@dataclass(frozen=True, eq=False, kw_only=True)
class HistorySlope:
    """Change of time histories per unit of a value: those at `stations`, or those of the readings where there are none.
    A value without any effect has neither.
    """

    stations: np.ndarray  # (n,) indices of disturbances
    series: np.ndarray  # (N, R, n), or (N, R, ny) of the readings


@dataclass(frozen=True, eq=False, kw_only=True)
class Slopes:
    """Slopes of the model by all slots: by its own parameters, which come first, and by values of histories."""

    functions: ParameterFunctions
    batch: Batch
    parameters: np.ndarray  # (R, np) parameters of the model
    moving: np.ndarray  # (N, R, nw) disturbances
    ends: tuple[np.ndarray, np.ndarray] | None  # states and disturbances at the ends of intervals (`in_stretches`)
    present: np.ndarray  # (R, slots) 1 for a parameter that acts in a record, else 0
    histories: tuple[HistorySlope, ...]  # those of the slots behind the parameters

    def whitened(self, kalman: Filter) -> np.ndarray:
        """(N, R, ny, slots) Whitened sensitivities to all slots."""
        linear = kalman.linear
        own = len(self.functions.free)
        stretches = self.functions.in_stretches(self.batch, self.parameters, linear.X, self.moving, ends=self.ends)
        columns = kalman.whiten_in_stretches(stretches, own, len(self.histories))
        columns[..., :own] *= self.present[:, None, :own]
        for i, slope in enumerate(self.histories, own):
            if len(slope.stations):
                columns[..., i] = kalman.whiten_histories(slope.stations, slope.series, [0])[..., 0]
            elif slope.series.shape[2]:
                nothing = np.zeros((*linear.defect.shape, 1))
                columns[..., i] = kalman.whiten(slope.series[..., None], nothing)[..., 0]
            else:
                columns[..., i] = 0.0
        return columns

    def along(self, linear: Linear, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, R, ny, 1) and (N-1, R, nx, 1) Change of outputs and of steps for a change of all slots."""
        own = len(self.functions.free)
        read = np.zeros((*linear.output.shape, 1))
        driven = np.zeros((*linear.defect.shape, 1))
        by_parameters = self.present[:, :own] * change[:own]
        about = self.batch, self.parameters, linear.X, self.moving
        stretches = self.functions.in_stretches(*about, by_parameters, self.ends)
        for at, Dp, Bp in stretches if own else ():
            read[at] = Dp
            driven[at] = Bp
        for slope, by in zip(self.histories, change[own:], strict=True):
            if len(slope.stations):
                y, f = inject(linear, slope.stations.tolist(), by * slope.series)
                read[..., 0] += y.sum(axis=3)
                driven[..., 0] += f.sum(axis=3)
            elif slope.series.shape[2]:
                read[..., 0] += by * slope.series
        return read, driven
