"""Whether something cheap contradicts a solution, and where to look for a better one.

A local minimum of a simulation over a long time is often not the lowest: the simulated motion is out of step with the
measured one, and a small change of the parameters does not bring it back. Its residuals are then slow, and the same
model explains short stretches of the record far better when each has an initial state of its own. A model that is
wrong shows the same, to a lesser degree. Multiple shooting with a state at every sample decides between the two: it
starts from the measured states, so that it cannot lose step, and either returns to the solution or finds a better one.
"""

from __future__ import annotations

import math

import numpy as np

from casid.estimation.attempt import Attempt
from casid.estimation.integration import EXACT
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import ObjectiveValue
from casid.estimation.solvers.quadratic import jacobi_scale
from casid.estimation.transcriptions.kernel import whitened
from casid.estimation.transcriptions.shooting import Shooting
from casid.estimation.transcriptions.transcription import MultipleShooting

_LAGS = 12  # samples
_SLOW = 0.5  # autocorrelation of residuals of which half is no noise
_LEFT = 0.5  # of the sum of squares: what short stretches leave of it where they contradict the whole
_STRETCH = 10  # samples
_PER_STATE = 5  # readings of a stretch per state, so that its initial state takes a fifth of them at most


def doubtful(attempt: Attempt) -> bool:
    """Whether short stretches of the records contradict a solution that was simulated over longer ones."""
    objective, value = attempt.objective, attempt.outcome.value
    dynamics = objective.dynamics
    if not isinstance(dynamics, Shooting) or dynamics.soft or dynamics.layout.length <= dynamics.layout.substeps:
        return False  # nothing is simulated, or there is a state at every sample already
    if _exact(objective, value) or largest_autocorrelation(objective, value) < _SLOW:
        return False
    return left_by_stretches(objective, value) < _LEFT


def _exact(objective: Objective, value: ObjectiveValue) -> bool:
    """Whether the outputs are met so well that what is left may be rounding and integration."""
    layout, o = objective.layout, objective.layout.z.shape[2]
    low = np.where(layout.present > 0, layout.z, np.inf).min(axis=(0, 1))
    high = np.where(layout.present > 0, layout.z, -np.inf).max(axis=(0, 1))
    levels = value.noise.levels
    rms = levels.rms(value.squares)[:o]
    return bool((rms <= EXACT * np.maximum(high - low, 0.0))[layout.present.sum(axis=(0, 1)) > 0].all())


def largest_autocorrelation(objective: Objective, value: ObjectiveValue) -> float:
    """Of the residuals of any output over some lags, in magnitude; those that are missing count as zero."""
    trajectory, layout = value.trajectory, objective.layout
    assert trajectory is not None
    o = layout.z.shape[2]
    off = ((trajectory.y - layout.z) * layout.present).reshape(-1, o)
    sums = np.zeros((_LAGS + 1, o))
    for sample in layout.sample:
        own = off[sample]
        for k in range(min(_LAGS + 1, len(own))):
            sums[k] += np.einsum("ij,ij->j", own[k:], own[: len(own) - k])
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(np.nan_to_num(np.abs(sums[1:] / sums[0])).max(initial=0.0))


def left_by_stretches(objective: Objective, value: ObjectiveValue) -> float:
    """What short stretches, each with its own initial state, leave of the sum of squared residuals of the whole, once
    the parameters have moved by one Gauss-Newton step; 1 is expected of a solution with white noise. Zero where the
    records are too short to tell, or the model does not move from the measured states."""
    problem, whole, n = objective.problem, objective.layout, len(objective.scale)
    weights, trajectory = objective.whitening(value.noise.levels), value.trajectory
    assert trajectory is not None
    before = _squares(trajectory.y, whole.z, weights, whole.pattern)
    channels = max(int((whole.present.sum(axis=(0, 1)) > 0).sum()), 1)
    length = max(_STRETCH, math.ceil(_PER_STATE * n / channels))
    if max(len(record) for record in problem.records) < 2 * length:
        return 0.0
    dynamics = MultipleShooting(interval=length, substeps=whole.substeps).dynamics(problem)
    layout, nodes = dynamics.layout, dynamics.layout.start.copy()
    parameters = value.parameters[layout.record]
    weak = np.diag(1.0 / objective.scale**2)
    for settled in (False, True):
        motion = dynamics.trajectory(nodes, parameters)
        if not np.isfinite(motion.y).all():
            return 0.0
        blocks = dynamics.blocks(motion, parameters, weights)
        by_state, gradient = blocks.hessian[:, :n, n:], blocks.gradient[:, :n, None]
        solved = np.linalg.solve(blocks.hessian[:, :n, :n] + weak, np.concatenate([by_state, gradient], axis=2))
        if not settled:
            nodes = nodes - solved[..., -1]
    left = _squares(motion.y, layout.z, weights, layout.pattern) - float((gradient * solved[..., -1:]).sum())
    information, slope = np.zeros((len(problem.parameters),) * 2), np.zeros(len(problem.parameters))
    for r in range(len(problem.records)):
        own, columns = layout.segments_of(r), problem.columns(r)
        direct = blocks.hessian[own, n:, n:] - by_state[own].transpose(0, 2, 1) @ solved[own, :, :-1]
        information[np.ix_(columns, columns)] += direct.sum(axis=0)
        through = (by_state[own].transpose(0, 2, 1) @ solved[own, :, -1:])[..., 0]
        slope[columns] += (blocks.gradient[own, n:] - through).sum(axis=0)
    scale = jacobi_scale(information)
    step = scale * np.linalg.lstsq(information * np.outer(scale, scale), scale * slope, rcond=1e-12)[0]
    states = layout.segments * n / max(float(layout.present.sum()), 1.0)
    return float((left - slope @ step) / (before * max(1.0 - states, 0.5)))


def _squares(y: np.ndarray, z: np.ndarray, weights: np.ndarray, pattern: np.ndarray) -> float:
    with np.errstate(over="ignore"):
        return float(np.square(whitened(y - z, weights, pattern)).sum())
