"""Find the parameters that the data do not determine at a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from casid.estimation.problem import Problem
from casid.estimation.solvers.own import AnyObjective, OwnObjective
from casid.estimation.solvers.point import Linearised
from casid.estimation.solvers.quadratic import jacobi_scale

_RANK = 1e-12  # of the scaled information: a smaller eigenvalue is rounding
_FAINT = 0.1  # standard deviations of the noise that all predictions together move
_PART = 0.3  # of the largest share in a direction: what has less is not named
_BY_PRIOR = 0.9  # of the information along a direction: without its prior the deviation is three times as large
_IDLE = 1e-6  # standard deviations of the noise that all predictions together move


def weakest(objective: AnyObjective, linear: Linearised, limit_multipliers: np.ndarray) -> tuple[str, ...]:
    """Parameters that the data hardly determine: a change by their whole size moves all predictions together by less
    than a tenth of the noise. If there is none, those of the direction that the data determine least."""
    size = np.maximum(np.abs(linear.point.theta), np.abs(objective.problem.start_vector))
    with np.errstate(over="ignore", invalid="ignore"):
        moves = size * np.sqrt(np.maximum(np.diagonal(linear.hessian), 0.0))
    faint = tuple(n for n, m in zip(objective.problem.parameters, moves, strict=True) if m < _FAINT)
    if faint:
        return faint
    free = objective.limits.free_directions(linear.point.theta, limit_multipliers)
    inner = free.T @ linear.hessian @ free
    if not len(inner) or not np.isfinite(inner).all():
        return ()
    scale = jacobi_scale(inner)
    vector = np.linalg.eigh(inner * np.outer(scale, scale))[1][:, 0]
    share = np.abs(free @ vector)
    return tuple(n for n, s in zip(objective.problem.parameters, share, strict=True) if s > _PART * share.max())


@dataclass(frozen=True, eq=False, kw_only=True)
class Determined:
    """Parameters and directions that the data determine: `lost` are those that they do not separate or determine;
    `directions` (parameters, k) those that they do determine; the `states` whose initial values take the place of
    lost ones, where nothing but the weak prior of these holds them."""

    lost: tuple[str, ...]
    directions: np.ndarray
    states: tuple[str, ...] = ()


def determined(objective: AnyObjective, linear: Linearised, limit_multipliers: np.ndarray) -> Determined:
    """Judge what the data say of the parameters at a point.

    Parameters are lost where a change by the whole size of the parameter, or by its start value if that is larger,
    moves no prediction by a noticeable part of the noise, also where initial states that nobody has given follow the
    change. A parameter that an active limit holds (`limit_multipliers`) is not lost.
    """
    theta = linear.point.theta
    free = objective.limits.free_directions(theta, limit_multipliers)
    names, directions = determined_along(objective.problem, linear.hessian, free, theta)
    follow = weak_pull(objective, linear) if directions.size else np.zeros((0, len(theta)))
    if not follow.size:
        return Determined(lost=names, directions=directions)
    scale = np.sqrt(np.maximum(np.diagonal(linear.hessian), 0.0))
    inner = directions.T @ linear.hessian @ directions
    own = jacobi_scale(inner)
    pull = follow @ directions * own
    try:
        shares, vectors = scipy.linalg.eigh(pull.T @ pull, inner * np.outer(own, own))
    except np.linalg.LinAlgError:
        return Determined(lost=names, directions=directions)
    by_prior = shares > _BY_PRIOR
    if not by_prior.any():
        return Determined(lost=names, directions=directions)
    along = directions @ (own[:, None] * vectors)
    weight = np.abs(along[:, by_prior]) * scale[:, None]
    weight = (weight / weight.max(axis=0)).max(axis=1)
    states = objective.problem.model.states
    moved = np.abs(follow @ along[:, by_prior]).reshape(-1, len(states), by_prior.sum()).max(axis=(0, 2))
    return Determined(
        lost=tuple(n for n, w in zip(objective.problem.parameters, weight, strict=True) if w > 0.1 or n in names),
        directions=along[:, ~by_prior],
        states=tuple(s for s, m in zip(states, moved, strict=True) if m > 0.1 * moved.max()),
    )


def weak_pull(objective: AnyObjective, linear: Linearised) -> np.ndarray:
    """(records * states, parameters) by how many of its deviations the weak prior of each initial state is moved when
    the states follow the parameters."""
    problem = objective.problem
    if isinstance(objective, OwnObjective) or objective.dynamics is None or not problem.is_initial_weak.any():
        return np.zeros((0, len(problem.parameters)))
    pull = np.zeros((len(problem.records), len(problem.model.states), len(problem.parameters)))
    for r, reduced in enumerate(linear.reduced):
        pull[r][:, problem.columns(r)] = reduced.ds_p[0]
    pull *= (objective.initial_precision * problem.is_initial_weak)[..., None]
    return pull.reshape(-1, len(problem.parameters))


def lost(objective: AnyObjective, linear: Linearised, limit_multipliers: np.ndarray) -> tuple[str, ...]:
    """Parameters that the data cannot tell apart, or of which they say nothing, see `determined`."""
    return determined(objective, linear, limit_multipliers).lost


def determined_along(
    problem: Problem, information: np.ndarray, free: np.ndarray, theta: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the lost parameters by an information matrix at theta, for parameters that can move in the directions
    `free`, and the directions (parameters, k) of these that the data do determine."""
    names = problem.parameters
    start = np.abs(problem.start_vector)
    # a parameter that begins at zero and stays there has no size of its own
    size = np.where(start > 0.0, np.maximum(np.abs(theta), start), 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        moves = size * np.sqrt(np.maximum(np.diagonal(information), 0.0))
        idle = (size > 0.0) & (moves < _IDLE) & (np.abs(free).max(axis=1, initial=0.0) > 0.0)
        inner = free.T @ information @ free
        scale = jacobi_scale(inner) if len(inner) else np.zeros(0)
        scaled = inner * np.outer(scale, scale)
    if not np.isfinite(scaled).all():  # the motion has departed: nothing can be said
        return tuple(names), free[:, :0]
    eigenvalues, vectors = np.linalg.eigh(scaled)
    known = scale[:, None] * vectors
    weight = np.zeros(len(names))
    confused = known[:, eigenvalues < _RANK]
    if confused.size:
        weight = np.abs(free @ confused).max(axis=1) / (np.abs(free) @ scale + 1e-300)
    determined = free @ known[:, eigenvalues >= _RANK]
    if idle.any():
        determined[idle] = 0.0
        left, sizes, _ = np.linalg.svd(determined / np.maximum(np.linalg.norm(determined, axis=0), 1e-300))
        determined = left[:, : int((sizes > 1e-9).sum())]
    return tuple(name for name, w, i in zip(names, weight, idle, strict=True) if w > 0.1 or i), determined
