"""One attempt at a solution: a transcription, a solver, and where they ended."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from casid.arguments import given
from casid.errors import EstimationError, InputError
from casid.estimation.cost import OwnLikelihood
from casid.estimation.integration import Attempt, integrated
from casid.estimation.problem import Problem
from casid.estimation.solvers.effort import Effort
from casid.estimation.solvers.following import FLAT
from casid.estimation.solvers.identified import lost
from casid.estimation.solvers.newton import to_second_order
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import OwnObjective
from casid.estimation.solvers.solver import Outcome, linear_at
from casid.estimation.solvers.status import Results
from casid.estimation.solvers.timed import Timed
from casid.estimation.transcriptions.dynamics import Dynamics
from casid.estimation.transcriptions.transcription import SingleShooting, Transcription, as_stepping, is_implicit

_PULL = 0.005  # of -ln(likelihood), half of what its integration may be off
# factor of a prior that pulls, and how often: twelve orders of magnitude
_WIDER = 30.0
_TIMES = 8
_ROUNDS = 3  # of steps and priors, of which each moves the end on which the other is judged
_LEAST_SECONDS = 1e-3
_MOST_SECONDS = 600.0


def attempted(problem: Problem, method: Transcription, solver: Timed) -> Attempt:
    """Minimise from the problem's start, integrate as finely as the data require, and judge the end to second order."""
    end = replace(_ended(problem, method, solver), fine=False)
    asked = getattr(method, "substeps", None)
    for _ in range(_ROUNDS):
        if (stepping := as_stepping(end.method)) is not None:
            end = integrated(end.objective, end.outcome, replace(stepping, substeps=asked), solver)
        freed = _freed(end, solver)
        if freed is end:
            break
        end = freed
    outcome = to_second_order(end.objective, end.outcome, min(max(solver.left, _LEAST_SECONDS), _MOST_SECONDS))
    return replace(end, outcome=outcome)


def likely(problem: Problem, method: Transcription, solver: Timed) -> Attempt:
    """The solution of a problem whose cost makes its likelihood itself.

    A time constant of infinity is one of minus infinity: where a parameter ran off to where the data say nothing of it,
    the way goes on from the other side.
    """
    end = _ended(problem, method, solver)
    linear = linear_at(end.objective, end.outcome)
    if end.outcome.status.result is not Results.NOT_IDENTIFIABLE or linear is None or solver.left <= 0.0:
        return end
    start = problem.start_vector
    gone = np.isin(problem.parameters, lost(end.objective, linear, end.outcome.limit_multipliers))
    gone &= np.abs(end.outcome.point.theta) > np.abs(start)
    if not gone.any():
        return end
    turned = replace(problem, start=problem.named(np.where(gone, -start, start)))
    other = _ended(turned, method, solver)
    if not other.outcome.converged or other.misfit > end.misfit + FLAT:
        return end
    iterations = end.outcome.iterations + other.outcome.iterations
    return replace(other, outcome=replace(other.outcome, iterations=iterations))


def _ended(problem: Problem, method: Transcription, solver: Timed) -> Attempt:
    objective = build_objective(problem, method, solver.effort)
    return Attempt(objective=objective, outcome=solver.minimise(objective), method=method, fine=True)


def _freed(end: Attempt, solver: Timed) -> Attempt:
    """The solution where initial states that are not given weigh nothing: their priors are widened as long as they
    do."""
    loose = ~end.objective.problem.is_initial_given
    for _ in range(_TIMES):
        objective = end.objective
        pulled = end.outcome.converged and _pull(objective, end.outcome, loose) > _PULL
        if not pulled or solver.left <= 0.0:
            break
        wider = _with_wider(objective.problem, loose)
        objective = Objective(wider, objective.dynamics, end.outcome.point, objective.effort)
        end = replace(end, objective=objective, outcome=solver.minimise(objective))
    return end


def _pull(objective: Objective, outcome: Outcome, loose: np.ndarray) -> float:
    """Return what the priors of the `loose` (records, states) initial states add to -ln(likelihood)."""
    if objective.dynamics is None:
        return 0.0
    apart = outcome.point.nodes[objective.layout.first] - objective.centre
    return 0.5 * float(((apart * objective.initial_precision)[loose] ** 2).sum())


def _with_wider(problem: Problem, loose: np.ndarray) -> Problem:
    std = problem.initial_knowledge[1] * np.where(loose, _WIDER, 1.0)
    names = [(f"{s}[{r.name}]") for r in problem.records for s in problem.model.states]
    wider = {name: float(v) for name, v, free in zip(names, std.ravel(), loose.ravel(), strict=True) if free}
    known = replace(problem.initial_state, std={**problem.initial_state.std, **wider})
    return replace(problem, initial_state=known)


def build_objective(problem: Problem, method: Transcription, effort: Effort | None = None) -> Any:
    """The residuals of a problem in a transcription, with a count of evaluations. Raises as `solve` does."""
    check_part(method, "dynamics", "transcription", "cs.MultipleShooting()")
    if isinstance(problem.cost, OwnLikelihood):
        if callable(check := getattr(problem.cost, "check_method", None)):
            check(method)
        return OwnObjective(problem, effort)
    if problem.simulated:
        return Objective(problem, method.dynamics(problem), effort=effort)
    if getattr(method, "process_noise", None):
        raise EstimationError("solve: EquationError simulates nothing, so process noise has no place in it")
    return Objective(problem, None, effort=effort)


def check_part(value: object, verb: str, what: str, example: str) -> None:
    """Raise InputError for what is no transcription or no solver."""
    if isinstance(value, type):
        raise InputError(f"solve: the {what} is {given(value)}; write {value.__name__}()")
    if not callable(getattr(value, verb, None)):
        raise InputError(f"solve: the {what} is {given(value)}, without a method '{verb}'; write {example} or the like")


def as_motion(attempt: Attempt, substeps: int = 0) -> Attempt:
    """The same parameters and initial states simulated in one piece, with the noise of highest likelihood; by so many
    `substeps` per sample interval, or else as many as the attempt has."""
    objective = attempt.objective
    point = attempt.outcome.point
    layout = objective.layout
    method = SingleShooting(substeps=substeps or layout.substeps, implicit=is_implicit(attempt.method))
    whole = Objective(objective.problem, method.dynamics(objective.problem))
    assert whole.dynamics is not None
    parameters = objective.problem.model_parameters(point.theta)[whole.layout.record]
    nodes = _continued(whole.dynamics, point.nodes[layout.first], parameters)
    begin = replace(point, nodes=nodes, noise=np.zeros((len(whole.layout.tied), nodes.shape[1])), points=None)
    value, _ = whole.relaxed(begin, whole.value(begin))
    outcome = replace(attempt.outcome, point=begin, value=value, linear=None, attracted=False)
    return Attempt(objective=whole, outcome=outcome, method=method)


def _continued(dynamics: Dynamics, first: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """(K, n) start states of all segments of one motion, from those (records, n) of the first of each record: a record
    is one segment, or several where the motion jumps."""
    layout = dynamics.layout
    nodes = first[layout.record]
    for _ in range(int(np.bincount(layout.record).max()) - 1):
        nodes[layout.tied + 1] = dynamics.trajectory(nodes, parameters).end[layout.tied]
    return nodes
