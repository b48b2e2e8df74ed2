"""Explain how a solution ended, and for what reason: a state, a parameter, a time or an expression is named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.solvers.full_noise import FullNoise
from casid.estimation.solvers.point import ObjectiveValue, Point
from casid.estimation.solvers.status import CONVERGED, Results, Stage, Status
from casid.estimation.transcriptions.transcription import SingleShooting
from casid.estimation.uncertainty import Uncertainty
from casid.model.expressions import origin
from casid.model.system import unguessed_states

_BEYOND = 1e3  # times the root mean square of what was measured: no simulation that follows it is so far away
_STEPS = (0.01, -0.01, 0.1, -0.1, 0.5, -0.5, 2.0)  # of a parameter's size, at which a jump is looked for
_RAN_OFF = 1e6  # times the larger of start and a-priori value: no data move a parameter there that they see


def final_status(problem: Problem, status: Status, point: Point, errors: Uncertainty, method: Any) -> Status:
    """The status of a fit: the state, parameter, time or expression that is the reason, and what to do about it."""
    jumping = _jumping(problem, errors)
    if jumping:
        return _jumping_status(jumping)
    if status.converged:
        return _not_identifiable(problem, point, errors)
    if status.result in (Results.STOPPED, Results.ANOTHER_MINIMUM):
        return status
    if status.stage is Stage.FLAT:
        names = ", ".join(errors.confused or errors.weakest) or "every parameter"
        return replace(
            status,
            reason=f"at the maximum of the likelihood the data hardly tell {names}",
            remedy="fix or give a prior",
        )
    cause = _no_number_at_start(problem)
    if cause:
        return Status(result=Results.FAILED, reason=cause)
    elsewhere = (
        "use MultipleShooting()"
        if isinstance(method, SingleShooting)
        else "check start values, units and time, or try Collocation()"
    )
    if status.stage is Stage.AT_START:
        status = replace(status, remedy=elsewhere)
    elif ran_away(problem, errors.value):
        reason = "the simulation runs away from the measured motion"
        status = Status(result=Results.DEPARTED, reason=reason, remedy=elsewhere)
    elif status.stage is Stage.SINGULAR:
        status = _undetermined(problem, errors)
    missing = _unguessed(problem)
    if missing:
        advice = (
            f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not measured and begin at zero: give "
            "define_model(guess=...) or InitialState(value={...})"
        )
        status = replace(status, remedy="; ".join(part for part in (status.remedy, advice) if part))
    return status


def _undetermined(problem: Problem, errors: Uncertainty) -> Status:
    """For a step that does not exist: which parameters it is that the data do not determine."""
    idle = idle_parameters(problem)
    remedy = "start elsewhere, fix one or give a prior"
    if idle:
        return _idle_status(idle)
    if errors.linear is not None and errors.confused:
        reason = f"the data cannot tell {', '.join(errors.confused)} apart"
        remedy = "fix one or give a prior"
    elif weak := ", ".join(errors.weakest):
        reason = f"the data hardly tell {weak} near this point"
    else:
        reason = "parameters or states cannot be told apart near this point"
    return Status(result=Results.NOT_IDENTIFIABLE, reason=reason, remedy=remedy)


def _idle_status(idle: list[str]) -> Status:
    return Status(
        result=Results.NOT_IDENTIFIABLE,
        reason=f"the model does not depend on {', '.join(idle)}",
        remedy=f"fix {'it' if len(idle) == 1 else 'them'}, or give a prior",
    )


def _jumping(problem: Problem, errors: Uncertainty) -> list[str]:
    """Parameters whose derivative is zero at the end and some way from it, although a step moves the predictions."""
    linear = errors.linear
    if linear is None:
        return []
    idle = idle_parameters(problem)
    theta = linear.point.theta
    size = np.maximum(np.abs(theta), np.abs(problem.start_vector))
    low, high = problem.bounds
    found = []
    for i in np.flatnonzero(np.diagonal(linear.hessian) == 1.0 / problem.prior_std**2):
        if problem.parameters[i] in idle:
            continue
        for step in _STEPS:
            stepped = theta.copy()
            stepped[i] = np.clip(theta[i] + step * (size[i] or 1.0), low[i], high[i])
            moves, slope = _moves(errors, linear.point, stepped)
            if slope[i] != 1.0 / problem.prior_std[i] ** 2:  # of a parameter that has no effect just here
                break
            if moves:
                found.append(problem.parameters[i])
                break
    return found


def _moves(errors: Uncertainty, point: Point, theta: np.ndarray) -> tuple[bool, np.ndarray]:
    """Return True if other parameters move the predictions, and the diagonal of the information there."""
    objective = errors.objective
    try:
        value = objective.value(replace(point, theta=theta), errors.value.noise)
        linear = objective.linearise(replace(point, theta=theta), value)
    except np.linalg.LinAlgError:
        return False, np.diagonal(errors.linear.hessian) if errors.linear else np.zeros(len(theta))
    before, after = (np.concatenate([v.squares.ravel(), v.defects.ravel()]) for v in (errors.value, value))
    return bool(np.isfinite(after).all() and (before != after).any()), np.diagonal(linear.hessian)


def _jumping_status(names: list[str]) -> Status:
    many = ", ".join(names)
    return Status(
        result=Results.NO_DERIVATIVE,
        reason=f"the model depends on {many}, and the derivative by {'it' if len(names) == 1 else 'them'} is zero "
        "everywhere, as of a time inside np.where or a comparison",
        remedy=f"write the transition smoothly, 0.5 + 0.5 * np.tanh((t - {names[0]}) / width) with a width of a sample "
        "or two, make the command a smooth function of it, or fix it and compare several values",
    )


def _not_identifiable(problem: Problem, point: Point, errors: Uncertainty) -> Status:
    confused = errors.confused
    if not confused:
        return CONVERGED
    gone = _ran_off(problem, point)
    if gone:
        reason = f"the iteration ran off to {', '.join(gone)}"
        return Status(result=Results.DEPARTED, reason=reason, remedy="start nearer, or give a prior or bounds")
    idle = [name for name in idle_parameters(problem) if name in confused]
    if idle:
        return _idle_status(idle)
    if errors.exchanged:
        states = ", ".join(errors.exchanged)
        reason = f"the data cannot tell {', '.join(confused)} from the initial value of {states}, which is not known"
        remedy = f"give InitialState(value={{...}}, std={{...}}) of {states}, read it, or fix one of these parameters"
    elif len(confused) == 1:
        reason = f"nothing in these data depends on {confused[0]}"
        remedy = "fix it or give a prior"
    else:
        reason = f"the data cannot tell {', '.join(confused)} apart"
        remedy = "fix one or give a prior"
    return Status(result=Results.NOT_IDENTIFIABLE, reason=reason, remedy=remedy)


def ran_away(problem: Problem, value: ObjectiveValue, times: float = _BEYOND) -> bool:
    """Judge whether simulated outputs are further from the readings than so many `times` their root mean square."""
    if not problem.simulated:
        return False
    levels = value.noise.levels
    squares = value.squares
    if isinstance(levels, FullNoise):
        return not np.isfinite(squares).all()
    measured = np.sqrt(levels.magnitude / np.maximum(levels.present, 1))
    return bool((~(levels.rms(squares) <= times * measured) & (measured > 0.0)).any())


def _ran_off(problem: Problem, point: Point) -> list[str]:
    """Parameters that are absurdly far away."""
    size = np.maximum(np.abs(problem.start_vector), np.abs(problem.nominal))
    far = np.abs(point.theta) > _RAN_OFF * np.where(size > 0.0, size, 1.0)
    return [f"{n} = {v:.3g}" for n, v, f in zip(problem.parameters, point.theta, far, strict=True) if f]


def idle_parameters(problem: Problem) -> list[str]:
    """List free parameters of no equation."""
    model = problem.model
    parts = [model.f, model.h, *model.events.values()]
    if model.equation is not None:
        parts.append(model.equation.prediction)
    used = ca.which_depends(ca.vertcat(*parts), model.p, 1, False)
    idle = {n for n, uses in zip(model.parameters, used, strict=True) if not uses}
    return [name for name, bare in zip(problem.parameters, problem.bare, strict=True) if bare in idle]


def _unguessed(problem: Problem) -> list[str]:
    if not problem.simulated:
        return []
    names = unguessed_states(problem.model, problem.records)
    return [name for name in names if name not in {n.split("[")[0] for n in problem.initial_state.value}]


def _no_number_at_start(problem: Problem) -> str:
    """The derivative or output that is no number at the measured states and start values; "" when all are."""
    if not problem.simulated:
        return ""
    model = problem.model
    both = ca.vertcat(model.f, model.h)
    names = [f"the derivative of '{s}'" for s in model.states] + [f"output '{o}'" for o in model.outputs]
    found = problem.at_guess(both)
    for record, p, values in zip(problem.records, problem.start_parameters, found, strict=True):
        numbers = np.isfinite(values)
        numbers[:, len(model.states) :] |= ~np.isfinite(problem.outputs_of(record))  # what is not read does not matter
        bad = np.argwhere(~numbers)
        if len(bad):
            k, i = bad[0]
            calm = np.zeros(len(model.disturbances))
            at = {"x": model.guess(record)[k], "u": record.matrix(model.inputs)[k], "p": p, "w": calm}
            return (
                f"at the start values {names[i]} is no number in record '{record.name}' at t = {record.t[k]:g} s: "
                f"{origin(both[int(i)], model.vectors, at)}"
            )
    return ""
