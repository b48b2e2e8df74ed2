"""The data of a diagnosis: an aircraft, its records prepared for the model, and the noise of every channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.diagnosis.criteria import Criteria, NoiseCriteria
from casid.diagnosis.evidence.size import AircraftSizes
from casid.diagnosis.flight.bounds import possible
from casid.diagnosis.flight.hypothesis import Regressors, derivative_std
from casid.diagnosis.flight.subject import Sizes, Subject, once
from casid.diagnosis.time_limit import TimeLimit
from casid.errors import InputError
from casid.filtering.innovations import Batch, NoiseModel, PointFunctions, make_batch, padded
from casid.model.aircraft import Aircraft
from casid.model.causes import group_channels, sensor_bias
from casid.model.dynamics import INTEGRATED, aircraft_model, flight_inputs, moved_coefficients
from casid.model.effect import Effect
from casid.model.effects import catalogue
from casid.model.flown_records import axes_of, with_estimates
from casid.model.measured_force import force_inputs, pulled_alike
from casid.model.path import aerodynamic_parameters, coefficient_names
from casid.model.station import Station, coefficient, control, reading, wind
from casid.model.system import Model
from casid.model.terms import IN_PLANE, OUT_OF_PLANE, Term, parse_term
from casid.model.usual_derivatives import missing_derivatives
from casid.records.noise import pooled_sigma, real_updates
from casid.records.noise_spectrum import density_sigma, high_band_holds, motion_edge
from casid.records.record import Record
from casid.records.thinning import averaged, spaced
from casid.signals import SURFACES

# If altitude were an output, a steady updraft, which is common, would appear as a bias of alpha.
_NOT_JUDGED = ("altitude", "north", "east")


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """An aircraft and its prepared records."""

    aircraft: Aircraft
    axes: str  # scope of the model that the records can support
    outputs: tuple[str, ...]  # channels that the model must explain
    records: tuple[Record, ...]
    sigma: dict[str, float]  # measurement noise of each output, 1-sigma
    input_sigma: dict[str, float]  # noise of each recorded input, by disturbance
    # outputs whose high band does not show their noise (filtered, held, coarse): `sigma` is a lower bound, raised by
    # `with_noise_above`
    doubted: tuple[str, ...] = ()
    # time between the readings of doubted outputs that count [s], 0 for all readings: readings in between contain no
    # more if a filter removed everything above the band of the motion
    spacing: float = 0.0
    # output -> (1-sigma, correlation time) of its innovations, for noise that is estimated with the model
    # (`NoiseModel.colour`)
    colour: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # sign of the air's rotation due to the gradient of its velocity, by axis (`aircraft_model`)
    turning: Mapping[str, float] = field(default_factory=dict)
    held: float = 0.0  # behaviour of inputs between recorded samples (`Batch.held`), for records that do not state it
    # whether a controller answers to every disturbance, so that predictions are compared with a record instead of a
    # simulation of the whole of it
    closed_loop: bool = False
    every: int = 1  # number of recorded samples of which each sample is the mean
    unknown: tuple[str, ...] = ()  # inputs that were never recorded: nothing that depends on them is judged
    limit: TimeLimit = field(default_factory=TimeLimit)  # the time that the search may take
    criteria: Criteria = Criteria()  # the thresholds for all decisions made with this flight
    sizes: Sizes = field(default_factory=AircraftSizes)  # measure of the sizes of causes
    _models: dict[tuple[str, ...], Model] = field(default_factory=dict, repr=False)
    _functions: dict[Model, PointFunctions] = field(default_factory=dict, repr=False)
    _regressors: dict[Model, Regressors] = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_models": {}, "_functions": {}, "_regressors": {}}  # built again on demand

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(record.name for record in self.records)

    @property
    def title(self) -> str:
        """Name of the object that is diagnosed."""
        return self.aircraft.name

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the six coefficients."""
        return coefficient_names(self.aircraft.force_axes)

    @property
    def moved(self) -> tuple[str, ...]:
        """Coefficients that act on the states of the model."""
        return self._moved

    @cached_property
    def _moved(self) -> tuple[str, ...]:
        return tuple(moved_coefficients(self.aircraft, self.axes))

    @property
    def terms(self) -> tuple[tuple[str, str, str], ...]:
        """(coefficient, parameter, term) of the aerodynamics."""
        return self._terms

    @cached_property
    def _terms(self) -> tuple[tuple[str, str, str], ...]:
        return tuple(aerodynamic_parameters(self.aircraft))

    @property
    def stations(self) -> list[str]:
        """Coefficients and axes of moving air within the scope, as disturbances of the model."""
        states = {"full": ("u", "v", "w"), "longitudinal": ("u", "w"), "lateral": ("v",)}[self.axes]
        winds = [wind(axis) for axis, state in zip("xyz", "uvw", strict=True) if state in states]
        return [*map(coefficient, self.moved), *winds]

    @property
    def readings(self) -> list[str]:
        """Readings at which a latent input may enter."""
        return [reading(name) for name in self.outputs]

    @property
    def offsets(self) -> list[Effect]:
        """Offsets of all instruments, which every aircraft has."""
        return [sensor_bias(name) for name in self.outputs]

    def smallest_that_matters(self, effect: Effect) -> float | None:
        """The smallest size of an effect that matters; None if it is judged by its consequences."""
        return effect.smallest_that_matters(self.aircraft)

    @property
    def lines(self) -> tuple[str, ...]:
        """None: the discrepancy of a coefficient contains its terms already (`Plant.lines`)."""
        return ()

    @property
    def imitated_names(self) -> frozenset[str]:
        """Names of effects that are a relative change of a fitted number of the file: none of an aeroplane."""
        return frozenset()

    def suspects(self, fit: Any) -> list[tuple[Effect, float, float]]:
        """None: what numbers of a file imitate is reported of these numbers."""
        return []

    def channels_of(self, effect: Effect) -> tuple[str, ...]:
        """The readings that an effect of an instrument changes."""
        return group_channels(effect.target)

    def term_along(self, effect: Effect, regressors: Mapping[str, np.ndarray]) -> np.ndarray | float:
        """(N, R) The term of an effect along `regressors` of this flight."""
        return parse_term(effect.regressor or "0").evaluate(regressors)

    def prior_std(self, model: Model, name: str) -> float:
        """Prior standard deviation of a parameter of the model."""
        return derivative_std(self, model, name)

    @cached_property
    def resting(self) -> tuple[str, ...]:
        """Surfaces that do not move: their derivatives are part of the offsets."""
        return tuple(s for s in SURFACES if not np.ptp(np.concatenate([record[s] for record in self.records])) > 0.0)

    @property
    def freed(self) -> tuple[str, ...]:
        """Derivatives, terms and knots of tables that act on the states; not those of a surface that does not move."""
        return self._freed

    @cached_property
    def _freed(self) -> tuple[str, ...]:
        moved = moved_coefficients(self.aircraft, self.axes)
        acting = [(name, term) for c, name, term in aerodynamic_parameters(self.aircraft) if c in moved]
        still = {name for name, term in acting if any(v in self.resting for v, _ in parse_term(term).factors)}
        knots = [name for name, coefficient in self.aircraft.knots.items() if coefficient in moved]
        return (*(name for name, _ in acting if name not in still), *knots)

    @property
    def effects(self) -> list[Effect]:
        """Every deterministic effect that these records can show."""
        every = (possible(e, self.aircraft, self.criteria.size) for e in catalogue(self.aircraft, self.outputs))
        known = [e for e in every if e.target not in self.unknown and not e.kind.startswith(self.unknown)]
        told = [e for e in known if e.regressor is None or not self._still & parse_term(e.regressor).variables]
        return [e for e in told if e.regressor is None or "[" not in e.regressor or e.name in self._stretches]

    @cached_property
    def _still(self) -> frozenset[str]:
        """Variables whose terms are not identifiable: those of axes out of scope, and angles that do not move.

        The product with a constant variable equals the term of the other variables, which symmetry may forbid.
        """
        angles = ("alpha", "beta", *SURFACES)
        moves = {a: [record[a] for record in self.records if a in record] for a in angles}
        rest = {a for a, x in moves.items() if x and np.nanstd(np.concatenate(x)) < self.criteria.prior.resting}
        out_of_axes = {"longitudinal": OUT_OF_PLANE, "lateral": IN_PLANE}.get(self.axes, ())
        return frozenset({*rest, *out_of_axes})

    @cached_property
    def _stretches(self) -> frozenset[str]:
        """Names of the stretches of tables that these records reach.

        Of stretches with the same effect in these records only the first is returned: a breakpoint without a sample
        near it makes no difference.
        """
        found: dict[tuple[str, bytes], str] = {}
        moves = self.regressors(self.model())
        for effect in catalogue(self.aircraft, self.outputs):
            if effect.regressor is None or "[" not in effect.regressor:
                continue
            term = parse_term(effect.regressor)
            share, series = (moves.measured(part) for part in (Term(factors=(), stretches=term.stretches), term))
            if np.ptp(share) > 0.0:
                # Series that differ by rounding only are equal in single precision.
                found.setdefault((effect.target, np.float32(1.0 + series).tobytes()), effect.name)
        return frozenset(found.values())

    @property
    def noise_by_fit(self) -> bool:
        """Return True if most outputs do not show their noise, so that its level and colour are estimated with the
        model."""
        return len(self.doubted) >= self.criteria.noise.common_filter * len(self.outputs)

    def noise(self, coloured: dict[str, tuple[float, float]] | None = None) -> NoiseModel:
        """The noise model of readings and inputs, with `coloured` disturbances."""
        return NoiseModel(measurement=self.sigma, inputs=self.input_sigma, coloured=coloured or {}, colour=self.colour)

    def model(self, effects: Sequence = ()) -> Model:
        """The aircraft model of this flight, with symbolic `effects` among its parameters."""
        symbolic = [effect for effect in effects if effect.symbolic]
        scope: dict = {"axes": self.axes, "outputs": self.outputs, "turning": self.turning, "equations": False}

        def build() -> Model:
            return aircraft_model(self.aircraft, effects=symbolic, known=force_inputs(self.records), **scope)

        return once(self._models, tuple(effect.name for effect in symbolic), build)

    def functions(self, model: Model) -> PointFunctions:
        """The functions of one of its models."""
        return once(self._functions, model, lambda: PointFunctions(model, ()))

    def regressors(self, model: Model) -> Regressors:
        """The aerodynamic regressors of one of its models."""
        return once(self._regressors, model, lambda: Regressors(self, model))

    def batch(self, model: Model) -> Batch:
        """The records as arrays, for one of its models."""
        batch = make_batch(model, self.records)
        if self.spacing:
            Z = batch.Z.copy()
            doubted = [model.outputs.index(o) for o in self.doubted]
            for j, record in enumerate(self.records):
                for i in doubted:
                    read = spaced(record.t, Z[: len(record), j, i], self.spacing)
                    Z[: len(record), j, i] = np.where(read, Z[: len(record), j, i], np.nan)
            batch = replace(batch, Z=Z)
        # Inputs that are held over a recorded interval act half of that interval late, and so do their means.
        return replace(batch, held=np.where(batch.held == 0.0, self.held, batch.held) / self.every)

    def measured(self, model: Model) -> np.ndarray:
        """(N, R, states) Measured motion; states that are not measured have the values of the trim."""
        return padded([model.guess(record) for record in self.records])

    def within_the_motion(self) -> Flight:
        """The flight with only as many readings of doubted outputs as twice the band of the motion needs."""
        edge = motion_edge(self.records)
        if not self.noise_by_fit or edge == 0.0:
            return self
        spacing = 0.5 / (2.0 * edge)  # up to the octave above
        return replace(self, spacing=spacing, _regressors={})

    def with_noise_above(self, left: Sequence[Record]) -> Flight:
        """The flight with the noise of doubted outputs raised according to `left`, the residuals of every record.

        Residuals in the octave above the motion (`motion_edge`) are counted, at most as much as was measured there,
        which is used alone where a simulation that departed left no residuals of a channel.
        This assumes that the noise has the same density below that octave, and that the residuals in it are no fault.
        """
        edge = motion_edge(self.records)
        if edge == 0.0:
            return self
        raised = {}
        for name in self.doubted:
            both = (that_have(records, name, self.criteria.noise) for records in (left, self.records))
            density = min((density_sigma(of, name, (edge, 2.0 * edge)) for of in both if of), default=0.0)
            if density > self.criteria.noise.density_ratio * self.sigma[name]:
                raised[name] = density
        return replace(self, sigma=self.sigma | raised)

    def with_filtered_inputs(self) -> Flight:
        """The flight with the noise of inputs as dense in the band of the motion as a filter common to all channels
        left it.

        If most outputs were filtered, the noise of the inputs exceeds their high band by the same factor as that of the
        outputs. The spectrum of an input itself does not show this, since an input may have any motion.
        """
        edge = motion_edge(self.records)
        criteria = self.criteria.noise
        filtered = self._filtered(self.outputs, edge)
        factors = [self.sigma[o] / sigma_of([r[o] for r in of], criteria) for o, of in filtered.items()]
        if len(factors) < criteria.common_filter * len(self.outputs):
            return self
        names = [Station.at(name).name for name in self.input_sigma]
        stated = self.aircraft.noise
        filtered = [name for name in self._filtered(names, edge) if not stated.get(name)]
        denser = {
            control(name): max(float(np.median(factors)), 1.0) * self.input_sigma[control(name)] for name in filtered
        }
        return replace(self, input_sigma=self.input_sigma | denser, _regressors={})

    def _filtered(self, names: Sequence[str], edge: float) -> dict[str, list[Record]]:
        """Channels whose high band does not show their noise, with the records that contain them."""
        having = {name: that_have(self.records, name, self.criteria.noise) for name in names}
        return {name: records for name, records in having.items() if not high_band_holds(records, name, edge)}

    def turned_by_air(self, turning: Mapping[str, float]) -> Flight:
        """The same records with a model whose air also rotates the aircraft."""
        return replace(self, turning=turning, _models={}, _functions={}, _regressors={})

    def with_inputs_held(self, share: float) -> Flight:
        """The flight with inputs held over a share of the sample interval (`Batch.held`), and a note about it."""
        late = 0.5e3 * share * float(np.median([record.dt for record in self.records])) / self.every
        note = f"inputs: taken to act {abs(late):.2g} ms {'after' if late > 0.0 else 'before'} the straight line"
        note += f" between their samples, as the surfaces agree: held over {share:.0%} of an interval"
        others = (tuple(n for n in record.notes if not n.startswith("inputs: ")) for record in self.records)
        noted = zip(self.records, others, strict=True)
        return replace(self, held=share, records=tuple(replace(r, notes=(*notes, note)) for r, notes in noted))

    def elsewhere(self, values: Mapping[str, float], records: Sequence[Record]) -> Flight:
        """Other records with the noise of this flight, and its aircraft with other values of its derivatives."""
        return self.with_records(with_estimates(self.aircraft, values, {}), records)

    def with_records(self, aircraft: Aircraft, records: Sequence[Record]) -> Flight:
        """Other records with the noise of this flight.

        Raises InputError if a record lacks inputs of the model or contains fewer than two of the outputs.
        """
        ready = [as_updated(flight_inputs(aircraft, record, self.axes), self.outputs) for record in records]
        ready = pulled_alike(ready, self.records)
        ready = tuple(with_all(record, self.outputs, self.criteria.noise) for record in _averaged(ready, self.every))
        same = aircraft is self.aircraft and force_inputs(ready) == force_inputs(self.records)
        built = {} if same else {"_models": {}, "_functions": {}}
        return replace(self, aircraft=aircraft, records=ready, _regressors={}, **built)


def of_aircraft(subject: Subject) -> Flight:
    """The flight of an aircraft that a part of a diagnosis is about. Raises TypeError for another subject."""
    if not isinstance(subject, Flight):
        raise TypeError(f"'{subject.title}' has no aerodynamics")
    return subject


def prepare(
    aircraft: Aircraft,
    records: Sequence[Record],
    criteria: Criteria | None = None,
    axes: str | None = None,
    *,
    average: bool = False,
) -> Flight:
    """Determine the outputs and their noise from the records, and the scope from the surfaces if it is not given.

    Offsets of all six coefficients are always estimated.

    average  whether samples are averaged to the rate that the motion needs (`_every`)
    raises   InputError if the records lack inputs of every model, or contain no outputs
    """
    criteria = criteria or Criteria()
    noise = criteria.noise
    axes = axes or axes_of(records)
    offsets = {f"{c}_0": 0.0 for c in aircraft.coefficients if f"{c}_0" not in aircraft.derivatives}
    aircraft = aircraft.with_derivatives(offsets | missing_derivatives(aircraft))
    modelled = aircraft_model(aircraft, axes=axes, equations=False).outputs
    moved = (*modelled, *(o for o in INTEGRATED[axes] if o not in _NOT_JUDGED))
    ready = pulled_alike(as_updated(flight_inputs(aircraft, record, axes), moved) for record in records)
    outputs = tuple(o for o in moved if moves(ready, o, noise))
    edge = motion_edge(ready)
    as_read = ready
    every = _every(ready, outputs, edge, criteria) if average else 1
    ready = _averaged(ready, every)
    stated = {name: value / math.sqrt(every) for name, value in aircraft.noise.items()}
    sigma = {o: stated.get(o) or sigma_of([r[o] for r in that_have(ready, o, noise)], noise) for o in outputs}
    rare = {o for o in moved if all(o in r and not has(r, o, noise) for r in ready)}
    left_out = {
        o: "too rarely read to tell of the motion" if o in rare else "constant in all records"
        for o in moved
        if o not in outputs
    }
    for acceleration, rate in RATE_OF.items():
        if {acceleration, rate} <= sigma.keys() and is_derived(ready, acceleration, sigma, noise):
            del sigma[acceleration]
            left_out[acceleration] = f"computed from {rate}, whose noise it has, and nothing new"
    outputs = tuple(sigma)
    ready = tuple(with_all(record, outputs, noise, left_out) for record in ready)
    inputs = {control(name): [r[name] for r in ready] for name in (*SURFACES, "thrust")}
    input_sigma = {
        name: stated.get(name[2:]) or pooled_sigma(series)
        for name, series in inputs.items()
        if np.ptp(np.concatenate(series)) > 0.0
    }
    input_sigma = {name: value for name, value in input_sigma.items() if np.isfinite(value) and value > 0.0}
    unsure = [o for o in outputs if not aircraft.noise.get(o)]
    held = {o: high_band_holds(that_have(as_read, o, noise), o, edge) for o in unsure}
    doubted = tuple(o for o in unsure if not held[o] or hides_noise(that_have(as_read, o, noise), o, noise))
    if len(doubted) >= noise.common_filter * len(outputs):  # a filter common to all channels: none shows its noise
        doubted = tuple(unsure)
    return Flight(
        aircraft=aircraft,
        axes=axes,
        outputs=outputs,
        records=ready,
        sigma=sigma,
        input_sigma=input_sigma,
        doubted=doubted,
        every=every,
        criteria=criteria,
    )


def _every(records: Sequence[Record], outputs: Sequence[str], edge: float, criteria: Criteria) -> int:
    """Return the number of samples that are averaged into one, so that the rate stays above what motion up to the
    frequency `edge` [Hz] needs.

    One if the motion is not known, or if a channel has another rate: the mean of its time would be another one.
    """
    complete = all(np.isfinite(r[o]).mean() > 1.0 - criteria.noise.present for r in records for o in outputs if o in r)
    if edge == 0.0 or not complete:
        return 1
    needed = criteria.numerics.samples_per_cycle * edge
    return max(1, int(min(1.0 / (record.dt * needed) for record in records) + 1e-6))


def _averaged(records: Sequence[Record], every: int) -> list[Record]:
    """The means of so many samples, with a note about it."""
    if every == 1:
        return list(records)
    found = []
    for record in records:
        note = f"{every} samples averaged into one, {1.0 / (every * record.dt):.3g} Hz, as the motion needs no more"
        found.append(averaged(record, every).with_notes(note))
    return found


_NOTHING: Mapping[str, str] = MappingProxyType({})


def as_updated(record: Record, outputs: Sequence[str]) -> Record:
    """The record without repeated readings, for `outputs` that a slower recorder updates."""
    slow = {}
    notes = []
    for name in (o for o in outputs if o in record):
        new = real_updates(record.t, record[name])
        if new.sum() < np.isfinite(record[name]).sum():
            slow[name] = np.where(new, record[name], np.nan)
            notes.append(f"{name}: {new.sum()} readings, each repeated until the next; repeats are left out")
    return replace(record.with_channels(**slow), notes=(*record.notes, *notes)) if slow else record


def has(record: Record, name: str, criteria: NoiseCriteria) -> bool:
    """Return True if the record contains enough samples of a channel."""
    return name in record and np.isfinite(record[name]).sum() > int(criteria.present * len(record))


def that_have(records: Sequence[Record], name: str, criteria: NoiseCriteria) -> list[Record]:
    """The records that contain enough samples of a channel."""
    return [record for record in records if has(record, name, criteria)]


def moves(records: Sequence[Record], name: str, criteria: NoiseCriteria) -> bool:
    """Return True if a channel is measured in some record and is not constant."""
    values = [record[name][np.isfinite(record[name])] for record in that_have(records, name, criteria)]
    return bool(values) and float(np.ptp(np.concatenate(values))) > 0.0


def with_all(
    record: Record, outputs: Sequence[str], criteria: NoiseCriteria, left_out: Mapping[str, str] = _NOTHING
) -> Record:
    """The record with all `outputs`; those that it does not measure have missing samples.

    It gets notes about these channels and about channels that are `left_out`, with the reason. Raises InputError if it
    measures fewer than two outputs.
    """
    shown = [name for name in outputs if has(record, name, criteria)]
    if len(shown) < 2:
        raise InputError(
            f"record '{record.name}': of the outputs {', '.join(outputs) or 'of the model'} it has only "
            f"{', '.join(shown) or 'none'}; at least two are needed: add the columns, or leave the record out"
        )
    absent = {name: np.full(len(record), np.nan) for name in outputs if name not in shown}
    notes = [f"{name}: not measured here, so the other records alone tell of it" for name in absent]
    notes += [f"{name}: {why}, so it is left out" for name, why in left_out.items() if name in record]
    return replace(record.with_channels(**absent), notes=(*record.notes, *notes)) if notes else record


def hides_noise(records: Sequence[Record], name: str, criteria: NoiseCriteria) -> bool:
    """Return True if the high band of a channel shows less than the smallest plausible noise."""
    series = [record[name] for record in records]
    return pooled_sigma(series) < criteria.smallest * float(np.nanstd(np.concatenate(series)))


def sigma_of(series: list[np.ndarray], criteria: NoiseCriteria) -> float:
    """1-sigma of the noise; the smallest plausible noise if there are too few samples."""
    noise = pooled_sigma(series, continuous=True)
    variation = float(np.nanstd(np.concatenate(series)))
    return max(noise if np.isfinite(noise) else 0.0, criteria.smallest * variation, 1e-12)


RATE_OF: Mapping[str, str] = MappingProxyType({"pdot": "p", "qdot": "q", "rdot": "r"})


def is_derived(
    records: Sequence[Record], acceleration: str, sigma: Mapping[str, float], criteria: NoiseCriteria
) -> bool:
    """Return True if an angular acceleration was computed from the rate of the same axis with a filter; `sigma` is
    their noise.

    A filter is fitted by least squares. If the acceleration was measured, the residual contains the noise of the rate,
    at least sigma |h|. If it was computed from the rate with such a filter, the residual is nearly zero. A longer
    filter, such as a smoother of the complete record, is recognised by its effect: the acceleration has less noise than
    any instrument, and much less than the differences of its rate.
    """
    rate = RATE_OF[acceleration]
    if _is_smoothed(records, acceleration, criteria):
        return True
    reach = criteria.differentiator
    pairs = [_pair(record, rate, acceleration, reach) for record in records]
    around, values = (np.concatenate(part) for part in zip(*pairs, strict=True))
    columns = np.column_stack([around, np.ones(len(values))])
    more = len(values) - columns.shape[1]
    if more <= 0:
        return False
    h = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = float(np.linalg.norm(values - columns @ h)) / math.sqrt(more)
    return left < criteria.differentiated * sigma[rate] * float(np.linalg.norm(h[:-1]))


def _is_smoothed(records: Sequence[Record], acceleration: str, criteria: NoiseCriteria) -> bool:
    """Return True if the high band of an acceleration has almost none of the noise that its variation and its rate
    imply."""
    both = [r for r in records if acceleration in r and RATE_OF[acceleration] in r]
    if not both:
        return False
    own, of_rate = (pooled_sigma([r[name] for r in both]) for name in (acceleration, RATE_OF[acceleration]))
    varies = float(np.nanstd(np.concatenate([r[acceleration] for r in both])))
    differences = of_rate / (math.sqrt(2.0) * float(np.median([r.dt for r in both])))
    return own < criteria.smallest * varies and own < criteria.differentiated * differences


def _pair(record: Record, rate: str, acceleration: str, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2 reach + 1) Samples of a rate around each of the (n,) samples of its acceleration, where all are present."""
    width = 2 * reach + 1
    if rate not in record or acceleration not in record or len(record) < width:
        return np.empty((0, width)), np.empty(0)
    around = np.lib.stride_tricks.sliding_window_view(record[rate], width)
    values = record[acceleration][reach:-reach]
    there = np.isfinite(around).all(axis=1) & np.isfinite(values)
    return around[there], values[there]
