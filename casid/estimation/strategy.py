"""The strategy of `solve` from a start to a solution that nothing cheap contradicts.

1. The usual solver in the transcription that was asked for: Gauss-Newton for Automatic().
2. Where it found nothing, or short stretches of the records contradict what it found: multiple shooting with a state at
   every sample, from the parameters that suit the stretches, from those where it ended and from the start; collocation
   after that. Under constraints that bind also from the solution without them. The most likely solution is taken.
3. Where none was found, Automatic() goes on in the transcription that was asked for, with all its methods.

With any other solver than Automatic() the second step only judges: a better solution is said in the status.

A local minimum of a simulation over a long time is often not the lowest: the simulated motion is out of step with the
measured one, and a small change of the parameters does not bring it back. Its residuals are then slow, and the same
model explains short stretches of the record far better when each has an initial state of its own. A model that is
wrong shows the same, to a lesser degree. Multiple shooting with a state at every sample decides between the two: from
the measured states and the parameters that suit the stretches it either returns to the solution or finds a better one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from casid.estimation.attempt import Attempt, as_motion, attempted, build_objective
from casid.estimation.integration import EXACT, Stepping, doubt_of_steps, is_implicit
from casid.estimation.problem import Problem
from casid.estimation.solvers.gauss_newton import GaussNewton
from casid.estimation.solvers.newton import Automatic
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import ObjectiveValue
from casid.estimation.solvers.quadratic import jacobi_scale
from casid.estimation.solvers.solver import Outcome, Solver
from casid.estimation.solvers.status import Results, Stage, Status
from casid.estimation.solvers.timed import Timed, timed
from casid.estimation.transcriptions.dynamics import Blocks
from casid.estimation.transcriptions.kernel import whitened
from casid.estimation.transcriptions.layout import Layout
from casid.estimation.transcriptions.transcription import Collocation, MultipleShooting, SingleShooting, Transcription

_EQUAL = 0.01  # of ln(likelihood), as good as the integration is
_NEAR = 0.1  # standard deviations between two ends of one minimum
_NODES = 20_000  # of a record: with more samples, several share a state


@dataclass(frozen=True, eq=False, kw_only=True)
class Ending:
    """What is taken, and what a person should know of how it was found, "" if nothing."""

    attempt: Attempt
    remark: str = ""


def ending(problem: Problem, method: Transcription, solver: Solver, begin: float) -> Ending:
    """The solution of a problem, see above, with its integration checked; the solver's seconds count from `begin`.
    Raises as the solver does."""
    end = _ending(problem, method, solver, timed(solver, begin))
    attempt = end.attempt
    doubt = "" if attempt.fine else doubt_of_steps(attempt.objective, attempt.outcome, attempt.method)
    if not doubt or attempt.outcome.status.stage is Stage.COARSE:  # said already
        return end
    return replace(end, remark="; ".join(filter(None, (end.remark, doubt))))


def _ending(problem: Problem, method: Transcription, solver: Solver, clock: Timed) -> Ending:
    if not isinstance(method, SingleShooting | MultipleShooting | Collocation) or not problem.simulated:
        return Ending(attempt=attempted(problem, method, clock))
    if isinstance(method, MultipleShooting) and method.process_noise:
        return Ending(attempt=attempted(problem, method, clock))
    quick = clock.with_solver(_quick(solver))
    automatic = isinstance(solver, Automatic)
    first = attempted(problem, method, quick if automatic else clock)
    if first.found and not doubtful(first) and not _held(first):
        return Ending(attempt=first)
    best, agreed = _searched(problem, method, first, quick) if first.found or automatic else (first, False)
    if automatic and not best.found and clock.left > 0.0:
        # where the motion of the start has no end, it is collocation that goes on
        stays = np.isfinite(first.outcome.value.cost) or problem.model.period is not None
        last = attempted(problem, method if stays else Collocation(), clock)
        best, agreed = _searched(problem, method, last, quick) if last.found else (_better(best, last), False)
    if not automatic and best is not first:
        return Ending(attempt=_with_status(first, _another(_found_elsewhere(best, first))))
    if best.found and not agreed and doubtful(best):
        best = _with_status(best, _another(_CONTRADICTED))
    remark = "" if best is first or not best.found else f"found on a second way: {_found_elsewhere(best, first)}"
    return _no_worse_than_start(problem, method, Ending(attempt=best, remark=remark))


_CONTRADICTED = "short stretches of the records are explained far better than the whole"
_REMEDY = "use solve(..., starts=20), or MultipleShooting(interval=1) from another start"


def _quick(solver: Solver) -> Solver:
    """What judges and looks elsewhere: Gauss-Newton that gives up where it creeps."""
    return solver.usual if isinstance(solver, Automatic) else GaussNewton(patient=False)


def _held(attempt: Attempt) -> bool:
    """Whether a constraint binds, so that it may have led the iteration astray."""
    problem = attempt.objective.problem
    return bool(problem.path_constraints) or bool(np.abs(attempt.outcome.limit_multipliers).max(initial=0.0) > 0.0)


def _searched(problem: Problem, method: Transcription, first: Attempt, quick: Timed) -> tuple[Attempt, bool]:
    """The most likely of a first end and those from other starts, and whether another start came to the same."""
    best, agreed = first, False
    for other, apart in _others(problem, method, first, quick):
        if first.found and _same(first, other):
            agreed |= apart
        elif other.found and (not best.found or other.misfit < best.misfit - _EQUAL):
            best, agreed = other, False
        elif not best.found and other.misfit < best.misfit:
            best = other
        if best.found and (agreed or not doubtful(best)) and not (_held(best) and best is first):
            break
    return best, agreed


def _others(problem: Problem, method: Transcription, first: Attempt, quick: Timed) -> Iterator[tuple[Attempt, bool]]:
    """Attempts from other starts, each made when it is asked for, as long as there is time, and whether their start
    does not depend on where the first ended."""
    fine = _fine(problem, method, is_implicit(first.method))
    if problem.constraints and quick.left > 0.0:
        free = replace(problem, constraints=())
        unbound = replace(quick, solver=GaussNewton(patient=False))
        found = attempted(free, method, unbound)
        if not found.found and quick.left > 0.0:
            found = attempted(free, fine, unbound)
        if found.found and quick.left > 0.0:
            yield attempted(replace(problem, start=found.values), method, quick), False
    if first.found and not doubtful(first):
        return
    ended = first.outcome.point.theta
    stretched = _suiting_stretches(first)
    for theta in (stretched, ended, problem.start_vector):
        if theta is not None and np.isfinite(theta).all() and quick.left > 0.0:
            start = dict(zip(problem.parameters, theta.tolist(), strict=True))
            yield attempted(replace(problem, start=start), fine, quick), theta is stretched or stretched is None
    between_samples = problem.feedback is None and problem.model.period is None
    if not isinstance(method, Collocation) and between_samples and quick.left > 0.0:
        yield attempted(problem, Collocation(), quick), True


def _suiting_stretches(first: Attempt) -> np.ndarray | None:
    """Parameters (parameters,) that suit short stretches, from where an attempt ended."""
    value = first.outcome.value
    if value.trajectory is None or not np.isfinite(value.parameters).all():
        return None
    try:
        return by_stretches(first.objective, value, is_implicit(first.method)).theta
    except np.linalg.LinAlgError:
        return None


def _fine(problem: Problem, method: Transcription, implicit: bool) -> Transcription:
    """With a state at every sample; the same integration as was asked for, by `implicit` steps where it took them."""
    if isinstance(method, Collocation):
        return method
    assert isinstance(method, SingleShooting | MultipleShooting)
    most = max(len(record) for record in problem.records)
    return MultipleShooting(interval=-(-most // _NODES), substeps=method.substeps, implicit=method.implicit or implicit)


def _same(first: Attempt, other: Attempt) -> bool:
    """Whether another iteration ended, or gave up on its way, at the same minimum."""
    if other.found and abs(other.misfit - first.misfit) <= _EQUAL:
        return True
    linear = first.outcome.linear
    if linear is None or other.misfit < first.misfit - _EQUAL:
        return False
    apart = other.outcome.point.theta - first.outcome.point.theta
    return bool(apart @ linear.hessian @ apart < _NEAR**2)


def _better(first: Attempt, second: Attempt) -> Attempt:
    """Of two ends that are no solution the one that is stationary, else the more likely."""
    stationary = [a.outcome.converged for a in (first, second)]
    if stationary[0] != stationary[1]:
        return second if stationary[1] else first
    return first if first.misfit < second.misfit else second


def _another(reason: str) -> Status:
    return Status(result=Results.ANOTHER_MINIMUM, reason=reason, remedy=_REMEDY)


def _with_status(attempt: Attempt, status: Status) -> Attempt:
    return replace(attempt, outcome=replace(attempt.outcome, status=status))


def _found_elsewhere(best: Attempt, first: Attempt) -> str:
    where = f"with {type(best.method).__name__}"
    if isinstance(best.method, MultipleShooting):
        where += f"(interval={best.method.interval})"
    gain = first.misfit - best.misfit
    if not first.found or not np.isfinite(gain):
        return f"{where}, after {type(first.method).__name__} had found nothing"
    return f"{where}, where ln(likelihood) is {gain:.4g} higher than where {type(first.method).__name__} ended"


def _no_worse_than_start(problem: Problem, method: Transcription, end: Ending) -> Ending:
    """The start where its simulation is more likely than what was found."""
    if isinstance(end.attempt.method, Stepping) and is_implicit(end.attempt.method):
        method = end.attempt.method  # the same integration of both
    objective = build_objective(problem, method)
    point = objective.start()
    nothing = Outcome(
        point=point,
        value=objective.value(point),
        status=end.attempt.outcome.status,
        iterations=end.attempt.outcome.iterations,
        stationarity=np.nan,
        limit_multipliers=np.zeros(len(objective.limits)),
    )
    start = as_motion(Attempt(objective=objective, outcome=nothing, method=method))
    reached = end.attempt if np.isfinite(end.attempt.misfit) else as_motion(end.attempt)
    if not start.misfit < reached.misfit - _EQUAL:
        return end
    status = end.attempt.outcome.status
    if status.converged:
        status = _another("the start is more likely than the minimum that was found")
    return Ending(attempt=_with_status(start, status), remark="no solver improved on the start, which is returned")


_LAGS = 12  # samples
_SLOW = 0.5  # autocorrelation of residuals of which half is no noise
_LEFT = 0.5  # of the sum of squares: what short stretches leave of it where they contradict the whole
_STRETCH = 10  # samples
_STEPS, _SETTLED = 15, 1e-3  # of Gauss and Newton, and relative change of the sum of squares that ends them
_RANK = 1e-8  # of the scaled information: less moves no parameter
_PER_STATE = 5  # readings of a stretch per state, so that its initial state takes a fifth of them at most


def doubtful(attempt: Attempt) -> bool:
    """Whether short stretches of the records contradict a simulated solution."""
    objective, value = attempt.objective, attempt.outcome.value
    dynamics = objective.dynamics
    if dynamics is None or dynamics.soft or value.trajectory is None:
        return False
    if _exact(objective, value) or largest_autocorrelation(objective, value) < _SLOW:
        return False
    return by_stretches(objective, value, is_implicit(attempt.method)).left < _LEFT


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


@dataclass(frozen=True, eq=False, kw_only=True)
class Stretches:
    """What short stretches, each with its own initial state, leave of the sum of squared residuals of the whole, and
    the parameters (parameters,) with which they do; 1 is expected of a solution with white noise. Zero and None where
    the records are too short to tell, or the model does not move from the measured states."""

    left: float
    theta: np.ndarray | None


def by_stretches(objective: Objective, value: ObjectiveValue, implicit: bool) -> Stretches:
    """Parameters and initial states of all stretches by some steps of Gauss and Newton from those of a value, by
    `implicit` or explicit steps of integration."""
    problem, whole, n = objective.problem, objective.layout, len(objective.scale)
    weights, trajectory = objective.whitening(value.noise.levels), value.trajectory
    assert trajectory is not None
    before = _squares(trajectory.y, whole.z, weights, whole.pattern)
    channels = max(int((whole.present.sum(axis=(0, 1)) > 0).sum()), 1)
    length = max(_STRETCH, math.ceil(_PER_STATE * n / channels))
    if max(len(record) for record in problem.records) < 2 * length:
        return Stretches(left=0.0, theta=None)
    dynamics = MultipleShooting(interval=length, substeps=whole.substeps, implicit=implicit).dynamics(problem)
    layout, weak = dynamics.layout, np.diag(1.0 / objective.scale**2)
    nodes, parameters = layout.start.copy(), value.parameters
    theta = np.zeros(len(problem.parameters))
    for r in range(len(problem.records)):
        theta[problem.columns(r)] = parameters[r, problem.free_index]
    best, found, step = math.inf, (nodes, theta), (np.zeros_like(nodes), np.zeros_like(theta))
    for iteration in range(_STEPS):
        motion = dynamics.trajectory(nodes, problem.model_parameters(theta)[layout.record])
        squares = _squares(motion.y, layout.z, weights, layout.pattern)
        if not squares < best:
            if best == math.inf:
                return Stretches(left=0.0, theta=None)
            step = 0.5 * step[0], 0.5 * step[1]
        else:
            settled = squares > (1.0 - _SETTLED) * best
            best, found = squares, (nodes, theta)
            if settled:
                break
            blocks = dynamics.blocks(motion, problem.model_parameters(theta)[layout.record], weights)
            step = _stretched_step(problem, layout, blocks, weak, moving=iteration > 0)
        nodes, theta = found[0] + step[0], found[1] + step[1]
    states = layout.segments * n / max(float(layout.present.sum()), 1.0)
    return Stretches(left=float(best / (before * max(1.0 - states, 0.5))), theta=found[1])


def _stretched_step(
    problem: Problem, layout: Layout, blocks: Blocks, weak: np.ndarray, moving: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Steps of the states (K, n) and, where they are `moving`, of the parameters (parameters,)."""
    n = len(weak)
    by_state, gradient = blocks.hessian[:, :n, n:], blocks.gradient[:, :n, None]
    solved = np.linalg.solve(blocks.hessian[:, :n, :n] + weak, np.concatenate([by_state, gradient], axis=2))
    theta = np.zeros(len(problem.parameters))
    if moving:
        information, slope = np.zeros((len(theta),) * 2), np.zeros(len(theta))
        for r in range(len(problem.records)):
            own, columns = layout.segments_of(r), problem.columns(r)
            turned = by_state[own].transpose(0, 2, 1)
            direct = blocks.hessian[own, n:, n:] - turned @ solved[own, :, :-1]
            information[np.ix_(columns, columns)] += direct.sum(axis=0)
            slope[columns] += (blocks.gradient[own, n:] - (turned @ solved[own, :, -1:])[..., 0]).sum(axis=0)
        scale = jacobi_scale(information)
        scaled = information * np.outer(scale, scale)
        theta = -scale * np.linalg.lstsq(scaled, scale * slope, rcond=_RANK)[0]
    own = np.array([problem.columns(r) for r in range(len(problem.records))])[layout.record]
    follow = (solved[..., :-1] @ theta[own][..., None])[..., 0]
    return -solved[..., -1] - follow, theta


def _squares(y: np.ndarray, z: np.ndarray, weights: np.ndarray, pattern: np.ndarray) -> float:
    with np.errstate(over="ignore"):
        return float(np.square(whitened(y - z, weights, pattern)).sum())
