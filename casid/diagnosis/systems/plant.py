"""A dynamic system and its records in the place of a `Flight`: model, noise, terms, sizes and priors for the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
from casid.diagnosis.flight.subject import Sizes, once
from casid.diagnosis.time_limit import TimeLimit
from casid.errors import EstimationError, InputError
from casid.estimation import Problem, solve
from casid.filtering.innovations import (
    Batch,
    Linear,
    NoiseModel,
    PointFunctions,
    at_points,
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
from casid.model.library import Library, as_term, effects_of
from casid.model.port import ModelPort as Port
from casid.model.port import ports_of, with_ports
from casid.model.station import as_read, control, reading, stuck
from casid.model.system import Model
from casid.model.with_effects import Draft
from casid.native.compiler import Compilable
from casid.records.noise import pooled_sigma
from casid.records.record import Record


class Terms:
    """The terms of a library along trajectories, the recorded inputs and the readings, by name."""

    def __init__(self, plant: Plant, model: Model) -> None:
        self._batch = plant.batch(model)
        self._states = model.states
        self._inputs = model.inputs
        self._sigma = plant.input_sigma
        names = [control(name) for name in model.inputs]
        self._acting = [model.disturbances.index(n) if n in model.disturbances else None for n in names]
        self._terms = tuple(map(as_term, plant.terms_of))
        base = plant.base
        rows = ca.densify(ca.vertcat(*plant.terms_of.values())) if self._terms else ca.SX(0, 1)
        self._function = Compilable(ca.Function("terms", [base.x, base.u], [rows]))
        self.recorded = {name: self._batch.U[..., i] for i, name in enumerate(self._inputs)}
        self._read = {as_read(name): self._batch.Z[..., i] for i, name in enumerate(model.outputs)}
        self._read |= {name: padded([record[name] for record in plant.records]) for name in plant.channels}

    def inputs(self, noise: Mapping[str, np.ndarray]) -> np.ndarray:
        """(N, R, nu) recorded inputs, corrected by their most likely `noise` (disturbance -> (N, R)) where they have
        any; noise larger than possible indicates a fault and is reduced in proportion to its excess."""
        if not noise:
            return self._batch.U
        U = self._batch.U.copy()
        live = self._batch.live
        for i, name in enumerate(self._inputs):
            if (station := control(name)) in noise:
                power = np.sum(noise[station] ** 2, axis=0) / live.sum(axis=0) / self._sigma[station] ** 2
                U[..., i] += noise[station] / np.maximum(power, 1.0)
        return U

    def along(self, X: np.ndarray, W: np.ndarray, inputs: np.ndarray, ahead: bool = False) -> dict[str, np.ndarray]:
        """name -> (N, R): states of the trajectory X (N, R, nx), `inputs` (N, R, nu), readings as measured, and the
        terms with the inputs as they act under the disturbances W (N, R, nw), whether predicted `ahead` or not."""
        table = {name: X[..., i] for i, name in enumerate(self._states)}
        table |= {name: inputs[..., i] for i, name in enumerate(self._inputs)} | self._read
        if not self._terms:
            return table
        acting = inputs.copy()
        for i, at in enumerate(self._acting):
            if at is not None:
                acting[..., i] += W[..., at]
        values = at_points(self._function, X, acting)[0][..., 0]
        return table | {name: values[..., i] for i, name in enumerate(self._terms)}


@dataclass(frozen=True, eq=False, kw_only=True)
class Plant:
    """A model and its records for a diagnosis."""

    base: Model  # the model as given, parameters with a prior of 0 fixed;  freed  its estimated parameters
    freed: tuple[str, ...]
    ports: tuple[Port, ...]  # where reality may differ;  terms_of  name -> expression that an equation may lack
    records: tuple[Record, ...]
    sigma: dict[str, float]  # 1-sigma of the noise of each output
    terms_of: Mapping[str, ca.SX]
    criteria: Criteria
    # record -> (N, states) start of a fit; otherwise the model's own first guess
    paths: Mapping[str, np.ndarray] = field(default_factory=dict)
    # the causes that are considered;  sizes  their measures of size
    effects: list[Effect] = field(default_factory=list)
    sizes: Sizes
    white: Mapping[str, float] = field(default_factory=dict)  # disturbance -> 1-sigma of process noise
    channels: tuple[str, ...] = ()  # channels of the records that effects look at, beside inputs and readings
    # makes the model with some symbolic effects, where these change more than equations and readings
    build: Callable[[Sequence[Effect]], Model] | None = None
    prepare: Callable[[Sequence[Record]], Sequence[Record]] = tuple  # makes records ready for the model
    # output -> (1-sigma, correlation time) of its innovations
    colour: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # whether predictions are compared with a record instead of a simulation (`Flight.closed_loop`)
    closed_loop: bool = False
    imitated: Mapping[str, Effect] = field(default_factory=dict)  # free number -> effect whose relative change it is
    # names of records -> effects that the file has in them
    known: Callable[[Sequence[str]], tuple[Attached, ...]] = lambda names: ()
    every: int = 1  # number of recorded samples of which each sample is the mean
    limit: TimeLimit = field(default_factory=TimeLimit)  # the time that the search may take
    input_sigma: dict[str, float] = field(default_factory=dict)
    doubted: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    offsets: list[Effect] = field(default_factory=list)
    noise_by_fit: bool = False
    held: float = 0.0
    coefficients: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()
    terms: tuple[tuple[str, str, str], ...] = ()
    _models: dict[tuple[str, ...], Model] = field(default_factory=dict, repr=False)
    _functions: dict[Model, PointFunctions] = field(default_factory=dict, repr=False)
    _regressors: dict[Model, Terms] = field(default_factory=dict, repr=False)

    @property
    def title(self) -> str:
        """Name of what is diagnosed."""
        return self.base.name

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(record.name for record in self.records)

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.base.outputs

    @property
    def stations(self) -> list[str]:
        """Equations and inputs at which something unknown may enter, as disturbances of the model."""
        return [port.station for port in self.ports if port.kind != "output"]

    @property
    def readings(self) -> list[str]:
        """Readings at which something unknown may enter."""
        return [reading(port.name) for port in self.ports if port.kind == "output"]

    def noise(self, coloured: dict[str, tuple[float, float]] | None = None) -> NoiseModel:
        """Measurement noise, and `coloured` disturbances beside it."""
        random = {"white": self.white, "inputs": self.input_sigma, "colour": self.colour}
        return NoiseModel(measurement=self.sigma, coloured=coloured or {}, **random)

    def model(self, effects: Sequence[Effect] = ()) -> Model:
        """The model with its ports as disturbances, and symbolic `effects` among its parameters."""
        symbolic = [effect for effect in effects if effect.symbolic]
        return once(self._models, tuple(effect.name for effect in symbolic), lambda: self._built(symbolic))

    def _built(self, effects: Sequence[Effect]) -> Model:
        if self.build is not None:
            model = self.build(effects)
            own = {"nominal": {**model.nominal, **self.base.nominal}, "prior_std": self.base.prior_std}
            return replace(model, state_scale=self.base.state_scale, **own)
        base = self.base
        draft = Draft(base, self.terms_of)
        symbols = {effect.name: ca.SX.sym("value") for effect in effects}
        for effect in effects:
            assert effect.change is not None
            effect.change(draft, {"value": symbols[effect.name]})
        made = draft.made([InForce(effect=effect, name=effect.name) for effect in effects], symbols)
        h = ca.SX(made.h)
        read = [port.name for port in self.ports if port.kind == "output"]
        loses = ca.SX.sym("stuck", len(read))
        for k, name in enumerate(read):
            h[base.outputs.index(name)] *= 1.0 - loses[k]
        model = replace(
            made,
            disturbances=(*base.disturbances, *map(stuck, read)),
            w=ca.vertcat(base.w, loses),
            h=h,
        )
        return with_ports(model, self.ports)

    def functions(self, model: Model) -> PointFunctions:
        """The functions of one of its models."""
        return once(self._functions, model, lambda: PointFunctions(model, ()))

    def regressors(self, model: Model) -> Terms:
        """The terms that effects of one of its models are made of."""
        return once(self._regressors, model, lambda: Terms(self, model))

    def batch(self, model: Model) -> Batch:
        return make_batch(model, self.records)

    def measured(self, model: Model) -> np.ndarray:
        """(N, R, states) motion from which a fit begins."""
        known = self.paths
        return padded([known[r.name] if r.name in known else self.base.guess(r) for r in self.records])

    def elsewhere(self, values: Mapping[str, float], records: Sequence[Record]) -> Plant:
        """This plant with values of its parameters, and other records under its noise."""
        base = replace(self.base, nominal={**self.base.nominal, **values})
        records = tuple(self.prepare(records))
        smoothed = self.criteria.numerics.fit.repeats
        paths = motions(base, records, self.sigma, smoothed) if self.build is None else {}
        return replace(
            self,
            base=base,
            records=records,
            paths=paths,
            _models={},
            _functions={},
            _regressors={},
        )

    def smallest_that_matters(self, effect: Effect) -> float | None:
        """None: the size of an effect of a system is judged by what it does."""
        least = effect.size.meaningful
        return None if self.build is None or callable(least) else least

    @property
    def lines(self) -> tuple[str, ...]:
        """Names of the regressors that parameters multiply: a term may be nearly a line in these."""
        return (*self.base.states, *self.base.inputs)

    @property
    def imitated_names(self) -> frozenset[str]:
        """Names of effects that are a relative change of a fitted number."""
        return frozenset(effect.name for effect in self.imitated.values())

    def suspects(self, fit: FlightFit) -> list[tuple[Effect, float, float]]:
        """(effect, value, stated 1-sigma) of every fitted number that left its stated uncertainty and is an effect.

        A number that is drawn to its stated value moves by sqrt(stated^2 - fitted^2), 1-sigma, where that is right.
        """
        found = []
        for name, make in self.imitated.items():
            if not any(slot.name == name for slot in fit.slots):
                continue
            given = self.base.nominal[name]
            std = self.base.prior_std.get(name, np.inf)
            change = fit[name] - given
            moves = math.sqrt(max(std**2 - fit.std(name) ** 2, 0.0))
            if abs(change) > fit.criteria.significance.sigmas * moves:
                found.append((make, change / given, std / given))
        return found

    def channels_of(self, effect: Effect) -> tuple[str, ...]:
        """The reading that an effect of an instrument changes."""
        return effect.reads

    def term_along(self, effect: Effect, regressors: Mapping[str, np.ndarray]) -> np.ndarray:
        """(N, R) the term of an effect along `regressors` of this plant."""
        return regressors[as_term(effect.regressor or "")]

    def prior_std(self, model: Model, name: str) -> float:
        """1-sigma of a parameter of the model before the records."""
        return model.prior_std.get(name, np.inf)


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


def plant_of(
    model: Model, records: Sequence[Record], ports: Sequence[Port], library: Library, criteria: Criteria
) -> Plant:
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
    return Plant(
        base=base,
        freed=free,
        ports=tuple(ports),
        records=tuple(records),
        sigma=sigma,
        terms_of=library.terms(base) | library.further_terms(base),
        criteria=for_systems(criteria, float(np.median([record.duration for record in records]))),
        paths=motions(base, records, sigma, criteria.numerics.fit.repeats),
        effects=effects_of(library, base, ports, records, free, criteria.systems),
        sizes=PlantSizes(),
    )


def for_systems(criteria: Criteria, duration: float) -> Criteria:
    """The criteria with times as long as the records of a system, which last a `duration` [s], are to those of an
    aircraft, and with as wide a search as its quick fits allow."""
    by = criteria.numerics.naming
    wider = criteria.numerics.systems.wider
    more = {name: wider * getattr(by, name) for name in ("trials", "further_trials")}
    iterations, tolerance = criteria.numerics.fit.trial
    table = {"naming": more, "fit": {"trial": (wider * iterations, tolerance)}}
    return in_time(criteria, duration / criteria.systems.record).with_values({"numerics": table})


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


def first_fit(plant: Plant) -> FlightFit:
    """The model with re-estimated parameters.

    The fit may diverge, or end in a minimum far from the records: if the model lacks a large effect, or if its states
    swing with little damping, so that a small error of a parameter turns their phase. It is then repeated from two
    starts that have fewer minima, and the nearest to the records is used, one that converged before others. The first
    has noise as large as the residual, which keeps the parameters near their priors. The second has process noise as
    large as the rates of the states: what is left is then the error of each equation (equation error).

    Raises EstimationError for a model that cannot follow its records at all.
    """
    try:
        plain = fit(plant, (), plant.noise(), extent="first")
    except InputError as error:
        raise EstimationError(
            f"model '{plant.title}' cannot be fitted to these records from its nominal values: {error}"
        ) from None
    left = float(np.sqrt(np.sum(plain.white**2) / plain.readings))
    if plain.converged and left < plant.criteria.given.fails:
        return plain
    wide, again = by_wider_noise(plain, left)
    found = [one for one in (plain, again, *_by_equation_error(plant)) if one.converged]
    if found:
        return min(found, key=lambda one: one.deviance)
    return evaluate(Work(plant, (), plant.noise(), "all"), (), wide.values, wide.motion)


def _by_equation_error(plant: Plant) -> list[FlightFit]:
    """The fit that starts from the values with the smallest error of the equations; empty where it departs."""
    stations = [port.station for port in plant.ports if port.kind == "state derivative"]
    at = [plant.base.states.index(port.name) for port in plant.ports if port.kind == "state derivative"]
    rates = [np.gradient(plant.paths[r.name], r.t, axis=0) for r in plant.records if r.name in plant.paths]
    if not stations or not rates:
        return []
    sizes = np.std(np.concatenate(rates), axis=0)[at]
    white = {s: float(size) for s, size in zip(stations, sizes, strict=True) if size > 0.0}
    try:
        first = fit(plant, (), replace(plant.noise(), white=white), extent="first")
        return [fit(plant, (), plant.noise(), first, extent="first")]
    except (InputError, np.linalg.LinAlgError):
        return []


class PlantSizes:
    """Size of a cause of a plant, in units of what matters at its port, or in the readings."""

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
        port = _port(fit, effect.enters)
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
        return [replace(best, called=_port(fit, best.station).words)]

    def missing_share(self, fit: FlightFit, missing: MissingInput) -> float:
        """R.m.s. of the latent input at a port over the variation there."""
        port = _port(fit, missing.station)
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


def _port(fit: FlightFit, station: str | None) -> Port:
    ports = {port.station: port for port in fit.flight.ports}  # pyright: ignore[reportAttributeAccessIssue]
    return ports[str(station)]


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
    change = _simulated(linear, at, history)
    variation = np.array(
        [
            max(float(np.std(linear.output[..., i][fit.batch.live])), fit.noise.measurement[name])
            for i, name in enumerate(fit.model.outputs)
        ]
    )
    with np.errstate(over="ignore"):  # of a motion that the linearisation lets grow
        return float(np.max(np.sqrt(np.mean(change[fit.batch.live] ** 2, axis=0)) / variation))


def _simulated(linear: Linear, at: int, history: np.ndarray) -> np.ndarray:
    """(N, R, ny) change of the readings by a history (N, R) at a disturbance."""
    x = np.zeros(linear.X.shape)
    h = history[..., None]
    driven = linear.Bw0[: len(x) - 1, ..., at] * h[:-1] + linear.Bw1[: len(x) - 1, ..., at] * h[1:]
    for k, added in enumerate(driven):
        x[k + 1] = (linear.A[k] @ x[k, ..., None])[..., 0] + added
    return (linear.C @ x[..., None])[..., 0] + linear.Dw[..., at] * h
