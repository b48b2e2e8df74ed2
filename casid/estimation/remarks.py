"""Write what a person should know of a fit beside its status: channels that it misses, values that contradict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from scipy.special import ndtri

from casid.estimation.cost import RangeWeights
from casid.estimation.fitted import ChannelFit, Estimate
from casid.estimation.noise import Huber, StudentT
from casid.estimation.problem import Problem
from casid.estimation.solvers.gauss_newton import GaussNewton
from casid.estimation.solvers.limits import ParameterLimits
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import AnyObjective, OwnObjective
from casid.estimation.transcriptions.transcription import MultipleShooting
from casid.model.numbers import with_deviation
from casid.model.system import bare_name
from casid.records.record import Record

_FAR = 3.0  # a-priori deviations: 3 in 1000 are as far by chance
_SURE = 2.0  # standard errors: the sign is known
_UNEXPLAINED = 2.0  # times the given noise: chosen; by chance a hundred samples are not beyond 1.3
_ROUNDED = 1e-9  # of a value that is at its limit
_NORMAL = 1.4826  # standard deviations in a median of magnitudes
_CHANCE = 1e-3  # that one of all readings is so far by chance
_FEW = 20  # readings, of which no one is far
_DOMINATE = 0.2  # of the squared residuals: the standard errors are a tenth too large
_RARE = 0.01  # of the readings: more of them are a misfit of the model
_NOTICED = 1.2  # times the standard error
_ONE_SIDED = 1e-3  # of the other side
_REACHED = 1e-6  # of the largest value: as near a path is at its limit


def remarks(fit: Any) -> tuple[str, ...]:
    """List what a fit should be read with, a sentence each: records that are there twice, starts beyond a limit,
    channels that their mean explains better, readings that dominate, residuals with colour, parameters that a limit
    holds, that are three a-priori deviations from the file or of the opposite sign, standard errors that no sample is
    left for."""
    with np.errstate(over="ignore", invalid="ignore"):  # residuals of a simulation that diverged
        readings = tuple(_readings(fit))
    found = [
        *_repeated(fit.problem.records),
        *_start(fit.problem),
        *_channels(fit.channels),
        *readings,
        *against_prior(fit.problem, fit.parameters),
    ]
    if not fit.converged:
        return tuple(found)
    found += _initial(fit)
    held = [*_held(fit), *_held_paths(fit)]
    errors = [*_colour(fit.uncertainty.coloured_channels, fit.parameters), *held, *_errors(fit.parameters)]
    return (*_noise(fit), *found, *errors)


def _repeated(records: Sequence[Record]) -> Iterator[str]:
    """Records with the same numbers: they count twice, and errors come out too small."""
    first: dict[tuple, str] = {}
    for record in records:
        content = tuple((name, np.asarray(record[name]).tobytes()) for name in sorted(record.channels))
        same = first.setdefault((record.t.tobytes(), content), record.name)
        if same != record.name:
            yield f"records: '{record.name}' has the same numbers as '{same}', so that these count twice; leave one out"


def _start(problem: Problem) -> Iterator[str]:
    """Start values beyond a limit, from which the iteration goes back to it."""
    for row, lower, upper in zip(*problem.linear_rows, strict=True):
        value = float(row @ problem.start_vector)
        beyond = max(lower - value, value - upper)
        if beyond > _ROUNDED * max(abs(value), abs(beyond)):
            names = [n for n, c in zip(problem.parameters, row, strict=True) if c != 0.0]
            limit = lower if value < lower else upper
            what = names[0] if len(names) == 1 and row.max() == 1.0 else f"the combination of {', '.join(names)}"
            yield f"start: {what} is {value:.6g}, beyond its limit {limit:.6g}; the search began there and moved inside"


def _readings(fit: Any) -> Iterator[str]:
    """Single readings far from all others, and from their neighbours, that hold much of the squared residuals."""
    records = {record.name: record for record in fit.problem.records}
    names = fit.problem.model.outputs
    robust = isinstance(fit.problem.noise, StudentT | Huber)
    simulated = {n: r for n, r in fit.residuals.items() if fit.problem.simulated and not robust}
    for c, name in enumerate(names if simulated else ()):
        found = list[tuple[float, str, float]]()
        every = np.concatenate([r[:, c] for r in simulated.values()])
        seen = every[np.isfinite(every)]
        if len(seen) < _FEW:
            continue
        limit = -_NORMAL * float(np.median(np.abs(seen))) * float(ndtri(0.5 * _CHANCE / len(seen)))
        squares = float(seen @ seen)
        count = len(seen)
        for record, residuals in simulated.items():
            own = residuals[:, c]
            where = np.flatnonzero(np.isfinite(own))
            values = own[where]
            apart = np.abs(values - scipy.ndimage.median_filter(values, 5, mode="nearest"))
            for i in np.flatnonzero((np.abs(values) > limit) & (apart > limit)):
                found.append((float(values[i] ** 2), record, float(records[record].t[where[i]])))
        share = sum(square for square, _, _ in found) / squares if squares > 0.0 else 0.0
        if share > _DOMINATE and len(found) < _RARE * count:
            _, record, t = max(found)
            many = f"{len(found)} readings" if len(found) > 1 else "one reading"
            yield (
                f"{name}: {many} of {count} hold{'s' * (len(found) == 1)} {100 * share:.0f} % of the squared residuals "
                f"(the largest in record '{record}' at t = {t:.6g} s): set what is wrong to NaN, or give a robust "
                "noise, noise=cs.StudentT()"
            )


def _colour(coloured: Sequence[str], parameters: Mapping[str, Estimate]) -> Iterator[str]:
    """Residuals that are no white noise, where that changes the standard errors."""
    ratios = [e.std / e.std_cramer_rao for e in parameters.values() if e.std_cramer_rao > 0.0]
    if coloured and max(ratios, default=1.0) > _NOTICED:
        yield (
            f"the residuals of {', '.join(coloured)} are coloured: std allows for it and is up to {max(ratios):.2g} "
            "times std_cramer_rao"
        )


def _held(fit: Any) -> Iterator[str]:
    """Parameters that are at a limit, alone or in a combination, and have an interval to one side."""
    theta = np.array(list(fit.values.values()))
    rows = ParameterLimits(fit.problem).at(theta)[1]
    in_force = (rows[fit.multipliers != 0.0] != 0.0).any(axis=0)
    at_bound = (theta == fit.problem.bounds).any(axis=0)
    for e, held in zip(fit.parameters.values(), in_force | at_bound, strict=True):
        name = e.name
        low = e.value - e.interval[0]
        high = e.interval[1] - e.value
        if held and min(low, high) < _ONE_SIDED * max(low, high):
            yield f"{name}: held by a limit; its 95 % interval is one-sided, {e.interval[0]:.4g} to {e.interval[1]:.4g}"


def _held_paths(fit: Any) -> Iterator[str]:
    """Path limits that samples reach."""
    model = fit.problem.model
    for limit in fit.problem.path_constraints:
        state = limit.name in model.states
        column = (model.states if state else model.outputs).index(limit.name)
        paths = [fit.states[r.name].trajectory if state else fit.predictions[r.name] for r in fit.problem.records]
        values = np.concatenate([path[:, column] for path in paths])
        room = np.minimum(limit.upper - values, values - limit.lower)
        reached = int((room <= _REACHED * max(float(np.abs(values).max()), 1e-300)).sum())
        if reached:
            soft = math.isfinite(limit.price)
            errors = "are those without it, and no smaller than within it" if soft else "allow for it"
            yield f"{limit.name}: its limit holds {reached} of {len(values)} samples; the standard errors {errors}"


def _noise(fit: Any) -> Iterator[str]:
    """Residuals that a given noise does not explain: the model is wrong, or the minimum is not the lowest."""
    problem = fit.problem
    misfit = fit.cost - fit.prior_cost
    samples = sum(channel.samples for channel in fit.channels.values())
    if problem.noise is None or isinstance(problem.noise, str | RangeWeights | StudentT | Huber):
        return
    times = math.sqrt(max(2.0 * misfit, 0.0) / samples)
    if times > _UNEXPLAINED and problem.is_output_error:
        tried = "" if fit.starts is not None else ": solve(..., starts=20) tells"
        yield (
            f"the residuals are {times:.2g} times the given noise: the model cannot follow these data, or another "
            f"minimum is lower{tried}"
        )


def _channels(channels: Mapping[str, ChannelFit]) -> Iterator[str]:
    for name, channel in channels.items():
        if channel.R2 < 0.0:
            yield f"{name}: R2 is {channel.R2:.2g}, its own mean explains it better than the model"
        elif math.isnan(channel.R2):
            yield f"{name}: measured as constant; nothing can be learnt from it"


def against_prior(problem: Problem, parameters: Mapping[str, Estimate]) -> Iterator[str]:
    """Parameters of the opposite sign of their a-priori value, or three a-priori deviations from it."""
    known = problem.model.prior_std
    for name, e in parameters.items():
        std = known.get(bare_name(problem.model, name), math.inf)
        far = abs(e.value - e.prior) / std if std > 0.0 else 0.0
        error = e.std if math.isfinite(e.std_corrected) else 0.0
        opposite = e.value * e.prior < 0.0 and abs(e.value) > _SURE * error
        stated = f" +- {std:.2g}" if math.isfinite(std) else ""
        numbers = f"{with_deviation(e.value, error)} against {e.prior:.4g}{stated}"
        if opposite:
            yield f"{name}: of the opposite sign of its a-priori value, {numbers}"
        elif far >= _FAR:
            yield f"{name}: {far:.1f} a-priori deviations from its a-priori value, {numbers}"


def _initial(fit: Any) -> Iterator[str]:
    """Initial states far from their prior."""
    for states in fit.initial_states.values():
        for e in states.values():
            far = abs(e.value - e.prior) / e.prior_std if e.prior_std > 0.0 else 0.0
            if far >= _FAR:
                yield (
                    f"initial state {e.name}: {far:.1f} deviations from what InitialState gives, "
                    f"{with_deviation(e.value, e.std)} against {e.prior:.4g} +- {e.prior_std:.2g}"
                )


def _errors(parameters: Mapping[str, Estimate]) -> Iterator[str]:
    if parameters and all(math.isnan(e.std) for e in parameters.values()):
        yield "no standard errors: as many unknowns as samples, and the noise is estimated with them"


_JUMP = 0.2  # of a channel's range, off the straight line between its neighbours: worth a look, and no more
_WORTH = 3.0  # ln(likelihood): odds of twenty to one between two models of as many parameters
_STEPS = 30  # of Gauss-Newton from the estimates


def jump_remarks(objective: AnyObjective, theta: np.ndarray) -> Iterator[str]:
    """A sentence for each input that jumps, runs linearly, and would explain the data better held; of the objective
    that was minimised, with its parameters theta."""
    problem = objective.problem
    sampled = problem.feedback is not None or problem.model.period is not None
    if isinstance(objective, OwnObjective) or objective.dynamics is None or objective.soft or sampled:
        return
    names = [name for name in problem.model.inputs if any(_jumps(record, name) for record in problem.records)]
    if not names:
        return
    steps = objective.layout.substeps
    plain = _log_likelihood(problem, theta, steps)
    for name in names:
        held = replace(problem, records=[_with_held(record, name) for record in problem.records])
        gain = _log_likelihood(held, theta, steps) - plain
        if gain > _WORTH:
            yield (
                f"input '{name}' jumps between samples and is taken as linear there; held, the log likelihood is "
                f"{gain:.3g} higher: write Record(..., hold={{'{name}': 'held'}})"
            )


def _jumps(record: Record, name: str) -> bool:
    if record.hold_of(name) != "linear" or name == "t" or len(record) < 3:
        return False
    t = record.t
    u = record[name]
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    off = np.abs(u[1:-1] - u[:-2] - share * (u[2:] - u[:-2]))
    return bool(off.max() > _JUMP * np.ptp(u) > 0.0)


def _with_held(record: Record, name: str) -> Record:
    hold = dict.fromkeys(record.channels, record.hold) if isinstance(record.hold, str) else dict(record.hold)
    return replace(record, hold=hold | {name: "held"})


def _log_likelihood(problem: Problem, theta: np.ndarray, steps: int) -> float:
    """At the optimum next to theta; minus infinity where there is none."""
    dynamics = MultipleShooting(substeps=steps).dynamics(problem)
    begin = replace(Objective(problem, dynamics).start(), theta=theta)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        value = GaussNewton(iterations=_STEPS).minimise(Objective(problem, dynamics, begin)).value
    found = value.noise.levels.log_likelihood(value.squares)
    return found if math.isfinite(found) else -math.inf
