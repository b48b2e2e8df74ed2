"""A model with ports as the subject of a diagnosis: its noise, terms, first fit and sizes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from casid.criterion import in_time
from casid.diagnosis.criteria import Criteria, NoiseCriteria
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.flight.evaluation import FlightFit, Work, evaluate
from casid.diagnosis.flight.fit import by_wider_noise, fit
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.flight.terms import Terms
from casid.errors import EstimationError, InputError
from casid.estimation import Problem, solve
from casid.filtering.innovations import (
    Linear,
    NoiseModel,
    PointFunctions,
    brought_inside,
    linearise,
    make_batch,
    moved_inside,
    padded,
)
from casid.filtering.kalman import kalman_filter, residual_column
from casid.model.causes.instruments import level
from casid.model.effect import Effect
from casid.model.in_force import InForce
from casid.model.library import Library, as_term, effects_of, frictions_of
from casid.model.port import ModelPort as Port
from casid.model.port import ports_of, with_ports
from casid.model.station import Station, as_read, control, stuck
from casid.model.system import Model
from casid.model.with_effects import Draft
from casid.records.noise import pooled_sigma
from casid.records.record import Record


def with_ports_of(subject: Subject, effects: Sequence[Effect], of: Ported) -> Model:
    """The model with its ports as disturbances, and symbolic `effects` among its parameters."""
    base = of.base
    draft = Draft(base, of.terms)
    symbols = {effect.name: ca.SX.sym("value") for effect in effects}
    for effect in effects:
        assert effect.change is not None
        sizes = effect.further.grid[0] if effect.further.grid else {}
        effect.change(draft, {**sizes, "value": symbols[effect.name]})
    made = draft.made([InForce(effect=effect, name=effect.name) for effect in effects], symbols)
    h = ca.SX(made.h)
    read = [port.name for port in of.ports if port.kind == "output"]
    loses = ca.SX.sym("stuck", len(read))
    for k, name in enumerate(read):
        h[base.outputs.index(name)] *= 1.0 - loses[k]
    model = replace(
        made,
        disturbances=(*base.disturbances, *map(stuck, read)),
        w=ca.vertcat(base.w, loses),
        h=h,
    )
    return with_ports(model, of.ports)


def terms_of(subject: Subject, model: Model, of: Ported) -> Terms:
    """The terms of the library, with the inputs as they act, beside states, inputs and readings as measured."""
    base = of.base
    moved = dict(zip(model.disturbances, ca.vertsplit(model.w), strict=True))
    acting = [u + moved.get(control(n), 0) for n, u in zip(model.inputs, ca.vertsplit(model.u), strict=True)]
    made = ca.Function("terms", [base.x, base.u], [ca.densify(ca.vertcat(*of.terms.values()))]) if of.terms else None
    rows = ca.vertsplit(made(model.x[: len(base.states)], ca.vertcat(*acting))) if made else []
    batch = subject.batch(model)
    read = {as_read(name): batch.Z[..., i] for i, name in enumerate(model.outputs)}
    read |= {name: padded([record[name] for record in subject.records]) for name in of.channels}
    named = dict(zip(map(as_term, of.terms), rows, strict=True))
    measured = subject.measured(model)
    return Terms(model, batch, named, measured, subject.input_sigma, states=model.states, read=read)


@dataclass(frozen=True, eq=False, kw_only=True)
class Ported:
    """A model with ports, as given: parameters with a prior of 0 are fixed."""

    base: Model
    ports: tuple[Port, ...]  # where reality may differ
    terms: Mapping[str, ca.SX]  # name -> expression that an equation may lack
    channels: tuple[str, ...] = ()  # channels of the records that effects look at, beside inputs and readings

    def fields(self) -> dict[str, Any]:
        """The fields of a subject that the model and its ports decide."""
        return {
            "title": self.base.name,
            "outputs": self.base.outputs,
            "stations": [port.station for port in self.ports if port.kind != "output"],
            "readings": [port.station for port in self.ports if port.kind == "output"],
            "lines": (*self.base.states, *self.base.inputs),
            "terms_of": partial(terms_of, of=self),
            "prior_of": stated_std,
        }


def stated_std(subject: Subject, model: Model, name: str) -> float:
    """1-sigma of a parameter before the records, as it is stated."""
    return model.prior_std.get(name, np.inf)


def _elsewhere(subject: Subject, values: Mapping[str, float], records: Sequence[Record], of: Ported) -> Subject:
    """The model with values of its parameters, along other records under the same noise."""
    base = replace(of.base, nominal={**of.base.nominal, **values})
    found = motions(base, records, subject.sigma, subject.criteria.numerics.fit.repeats)
    return subject.changed(**_of_model(replace(of, base=base)), records=tuple(records), paths=found)


def _of_model(of: Ported) -> dict[str, Any]:
    return {**of.fields(), "build": partial(with_ports_of, of=of), "elsewhere_of": partial(_elsewhere, of=of)}


def motions(model: Model, records: Sequence[Record], noise: Mapping[str, float], times: int) -> dict[str, np.ndarray]:
    """record -> (N, states) motion from which a fit may begin: as it was read, states that no instrument reads by a
    smoother, run some `times`, to which every equation is as uncertain as it is large. A record on which that departs
    has none."""
    wide = with_ports(model, [port for port in ports_of(model) if port.kind == "state derivative"])
    functions = PointFunctions(wide, ())
    found = {}
    rates = ca.Function("rates", [model.x, model.u, model.p, model.w], [ca.densify(model.f)])
    for record in records:
        batch = make_batch(wide, [record])
        P = model.nominal_vector()[None]
        X = brought_inside(functions, batch, P, model.guess(record)[:, None])
        sizes = np.std(rates(X[:, 0].T, batch.U[:, 0].T, P[0], np.zeros(len(model.disturbances))).full(), axis=1)
        white = {f"f_{name}": float(size) for name, size in zip(model.states, sizes, strict=True) if size > 0.0}
        try:
            with np.errstate(all="ignore"):
                for _ in range(times):
                    linear = linearise(functions, batch, P, X)
                    smoother = kalman_filter(linear, NoiseModel(measurement=noise, white=white))
                    step = smoother.smooth(*residual_column(linear))[0][..., : X.shape[2]]
                    X = moved_inside(functions, batch, P, X, step)
        except np.linalg.LinAlgError:
            continue
        if np.isfinite(X).all():
            found[record.name] = X[:, 0]
    return found


def ported(
    model: Model, records: Sequence[Record], ports: Sequence[Port], library: Library, criteria: Criteria
) -> tuple[Subject, Ported]:
    """A model and the records to be fitted. Priors of 0 become fixed values, and a state is as large as it is measured.

    Raises InputError for an output that no record has, and for a model without a free parameter."""
    free = tuple(name for name in model.parameters if model.prior_std.get(name) != 0.0)
    if not free:
        raise InputError(f"model '{model.name}' has no free parameter; give at least one a prior above 0, or none")
    guess = np.concatenate([model.guess(record) for record in records])
    seen = dict(zip(model.states, np.sqrt(np.mean(guess**2, axis=0)).tolist(), strict=True))
    base = replace(
        model,
        prior_std={name: std for name, std in model.prior_std.items() if std > 0.0},
        state_scale={name: seen[name] or scale for name, scale in model.state_scale.items()},
    )
    sigma = noise_of(base, records, criteria.noise)
    paths = motions(base, records, sigma, criteria.numerics.fit.repeats)
    frictions = frictions_of(base, paths, criteria.naming.approximate)
    terms = library.terms(base) | library.further_terms(base) | {one.name: one.term for one in frictions.values()}
    of = Ported(base=base, ports=tuple(ports), terms=terms)
    effects = effects_of(library, base, ports, records, free, frictions, criteria.naming.approximate)
    return Subject(
        **_of_model(of),
        freed=free,
        records=tuple(records),
        sigma=sigma,
        criteria=for_systems(criteria, float(np.median([record.duration for record in records]))),
        paths=paths,
        catalogue=lambda _: effects,
        sizes=PortSizes(ports={port.station: port for port in of.ports}),
    ), of


def for_systems(criteria: Criteria, duration: float) -> Criteria:
    """The criteria with times as long as the records of a system, which last a `duration` [s], are to those of an
    aircraft, and with as wide a search as its quick fits allow."""
    by = criteria.numerics.naming
    wider = by.few
    iterations, tolerance = criteria.numerics.fit.rough
    table = {"naming": {"trials": wider * by.trials}, "fit": {"rough": (wider * iterations, tolerance)}}
    return in_time(criteria, duration / criteria.numerics.record).with_values({"numerics": table})


def noise_of(model: Model, records: Sequence[Record], criteria: NoiseCriteria) -> dict[str, float]:
    """Output -> 1-sigma, from the band above the motion; for records that are too short for that, from a fit of the
    model.

    Raises InputError for an output that no record has.
    """
    found = {}
    for name in model.outputs:
        series = [r[name] for r in records if name in r]
        there = [s[np.isfinite(s)] for s in series if np.isfinite(s).any()]
        if not there:
            raise InputError(
                f"no record has the output '{name}' of '{model.name}'; add the channel, or drop the output"
            )
        least = max(criteria.smallest * float(np.std(np.concatenate(there))), 1e-12)
        sigma = pooled_sigma(there)
        found[name] = max(sigma, least) if np.isfinite(sigma) else np.nan
    if not np.isfinite(list(found.values())).all():
        fitted = solve(Problem(model, records, free=["*"], prior=True), starts=1)
        found = {name: sigma if np.isfinite(sigma) else fitted.noise[name] for name, sigma in found.items()}
    return found


def first_fit(subject: Subject) -> FlightFit:
    """The model with re-estimated parameters.

    The fit may diverge, or end in a minimum far from the records: if the model lacks a large effect, or if its states
    swing with little damping, so that a small error of a parameter turns their phase. It is then repeated from two
    starts that have fewer minima, and the nearest to the records is used, one that converged before others. The first
    has noise as large as the residual, which keeps the parameters near their priors. The second has process noise as
    large as the rates of the states: what is left is then the error of each equation (equation error).

    Raises EstimationError for a model that cannot follow its records at all.
    """
    try:
        plain = fit(subject, (), subject.noise(), extent="settled")
    except InputError as error:
        raise EstimationError(
            f"model '{subject.title}' cannot be fitted to these records from its nominal values: {error}"
        ) from None
    left = float(np.sqrt(np.sum(plain.white**2) / plain.readings))
    if plain.converged and left < subject.criteria.parts.tenfold:
        return plain
    wide, again = by_wider_noise(plain, left)
    found = [one for one in (plain, again, *_by_equation_error(subject)) if one.converged]
    if found:
        return min(found, key=lambda one: one.deviance)
    return evaluate(Work(subject, (), subject.noise(), "all"), (), wide.values, wide.motion)


def _by_equation_error(subject: Subject) -> list[FlightFit]:
    """The fit that starts from the values with the smallest error of the equations; empty where it departs."""
    states = subject.model().states
    stations = [name for name in subject.stations if Station.at(name).kind == "equation"]
    at = [states.index(Station.at(name).name) for name in stations]
    rates = [np.gradient(subject.paths[r.name], r.t, axis=0) for r in subject.records if r.name in subject.paths]
    if not stations or not rates:
        return []
    sizes = np.std(np.concatenate(rates), axis=0)[at]
    white = {s: float(size) for s, size in zip(stations, sizes, strict=True) if size > 0.0}
    try:
        first = fit(subject, (), replace(subject.noise(), white=white), extent="settled")
        return [fit(subject, (), subject.noise(), first, extent="settled")]
    except (InputError, np.linalg.LinAlgError):
        return []


@dataclass(frozen=True, kw_only=True)
class PortSizes:
    """Size of a cause of a model, in units of what matters at its port, or in the readings."""

    ports: Mapping[str, Port]  # by station

    def share_of(self, fit: FlightFit, one: Attached) -> float:
        """R.m.s. of the effect of a cause at its port, in units of what matters there.

        At an equation it is the relative change of a reading if that is larger: little damping is a small part of an
        acceleration, but a large change of a swing.
        """
        effect = one.effect
        value = one.values["value"]
        share = fit.criteria.size.share
        if effect.timed:
            return abs(value) / share  # nothing is left of a reading that does not move
        if effect.traits.relative:
            return abs(value) / (share * max(abs(fit.model.nominal[effect.target]), 1e-12))
        port = self.ports[str(effect.enters)]
        history = _history(fit, one)
        there = np.array([one.concerns(name) for name in fit.batch.names]) & fit.batch.live
        size = _size(history[there]) / matters_at(fit, port)
        if port.kind != "state derivative" or port.matters is not None:
            return size
        return max(size, _change_of_readings(fit, port, np.where(there, history, 0.0)) / share)

    def told(self, fit: FlightFit, one: Attached, std: float) -> tuple[float, float]:
        """Value and 1-sigma of a cause for a person; of a reading that is stuck, its level."""
        effect = one.effect
        records = fit.flight.records
        if effect.timed:
            concerned = [record for record in records if one.concerns(record.name) and effect.target in record]
            read = [record[effect.target][record.t > one.onsets[record.name]] for record in concerned]
            seen = np.concatenate([values[np.isfinite(values)] for values in read])
            return level(seen), fit.flight.sigma[effect.target] / math.sqrt(max(len(seen), 1))
        return effect.in_words(one.values)["value"], std

    def told_at(self, fit: FlightFit, missing: Sequence[MissingInput]) -> list[MissingInput]:
        """Return, of latent inputs with the strongest first, the one that is reported, with its port in words.

        Among ports with nearly equal statistics it is an input, because its effect enters an equation too.
        """
        if not missing:
            return []
        alike = [one for one in missing if missing[0].gain - one.gain < equivalence(missing[0].gain, fit.criteria)]
        best = next((one for one in alike if one.place.kind == "control"), missing[0])
        return [replace(best, called=self.ports[best.station].words)]

    def missing_share(self, fit: FlightFit, missing: MissingInput) -> float:
        """R.m.s. of the latent input at a port over the variation there."""
        port = self.ports[missing.station]
        return fit.criteria.size.share * missing.rms / matters_at(fit, port)

    def missing_size(self, fit: FlightFit, missing: MissingInput) -> float:
        """The same in units of what matters."""
        return self.missing_share(fit, missing) / fit.criteria.size.share


def matters_at(fit: FlightFit, port: Port) -> float:
    """The smallest r.m.s. size that matters at a port: stated by the port, or a part of the variation there."""
    if port.matters is not None:
        return port.matters
    live = fit.batch.live
    if port.kind == "state derivative":
        x = fit.motion.X[..., fit.model.states.index(port.name)]
        there = np.gradient(x, axis=0)[live] / np.gradient(fit.batch.t, axis=0)[live]
    elif port.kind == "input":
        there = fit.batch.U[..., fit.model.inputs.index(port.name)][live]
    else:
        there = fit.linear.output[..., fit.model.outputs.index(port.name)][live]
    return max(fit.criteria.size.share * float(np.std(there)), 1e-12)


def _history(fit: FlightFit, one: Attached) -> np.ndarray:
    """(N, R) what a cause adds where it enters."""
    effect = one.effect
    names = fit.batch.names
    t = fit.batch.t
    if effect.regressor is not None:
        return one.values["value"] * fit.regressors[as_term(effect.regressor)]
    if effect.series is not None:
        W = disturbance_series([one], names, t, fit.known, fit.model.disturbances)
        return W[..., fit.model.disturbances.index(str(effect.enters))]
    i = fit.model.outputs.index(effect.target)
    read = fit.linear.output
    if effect.output is not None:
        return (readings([one], names, t, read, fit.model.outputs, fit.known) - read)[..., i]
    assert effect.change is not None
    found = _Read(read[..., i])
    effect.change(found, one.values)
    return found.reading - read[..., i]


class _Read:
    """A reading in numbers, where `Draft` has it in symbols."""

    def __init__(self, reading: np.ndarray) -> None:
        self.reading = reading

    def reads(self, channel: str, read: Callable[[Any], Any], true: Callable[[Any], Any]) -> None:
        self.reading = read(self.reading)


def _size(values: np.ndarray) -> float:
    """Size of an effect: the value of a constant, the variation of anything else."""
    varies = float(np.std(values))
    whole = float(np.sqrt(np.mean(values**2)))
    return varies if varies > 1e-9 * whole else whole


def _change_of_readings(fit: FlightFit, port: Port, history: np.ndarray) -> float:
    """Largest r.m.s. change of a reading by a history (N, R) at a port, over the variation of that reading; the motion
    linearised, from the same initial state."""
    linear = fit.linear
    at = fit.model.disturbances.index(port.station)
    with np.errstate(over="ignore", invalid="ignore"):  # of a motion that the linearisation lets grow
        change = _simulated(linear, at, history)
    variation = np.array(
        [
            max(float(np.std(linear.output[..., i][fit.batch.live])), fit.noise.measurement[name])
            for i, name in enumerate(fit.model.outputs)
        ]
    )
    with np.errstate(over="ignore"):
        return float(np.max(np.sqrt(np.mean(change[fit.batch.live] ** 2, axis=0)) / variation))


def _simulated(linear: Linear, at: int, history: np.ndarray) -> np.ndarray:
    """(N, R, ny) change of the readings by a history (N, R) at a disturbance."""
    x = np.zeros(linear.X.shape)
    h = history[..., None]
    driven = linear.Bw0[: len(x) - 1, ..., at] * h[:-1] + linear.Bw1[: len(x) - 1, ..., at] * h[1:]
    for k, added in enumerate(driven):
        x[k + 1] = (linear.A[k] @ x[k, ..., None])[..., 0] + added
    return (linear.C @ x[..., None])[..., 0] + linear.Dw[..., at] * h
