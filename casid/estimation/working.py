"""A problem as the solvers take it: what is posed in other coordinates is brought to theirs, and the fit back.

Solvers know a model of free parameters, one noise level per channel, and initial states that are free or numbers. So a
parameter that is estimated by its logarithm enters as exp(p); an output with a noise per sample is divided by that, an
input of the model. A state whose initial value is a formula is counted from there, where it begins at zero. And an
input that is cubic between its samples is a polynomial in the time since the last one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from casid.estimation.constraints import Constraint, LinearConstraint, NonlinearConstraint, PathConstraint
from casid.estimation.fit import Fit
from casid.estimation.fitted import StateHistory, channel_fits
from casid.estimation.guess import looked_up, with_guess
from casid.estimation.initial_state import InitialState
from casid.estimation.problem import Problem
from casid.estimation.solvers.limits import ParameterLimits
from casid.estimation.uncertainty import Rescaled
from casid.model.built import cached, share_cache
from casid.model.expressions import Symbols
from casid.model.splines import cubic_inputs, splined, with_splines
from casid.model.system import Model, bare_name
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Working:
    """`posed` by the user, and `problem` as it is solved; the same object where nothing needs another form."""

    posed: Problem
    problem: Problem

    def returned(self, fit: Fit) -> Fit:
        """The fit of `problem` as one of `posed`."""
        if self.problem is self.posed:
            return fit
        by_log = self.posed.by_logarithm
        values = np.array(list(natural(self.posed, fit.values).values()))
        limits = ParameterLimits(self.posed)
        theta = limits.kept(values, fit.multipliers)
        # bounds of parameters are bounds of their logarithms
        by_limit = [theta[i] if i is not None and by_log[i] else 1.0 for i in limits.single]
        found = replace(
            fit,
            problem=self.posed,
            values=self.posed.named(theta),
            uncertainty=Rescaled(fit.uncertainty, np.where(by_log, values, 1.0)),
            multipliers=fit.multipliers / np.array(by_limit),
            states=self._states(fit, theta),
        )
        return self._with_noise(found) if self.posed.sigma_channels else found

    def _states(self, fit: Fit, theta: np.ndarray) -> dict[str, StateHistory]:
        offsets = initial_offsets(self.posed, theta)
        pairs = zip(fit.states.items(), offsets, strict=False)
        return {
            name: replace(history, trajectory=history.trajectory + offset, nodes=history.nodes + offset)
            for (name, history), offset in pairs
        }

    def _with_noise(self, fit: Fit) -> Fit:
        """Return the fit in units of the channels, from one in units of the noise of each sample."""
        outputs = self.posed.model.outputs
        sigma = {r.name: _sigma(self.posed, r) for r in self.posed.records}
        measured = {r.name: self.posed.outputs_of(r) for r in self.posed.records}
        predicted = {name: y * sigma[name] for name, y in fit.predictions.items()}
        # a prediction that diverged has no finite residual, so what is measured is not read off the residuals
        residuals = {name: measured[name] - y for name, y in predicted.items()}
        sizes = np.concatenate([sigma[n] for n in predicted])
        present = np.isfinite(np.concatenate([measured[n] for n in predicted]))
        rms = np.sqrt((sizes**2 * present).sum(axis=0) / np.maximum(present.sum(axis=0), 1))
        inner = dict(zip(self.problem.model.outputs, range(len(outputs)), strict=True))
        scale = np.diag(np.where(present.any(axis=0), rms, 1.0))
        return replace(
            fit,
            predictions=predicted,
            residuals=residuals,
            channels=channel_fits(outputs, measured, predicted),
            noise={outputs[inner[name]]: value * float(rms[inner[name]]) for name, value in fit.noise.items()},
            noise_covariance=scale @ fit.noise_covariance @ scale,
            log_likelihood=fit.log_likelihood - float(np.log(sizes[present]).sum()),
        )


def working(problem: Problem, deadline: float = math.inf) -> Working:
    """The problem in the coordinates that solvers know, with a guess of every state. `Problem` has checked that they
    can take it."""
    with_initial = bool(problem.model.initial) and problem.simulated
    inner = along_splines(problem)
    if problem.logarithmic or with_initial or problem.sigma_channels:
        inner = _in_other_coordinates(inner, with_initial)
    return Working(posed=problem, problem=with_guess(problem, inner, deadline))


def along_splines(problem: Problem) -> Problem:
    """The problem with cubic inputs as polynomials of their samples; itself where there are none."""
    names = cubic_inputs(problem.model, problem.records) if problem.simulated else ()
    if not names:
        return problem
    model = cached(problem.model, ("splines", names), lambda: with_splines(problem.model, names))
    return replace(problem, model=model, records=[splined(record, names) for record in problem.records])


def _in_other_coordinates(problem: Problem, with_initial: bool) -> Problem:
    model = problem.model
    key = ("working", problem.logarithmic, with_initial, tuple(problem.sigma_channels.items()))
    base = cached(
        model, key, lambda: _transformed(model, problem.logarithmic, with_initial, dict(problem.sigma_channels))
    )
    offsets = initial_offsets(problem, problem.start_vector)
    table = {r.name: model.guess(r) - offsets[i] for i, r in enumerate(problem.records)}
    by_log = problem.by_logarithm
    start = problem.named(np.where(by_log, np.log(np.where(by_log, problem.start_vector, 1.0)), problem.start_vector))
    noise = problem.noise
    if isinstance(noise, Mapping):
        renamed = dict(zip(model.outputs, base.outputs, strict=True))
        noise = {renamed.get(name, name): 1.0 if isinstance(s, str) else s for name, s in noise.items()}
    return replace(
        problem,
        records=[_scaled(problem, record) for record in problem.records],
        start=start,
        log=(),
        noise=noise,
        constraints=[_constraint(c, problem) for c in problem.constraints],
        initial_state=_initial_state(problem) if with_initial else problem.initial_state,
        model=share_cache(replace(base, guess=partial(looked_up, table)), base),
    )


def natural(problem: Problem, values: Mapping[str, float]) -> dict[str, float]:
    """Estimates of the parameters themselves, from those of the solvers' coordinates."""
    pairs = zip(values.items(), problem.by_logarithm, strict=True)
    return {name: float(np.exp(value)) if by_log else value for (name, value), by_log in pairs}


def initial_offsets(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """(records, states) initial values by the model's formulae, zero where it has none; theta (parameters,)."""
    model = problem.model
    found = np.zeros((len(problem.records), len(problem.model.states)))
    if model.initial and problem.simulated:
        values = cached(model, ("initial",), lambda: ca.Function("g", [model.p], [_offset(model, model.p)]))
        for i, p in enumerate(problem.model_parameters(theta)):
            found[i] = values(p).full()[:, 0]
    return found


def _offset(model: Model, p: ca.SX) -> ca.SX:
    """(states,) initial values at parameters p, zero where they are no formula."""
    columns = [model.initial.get(name, ca.SX(0)) for name in model.states]
    return ca.densify(ca.substitute(ca.vertcat(*columns), model.p, p))


def _transformed(model: Model, logarithmic: tuple[str, ...], with_initial: bool, sigma: Mapping[str, str]) -> Model:
    rows = ca.vertsplit(model.p) if model.parameters else []
    p = ca.vertcat(*(ca.exp(row) if n in logarithmic else row for n, row in zip(model.parameters, rows, strict=True)))
    x = model.x + _offset(model, p) if with_initial else model.x
    f, h = ca.substitute([model.f, model.h], [model.x, model.p], [x, p]) if model.parameters else (model.f, model.h)
    if with_initial and model.period is not None:
        f -= ca.substitute(_offset(model, model.p), model.p, p)
    after = [ca.substitute(g, ca.vertcat(model.x, model.p), ca.vertcat(x, p)) for g in model.events.values()]
    if with_initial:
        after = [g - ca.substitute(_offset(model, model.p), model.p, p) for g in after]
    further = [channel for channel in dict.fromkeys(sigma.values()) if channel not in model.inputs]
    u = ca.vertcat(model.u, ca.SX.sym("sigma", len(further)))
    inputs = (*model.inputs, *further)
    sizes = ca.vertcat(*(u[inputs.index(sigma[o])] if o in sigma else ca.SX(1) for o in model.outputs))
    equation = model.equation
    if equation is not None:
        target, prediction = ca.substitute([equation.target, equation.prediction], [model.p], [p])
        equation = replace(equation, target=target, prediction=prediction)
    nominal = {n: float(np.log(v)) if n in logarithmic else v for n, v in model.nominal.items()}
    prior = {n: std / model.nominal[n] if n in logarithmic else std for n, std in model.prior_std.items()}
    return replace(
        model,
        inputs=inputs,
        u=u,
        f=f,
        h=h / sizes,
        outputs=tuple(f"{o} in units of {sigma[o]}" if o in sigma else o for o in model.outputs),
        nominal=nominal,
        prior_std=prior,
        equation=equation,
        initial={},
        events=dict(zip(model.events, after, strict=True)),
    )


def _scaled(problem: Problem, record: Record) -> Record:
    """The record with outputs in units of the noise of their samples, under names of their own."""
    if not problem.sigma_channels:
        return record
    added = {}
    for name, channel in problem.sigma_channels.items():
        added[channel] = np.where(record[channel] > 0.0, record[channel], 1.0)
        if name in record:
            added[f"{name} in units of {channel}"] = record[name] / added[channel]
    return record.with_channels(**added)


def _sigma(problem: Problem, record: Record) -> np.ndarray:
    """(N, outputs) what outputs are divided by."""
    columns = []
    for name in problem.model.outputs:
        channel = problem.sigma_channels.get(name)
        sigma = np.ones(len(record)) if channel is None else record[channel]
        columns.append(np.where(sigma > 0.0, sigma, 1.0))
    return np.stack(columns, axis=1)


def _constraint(constraint: Constraint, problem: Problem) -> Constraint:
    """A limit on parameters as one on what is estimated, the logarithm of some of them."""
    if isinstance(constraint, PathConstraint) or not problem.logarithmic:
        return constraint
    if isinstance(constraint, NonlinearConstraint):
        return replace(constraint, function=partial(_of_logarithms, problem, constraint.function))
    by_log = [name for name in constraint.coefficients if bare_name(problem.model, name) in problem.logarithmic]
    if not by_log:
        return constraint
    if len(constraint.coefficients) > 1:
        weighted_sum = partial(_of_logarithms, problem, partial(_weighted_sum, dict(constraint.coefficients)))
        return NonlinearConstraint(function=weighted_sum, lower=constraint.lower, upper=constraint.upper)
    ((name, factor),) = constraint.coefficients.items()
    low, high = sorted((constraint.lower / factor, constraint.upper / factor))
    with np.errstate(divide="ignore"):
        return LinearConstraint(
            coefficients={name: 1.0}, lower=float(np.log(max(low, 0.0))), upper=float(np.log(max(high, 0.0)))
        )


def _of_logarithms(problem: Problem, function: Callable[[Any], Any], s: Any) -> Any:
    """A user's function of parameters, where the namespace `s` has the logarithms of some."""
    values = {n: getattr(s, n) for n in problem.model.parameters}
    return function(Symbols("parameters", {n: ca.exp(v) if n in problem.logarithmic else v for n, v in values.items()}))


def _weighted_sum(coefficients: Mapping[str, float], s: Any) -> Any:
    return sum(c * getattr(s, name) for name, c in coefficients.items())


def _initial_state(problem: Problem) -> InitialState:
    """Zero, exactly unless stated otherwise, for states that are counted from their initial value."""
    given = problem.initial_state
    said = {name.split("[")[0] for name in given.std}
    begin = problem.model.initial
    return InitialState(
        value={**given.value, **dict.fromkeys(begin, 0.0)},
        std={**given.std, **{name: 0.0 for name in begin if name not in said}},
    )
