"""How many steps a sample interval takes: the error of the integration against the noise of the data.

An error e of the predictions, in standard deviations of the data, moves no estimate by more than |e| of its own
standard deviations: the estimate is a projection of the residuals. So |e| over all samples must be small. It moves
-ln(likelihood) at the optimum by r'e + |e|^2/2 with the residuals r: some |e| where they are noise, more where they are
not. That must be small beside the one half that a parameter more is worth.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np

from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point
from casid.estimation.solvers.solver import Outcome, Solver
from casid.estimation.transcriptions.collocation import LiftedCollocation
from casid.estimation.transcriptions.dynamics import Dynamics
from casid.estimation.transcriptions.steps import compiled, rates_function
from casid.estimation.transcriptions.transcription import Collocation, MultipleShooting, SingleShooting, Transcription

Stepping = SingleShooting | MultipleShooting | Collocation  # the transcriptions that choose their steps
_TOLERANCE = 0.1  # standard deviations that an estimate may be off
_COST = 0.01  # that -ln(likelihood) may be off: one percent of a likelihood ratio, a fiftieth of a parameter's worth
EXACT = 1e-4  # of a channel's range: measurements that claim more are not held to it
_ORDER = 4  # of Runge and Kutta's method
_SAMPLES, _CHECKED = 32, 4  # at which the motion's rates are looked at, and those of them where they are largest
_MOST_STEPS = 64  # per sample interval: what takes more is stiff
_STABLE = 2.5  # of rate times step, of which the method bears 2.78
_REFINEMENTS = 5  # solutions with ever more steps per sample interval
_GROWTH = 1.3  # more steps than the order asks for
_NEAR = 4  # times as many steps, at most: the motion was off by some ten deviations, and the solution by no more


def integrated(
    objective: Objective, outcome: Outcome, method: Stepping, solver: Solver
) -> tuple[Objective, Outcome, Transcription]:
    """The solution on a motion that is integrated well enough, with its objective and the transcription that it took:
    with more steps where the data are worth them."""
    return _finely(objective, outcome, method, solver) if method.substeps is None else (objective, outcome, method)


def _finely(
    objective: Objective, outcome: Outcome, method: Stepping, solver: Solver
) -> tuple[Objective, Outcome, Transcription]:
    """The solution with as many steps per sample interval as the data are worth; by collocation what is stiff."""
    problem, steps = objective.problem, 1
    if objective.dynamics is None or problem.feedback is not None or objective.soft:
        return objective, outcome, method
    for _ in range(_REFINEMENTS):
        needed = _needed_steps(objective, outcome, replace(method, substeps=2 * steps))
        if needed <= steps:
            break
        near = outcome.status == "converged" and needed <= _NEAR * steps
        steps = needed
        if steps > _MOST_STEPS:
            if isinstance(method, Collocation):
                break
            method, steps, near = Collocation(), 1, False
        coarse = objective.dynamics
        method = replace(method, substeps=steps)
        dynamics = method.dynamics(problem)
        begin = _begin(outcome.point, coarse, dynamics) if near else None
        objective = Objective(problem, dynamics, begin)
        outcome = solver.minimise(objective)
        if near and outcome.status != "converged":
            objective = Objective(problem, dynamics)
            outcome = solver.minimise(objective)
    return objective, outcome, method


def _begin(point: Point, coarse: Dynamics | None, fine: Dynamics) -> Point:
    """The point on a finer mesh, with interior states on the polynomials of the coarser one."""
    if isinstance(fine, LiftedCollocation) and isinstance(coarse, LiftedCollocation) and point.points is not None:
        return replace(point, points=fine.refined(coarse, point.nodes, point.points))
    return point


def _needed_steps(objective: Objective, outcome: Outcome, finer: Stepping) -> int:
    steps = objective.layout.substeps
    if outcome.status != "converged":  # where it gave up is no place to judge the motion of the solution
        return steps if isinstance(finer, Collocation) else max(_stable_steps(objective), steps)
    if _is_plain(objective, outcome):
        return steps
    linear = outcome.linear
    if linear is None:
        with suppress(np.linalg.LinAlgError):
            linear = objective.linearise(outcome.point, outcome.value)
    if linear is None:
        return max(_stable_steps(objective), steps)
    excess = _integration_error(objective, outcome, linear, finer)
    if not np.isfinite(excess) and isinstance(finer, Collocation):
        return 2 * steps
    return steps if excess < 1.0 else max(_steps_for(excess, steps, _order(finer)), steps + 1)


def _is_plain(objective: Objective, outcome: Outcome) -> bool:
    """Whether the rates of the motion alone say that the error is small enough, with no look at the motion.

    A step h of the method errs by (rate h)^4/120 of what moves in the signal over the time 1/rate.
    """
    layout, value = objective.layout, outcome.value
    assert value.trajectory is not None
    worst = (_fastest(objective, value.trajectory.states, value.parameters) * float(layout.dt.max())) ** _ORDER / 120.0
    mean = (layout.z * layout.present).sum(axis=(0, 1)) / np.maximum(layout.present.sum(axis=(0, 1)), 1.0)
    moves = (layout.z - mean) * layout.present / value.noise.levels.sigma[: len(mean)]
    off = worst * float(np.linalg.norm(moves))
    return bool(off < _TOLERANCE and off * np.sqrt(2.0 * value.cost) < _COST)


def _fastest(objective: Objective, states: np.ndarray, parameters: np.ndarray, decaying: bool = False) -> float:
    """Largest magnitude of an eigenvalue of df/dx [1/s] at some samples of states (K, L, n), or of the decaying ones
    alone."""
    model, layout = objective.problem.model, objective.layout
    count, length, n = states.shape
    which, scale = np.linspace(0, count * length - 1, _SAMPLES).astype(int), objective.scale
    flat, inputs = states.reshape(-1, n), layout.u0[:, :length].reshape(count * length, -1)
    found = compiled(model, rates_function).mapped(_SAMPLES)(
        flat[which], inputs[which], parameters[layout.record[which // length]]
    )[0]
    found = found.reshape(_SAMPLES, n, n)
    if not np.isfinite(found).all():
        return 0.0 if decaying else math.inf
    largest = np.argsort(np.square(found * scale[:, None] / scale).sum(axis=(1, 2)))[-_CHECKED:]
    eigenvalues = np.linalg.eigvals(found[largest])
    return float(np.abs(eigenvalues[eigenvalues.real < 0.0] if decaying else eigenvalues).max(initial=0.0))


def _order(method: Transcription) -> int:
    """With which power of the step the error falls."""
    return 2 * method.degree - 1 if isinstance(method, Collocation) else _ORDER


def _stable_steps(objective: Objective) -> int:
    """Steps per sample interval with which a decaying motion at the start does not grow by the method alone."""
    interval, start = float(objective.layout.dt.max()) * objective.layout.substeps, objective.start()
    parameters = objective.problem.model_parameters(start.theta)
    rate = _fastest(objective, start.nodes[:, None], parameters, decaying=True)
    return math.ceil(min(rate * interval / _STABLE, 1e6))


def _integration_error(objective: Objective, outcome: Outcome, linear: Linearised, method: Transcription) -> float:
    """How many times too large |e| is, or what it makes of the cost, if that is worse. By the motion with twice as many
    steps from the same nodes; `method` is the transcription with these."""
    value, nodes = outcome.value, outcome.point.nodes
    trajectory, finer = value.trajectory, method.dynamics(objective.problem)
    assert trajectory is not None and linear.blocks is not None
    power = 2.0 ** _order(method)
    scale = power / (power - 1.0)  # of the difference, to the error
    if isinstance(finer, LiftedCollocation):
        y, end = _with_halves(objective, outcome, finer)
    else:
        better = finer.trajectory(nodes, value.parameters[objective.layout.record])
        y, end = better.y[:, ::2], better.end
    direct, along = _directly(objective, value, scale * (y - trajectory.y))
    shift = _shift_of_nodes(objective, linear, scale * (end - trajectory.end))
    # what a shift of a node does to the predictions of its segment, in the whitened norm
    n = shift.shape[1]
    by_node = np.einsum("kn,knm,km->k", shift, linear.blocks.hessian[:, :n, :n], shift)
    # of both first orders the residuals' part: at the optimum the parameters' own moves change nothing
    off, cost = np.sqrt(direct + by_node.sum()), along + (linear.blocks.gradient[:, :n] * shift).sum()
    # where the model misses its data the likelihood is worth less, by how much larger than noise the residuals are
    worth = max(2.0 * value.cost / value.noise.levels.count, 1.0)
    return float(np.maximum(off / _TOLERANCE, np.abs(cost) / (worth * _COST)))


def _with_halves(objective: Objective, outcome: Outcome, halves: LiftedCollocation) -> tuple[np.ndarray, np.ndarray]:
    """y (K, L, o) and end (K, n) of segments whose every step of collocation is two half steps, from the same nodes."""
    dynamics, value = objective.dynamics, outcome.value
    assert isinstance(dynamics, LiftedCollocation) and outcome.point.points is not None
    assert value.trajectory is not None
    parameters = value.parameters[objective.layout.record]
    made = dynamics.local_errors(outcome.point.nodes, outcome.point.points, parameters, halves)
    return dynamics.carried(value.trajectory, parameters, made)


def _directly(objective: Objective, value: ObjectiveValue, difference: np.ndarray) -> tuple[float, float]:
    """Of the whitened difference (K, L, o) of the predictions from the same nodes: sum of squares, and product with the
    residuals."""
    layout = objective.layout
    assert value.trajectory is not None
    low = np.where(layout.present > 0, layout.z, np.inf).min(axis=(0, 1))
    high = np.where(layout.present > 0, layout.z, -np.inf).max(axis=(0, 1))
    sigma = np.maximum(value.noise.levels.sigma[: len(low)], EXACT * np.maximum(high - low, 0.0))
    off = difference * layout.present / sigma
    return float((off**2).sum()), float((off * (value.trajectory.y - layout.z) / sigma).sum())


def _shift_of_nodes(objective: Objective, linear: Linearised, off: np.ndarray) -> np.ndarray:
    """(K, n) how far the errors `off` (K, n) at the ends of segments carry the nodes after them.

    Of a motion that grows by itself, faster than a double integrator, no error grows with it: the data hold the nodes.
    There each error counts where it is made.
    """
    assert linear.blocks is not None
    carried, alone, n = np.zeros_like(off), np.zeros_like(off), off.shape[1]
    with np.errstate(over="ignore", invalid="ignore"):
        for k in objective.layout.tied:
            carried[k + 1] = linear.blocks.transition[k, :, :n] @ carried[k] + off[k]
            alone[k + 1] = off[k]
    most, made = (float(np.abs(one / objective.scale).max(initial=0.0)) for one in (carried, alone))
    return carried if most <= len(off) ** 2 * made else alone


def _steps_for(excess: float, substeps: int, power: int = _ORDER) -> int:
    """Steps per sample interval with which an error so many times too large should be small enough; a motion that ran
    off needs any number."""
    needed = _GROWTH * substeps * excess ** (1.0 / power) if math.isfinite(excess) else math.inf
    return math.ceil(min(needed, 1e6))
