"""How many steps a sample interval takes: the error of the integration against the noise of the data.

An error e of the predictions, in standard deviations of the data, moves no estimate by more than |e| of its own
standard deviations: the estimate is a projection of the residuals. So |e| over all samples is what must be small.
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np

from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point
from casid.estimation.transcriptions.collocation import LiftedCollocation
from casid.estimation.transcriptions.dynamics import Trajectory
from casid.estimation.transcriptions.steps import cached, quiet
from casid.estimation.transcriptions.transcription import Collocation, Transcription
from casid.native.compiler import Compilable

TOLERANCE = 0.1  # standard deviations that an estimate may be off
_EXACT = 1e-4  # of a channel's range: measurements that claim more are not held to it
_ORDER = 4  # of Runge and Kutta's method
_NODES = 4  # at which the motion's rates are looked at
MOST_STEPS = 64  # per sample interval: what takes more is stiff
_STABLE = 2.5  # of rate times step, of which the method bears 2.78
_GROWTH = 1.3  # more steps than the order asks for


def is_plain(objective: Objective, value: ObjectiveValue, point: Point) -> bool:
    """Whether the rates of the motion alone say that the error is small enough, with no look at the motion.

    A step h of the method errs by (rate h)^4/120 of the signal over the time 1/rate.
    """
    step = float(objective.layout.dt.max())
    worst = (_fastest(objective, point) * step) ** _ORDER / 120.0
    return bool(worst * value.noise.levels.size < TOLERANCE)


def _fastest(objective: Objective, point: Point, decaying: bool = False) -> float:
    """Largest magnitude of an eigenvalue of df/dx [1/s] at some of the nodes, or of the decaying ones alone."""
    model, layout = objective.problem.model, objective.layout
    slope = cached(
        model,
        ("compiled rates",),
        lambda: Compilable(
            ca.Function(
                "rates", [model.x, model.u, model.p], [ca.densify(ca.jacobian(quiet(model, model.f), model.x).T)]
            )
        ),
    )
    which = np.linspace(0, layout.segments - 1, _NODES).astype(int)
    parameters = objective.problem.model_parameters(point.theta)[layout.record[which]]
    found = slope.mapped(_NODES)(point.nodes[which], layout.u0[which, 0], parameters)[0].reshape(
        _NODES, len(model.states), -1
    )
    if not np.isfinite(found).all():
        return 0.0 if decaying else math.inf
    rates = np.linalg.eigvals(found)
    return float(np.abs(rates[rates.real < 0.0] if decaying else rates).max(initial=0.0))


def order(method: Transcription) -> int:
    """With which power of the step the error falls."""
    return 2 * method.degree - 1 if isinstance(method, Collocation) else _ORDER


def stable_steps(objective: Objective) -> int:
    """Steps per sample interval with which a decaying motion at the start does not grow by the method alone."""
    interval = float(objective.layout.dt.max()) * objective.layout.substeps
    return math.ceil(min(_fastest(objective, objective.start(), decaying=True) * interval / _STABLE, 1e6))


def integration_error(
    objective: Objective, point: Point, linear: Linearised, value: ObjectiveValue, method: Transcription
) -> float:
    """|e| by the motion with twice as many steps from the same nodes; `method` is the transcription with these."""
    trajectory, finer = value.trajectory, method.dynamics(objective.problem)
    assert trajectory is not None and linear.blocks is not None
    power = 2.0 ** order(method)
    scale = power / (power - 1.0)  # of the difference, to the error
    if isinstance(finer, LiftedCollocation):
        better = replace(trajectory, end=_end_of_halves(objective, point, trajectory, finer))
        direct = 0.0  # samples are nodes
    else:
        better = finer.trajectory(point.nodes, objective.parameters(point.theta))
        direct = _directly(objective, value, trajectory, better, scale)
    shift = _shift_of_nodes(objective, linear, scale * (better.end - trajectory.end))
    # what a shift of a node does to the predictions of its segment, in the whitened norm
    n = shift.shape[1]
    by_node = np.einsum("kn,knm,km->k", shift, linear.blocks.hessian[:, :n, :n], shift)
    return float(np.sqrt(direct + by_node.sum()))


def _end_of_halves(objective: Objective, point: Point, coarse: Trajectory, finer: LiftedCollocation) -> np.ndarray:
    """(K, n) ends of the steps of collocation by two half steps each; the last sample of a record has no step."""
    layout, halves = objective.layout, finer.layout
    last = np.append(layout.first[1:], layout.segments) - 1
    steps = np.setdiff1d(np.arange(layout.segments), last)
    pair = halves.first[layout.record[steps]] + 2 * (steps - layout.first[layout.record[steps]])
    parameters = objective.problem.model_parameters(point.theta)[halves.record]
    end = coarse.end.copy()
    end[steps] = finer.ends_of_pairs(point.nodes[steps], pair, parameters)
    return end


def _directly(objective: Objective, value: ObjectiveValue, coarse: Trajectory, fine: Trajectory, scale: float) -> float:
    """Sum of squares of the whitened difference of the predictions from the same nodes."""
    layout = objective.layout
    low = np.where(layout.present > 0, layout.z, np.inf).min(axis=(0, 1))
    high = np.where(layout.present > 0, layout.z, -np.inf).max(axis=(0, 1))
    sigma = np.maximum(value.noise.levels.sigma[: len(low)], _EXACT * np.maximum(high - low, 0.0))
    return float(((scale * (fine.y[:, ::2] - coarse.y) * layout.present / sigma) ** 2).sum())


def _shift_of_nodes(objective: Objective, linear: Linearised, off: np.ndarray) -> np.ndarray:
    """(K, n) how far the errors `off` (K, n) at the ends of segments carry the nodes after them."""
    assert linear.blocks is not None
    shift, n = np.zeros_like(off), off.shape[1]
    for k in objective.layout.tied:
        shift[k + 1] = linear.blocks.transition[k, :, :n] @ shift[k] + off[k]
    return shift


def steps_for(error: float, substeps: int, power: int = _ORDER) -> int:
    """Steps per sample interval with which the error should be small enough; a motion that ran off needs any number."""
    needed = _GROWTH * substeps * (error / TOLERANCE) ** (1.0 / power) if math.isfinite(error) else math.inf
    return math.ceil(min(needed, 1e6))
