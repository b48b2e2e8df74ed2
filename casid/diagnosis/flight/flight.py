"""The records of an aircraft, prepared for its model, and the noise of every channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from casid.diagnosis.criteria import Criteria, NoiseCriteria
from casid.diagnosis.evidence.size import AircraftSizes
from casid.diagnosis.flight.bounds import possible
from casid.diagnosis.flight.hypothesis import derivative_std
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.flight.terms import Table, Terms
from casid.errors import InputError
from casid.filtering.innovations import make_batch
from casid.model import operators
from casid.model.aircraft import Aircraft
from casid.model.causes.instruments import sensor_bias
from casid.model.dynamics import INTEGRATED, aircraft_model, flight_inputs, moved_coefficients
from casid.model.effect import Effect
from casid.model.effects import catalogue
from casid.model.flown_records import axes_of, with_estimates
from casid.model.measured_force import force_inputs, pulled_alike
from casid.model.path import (
    AIR_STATES,
    STATES,
    SignalPath,
    aerodynamic_parameters,
    air_data_station,
    disturbance_names,
    given_series,
    surface_station,
    wind_station,
)
from casid.model.station import Station, coefficient, control, reading, wind
from casid.model.system import Model
from casid.model.terms import IN_PLANE, OUT_OF_PLANE, Term, parse_term
from casid.model.usual_derivatives import missing_derivatives
from casid.records.noise import pooled_sigma, real_updates
from casid.records.noise_spectrum import density_sigma, high_band_holds, motion_edge
from casid.records.record import Record
from casid.records.thinning import averaged
from casid.signals import SURFACES

# If altitude were an output, a steady updraft, which is common, would appear as a bias of alpha.
_NOT_JUDGED = ("altitude", "north", "east")


def _airframe(aircraft: Aircraft, axes: str, records: Sequence[Record], outputs: Sequence[str]) -> dict[str, Any]:
    """The fields of a subject that depend on the aircraft, the scope, and the motion of the records."""
    states = {"full": ("u", "v", "w"), "longitudinal": ("u", "w"), "lateral": ("v",)}[axes]
    winds = [wind(axis) for axis, state in zip("xyz", "uvw", strict=True) if state in states]
    moved = tuple(moved_coefficients(aircraft, axes))
    terms = tuple(aerodynamic_parameters(aircraft))
    # derivatives, terms and knots of tables that act on the states; not those of a surface that does not move
    acting = [(name, term) for c, name, term in terms if c in moved]
    at_rest = resting(records)
    still = {name for name, term in acting if any(v in at_rest for v, _ in parse_term(term).factors)}
    knots = [name for name, coefficient in aircraft.knots.items() if coefficient in moved]
    return {
        "file": aircraft,
        "title": aircraft.name,
        "axes": axes,
        "coefficients": aircraft.coefficients,
        "moved": moved,
        "terms": terms,
        "stations": [*map(coefficient, moved), *winds],
        "readings": [reading(name) for name in outputs],
        "offsets": [sensor_bias(name) for name in outputs],
        "freed": (*(name for name, _ in acting if name not in still), *knots),
    }


def resting(records: Sequence[Record]) -> tuple[str, ...]:
    """Surfaces that do not move: their derivatives are part of the offsets."""
    return tuple(s for s in SURFACES if not np.ptp(np.concatenate([record[s] for record in records])) > 0.0)


def _built(flight: Subject, effects: Sequence[Effect]) -> Model:
    scope: dict[str, Any] = {"axes": flight.axes, "outputs": flight.outputs, "turning": flight.turning}
    known = force_inputs(flight.records)
    return aircraft_model(flight.aircraft, effects=effects, known=known, equations=False, **scope)


def _regressors(flight: Subject, model: Model) -> Terms:
    """The aerodynamic regressors, with those by rates of change of the flow angles, and the aircraft's own aerodynamics
    (`given_series`)."""
    aircraft = flight.aircraft
    named = dict(zip((*model.states, *model.inputs), (*ca.vertsplit(model.x), *ca.vertsplit(model.u)), strict=True))
    moving = dict(zip(model.disturbances, ca.vertsplit(model.w), strict=True))
    air = [AIR_STATES[axis][0] for axis in flight.turning]
    path = SignalPath(
        aircraft=aircraft,
        state={s: named[s] for s in (*STATES, *air) if s in named},
        inputs=named,
        parameter={},
        turning={axis: sign for axis, sign in flight.turning.items() if AIR_STATES[axis][0] in named},
        disturbance={d: moving.get(d, ca.SX(0)) for d in disturbance_names(aircraft)},
    )
    for station in (surface_station, wind_station, air_data_station):
        station(path)
    lengths = {"alpha": aircraft.rate_length_pitch, "beta": aircraft.rate_length_lateral}

    def further(motion: Table, table: Table, t: np.ndarray, ahead: bool) -> Table:
        """Rates of the flow angles are from finite differences, of samples before alone where the motion is predicted
        `ahead`."""
        found = {name: motion[name] for name in ("phi", "theta") if name in motion}
        found |= {f"rate_{name}": motion[name] for name in "pqr" if name in motion}  # [rad/s]
        if all(name in motion for name in operators.TURNING):
            columns = zip(t.T, *(motion[name].T for name in operators.TURNING), strict=True)
            found["turned"] = np.stack([operators.turned(*column) for column in columns], axis=1)
        slope = _since_the_last if ahead else np.gradient
        airspeed = table.pop(_AIRSPEED)
        for angle, length in lengths.items():
            rate = [slope(series, at) for series, at in zip(table[angle].T, t.T, strict=True)]
            found[f"{angle}dot"] = np.stack(rate, axis=1) * length / airspeed
        return found

    rows = {**path.regressor, **given_series(path), _AIRSPEED: path.air["V"]}
    measured = flight.measured(model)
    batch = make_batch(model, flight.records)
    return Terms(model, batch, rows, measured, flight.input_sigma, further=further, quiet=True)


_AIRSPEED = " V"  # row of the airspeed, which is no regressor


def _since_the_last(series: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Rates of change (N,) from the sample before; that of the first sample is zero."""
    return np.concatenate([np.zeros(1), np.diff(series) / np.diff(t)])


def _effects(flight: Subject) -> list[Effect]:
    """Every deterministic effect that these records can show."""
    aircraft = flight.aircraft
    every = [possible(e, aircraft, flight.criteria.size) for e in catalogue(aircraft, flight.outputs)]
    known = [e for e in every if e.target not in flight.unknown and not e.kind.startswith(flight.unknown)]
    still = _still(flight)
    told = [e for e in known if e.regressor is None or not still & parse_term(e.regressor).variables]
    stretches = _stretches(flight, every)
    return [e for e in told if e.regressor is None or "[" not in e.regressor or e.name in stretches]


def _still(flight: Subject) -> frozenset[str]:
    """Variables whose terms are not identifiable: those of axes out of scope, and angles that do not move.

    The product with a constant variable equals the term of the other variables, which symmetry may forbid.
    """
    angles = ("alpha", "beta", *SURFACES)
    moves = {a: [record[a] for record in flight.records if a in record] for a in angles}
    rest = {a for a, x in moves.items() if x and np.nanstd(np.concatenate(x)) < flight.criteria.noise.smallest}
    out_of_axes = {"longitudinal": OUT_OF_PLANE, "lateral": IN_PLANE}.get(flight.axes, ())
    return frozenset({*rest, *out_of_axes})


def _stretches(flight: Subject, effects: Sequence[Effect]) -> frozenset[str]:
    """Names of the stretches of tables that these records reach.

    Of stretches with the same effect in these records only the first is returned: a breakpoint without a sample
    near it makes no difference.
    """
    found: dict[tuple[str, bytes], str] = {}
    for effect in effects:
        if effect.regressor is None or "[" not in effect.regressor:
            continue
        moves = flight.regressors(flight.model())
        term = parse_term(effect.regressor)
        share, series = (moves.measured(part) for part in (Term(factors=(), stretches=term.stretches), term))
        if np.ptp(share) > 0.0:
            # Series that differ by rounding only are equal in single precision.
            found.setdefault((effect.target, np.float32(1.0 + series).tobytes()), effect.name)
    return frozenset(found.values())


def with_aircraft(flight: Subject, aircraft: Aircraft) -> Subject:
    """The same records with another aircraft."""
    return flight.changed(**_airframe(aircraft, flight.axes, flight.records, flight.outputs))


def within_the_motion(flight: Subject) -> Subject:
    """The flight with only as many readings of doubted outputs as twice the band of the motion needs."""
    edge = motion_edge(flight.records)
    if not flight.noise_by_fit or edge == 0.0:
        return flight
    spacing = 0.5 / (2.0 * edge)  # up to the octave above
    return replace(flight, spacing=spacing, _regressors={})


def with_noise_above(flight: Subject, left: Sequence[Record]) -> Subject:
    """The flight with the noise of doubted outputs raised according to `left`, the residuals of every record.

    Residuals in the octave above the motion (`motion_edge`) are counted, at most as much as was measured there,
    which is used alone where a simulation that departed left no residuals of a channel.
    This assumes that the noise has the same density below that octave, and that the residuals in it are no fault.
    """
    edge = motion_edge(flight.records)
    if edge == 0.0:
        return flight
    raised = {}
    criteria = flight.criteria.noise
    for name in flight.doubted:
        both = (that_have(records, name, criteria) for records in (left, flight.records))
        density = min((density_sigma(of, name, (edge, 2.0 * edge)) for of in both if of), default=0.0)
        if density > flight.criteria.parts.otherwise * flight.sigma[name]:
            raised[name] = density
    return replace(flight, sigma=flight.sigma | raised)


def with_filtered_inputs(flight: Subject) -> Subject:
    """The flight with the noise of inputs as dense in the band of the motion as a filter common to all channels
    left it.

    If most outputs were filtered, the noise of the inputs exceeds their high band by the same factor as that of the
    outputs. The spectrum of an input itself does not show this, since an input may have any motion.
    """
    edge = motion_edge(flight.records)
    criteria = flight.criteria.noise
    filtered = _filtered(flight, flight.outputs, edge)
    factors = [flight.sigma[o] / sigma_of([r[o] for r in of], criteria) for o, of in filtered.items()]
    if len(factors) < flight.criteria.parts.most * len(flight.outputs):
        return flight
    names = [Station.at(name).name for name in flight.input_sigma]
    stated = flight.aircraft.noise
    unstated = [name for name in _filtered(flight, names, edge) if not stated.get(name)]
    factor = max(float(np.median(factors)), 1.0)
    denser = {control(name): factor * flight.input_sigma[control(name)] for name in unstated}
    return replace(flight, input_sigma=flight.input_sigma | denser, _regressors={})


def _filtered(flight: Subject, names: Sequence[str], edge: float) -> dict[str, list[Record]]:
    """Channels whose high band does not show their noise, with the records that contain them."""
    having = {name: that_have(flight.records, name, flight.criteria.noise) for name in names}
    return {name: records for name, records in having.items() if not high_band_holds(records, name, edge)}


def with_inputs_held(flight: Subject, share: float) -> Subject:
    """The flight with inputs held over a share of the sample interval (`Batch.held`), and a note about it."""
    late = 0.5e3 * share * float(np.median([record.dt for record in flight.records])) / flight.every
    note = f"inputs: taken to act {abs(late):.2g} ms {'after' if late > 0.0 else 'before'} the straight line"
    note += f" between their samples, as the surfaces agree: held over {share:.0%} of an interval"
    others = (tuple(n for n in record.notes if not n.startswith("inputs: ")) for record in flight.records)
    noted = zip(flight.records, others, strict=True)
    return replace(flight, held=share, records=tuple(replace(r, notes=(*notes, note)) for r, notes in noted))


def _elsewhere(flight: Subject, values: Mapping[str, float], records: Sequence[Record]) -> Subject:
    """Other records with the noise of this flight, and its aircraft with other values of its derivatives.

    Raises InputError if a record lacks inputs of the model or contains fewer than two of the outputs.
    """
    aircraft = with_estimates(flight.aircraft, values, {}) if values else flight.aircraft
    ready = [as_updated(flight_inputs(aircraft, record, flight.axes), flight.outputs) for record in records]
    ready = pulled_alike(ready, flight.records)
    ready = tuple(with_all(record, flight.outputs, flight.criteria.noise) for record in _averaged(ready, flight.every))
    fields = {**_airframe(aircraft, flight.axes, ready, flight.outputs), "records": ready}
    if aircraft is flight.aircraft and force_inputs(ready) == force_inputs(flight.records):
        return replace(flight, **fields, _regressors={})
    return flight.changed(**fields)


def prepare(
    aircraft: Aircraft,
    records: Sequence[Record],
    criteria: Criteria | None = None,
    axes: str | None = None,
    *,
    average: bool = False,
) -> Subject:
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
        if {acceleration, rate} <= sigma.keys() and is_derived(ready, acceleration, sigma, criteria):
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
    if len(doubted) >= criteria.parts.most * len(outputs):  # a filter common to all channels: none shows its noise
        doubted = tuple(unsure)
    return Subject(
        **_airframe(aircraft, axes, ready, outputs),
        outputs=outputs,
        records=ready,
        sigma=sigma,
        input_sigma=input_sigma,
        doubted=doubted,
        every=every,
        criteria=criteria,
        sizes=AircraftSizes(),
        build=_built,
        terms_of=_regressors,
        catalogue=_effects,
        prior_of=derivative_std,
        elsewhere_of=_elsewhere,
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


def is_derived(records: Sequence[Record], acceleration: str, sigma: Mapping[str, float], criteria: Criteria) -> bool:
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
    reach = round(0.5 * criteria.numerics.samples_per_cycle)
    pairs = [_pair(record, rate, acceleration, reach) for record in records]
    around, values = (np.concatenate(part) for part in zip(*pairs, strict=True))
    columns = np.column_stack([around, np.ones(len(values))])
    more = len(values) - columns.shape[1]
    if more <= 0:
        return False
    h = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = float(np.linalg.norm(values - columns @ h)) / math.sqrt(more)
    return left < criteria.parts.most * sigma[rate] * float(np.linalg.norm(h[:-1]))


def _is_smoothed(records: Sequence[Record], acceleration: str, criteria: Criteria) -> bool:
    """Return True if the high band of an acceleration has almost none of the noise that its variation and its rate
    imply."""
    both = [r for r in records if acceleration in r and RATE_OF[acceleration] in r]
    if not both:
        return False
    own, of_rate = (pooled_sigma([r[name] for r in both]) for name in (acceleration, RATE_OF[acceleration]))
    varies = float(np.nanstd(np.concatenate([r[acceleration] for r in both])))
    differences = of_rate / (math.sqrt(2.0) * float(np.median([r.dt for r in both])))
    return own < criteria.noise.smallest * varies and own < criteria.parts.most * differences


def _pair(record: Record, rate: str, acceleration: str, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2 reach + 1) Samples of a rate around each of the (n,) samples of its acceleration, where all are present."""
    width = 2 * reach + 1
    if rate not in record or acceleration not in record or len(record) < width:
        return np.empty((0, width)), np.empty(0)
    around = np.lib.stride_tricks.sliding_window_view(record[rate], width)
    values = record[acceleration][reach:-reach]
    there = np.isfinite(around).all(axis=1) & np.isfinite(values)
    return around[there], values[there]
