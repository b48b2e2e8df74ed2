"""Choose the number of steps in a sample interval: the error of the integration against the noise of the data.

An error e of the predictions, in standard deviations of the data, moves no estimate by more than |e| of its own
standard deviations: the estimate is a projection of the residuals. So |e| over all samples must be small. It moves
-ln(likelihood) at the optimum by r'e + |e|^2/2 with the residuals r: some |e| where they are noise, more where they are
not. That must be small beside the one half that a parameter more is worth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.solvers.newton import is_found
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import AnyObjective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point
from casid.estimation.solvers.solver import Outcome, linear_at
from casid.estimation.solvers.status import Stage, too_coarse
from casid.estimation.solvers.timed import Timed
from casid.estimation.stretches import EXACT, Stretches, by_stretches, is_slow
from casid.estimation.transcriptions.collocation import CONDENSED, LiftedCollocation
from casid.estimation.transcriptions.dynamics import Dynamics
from casid.estimation.transcriptions.layout import build_layout
from casid.estimation.transcriptions.steps import slopes_function
from casid.estimation.transcriptions.transcription import (
    Collocation,
    MultipleShooting,
    SingleShooting,
    Stepping,
    Transcription,
    as_stepping,
    is_implicit,
    order_of,
)
from casid.model.built import compiled

_TOLERANCE = 0.1  # standard deviations that an estimate may be off
_COST = 0.01  # that -ln(likelihood) may be off: one percent of a likelihood ratio, a fiftieth of a parameter's worth
MET = 1e-6  # scaled constraint residuals of a point that is a motion of the model
# at which the motion's rates are looked at, and those of them where they are largest
_SAMPLES = 32
_CHECKED = 4
MOST_STEPS = 64  # per sample interval: what takes more is stiff
_IN_ALL = 1_000_000  # steps of all states and records, which explicit ones of a compiled model take in a second
_STABLE = 2.5  # of rate times step, of which the method bears 2.78
_UNEVEN = 1.5  # times the shortest step
# of rate times step: an implicit method has poles there, of one stage at 1 and of more beyond, and damps what grows
# faster, by half steps too, so that the two agree on a motion that is none
_GROWING = 1.0
_REFINING = 60  # evaluations, at least
_REFINEMENTS = 5  # solutions with ever more steps per sample interval
_GROWTH = 1.3  # more steps than the order asks for
_NEAR = 4  # times as many steps, at most: the motion was off by some ten deviations, and the solution by no more


@dataclass(frozen=True, eq=False, kw_only=True)
class Attempt:
    """End of a solver, with the objective and the transcription that it took; `fine`: with half the steps of
    integration the solution is the same, `coarse`: it would be another one. `remark`: what a person should know of how
    it was found, "" if nothing."""

    objective: Any  # an `Objective`, or an `OwnObjective` where the cost makes its likelihood itself
    outcome: Outcome
    method: Transcription
    fine: bool = False
    coarse: bool = False
    remark: str = ""

    @property
    def found(self) -> bool:
        """Return True if it converged where the data determine every parameter."""
        return is_found(self.objective, self.outcome)

    @property
    def misfit(self) -> float:
        """Return `misfit_of` the end."""
        return misfit_of(self.objective, self.outcome.value)

    @cached_property
    def stretches(self) -> Stretches:
        """Return the fit of short stretches of the records; nothing where it ended without a motion."""
        value = self.outcome.value
        if value.trajectory is None or not np.isfinite(value.parameters).all():
            return Stretches()
        return by_stretches(self.objective, value, is_implicit(self.method))

    @cached_property
    def is_slow(self) -> bool:
        """Return True if its residuals are slow."""
        return is_slow(self.objective, self.outcome.value)

    @property
    def doubtful(self) -> bool:
        """Return True if another minimum may be better: residuals are slow, and short stretches do not agree."""
        return self.is_slow and not self.stretches.agree

    @property
    def values(self) -> dict[str, float]:
        """Name -> estimate, of the problem as it is solved."""
        return self.objective.problem.named(self.outcome.point.theta)


def misfit_of(objective: AnyObjective, value: ObjectiveValue) -> float:
    """-ln(likelihood x prior), up to a constant of the problem; infinite where the point is no motion."""
    return objective.misfit(value) if value.worst() < MET else math.inf


def integrated(objective: Objective, outcome: Outcome, method: Stepping, solver: Timed) -> Attempt:
    """The solution on a motion that is integrated well enough: with more steps where the data are worth them."""
    if method.substeps is not None or objective.problem.model.period is not None:
        return Attempt(objective=objective, outcome=outcome, method=method)
    solver.effort.grant(_REFINING)  # so that the end of a search that was cut short is integrated well enough too
    found = _judged(_finely(objective, outcome, method, solver))
    others = [_by_implicit_shooting, _by_many_steps] if found.outcome.point.points is not None else []
    if found.outcome.status.stage is Stage.AT_START and not found.objective.soft:
        others = [_by_many_steps]
    for otherwise in others:
        if found.outcome.converged or solver.left <= 0.0:
            break
        other = _judged(otherwise(objective, method, solver))
        found = other if _is_lower(other, found) else found
    return found


def _judged(end: Attempt) -> Attempt:
    """The end, with status `too_coarse` where its steps are too long for the data."""
    if end.fine or not end.outcome.converged:
        return end
    doubt = doubt_of_steps(end)
    return replace(end, outcome=replace(end.outcome, status=too_coarse(doubt))) if doubt else end


def _by_implicit_shooting(objective: Objective, method: Stepping, solver: Timed) -> Attempt:
    """Shoot implicitly where collocation finds no solution: it may lead states out of the range in which the model
    has numbers, which the motion itself never leaves."""
    implicit = SingleShooting(implicit=True) if isinstance(method, Collocation) else replace(method, implicit=True)
    steps = min(_steps_at_start(objective, solver), MOST_STEPS)
    objective = Objective(
        objective.problem, replace(implicit, substeps=steps).dynamics(objective.problem), effort=objective.effort
    )
    return _finely(objective, solver.minimise(objective), implicit, solver)


def _by_many_steps(objective: Objective, method: Stepping, solver: Timed) -> Attempt:
    """Integrate by explicit steps as short as a jump of the motion within a sample interval, which are quick, where
    implicit steps as long as can be afforded have no solution or another one."""
    problem = objective.problem
    steps = max(_IN_ALL // (sum(map(len, problem.records)) * len(problem.model.states)), MOST_STEPS)
    ends = list[Attempt]()
    for explicit in (MultipleShooting() if isinstance(method, Collocation) else method, SingleShooting()):
        explicit = replace(explicit, implicit=False, substeps=steps)
        own = solver.allowed(_REFINING)
        ends.append(_solved(Objective(problem, explicit.dynamics(problem), effort=own.effort), explicit, own))
    end = min(ends, key=lambda one: one.misfit)
    return end if doubt_of_steps(end) else replace(end, fine=_is_motion(end.outcome))


def _is_lower(one: Attempt, other: Attempt) -> bool:
    """Return True if the first of two ends is a solution, or more likely and a motion of the model."""
    if one.outcome.converged or other.outcome.converged:
        return one.outcome.converged
    ends = (one, other)
    costs = [e.objective.misfit(e.outcome.value) + e.outcome.value.violation() for e in ends]
    return bool(costs[0] < costs[1] or not np.isfinite(costs[1]))


def _finely(objective: Objective, outcome: Outcome, method: Stepping, solver: Timed) -> Attempt:
    """The solution with as many steps per sample interval as the data are worth; by collocation what is stiff."""
    problem = objective.problem
    end = Attempt(objective=objective, outcome=outcome, method=method)
    if not is_judged(objective):
        return end
    steps = objective.layout.substeps
    for _ in range(_REFINEMENTS):
        if solver.left <= 0.0:
            break
        needed = _needed_steps(end.objective, end.outcome, replace(method, substeps=2 * steps), solver)
        if needed <= steps:
            return replace(end, fine=_is_motion(end.outcome))
        if solver.left <= 0.0:
            break
        near = _is_motion(end.outcome) and needed <= _NEAR * steps
        steps = needed
        if steps > MOST_STEPS:
            if method.implicit:
                return _too_fast(end, MOST_STEPS)
            near = end.outcome.converged
            steps = min(_steps_at_start(end.objective, solver), MOST_STEPS)
            method = replace(method, implicit=True) if near else Collocation()
        coarse = end.objective.dynamics
        method = replace(method, substeps=steps)
        dynamics = method.dynamics(problem)
        begin = _begin(end.outcome.point, coarse, dynamics) if near else None
        end = _solved(Objective(problem, dynamics, begin, objective.effort), method, solver)
        if near and not end.outcome.converged and solver.left > 0.0:
            anew = _solved(Objective(problem, dynamics, effort=objective.effort), method, solver)
            end = anew if _is_lower(anew, end) else end
    return end


def _too_fast(end: Attempt, steps: int) -> Attempt:
    """The end with a status that says so where the motion is too fast for the steps that can be afforded."""
    if _is_motion(end.outcome):
        return end
    status = too_coarse(
        f"the motion is faster than {steps} steps per sample interval follow: sample more often, or start where it is "
        "slower"
    )
    return replace(end, outcome=replace(end.outcome, status=status))


def _solved(objective: Objective, method: Stepping, solver: Timed) -> Attempt:
    return Attempt(objective=objective, outcome=solver.minimise(objective), method=method)


def _begin(point: Point, coarse: Dynamics | None, fine: Dynamics) -> Point:
    """The point on a finer mesh, with interior states on the polynomials of the coarser one."""
    if point.points is None:
        return point
    return replace(point, points=_lifted(fine).refined(_lifted(coarse), point.nodes, point.points))


def _lifted(dynamics: Dynamics | None) -> LiftedCollocation:
    """The dynamics of a point with interior states."""
    assert isinstance(dynamics, LiftedCollocation)
    return dynamics


def _needed_steps(objective: Objective, outcome: Outcome, finer: Stepping, solver: Timed) -> int:
    steps = objective.layout.substeps
    if not _is_motion(outcome):  # where it gave up is no place to judge the motion of the solution
        if not finer.implicit:
            return max(_stable_steps(objective), _finite_steps(objective, replace(finer, substeps=None), solver))
        return max(_steps_at_start(objective, solver), steps if np.isfinite(outcome.value.cost) else 2 * steps)
    if not outcome.converged and not finer.implicit and _stable_steps(objective) > steps:
        return _stable_steps(objective)
    linear = linear_at(objective, outcome)
    if linear is None:
        return steps if finer.implicit else max(_stable_steps(objective), steps)
    if finer.implicit and _growing_steps(objective, outcome) > steps:
        return _growing_steps(objective, outcome)
    excess = _excess(*_integration_error(objective, outcome, linear, finer))
    if not np.isfinite(excess) and finer.implicit:
        return 2 * steps
    if not finer.implicit and (stable := _stable_steps_of_uneven(objective, outcome.value)) > steps:
        return stable
    return steps if excess < 1.0 else max(_steps_for(excess, steps, order_of(finer)), steps + 1)


def _eigenvalues(objective: Objective, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of df/dx [1/s], at those of some samples of states (K, L, n) where it is largest; none
    where it is not finite."""
    model = objective.problem.model
    layout = objective.layout
    count, length, n = states.shape
    which = np.linspace(0, count * length - 1, _SAMPLES).astype(int)
    scale = objective.scale
    flat = states.reshape(-1, n)
    inputs = layout.u0[:, :length].reshape(count * length, -1)
    found = compiled(model, slopes_function, "f").mapped(_SAMPLES)(
        flat[which], inputs[which], parameters[layout.record[which // length]]
    )[1]
    found = found.reshape(_SAMPLES, n, n)
    if not np.isfinite(found).all():
        return np.empty(0)
    largest = np.argsort(np.square(found * scale[:, None] / scale).sum(axis=(1, 2)))[-_CHECKED:]
    return np.asarray(np.linalg.eigvals(found[largest])).ravel()


def _is_motion(outcome: Outcome) -> bool:
    """Return True if an end is a motion of the model, converged or not."""
    value = outcome.value
    return outcome.converged or bool(np.isfinite(value.cost) and value.worst() < MET)


def _stable_steps(objective: Objective, end: ObjectiveValue | None = None) -> int:
    """Steps per sample interval with which a decaying motion at the start, or along an end, does not grow by the method
    alone."""
    interval = float(objective.layout.dt.max()) * objective.layout.substeps
    start = objective.start()
    states = start.nodes[:, None]
    parameters = objective.problem.model_parameters(start.theta)
    if end is not None and end.trajectory is not None:
        states = end.trajectory.states
        parameters = end.parameters
    eigenvalues = _eigenvalues(objective, states, parameters)
    rate = float(np.abs(eigenvalues[np.real(eigenvalues) < 0.0]).max(initial=0.0))
    return math.ceil(min(rate * interval / _STABLE, 1e6))


def _stable_steps_of_uneven(objective: Objective, end: ObjectiveValue) -> int:
    """Return `_stable_steps` at an end where only few steps may be too long for the method: their error stays small,
    and a decay that cannot become faster looks like a minimum. Steps that are all too long show by their error."""
    steps = objective.layout.dt[objective.layout.dt > 0.0]
    return _stable_steps(objective, end) if steps.max(initial=0.0) > _UNEVEN * steps.min(initial=np.inf) else 0


def _growing_steps(objective: Objective, outcome: Outcome) -> int:
    """Steps per sample interval with which an implicit method does not damp a motion that grows."""
    value = outcome.value
    assert value.trajectory is not None
    interval = float(objective.layout.dt.max()) * objective.layout.substeps
    eigenvalues = _eigenvalues(objective, value.trajectory.states, value.parameters)
    return math.ceil(min(float(np.real(eigenvalues).max(initial=0.0)) * interval / _GROWING, 1e6))


def _steps_at_start(objective: Objective, solver: Timed) -> int:
    """Steps of collocation per sample interval with which the motion at the start is right to a deviation of the data:
    a coarser mesh may have no solution, or one of its own. More than are taken where none of these is right."""
    problem = objective.problem
    steps = 1
    sigma = objective.noise.levels.sigma[: len(problem.model.outputs)]
    first = np.cumsum([0] + [len(record) - 1 for record in problem.records])[:-1]
    coarse = _collocated(problem, steps)
    while steps <= MOST_STEPS and solver.left > 0.0:
        fine = _collocated(problem, 2 * steps)
        made = coarse[0] - fine[0]
        carried = np.zeros_like(made)
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(len(made)):
                carried[k] = made[k] + (0.0 if k in first else fine[1][k] @ carried[k - 1])
        off = _held_by_data(carried, made, objective.scale)
        if np.linalg.norm((fine[2] @ off[..., None])[..., 0] / sigma) < 1.0:
            break
        coarse = fine
        steps = 2 * steps
    return steps


def _finite_steps(objective: Objective, method: Stepping, solver: Timed) -> int:
    """Steps per sample interval with which the motion at the start is finite: as they are where no number makes it
    so."""
    steps = objective.layout.substeps
    if np.isfinite(objective.value(objective.start()).cost):
        return steps
    more = 2 * steps
    while more <= MOST_STEPS and solver.left > 0.0:
        finer = Objective(objective.problem, replace(method, substeps=more).dynamics(objective.problem))
        if np.isfinite(finer.value(finer.start()).cost):
            return more
        more *= 2
    return steps


def _collocated(problem: Problem, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate `LiftedCollocation.after_samples` at the start."""
    layout = build_layout(problem, CONDENSED, steps)
    dynamics = LiftedCollocation(problem.model, problem.free_index, layout, Collocation().degree)
    return dynamics.after_samples(problem.start_parameters)


def _held_by_data(carried: np.ndarray, alone: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return errors (count, n) as they are carried along, unless the motion grows by itself, faster than a double
    integrator. There the data hold the nodes, so that each error counts where it is made: `alone`."""
    most, made = (float(np.abs(one / scale).max(initial=0.0)) for one in (carried, alone))
    return carried if most <= len(alone) ** 2 * made else alone


def doubt_of_steps(end: Attempt) -> str:
    """Return what to report of a solution whose steps are longer than the data allow; "" where they are not, or
    where that is unknown."""
    objective = end.objective
    outcome = end.outcome
    method = as_stepping(end.method)
    if method is None or not is_judged(objective) or not _is_motion(outcome):
        return ""
    steps = objective.layout.substeps
    linear = linear_at(objective, outcome)
    if linear is None:
        return ""
    if method.implicit and (needed := _growing_steps(objective, outcome)) > steps:
        return (
            f"implicit integration with {steps} step{'s' * (steps > 1)} per sample interval damps a motion that grows: "
            f"give substeps={needed} or more, or bounds of the parameters"
        )
    off, cost = _integration_error(objective, outcome, linear, replace(method, substeps=2 * steps))
    steps_said = f"integration with {steps} step{'s' * (steps > 1)} per sample interval"
    if _excess(off, cost) < 1.0:
        if method.implicit or _stable_steps_of_uneven(objective, outcome.value) <= steps:
            return ""
        return f"{steps_said} cannot follow a decay that the data hardly determine: give bounds of the parameters"
    far = f"ln(likelihood) by {abs(cost):.2g} and estimates by up to {off:.2g} standard errors"
    if not np.isfinite(off + cost):
        far = "the solution by more than can be told"
    return f"{steps_said} changes {far}: give a larger substeps=, or leave it out"


def is_judged(objective: Objective) -> bool:
    """Return True if half steps show how large the error is: not in discrete time, with a control law in the loop,
    or with random defects."""
    problem = objective.problem
    stepless = problem.feedback is not None or problem.model.period is not None
    return objective.dynamics is not None and not stepless and not objective.soft


def _excess(off: float, cost: float) -> float:
    """Return how many times too large an error is, see `_integration_error`."""
    return max(off / _TOLERANCE, abs(cost) / _COST)


def _integration_error(
    objective: Objective, outcome: Outcome, linear: Linearised, method: Stepping
) -> tuple[float, float]:
    """|e|, and what e makes of the cost. By the motion with twice as many steps from the same nodes; `method` is the
    transcription with these."""
    value = outcome.value
    trajectory, (y, end) = value.trajectory, _with_half_steps(objective, outcome, method)
    assert trajectory is not None and linear.blocks is not None
    power = 2.0 ** order_of(method)
    scale = power / (power - 1.0)  # of the difference, to the error
    direct, along = _directly(objective, value, scale * (y - trajectory.y))
    made = scale * (end - trajectory.end)
    shift, is_carried = _shift_of_nodes(objective, linear, made)
    # what a shift of a node does to the predictions of its segment, in the whitened norm
    n = shift.shape[1]
    by_node = np.einsum("kn,knm,km->k", shift, linear.blocks.hessian[:, :n, :n], shift)
    # of both first orders the residuals' part: at the optimum the parameters' own moves change nothing
    off = np.sqrt(direct + by_node.sum())
    if is_carried:
        cost = along + (linear.blocks.gradient[:, :n] * shift).sum()
    else:  # parameters and all nodes follow: a constraint's multiplier is what its error is worth
        ends = [made[objective.layout.segments_of(r)][:-1] for r in range(len(linear.reduced))]
        cost = along - sum(float((red.l0 * off).sum()) for red, off in zip(linear.reduced, ends, strict=True))
    # where the model misses its data the likelihood is worth less, by how much larger than noise the residuals are
    worth = max(2.0 * value.cost / value.noise.levels.count, 1.0)
    return float(off), float(cost / worth)


def _with_half_steps(objective: Objective, outcome: Outcome, method: Stepping) -> tuple[np.ndarray, np.ndarray]:
    """y (K, L, o) and end (K, n) of segments from the same nodes; nothing else of the finer motion stays in memory."""
    finer = method.dynamics(objective.problem)
    point = outcome.point
    parameters = outcome.value.parameters[objective.layout.record]
    if point.points is None:
        better = finer.trajectory(point.nodes, parameters)
        return better.y[:, ::2].copy(), better.end
    dynamics = _lifted(objective.dynamics)
    made = dynamics.local_errors(point.nodes, point.points, parameters, _lifted(finer))
    assert outcome.value.trajectory is not None
    return dynamics.carried(outcome.value.trajectory, parameters, made)


def _directly(objective: Objective, value: ObjectiveValue, difference: np.ndarray) -> tuple[float, float]:
    """Return, for the whitened difference (K, L, o) of the predictions from the same nodes, the sum of squares and
    the product with the residuals."""
    layout = objective.layout
    assert value.trajectory is not None
    sigma = np.maximum(value.noise.levels.sigma[: layout.z.shape[2]], EXACT * layout.ranges)
    off = np.where(layout.present, difference, 0.0) / sigma
    return float((off**2).sum()), float((off * layout.residuals(value.trajectory.y) / sigma).sum())


def _shift_of_nodes(objective: Objective, linear: Linearised, off: np.ndarray) -> tuple[np.ndarray, bool]:
    """(K, n) how far the errors `off` (K, n) at the ends of segments carry the nodes after them, and whether they do;
    otherwise each stays where it is made."""
    assert linear.blocks is not None
    carried = np.zeros_like(off)
    alone = np.zeros_like(off)
    n = off.shape[1]
    with np.errstate(over="ignore", invalid="ignore"):
        for k in objective.layout.tied:
            carried[k + 1] = linear.blocks.transition[k, :, :n] @ carried[k] + off[k]
            alone[k + 1] = off[k]
    found = _held_by_data(carried, alone, objective.scale)
    return found, found is carried


def _steps_for(excess: float, substeps: int, power: int) -> int:
    """Steps per sample interval with which an error so many times too large should be small enough; a motion that ran
    off needs any number."""
    needed = _GROWTH * substeps * excess ** (1.0 / power) if math.isfinite(excess) else math.inf
    return math.ceil(min(needed, 1e6))
