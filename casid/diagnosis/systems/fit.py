"""Fit an extended model to records, and fly it on records that no fit has seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.systems.cause import PartOfModel
from casid.diagnosis.systems.criteria import SystemCriteria
from casid.diagnosis.systems.extended import Extended
from casid.errors import CasidError, EstimationError, InputError
from casid.estimation import Fit, Problem, solve
from casid.filtering.initial_state import fit_initial_state
from casid.filtering.innovations import NoiseModel, PointFunctions, linearise, make_batch
from casid.filtering.kalman import kalman_filter, residual_column
from casid.model.port import ports_of, with_ports
from casid.model.simulate import simulate
from casid.model.system import Model
from casid.records.noise import pooled_sigma
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """What stays the same over a diagnosis: records as given, noise of each output, parameters that are fitted, and by
    which criteria."""

    records: tuple[Record, ...]
    noise: Mapping[str, float]
    free: tuple[str, ...]
    criteria: Criteria


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted:
    """An extended model with its values fitted; `fit` as the engine gives it, `records` prepared for it."""

    extended: Extended
    values: Mapping[str, float]
    fit: Fit
    records: tuple[Record, ...]

    @property
    def model(self) -> Model:
        return self.extended.model


def noise_of(model: Model, records: Sequence[Record], criteria: SystemCriteria) -> dict[str, float]:
    """Output -> 1-sigma, from the band above the motion; of what is too short for that, from a fit of the model.

    Raises InputError for an output that no record has."""
    found = {}
    for name in model.outputs:
        series = [r[name] for r in records if name in r]
        there = [s[np.isfinite(s)] for s in series if np.isfinite(s).any()]
        if not there:
            raise InputError(
                f"no record has the output '{name}' of '{model.name}'; add the channel, or drop the output"
            )
        least = max(criteria.smallest_noise * float(np.std(np.concatenate(there))), 1e-12)
        sigma = pooled_sigma(there)
        found[name] = max(sigma, least) if np.isfinite(sigma) else np.nan
    if not np.isfinite(list(found.values())).all():
        fit = solve(Problem(model, records, free=["*"], prior=True))
        found = {name: sigma if np.isfinite(sigma) else fit.noise[name] for name, sigma in found.items()}
    return found


def motions(
    model: Model, records: Sequence[Record], noise: Mapping[str, float], criteria: SystemCriteria
) -> dict[str, np.ndarray]:
    """record -> (N, states) motion from which a fit may begin: as it was read, states that no instrument reads by a
    smoother to which every equation is as uncertain as it is large. A record on which that departs has none."""
    wide = with_ports(model, [port for port in ports_of(model) if port.kind == "state derivative"])
    functions, found = PointFunctions(wide, ()), {}
    rates = ca.Function("rates", [model.x, model.u, model.p, model.w], [ca.densify(model.f)])
    for record in records:
        batch, P = make_batch(wide, [record]), model.nominal_vector()[None]
        X = model.guess(record)[:, None]
        sizes = np.std(rates(X[:, 0].T, batch.U[:, 0].T, P[0], np.zeros(len(model.disturbances))).full(), axis=1)
        white = {f"f_{name}": float(size) for name, size in zip(model.states, sizes, strict=True) if size > 0.0}
        try:
            with np.errstate(all="ignore"):
                for _ in range(criteria.smoothed):
                    linear = linearise(functions, batch, P, X)
                    smoother = kalman_filter(linear, NoiseModel(measurement=noise, white=white))
                    X = X + smoother.smooth(*residual_column(linear))[0][..., : X.shape[2]]
        except np.linalg.LinAlgError:
            continue
        if np.isfinite(X).all():
            found[record.name] = X[:, 0]
    return found


def fitted(extended: Extended, question: Question, start: Mapping[str, float]) -> Fitted | None:
    """The extended model fitted; None when that fails. Operators and onsets are gone back to until they stay."""
    model, now = extended.model, extended
    fixed = {name: model.nominal[name] for name in extended.base.parameters if name not in question.free}
    values = {**start, **{one.name: one.value for one in extended.attached}}
    fit, records = None, question.records
    for _ in range(question.criteria.systems.rounds):
        records = tuple(now.prepared(r) for r in question.records)
        problem = Problem(model, records, free=["*"], fixed=fixed, start=values, noise=question.noise, prior=True)
        try:
            fit = solve(problem)
        except (EstimationError, np.linalg.LinAlgError):
            return None
        if not np.isfinite(fit.cost):
            return None
        values = dict(fit.values)
        motion = {name: states.trajectory for name, states in fit.states.items()}
        moved = replace(
            now, attached=tuple(_moved(one, values[one.name], fit, question.criteria.systems) for one in now.attached)
        )
        moved = moved.along(motion, records, model.nominal_vector({**fixed, **values}))
        pairs = zip(now.attached, moved.attached, strict=True)
        settled = all(_same(one, other, question) for one, other in pairs)
        now = moved
        if settled:
            break
        values |= {one.name: one.value for one in now.attached}
    if fit is None:
        return None
    return Fitted(extended=now, values={**fixed, **fit.values}, fit=fit, records=records)


def _moved(one: PartOfModel, value: float, fit: Fit, criteria: SystemCriteria) -> PartOfModel:
    """A cause where the fit has it, an onset where the residuals have it."""
    if one.cause.operator is not None and one.centre > 0.0 and min(v for v, _ in one.cause.grid) > 0.0:
        value = float(np.clip(value, one.value / criteria.factor, criteria.factor * one.value))
    if not one.cause.onset:
        return one.at(value)
    found = {}
    for record in fit.problem.records:
        if record.name in one.onset_s:
            found[record.name] = _onset(one, value, fit, record)
    return replace(one.at(value), onset_s=found)


def _onset(one: PartOfModel, value: float, fit: Fit, record: Record) -> float:
    """Time [s] from which a reading is stuck: where the squares about the model before it and the value after it are
    least. The motion is that of the fit, in which the reading takes no part from the present onset on."""
    model, i = fit.problem.model, fit.problem.model.outputs.index(one.cause.target)
    moving = record.with_channels(**{str(one.flag): np.zeros(len(record))})
    reads = ca.Function("reads", [model.x, model.u, model.p, model.w], [model.h])
    p = fit.problem.model_parameters(np.array(list(fit.values.values())))[0]
    states = fit.states[record.name].trajectory
    would = reads(states.T, moving.matrix(model.inputs).T, p, np.zeros(len(model.disturbances))).full()[i]
    free, stuck = (np.nan_to_num(record[one.cause.target] - of) ** 2 for of in (would, value))
    squares = np.r_[0.0, np.cumsum(free)] + np.r_[np.cumsum(stuck[::-1])[::-1], 0.0]
    return float(record.t[min(int(np.argmin(squares)), len(record) - 2)])


def _same(one: PartOfModel, other: PartOfModel, question: Question) -> bool:
    criteria = question.criteria.systems
    if one.cause.late:
        return all(
            np.abs(left - one.left.get(name, 0.0)).max() < criteria.still * question.noise[one.cause.target]
            for name, left in other.left.items()
        )
    near = abs(one.value - other.value) <= criteria.settled * abs(other.value)
    return (one.cause.operator is None or near) and dict(one.onset_s) == dict(other.onset_s)


def change_of_outputs(found: Fitted, name: str) -> float:
    """What a cause does to the motion: the largest r.m.s. change of an output without it, as a part of its variation.

    Initial states and all other values are the same. A little damping, a small part of an acceleration, is much of a
    swing.
    """
    with_it, without = [], []
    for record in found.records:
        start = found.fit.states[record.name].trajectory[0]
        try:
            with_it.append(simulate(found.model, record, start, found.values).outputs)
        except InputError:  # it cannot be flown open loop, and nothing is said of it so
            return 0.0
        try:
            without.append(simulate(found.model, record, start, {**found.values, name: 0.0}).outputs)
        except InputError:  # it takes the cause to keep the motion
            return float("inf")
    flown, other = np.concatenate(with_it), np.concatenate(without)
    variation = np.maximum(np.std(flown, axis=0), [found.fit.noise[output] for output in found.model.outputs])
    return float((np.sqrt(np.mean((flown - other) ** 2, axis=0)) / variation).max())


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """Open-loop simulations of records, initial states fitted: output -> r.m.s. residual over noise; and record ->
    output -> (N,) what the simulation says it reads, nothing of a record on which it diverges."""

    records: tuple[str, ...]
    rms: Mapping[str, float]
    readings: int
    simulated: Mapping[str, Mapping[str, np.ndarray]]

    @property
    def log_likelihood(self) -> float:
        """Per reading, without its constant."""
        return -0.5 * float(np.mean([v**2 for v in self.rms.values()]))


def fly(extended: Extended, values: Mapping[str, float], records: Sequence[Record], question: Question) -> Flown:
    """Simulate records with these values. A cause that is in some records only is tried in these, with and without."""
    squares, counts = dict.fromkeys(question.noise, 0.0), dict.fromkeys(question.noise, 0)
    simulated: dict[str, Mapping[str, np.ndarray]] = {}
    for record in records:
        tried = [_simulated(one, values, record, question) for one in _shapes(extended, record)]
        off = [_squares(one, record, question.noise) for one in tried]
        best = min(range(len(off)), key=lambda k: sum(s for s, _ in off[k].values()))
        simulated[record.name] = tried[best]
        for name, (square, count) in off[best].items():
            squares[name] += square
            counts[name] += count
    rms = {name: float(np.sqrt(squares[name] / n)) for name, n in counts.items() if n}
    names = tuple(r.name for r in records)
    return Flown(records=names, rms=rms, readings=sum(counts.values()), simulated=simulated)


def _shapes(extended: Extended, record: Record) -> list[Extended]:
    some = [one for one in extended.attached if one.flag is not None and not one.cause.onset]
    if not some:
        return [extended]
    there = [replace(one, records=(record.name,)) if one in some else one for one in extended.attached]
    return [extended, replace(extended, attached=tuple(there))]


def _simulated(
    extended: Extended, values: Mapping[str, float], record: Record, question: Question
) -> dict[str, np.ndarray]:
    """Output -> (N,) of an open-loop simulation; nothing where that diverges."""
    noise, criteria = question.noise, question.criteria.systems
    own = {name: value for name, value in values.items() if name in extended.base.parameters}
    base = replace(extended.base, nominal={**extended.base.nominal, **own})
    extended = replace(extended, paths=motions(base, [record], noise, criteria))
    flown = None
    for _ in range(criteria.rounds if any(one.cause.late for one in extended.attached) else 1):
        prepared = extended.prepared(record)
        model = replace(extended.model, nominal={**extended.model.nominal, **values})
        try:
            with np.errstate(all="ignore"):
                flown = simulate(model, prepared, fit_initial_state(model, prepared))
        except (CasidError, np.linalg.LinAlgError):
            flown = None
            break
        extended = extended.along({record.name: flown.states}, [prepared], model.nominal_vector())
    return {name: flown.output(name) for name in noise} if flown else {}


def _squares(
    simulated: Mapping[str, np.ndarray], record: Record, noise: Mapping[str, float]
) -> dict[str, tuple[float, int]]:
    """Output -> squares of its residuals over the noise, infinite where the simulation diverges, and their number."""
    found = {}
    for name, sigma in noise.items():
        if name in record:
            there = np.isfinite(record[name])
            off = record[name][there] - simulated[name][there] if simulated else np.full(there.sum(), np.inf)
            found[name] = float(np.sum((off / sigma) ** 2)), int(there.sum())
    return found
