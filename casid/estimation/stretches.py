"""Short stretches of the records, each with an initial state of its own, against the whole.

A local minimum of a simulation over a long time is often not the lowest: the simulated motion is out of step with the
measured one, and a small change of the parameters does not bring it back. Its residuals are then slow, and the same
model explains short stretches of the record far better when each has an initial state of its own. A model that is
wrong shows the same, to a lesser degree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.solvers.kkt import without_starts
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import ObjectiveValue
from casid.estimation.solvers.quadratic import jacobi_scale
from casid.estimation.transcriptions.dynamics import Blocks
from casid.estimation.transcriptions.kernel import whitened
from casid.estimation.transcriptions.layout import Layout
from casid.estimation.transcriptions.transcription import MultipleShooting

EXACT = 1e-4  # of a channel's range: measurements that claim more are not held to it
_LAGS = 12  # samples
_SLOW = 0.5  # autocorrelation of residuals of which half is no noise
_LEFT = 0.5  # of the sum of squares: what short stretches leave of it where they contradict the whole
_STRETCH = 10  # samples
# of Gauss and Newton, and relative change of the sum of squares that ends them
_STEPS = 15
_SETTLED = 1e-3
_RANK = 1e-8  # of the scaled information: less moves no parameter
_PER_STATE = 5  # readings of a stretch per state, so that its initial state takes a fifth of them at most


def is_slow(objective: Objective, value: ObjectiveValue) -> bool:
    """Return True if residuals of a simulated solution are so slow that stretches have to be fitted."""
    dynamics = objective.dynamics
    if dynamics is None or dynamics.soft or value.trajectory is None:
        return False
    return not _exact(objective, value) and largest_autocorrelation(objective, value) >= _SLOW


def _exact(objective: Objective, value: ObjectiveValue) -> bool:
    """Return True if the outputs are met so well that what is left may be rounding and integration."""
    layout = objective.layout
    o = objective.layout.z.shape[2]
    rms = value.noise.levels.rms(value.squares)[:o]
    return bool((rms <= EXACT * layout.ranges)[layout.present.any(axis=(0, 1))].all())


def largest_autocorrelation(objective: Objective, value: ObjectiveValue) -> float:
    """Return the largest autocorrelation of the residuals of any output over some lags, in magnitude; missing ones
    count as zero."""
    trajectory = value.trajectory
    layout = objective.layout
    assert trajectory is not None
    o = layout.z.shape[2]
    off = layout.residuals(trajectory.y).reshape(-1, o)
    sums = np.zeros((_LAGS + 1, o))
    for sample in layout.sample:
        own = off[sample]
        for k in range(min(_LAGS + 1, len(own))):
            sums[k] += np.einsum("ij,ij->j", own[k:], own[: len(own) - k])
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(np.nan_to_num(np.abs(sums[1:] / sums[0])).max(initial=0.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Stretches:
    """Share of the sum of squared residuals of the whole that short stretches leave, each with its own initial
    state, and the parameters (parameters,) with which they do; 1 is expected of a solution with white noise. NaN and
    None where the records are too short, or the model does not move from the measured states."""

    left: float = math.nan
    theta: np.ndarray | None = None

    @property
    def agree(self) -> bool:
        """Return True if the whole explains the records about as well."""
        return self.left >= _LEFT

    @property
    def contradict(self) -> bool:
        """Return True if the stretches explain the records far better."""
        return self.left < _LEFT


def by_stretches(objective: Objective, value: ObjectiveValue, implicit: bool) -> Stretches:
    """Parameters and initial states of all stretches by some steps of Gauss and Newton from those of a value, by
    `implicit` or explicit steps of integration."""
    try:
        return _by_stretches(objective, value, implicit)
    except np.linalg.LinAlgError:
        return Stretches()


def _by_stretches(objective: Objective, value: ObjectiveValue, implicit: bool) -> Stretches:
    problem = objective.problem
    whole = objective.layout
    n = len(objective.scale)
    weights = objective.whitening(value.noise.levels)
    trajectory = value.trajectory
    assert trajectory is not None
    before = _squares(trajectory.y, whole.z, weights, whole.pattern)
    channels = max(int((whole.present.sum(axis=(0, 1)) > 0).sum()), 1)
    length = max(_STRETCH, math.ceil(_PER_STATE * n / channels))
    if max(len(record) for record in problem.records) < 2 * length:
        return Stretches()
    if before == 0.0:  # the whole leaves nothing
        return Stretches(left=1.0)
    dynamics = MultipleShooting(interval=length, substeps=whole.substeps, implicit=implicit).dynamics(problem)
    layout = dynamics.layout
    weak = np.diag(1.0 / objective.scale**2)
    nodes = layout.start.copy()
    parameters = value.parameters
    theta = np.zeros(len(problem.parameters))
    for r in range(len(problem.records)):
        theta[problem.columns(r)] = parameters[r, problem.free_index]
    best = math.inf
    found = (nodes, theta)
    step = (np.zeros_like(nodes), np.zeros_like(theta))
    for iteration in range(_STEPS):
        motion = dynamics.trajectory(nodes, problem.model_parameters(theta)[layout.record])
        squares = _squares(motion.y, layout.z, weights, layout.pattern)
        if not squares < best:
            if best == math.inf:
                return Stretches()
            step = 0.5 * step[0], 0.5 * step[1]
        else:
            settled = squares > (1.0 - _SETTLED) * best
            best = squares
            found = (nodes, theta)
            if settled:
                break
            blocks = dynamics.blocks(motion, problem.model_parameters(theta)[layout.record], weights)
            step = _stretched_step(problem, layout, blocks, weak, moving=iteration > 0)
        nodes = found[0] + step[0]
        theta = found[1] + step[1]
    states = layout.segments * n / max(float(layout.present.sum()), 1.0)
    return Stretches(left=float(best / (before * max(1.0 - states, 0.5))), theta=found[1])


def _stretched_step(
    problem: Problem, layout: Layout, blocks: Blocks, weak: np.ndarray, moving: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Steps of the states (K, n) and, where they are `moving`, of the parameters (parameters,)."""
    n = len(weak)
    theta = np.zeros(len(problem.parameters))
    blocks.hessian[:, :n, :n] += weak
    solved, inner, left = without_starts(blocks.hessian, blocks.gradient, n)
    if moving:
        information = np.zeros((len(theta),) * 2)
        slope = np.zeros(len(theta))
        for r in range(len(problem.records)):
            own = layout.segments_of(r)
            columns = problem.columns(r)
            information[np.ix_(columns, columns)] += inner[own].sum(axis=0)
            slope[columns] += left[own].sum(axis=0)
        scale = jacobi_scale(information)
        scaled = information * np.outer(scale, scale)
        if not (np.isfinite(scaled).all() and np.isfinite(slope).all()):
            raise np.linalg.LinAlgError("the sensitivities are no numbers here")
        theta = -scale * np.linalg.lstsq(scaled, scale * slope, rcond=_RANK)[0]
    own = np.array([problem.columns(r) for r in range(len(problem.records))])[layout.record]
    follow = (solved[..., :-1] @ theta[own][..., None])[..., 0]
    return -solved[..., -1] - follow, theta


def _squares(y: np.ndarray, z: np.ndarray, weights: np.ndarray, pattern: np.ndarray) -> float:
    with np.errstate(over="ignore"):
        return float(np.square(whitened(y - z, weights, pattern)).sum())
