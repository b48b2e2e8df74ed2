"""Effects whose sizes are free and whose histories follow from the records: a lag of a command, the time of a gust.

A history enters the model to first order about the values at which it was made (`in_force`). Here it is made again at
the estimates until these stay: with exact derivatives that is Gauss-Newton in the sizes, with everything else at its
optimum each time. A size moves by no more than its reach at a time. The reach becomes shorter where the estimates swing
and longer where they follow it, so that sizes several times those of the start are found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from casid.estimation.constraints import limit_parameter
from casid.estimation.fit import Fit
from casid.estimation.problem import Problem
from casid.estimation.solvers.status import Results, Status
from casid.model.system import bare_name
from casid.model.with_effects import at_own_times

_ROUNDS = 60
_SETTLED = 1e-3  # of a standard deviation, by which an estimate moves at the end
_ROUNDED = 1e-7  # of its size likewise, of one without a standard deviation
_REACH = 1.0  # of the size of an estimate
# of the reach, where an estimate turns back and where it goes on to its end
_SHORTER = 0.5
_LONGER = 1.5


def solved_with_histories(problem: Problem, first: Callable[[Problem], Fit], again: Callable[[Problem], Fit]) -> Fit:
    """Return the fit of a problem whose model has histories: `first` solves with all that is usual, `again` from where
    a fit ended."""
    moving = _sizes(problem)
    now = problem
    fit = (again if moving else first)(_held(now))
    reach = {name: _first_reach(problem, name) for name in moving}
    last = dict.fromkeys(moving, 0.0)
    settled = not moving
    for _ in range(_ROUNDS if moving else 0):
        before = now.named(now.start_vector)
        steps = {name: fit.values[name] - before[name] for name in moving}
        if (
            all(abs(step) <= _allowed(fit, name) for name, step in steps.items())
            and fit.uncertainty.solved.linear is not None
        ):
            settled = True
            break
        for name, step in steps.items():
            if step * last[name] < 0.0:
                reach[name] *= _SHORTER
            elif abs(step) > 0.99 * reach[name]:
                reach[name] *= _LONGER
        last = steps
        now = replace(now, start={**before, **_finite(fit)})
        fit = again(_held(_within(now, reach)))
    if settled and moving:
        fit = first(_held(replace(now, start={**dict(now.start), **_finite(fit)})))
    ended = fit.ended
    if not settled and ended.converged:
        reason = f"the records do not settle {', '.join(moving)}"
        ended = Status(result=Results.STOPPED, reason=reason, remedy="start nearer, fix one, or limit it")
    return _at_own_times(replace(fit, problem=replace(problem, start=dict(fit.values)), ended=ended))


def _finite(fit: Fit) -> dict[str, float]:
    return {name: value for name, value in fit.values.items() if np.isfinite(value)}


def _sizes(problem: Problem) -> tuple[str, ...]:
    """Free parameters by which histories change."""
    own = {name for one in problem.model.histories for name in one.parameters}
    return tuple(name for name, bare in zip(problem.parameters, problem.bare, strict=True) if bare in own)


def _held(problem: Problem) -> Problem:
    """The problem with the histories that its records have."""
    return replace(problem, model=problem.model.without_histories())


def _within(problem: Problem, reach: dict[str, float]) -> Problem:
    start = problem.named(problem.start_vector)
    near = [limit_parameter(n, lower=start[n] - by, upper=start[n] + by) for n, by in reach.items()]
    return replace(problem, constraints=[*problem.constraints, *near])


def _first_reach(problem: Problem, name: str) -> float:
    """A size may double at first; one of zero may become as large as is typical."""
    start = abs(problem.named(problem.start_vector)[name])
    bare = bare_name(problem.model, name)
    effects = [one.of for one in problem.model.histories if bare in one.parameters]
    if ".onset[" in bare:
        return max(20.0 * problem.records[0].dt, 0.25)
    key = "value" if bare == effects[0].name else bare.removeprefix(f"{effects[0].name}.")
    typical = [abs(one[key]) for one in effects[0].effect.further.grid if abs(one.get(key, 0.0)) > 0.0]
    usual = typical[0] if typical else 1.0
    return _REACH * (start or usual)


def _allowed(fit: Fit, name: str) -> float:
    """Return how much an estimate may move at the end."""
    std = fit.parameters[name].std_cramer_rao
    return max(_SETTLED * std if np.isfinite(std) else 0.0, _ROUNDED * abs(fit.values[name]))


def _at_own_times(fit: Fit) -> Fit:
    """The fit with predictions at the times at which they were read."""
    problem = fit.problem
    model = problem.model
    predictions = dict(fit.predictions)
    residuals = dict(fit.residuals)
    count = len(model.outputs)
    for record, parameters in zip(problem.records, problem.start_parameters, strict=True):
        sizes = dict(zip(model.parameters, parameters.tolist(), strict=True))
        found = predictions[record.name]
        if found.shape[1] < count or not problem.simulated:
            continue
        moved = at_own_times(model, record, found[:, :count], sizes)
        if moved is not found[:, :count]:
            predictions[record.name] = np.hstack([moved, found[:, count:]])
            own = [record.channels.get(f"recorded {name}", record.channels.get(name)) for name in model.outputs]
            read = np.stack([np.full(len(record), np.nan) if one is None else one for one in own], axis=1)
            residuals[record.name] = np.hstack([read - moved, residuals[record.name][:, count:]])
    return replace(fit, predictions=predictions, residuals=residuals)
