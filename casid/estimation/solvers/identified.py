"""Find the parameters that the data do not determine at a point."""

from __future__ import annotations

import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised
from casid.estimation.solvers.quadratic import jacobi_scale

_RANK = 1e-12  # of the scaled information: a smaller eigenvalue is rounding
_FAINT = 0.1  # standard deviations of the noise that all predictions together move
_PART = 0.3  # of the largest share in a direction: what has less is not named
_IDLE = 1e-6  # standard deviations of the noise that all predictions together move


def weakest(objective: Objective, linear: Linearised, limit_multipliers: np.ndarray) -> tuple[str, ...]:
    """Parameters that the data hardly determine: a change by their whole size moves all predictions together by less
    than a tenth of the noise. If there is none, those of the direction that the data determine least."""
    size = np.maximum(np.abs(linear.point.theta), np.abs(objective.problem.start_vector))
    with np.errstate(over="ignore", invalid="ignore"):
        moves = size * np.sqrt(np.maximum(np.diagonal(linear.hessian), 0.0))
    faint = tuple(n for n, m in zip(objective.problem.parameters, moves, strict=True) if m < _FAINT)
    if faint:
        return faint
    free = objective.free_directions(linear.point.theta, limit_multipliers)
    inner = free.T @ linear.hessian @ free
    if not len(inner) or not np.isfinite(inner).all():
        return ()
    scale = jacobi_scale(inner)
    vector = np.linalg.eigh(inner * np.outer(scale, scale))[1][:, 0]
    share = np.abs(free @ vector)
    return tuple(n for n, s in zip(objective.problem.parameters, share, strict=True) if s > _PART * share.max())


def lost(objective: Objective, linear: Linearised, limit_multipliers: np.ndarray) -> tuple[str, ...]:
    """Parameters that the data do not separate, or that have no effect on them. A change by the whole size of the
    parameter, or by its start value if that is larger, moves no prediction by a noticeable part of the noise.

    limit_multipliers: a parameter that an active limit holds is not lost.
    """
    theta = linear.point.theta
    return lost_along(objective.problem, linear.hessian, objective.free_directions(theta, limit_multipliers), theta)


def lost_along(problem: Problem, information: np.ndarray, free: np.ndarray, theta: np.ndarray) -> tuple[str, ...]:
    """Return `lost` by an information matrix at theta, for parameters that can move in the directions `free`."""
    return determined_along(problem, information, free, theta)[0]


def determined_along(
    problem: Problem, information: np.ndarray, free: np.ndarray, theta: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return `lost_along`, and the directions (parameters, k) of `free` that the data do determine."""
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
