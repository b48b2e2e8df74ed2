"""An aircraft with rotors as the subject of a diagnosis: it flies in closed loop, so that innovations judge it.

A multirotor integrates its moments four times into position, and its controller answers every disturbance: in open loop
no simulation follows a flight for longer than a second, and inputs are correlated with what disturbs the motion. The
filter therefore has process noise in every force and moment equation; its size, and that of the readings, is the most
likely one beside all parameters and a constant at every equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from casid.data_check.rotors import airborne
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.evidence.size import consequence
from casid.diagnosis.flight.bounds import possible
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import as_updated, moves
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import colour_of
from casid.diagnosis.flight.ported import Ported, PortSizes, for_systems, noise_of
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.flight.terms import term_along
from casid.diagnosis.given.as_given import attached_effects
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.sentences import noted, thrust_curve
from casid.errors import InputError
from casid.filtering.innovations import Linear, NoiseModel, PointFunctions, linearise, make_batch, padded
from casid.filtering.kalman import Filter, kalman_filter, residual_column
from casid.filtering.noise_levels import Levels, most_likely_levels
from casid.model.aircraft import Aircraft
from casid.model.causes.instruments import sensor_bias
from casid.model.causes.loading import mass
from casid.model.causes.rotors import rotor_delay, rotor_effectiveness, rotor_lag
from casid.model.dynamics import aircraft_model, flight_inputs, outputs_of
from casid.model.effect import Effect
from casid.model.effect_value import EffectValue
from casid.model.effects import catalogue, effect_of
from casid.model.path import (
    EQUATIONS,
    GROUND,
    INTEGRALS,
    SignalPath,
    air_data_station,
    disturbance_names,
    surface_station,
    wind_station,
)
from casid.model.port import ModelPort as Port
from casid.model.rotors import ALL, effectiveness
from casid.model.station import Station, control, equation
from casid.model.system import Model
from casid.model.terms import COEFFICIENTS, parse_term
from casid.records.noise import pooled_sigma
from casid.records.record import Record
from casid.records.thinning import averaged

_ACCELERATIONS = ("pdot", "qdot", "rdot")  # computed from the rates, and nothing new
_WORDS = {
    "u": "the force along x",
    "v": "the force along y",
    "w": "the force along z",
    "p": "the rolling moment",
    "q": "the pitching moment",
    "r": "the yawing moment",
}
_ALIKE = (("f_u", "f_v"), ("f_w",), ("f_p", "f_q"), ("f_r",))  # equations whose disturbances are of one size
_READ_BY = {"u": "ax", "v": "ay", "w": "az", "p": "p", "q": "q", "r": "r"}  # equation -> the reading that has its noise
_WHERE = (*INTEGRALS, *GROUND)  # readings whose offset is a choice of the origin, or none


def measured_outputs(aircraft: Aircraft, records: Sequence[Record], criteria: Criteria) -> tuple[str, ...]:
    """The channels of the motion that the records measure. Raises InputError where none measures rotation."""
    modelled = (*outputs_of(aircraft), *INTEGRALS, *GROUND)
    found = tuple(n for n in modelled if n not in _ACCELERATIONS and moves(records, n, criteria.noise))
    if not set(found) & {"p", "q", "phi", "theta", *GROUND[:2], "north", "east"}:
        raise InputError(
            f"record '{records[0].name}': no rate, attitude or motion over ground is measured; without any the rotors "
            f"of '{aircraft.name}' cannot be told apart"
        )
    return found


def with_stated_uncertainty(aircraft: Aircraft, criteria: Criteria) -> Aircraft:
    """The aircraft with a usual uncertainty of its rotors, and of the derivatives of its wing, where its file states
    none."""
    rotors = aircraft.required_rotors
    if not rotors.relative_uncertainty and not any(one.std for one in rotors.each):
        rotors = replace(rotors, relative_uncertainty=criteria.size.share)
    of_wing = aircraft.relative_uncertainty or (criteria.data.outlying if aircraft.winged else 0.0)
    return replace(aircraft, rotors=rotors, relative_uncertainty=of_wing)


def rotorcraft(aircraft: Aircraft, records: Sequence[Record], criteria: Criteria) -> tuple[Subject, Model]:
    """The subject of an aircraft with rotors and the records to be fitted, and its model as given.

    Raises InputError for records that lack an input of a rotor, or every rate.
    """
    aircraft = with_stated_uncertainty(aircraft, criteria)
    outputs = measured_outputs(aircraft, records, criteria)
    ready = prepared(aircraft, records, outputs, criteria.rotors.rate)
    own = [value for value in aircraft.effects if _in_every_flight(value)]
    build = partial(_built, aircraft, outputs, tuple(map(effect_of, own)))
    base = build(())
    offsets = {f"bias_{name}": _usual_offset(name, aircraft) for name in outputs if name not in _WHERE}
    guess = np.concatenate([base.guess(record) for record in ready])
    seen = dict(zip(base.states, np.sqrt(np.mean(guess**2, axis=0)).tolist(), strict=True))
    scale = {name: max(seen[name], criteria.rotors.smallest) for name in base.states}
    stated = offsets | {effect_of(value).name: value.std for value in own if value.std}
    nominal = dict(base.nominal) | {effect_of(value).name: value.value for value in own}
    base = replace(base, nominal=nominal, prior_std={**base.prior_std, **stated}, state_scale=scale)
    ports = (
        *(Port(kind="state derivative", name=name, words=_WORDS[name]) for name in _WORDS),
        *(Port(kind="output", name=name) for name in outputs),
    )
    rotors = aircraft.required_rotors
    commanded = {name: pooled_sigma([record[name] for record in ready]) for name in rotors.names}
    by_band = NoiseModel(
        measurement=noise_of(base, ready, criteria.noise),
        white=_usual_disturbances(aircraft, criteria.parts.tenth),
        inputs={control(name): sigma for name, sigma in commanded.items() if np.isfinite(sigma) and sigma > 0.0},
    )
    every = [possible(e, aircraft, criteria.size) for e in catalogue(aircraft, outputs) if _can_show(e, aircraft)]
    there = {effect_of(value).key for value in aircraft.effects}
    terms = _terms_of_wing(aircraft, base, every)
    told = [e for e in every if e.regressor in terms or (e.regressor is None and e.target not in COEFFICIENTS)]
    effects = [_in_all_records(e) for e in told if e.key not in there]
    channels = tuple(name for name in ready[0].channels if name not in (*outputs, *base.inputs))
    of = Ported(base=base, ports=ports, terms=terms, channels=channels)
    flight = Subject(
        **_of_model(of, build),
        file=aircraft,
        freed=tuple(name for name in base.parameters if name in base.prior_std),
        records=ready,
        sigma=dict(by_band.measurement),
        white=by_band.white,
        input_sigma=dict(by_band.inputs),
        criteria=for_systems(criteria, float(np.median([record.duration for record in ready]))),
        catalogue=lambda _: effects,
        sizes=RotorSizes(aircraft=aircraft, at_ports=PortSizes(ports={port.station: port for port in ports})),
        by_innovations=True,
        imitated={effectiveness(name): _judged_as_stated(rotor_effectiveness(name)) for name in rotors.names},
    )
    return _with_noise(flight, base, by_band), base


def known_effects(flight: Subject, names: Sequence[str]) -> tuple[Attached, ...]:
    """The effects of the file that act in the records of some names, and are no numbers of the model."""
    aircraft = flight.aircraft
    others = tuple(value for value in aircraft.effects if not _in_every_flight(value))
    return tuple(attached_effects(replace(aircraft, effects=others), names))


Build = Callable[[Sequence[Effect]], Model]


def _of_model(of: Ported, build: Build) -> dict[str, Any]:
    """The fields of the subject that depend on the model as given."""

    def built(flight: Subject, effects: Sequence[Effect]) -> Model:
        base = of.base
        model = build(effects)
        own = {"nominal": {**model.nominal, **base.nominal}, "prior_std": base.prior_std}
        return replace(model, state_scale=base.state_scale, **own)

    def elsewhere(flight: Subject, values: Mapping[str, float], records: Sequence[Record]) -> Subject:
        base = replace(of.base, nominal={**of.base.nominal, **values})
        ready = prepared(flight.aircraft, records, flight.outputs, flight.criteria.rotors.rate)
        return flight.changed(**_of_model(replace(of, base=base), build), records=ready)

    return {**of.fields(), "build": built, "elsewhere_of": elsewhere}


def _terms_of_wing(aircraft: Aircraft, base: Model, effects: Iterable[Effect]) -> dict[str, ca.SX]:
    """Term -> expression of it in states and inputs, for terms that effects multiply in a coefficient of the wing; of
    the rates of the flow angles there are none."""
    if not aircraft.winged:
        return {}
    named = dict(zip((*base.states, *base.inputs), (*ca.vertsplit(base.x), *ca.vertsplit(base.u)), strict=True))
    still = dict.fromkeys(disturbance_names(aircraft), ca.SX(0))
    path = SignalPath(aircraft=aircraft, state=named, inputs=named, parameter={}, disturbance=still)
    for along in (surface_station, wind_station, air_data_station):
        along(path)
    terms = {one.regressor: parse_term(one.regressor) for one in effects if one.regressor}
    return {name: ca.SX(term.evaluate(path.regressor)) for name, term in terms.items() if "dot" not in name}


def _with_noise(flight: Subject, base: Model, by_band: NoiseModel) -> Subject:
    """The flight with its most likely noise: about the file as given, and once more about its fit under that noise."""
    values: Mapping[str, float] = {}
    for again in (False, True):
        at = replace(base, nominal={**base.nominal, **values})
        noise = most_likely_noise(at, flight.records, flight.freed, by_band, flight.criteria)
        own = {"white": noise.white, "input_sigma": dict(noise.inputs)}
        flight = replace(flight, sigma=dict(noise.measurement), **own)
        values = values if again else first_fit(flight).derivatives
    return flight


def before_vertical(record: Record, step: float) -> tuple[Record, tuple[NotJudged, ...]]:
    """The part of a record before its pitch can pass the vertical within a `step` [s], and what is then not judged: the
    Euler angles of the model have no rates there."""
    if "theta" not in record:
        return record, ()
    turns = record["q"] if "q" in record else np.gradient(record["theta"], record.t)
    steep = np.abs(record["theta"]) + step * np.abs(turns) >= 0.5 * math.pi  # False where it was not read
    if not steep.any() or not (before := int(np.argmax(steep))):
        return record, ()
    because = "the nose passes the vertical, where the model has no angles"
    left = NotJudged(what=f"{record.name} from {record.t[before]:.1f} s on", because=because)
    return record.between(record.t[0], record.t[before] - 0.5 * record.dt), (left,)


def _usual_offset(channel: str, aircraft: Aircraft) -> float:
    """Prior 1-sigma of the offset of an instrument: of a small one, as large as matters."""
    return float(sensor_bias(channel).smallest_that_matters(aircraft) or np.inf)


def prepared(aircraft: Aircraft, records: Iterable[Record], outputs: Sequence[str], rate: float) -> tuple[Record, ...]:
    """The records with all inputs of the model, without readings that only repeat the one before, without what is on
    the ground, and without the beginning, at which the speed of the rotors depends on commands before it."""
    ready = (as_updated(flight_inputs(aircraft, _in_flight(aircraft, record)), outputs) for record in records)
    return tuple(averaged(one, every) if (every := int(1.0 / (one.dt * rate))) > 1 else one for one in ready)


def _in_flight(aircraft: Aircraft, record: Record) -> Record:
    first, last = airborne(record, aircraft.required_rotors)
    settled = max(one.delay + 3.0 * one.lag for one in aircraft.required_rotors.each)
    begin = first + settled if settled < 0.5 * (last - first) else first
    return record.between(begin, last + 0.5 * record.dt)


def _built(aircraft: Aircraft, outputs: Sequence[str], own: Sequence[Effect], effects: Sequence[Effect]) -> Model:
    return aircraft_model(aircraft, outputs=outputs, effects=(*own, *effects), equations=False)


def _in_every_flight(value: EffectValue) -> bool:
    """Return True if an effect of the file is a number of the model, as uncertain as the file states; others are
    attached."""
    effect = effect_of(value)
    return effect.symbolic and not (value.records or value.onset_s or effect.states)


def _judged_as_stated(effect: Effect) -> Effect:
    """An effect that is judged against the stated uncertainty of its number."""
    return replace(effect, size=replace(effect.size, stated=True))


def _in_all_records(effect: Effect) -> Effect:
    """An effect of the loading shows in all records: the thrust of the rotors is known as well as weight is."""
    return replace(effect, traits=replace(effect.traits, relative=False, shows_as=()))


def _can_show(effect: Effect, aircraft: Aircraft) -> bool:
    """Return True if an effect can show in this model: moving air only where something depends on it."""
    rotors = aircraft.required_rotors
    moved_by_air = aircraft.winged or any(rotors.drag) or rotors.inflow
    return bool(moved_by_air) or effect.enters is None or not effect.enters.startswith("wind_")


def most_likely_noise(
    model: Model, records: Sequence[Record], free: Sequence[str], start: NoiseModel, criteria: Criteria
) -> NoiseModel:
    """The noise of readings and inputs, and process noise, by coordinate ascent of the likelihood.

    A command is logged at another time than the one at which it acts, and more slowly than it changes. At the `start`,
    the noise of the readings is that of their high band: a reading may have more, for a filter or a slow update hides
    some of it, and hardly less.
    """
    linear = _smoothed(model, records, free, start)
    sigma = dict(start.measurement)
    white = dict(start.white)
    Z = linear.residual + linear.output
    wide = 1.0 / criteria.noise.smallest
    bounds = {name: (value / wide, value * wide) for name, value in white.items()}
    for i, (name, quick) in enumerate(start.measurement.items()):
        varies = float(np.std(Z[..., i][linear.seen[..., i]]))
        bounds[name] = (criteria.parts.half * quick, max(criteria.parts.quarter * varies, quick))
    inputs = dict(start.inputs)
    for name, value in inputs.items():  # at most all that varies
        series = np.concatenate([record[Station.at(name).name] for record in records])
        bounds[name] = criteria.parts.half * value, max(float(np.std(series)), value)
    groups = [*_ALIKE, *((name,) for name in sigma), *([tuple(inputs)] if inputs else [])]

    def noise(levels: Levels) -> NoiseModel:
        readings, equations, logged = ({name: levels[name] for name in one} for one in (sigma, white, inputs))
        return replace(start, measurement=readings, white=equations, inputs=logged)

    found = most_likely_levels(
        sigma | white | inputs,
        bounds,
        lambda levels: _deviance(linear, noise(levels)),
        groups,
        criteria.parts.steps,
        criteria.numerics.naming.trials,
        criteria.numerics.fit.rough[1],
    )
    return noise(found)


def first_fit(flight: Subject) -> FlightFit:
    """The file with its numbers estimated, and the timing of its inputs, which no record determines to a sample.

    What is later than a log may be late is a cause: the timing is then that of the record, so that causes compete.
    """
    known = known_effects(flight, flight.names)
    late = Attached(effect=rotor_delay(ALL), values={"value": 0.0}, nuisance=True)
    if any(one.effect.key == late.effect.key for one in known):
        return fit(flight, known, flight.noise(), extent="settled")
    fitted = fit(flight, (*known, late), flight.noise(), extent="settled")
    surely = abs(fitted[late.name]) - flight.criteria.significance.sigmas * fitted.std(late.name)
    if surely < (flight.smallest_that_matters(late.effect) or np.inf):
        return fitted
    return fit(flight, known, flight.noise(), extent="settled")


def in_its_colour(flight: Subject, fitted: FlightFit) -> tuple[Subject, FlightFit]:
    """The flight and its fit with innovations as coloured as those of the fit: what disturbs a multirotor lasts longer
    than a sample.

    Its correlation time tau is at most the longest that records of length T can separate from an infinite one, as its
    relative 1-sigma is sqrt(2 tau / T): what may as well last for ever is no noise, but something that the model lacks.
    """
    length = sum(record.duration for record in flight.records)
    longest = length / (2.0 * fitted.criteria.significance.sigmas**2)
    for _ in range(fitted.criteria.numerics.fit.repeats):
        before = flight.colour
        colour = colour_of(fitted, flight.outputs, longest)
        flight = replace(flight, colour=colour)
        fitted = fit(flight, fitted.attached, flight.noise(), fitted, extent="settled")
        stays = fitted.criteria.numerics.fit.stays
        if before and all(abs(np.log(colour[o][0] / before[o][0])) < stays for o in colour):
            break
    return flight, fitted


def _smoothed(model: Model, records: Sequence[Record], free: Sequence[str], noise: NoiseModel) -> Linear:
    """The model linearised about the motion that a smoother makes of the measured one."""
    functions = PointFunctions(model, free)
    batch = make_batch(model, records)
    P = np.tile(model.nominal_vector(), (len(records), 1))
    X = padded([model.guess(record) for record in records])
    measured = linearise(functions, batch, P, X)
    try:
        moved, _ = kalman_filter(measured, noise).smooth(*residual_column(measured))
    except np.linalg.LinAlgError:  # readings so exact that their covariance is no more than rounding: they stay
        return measured
    return linearise(functions, batch, P, X + moved[..., : len(model.states)])


def _deviance(linear: Linear, noise: NoiseModel) -> float:
    """Deviance under a noise, with the free parameters and a constant at every equation of motion eliminated; infinite
    where rounding leaves the innovations no density."""
    try:
        found = _eliminated(linear, kalman_filter(linear, noise), list(noise.white))
    except np.linalg.LinAlgError:
        return math.inf
    return found if math.isfinite(found) else math.inf


def _eliminated(linear: Linear, kalman: Filter, disturbed: Sequence[str]) -> float:
    """Deviance of a filter, with the free parameters and a constant at the `disturbed` equations eliminated."""
    stations = [linear.model.disturbances.index(name) for name in disturbed]
    ones = np.ones((*linear.X.shape[:2], len(stations)))
    left = kalman.whiten(*residual_column(linear)).reshape(-1)
    columns = [kalman.whiten_histories(stations, ones), kalman.whiten(linear.Dp, linear.Bp)]
    basis = np.concatenate([one.reshape(len(left), -1) for one in columns], axis=1)
    negligible = np.abs(basis) < np.sqrt(np.finfo(float).tiny)  # products below the normal numbers are slow
    basis[negligible] = 0.0
    scale = np.sqrt(np.sum(basis**2, axis=0))
    basis = basis[:, scale > 0.0] / scale[scale > 0.0]
    values, vectors = np.linalg.eigh(basis.T @ basis)
    kept = values > 1e-10 * values[-1]
    taken = (vectors[:, kept].T @ (basis.T @ left)) ** 2 / values[kept]
    return float(left @ left - taken.sum() + np.sum(kalman.log_determinant))


def _usual_disturbances(aircraft: Aircraft, part: float) -> dict[str, float]:
    """Equation -> 1-sigma of process noise that a part of the weight makes, at the arm of a rotor."""
    force = part * aircraft.gravity
    arm = max(math.hypot(*one.position[:2]) for one in aircraft.required_rotors.each)
    moment = force * aircraft.mass * arm
    inertia = {"p": aircraft.inertia.Ixx, "q": aircraft.inertia.Iyy, "r": aircraft.inertia.Izz}
    return {equation(n): moment / inertia[n] if n in inertia else force for n in EQUATIONS}


def too_small_for_rotors(aircraft: Aircraft, detectable: Mapping[str, float], criteria: Criteria) -> list[NotJudged]:
    """List what the records cannot show of rotors and mass: sizes below the smallest that would have shown. A rotor is
    judged against its stated uncertainty, as one number and not as the best of many."""
    alone = criteria.significance.sigmas / criteria.significance.detectable
    each = [alone * detectable.get(rotor_effectiveness(name).name, math.inf) for name in aircraft.required_rotors.names]
    sizes = (
        ("a change of the thrust of one rotor under {:.0f} %", 100.0 * max(each)),
        ("a lag of all rotors that differs by less than {:.2g} s", detectable.get(rotor_lag(ALL).name, math.inf)),
        ("a mass that differs by less than {:.2g} kg", detectable.get(mass().name, math.inf)),
    )
    told = [sentence.format(size) for sentence, size in sizes if math.isfinite(size)]
    because = "the controller answers what disturbs the flight, and less would not have shown in these records"
    return [NotJudged(what=", ".join(told), because=because)] if told else []


def with_thrust_curve(found: Diagnosis) -> Diagnosis:
    """The diagnosis with the thrust by the records in words, beside the first cause that changes the curve of the
    file."""
    weight = found.extended_aircraft.mass * found.extended_aircraft.gravity
    rotors = found.extended_aircraft.required_rotors
    changing = []
    for cause in found.causes:
        make = cause.effect.forms.into_rotors
        held = make(rotors, weight, cause.value) if make else None
        if held and [one.thrust for one in held.each] != [one.thrust for one in rotors.each]:
            changing.append(cause)
        rotors = held or rotors
    told = [noted(one, thrust_curve(rotors, weight)) if one in changing[:1] else one for one in found.causes]
    return replace(found, causes=tuple(told))


@dataclass(frozen=True, kw_only=True)
class RotorSizes:
    """Size of a cause of an aircraft with rotors, in units of the smallest that matters."""

    aircraft: Aircraft
    at_ports: PortSizes

    def share_of(self, fit: FlightFit, one: Attached) -> float:
        """The value over the smallest that matters; for a reading, or for a time, not more than its consequence."""
        if one.effect.regressor is not None:
            return self._of_term(fit, one)
        smallest = one.effect.smallest_that_matters(self.aircraft)
        own = np.inf if smallest is None else abs(one.values["value"]) / smallest
        return min(own, consequence(fit, one))

    def _of_term(self, fit: FlightFit, one: Attached) -> float:
        """Largest r.m.s. acceleration by a term of the wing, over that by the part of the weight that matters, at the
        arm of a rotor for the moments."""
        linear = fit.linear
        at = fit.model.disturbances.index(str(one.effect.enters))
        term = np.broadcast_to(term_along(one.effect.regressor or "", fit.regressors), fit.batch.live.shape)
        rates = one.values["value"] * term[:-1, :, None] * (linear.Bw0 + linear.Bw1)[..., at] / linear.dt[..., None]
        least = _usual_disturbances(self.aircraft, fit.criteria.size.share)
        sizes = [np.sqrt(np.mean(rates[..., fit.model.states.index(n)] ** 2)) / least[equation(n)] for n in EQUATIONS]
        return float(max(sizes))

    def told(self, fit: FlightFit, one: Attached, std: float) -> tuple[float, float]:
        """Value and 1-sigma of a cause for a person."""
        return one.effect.in_words(one.values)["value"], std

    def told_at(self, fit: FlightFit, missing: Sequence[MissingInput]) -> list[MissingInput]:
        """The strongest of the latent inputs, with its port in words."""
        return self.at_ports.told_at(fit, missing)

    def missing_share(self, fit: FlightFit, missing: MissingInput) -> float:
        """R.m.s. of the latent input at a port over the variation there."""
        return self.at_ports.missing_share(fit, missing)

    def missing_size(self, fit: FlightFit, missing: MissingInput) -> float:
        """The same in units of what matters."""
        return self.at_ports.missing_size(fit, missing)
