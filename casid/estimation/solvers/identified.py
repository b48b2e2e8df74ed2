"""Of which parameters the data say nothing at a point."""

from __future__ import annotations

import numpy as np

from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised
from casid.estimation.solvers.quadratic import jacobi_scale

_RANK = 1e-12  # of the scaled information: a smaller eigenvalue is rounding
_IDLE = 1e-6  # standard deviations of the noise that all predictions together move


def lost(objective: Objective, linear: Linearised, limit_multipliers: np.ndarray) -> tuple[str, ...]:
    """Parameters that the data cannot tell apart, or of which they say nothing: a change by the whole size of the
    parameter, or by its start value if that is larger, moves no prediction by a noticeable part of the noise.

    limit_multipliers: a parameter that an active limit holds is not lost.
    """
    names, free = objective.problem.parameters, objective.free_directions(limit_multipliers)
    inner = free.T @ linear.hessian @ free
    scale = jacobi_scale(inner) if len(inner) else np.zeros(0)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = inner * np.outer(scale, scale)
    if not np.isfinite(scaled).all():  # the motion has departed: nothing can be said
        return tuple(names)
    start = np.abs(objective.problem.start_vector)
    # a parameter that begins at zero and stays there has no size of its own
    size = np.where(start > 0.0, np.maximum(np.abs(linear.point.theta), start), 0.0)
    moves = size * np.sqrt(np.maximum(np.diagonal(linear.hessian), 0.0))
    moving = np.abs(free).max(axis=1, initial=0.0) > 0.0
    idle = (size > 0.0) & (moves < _IDLE) & moving
    eigenvalues, vectors = np.linalg.eigh(scaled)
    confused = vectors[:, eigenvalues < _RANK]
    weight = np.zeros(len(names))
    if confused.size:
        weight = np.abs(free @ (scale[:, None] * confused)).max(axis=1) / (np.abs(free) @ scale + 1e-300)
    return tuple(name for name, w, i in zip(names, weight, idle, strict=True) if w > 0.1 or i)
