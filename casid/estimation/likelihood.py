"""ln(likelihood) and ln(prior) of an end, as statistics has them: of one motion, integrated to a given error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.estimation.integration import Attempt
from casid.estimation.problem import Problem
from casid.estimation.solvers.full_noise import moments_of
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import AnyObjective, OwnObjective
from casid.estimation.solvers.solver import Outcome
from casid.estimation.solvers.status import Results
from casid.model.simulate import cvodes_step, flown, steps_of

_CLOSE = 1e-8  # relative error of the integration
_MOST_SAMPLES = 50_000  # that take ten seconds


@dataclass(frozen=True, eq=False, kw_only=True)
class Judged:
    """ln(likelihood) of an end, or why there is none; `outputs` per record (N, o) of the motion that it is of, where
    that is not the motion of the iteration."""

    log_likelihood: float
    without: str = ""
    outputs: tuple[np.ndarray, ...] | None = None


def judged(attempt: Attempt) -> Judged:
    """The likelihood of an end.

    An end without open defects is one motion, converged or not, and has it from its own integration, whose error is
    checked. Another one is simulated once more in one piece from its initial states, by an implicit method of variable
    order. A motion that is there already is not: where it grows, the least difference at its begin would be all that is
    seen at its end. Noise that is estimated is that of the residuals of the motion.
    """
    objective = attempt.objective
    value = attempt.outcome.value
    if isinstance(objective, OwnObjective):
        return Judged(log_likelihood=objective.log_likelihood(value))
    problem = objective.problem
    levels = value.noise.levels
    squares = value.squares
    plain = objective.dynamics is not None and objective.equations is None and not objective.soft
    solved = attempt.outcome.status.result in (Results.CONVERGED, Results.ANOTHER_MINIMUM)
    if solved or not plain or problem.feedback is not None or problem.model.period is not None:
        return Judged(log_likelihood=levels.log_likelihood(squares))
    if math.isfinite(attempt.misfit) and not attempt.coarse:
        return Judged(log_likelihood=levels.relaxed(squares)[0].log_likelihood(squares))
    if sum(len(record) for record in problem.records) > _MOST_SAMPLES:
        reason = "no likelihood: the end is no solution, and its records are too long to simulate once more"
        return Judged(log_likelihood=math.nan, without=reason)
    outputs = _simulated(objective, attempt.outcome)
    off = np.full(1, np.nan) if outputs is None else _residuals(problem, outputs)
    if not np.isfinite(off).all():
        reason = "no likelihood: simulated in one piece, the motion of the end departs"
        return Judged(log_likelihood=math.nan, without=reason)
    squares = (off**2).sum(axis=0)
    if levels.full:
        pattern = objective.layout.pattern.ravel()[np.concatenate(objective.layout.sample)]
        squares = moments_of(off, pattern, objective.layout.seen)
    return Judged(log_likelihood=levels.relaxed(squares)[0].log_likelihood(squares), outputs=outputs)


def _simulated(objective: Objective, outcome: Outcome) -> tuple[np.ndarray, ...] | None:
    """Outputs per record (N, o) from the initial states; None where the motion is not finite."""
    problem = objective.problem
    layout = objective.layout
    model = objective.problem.model
    run = steps_of(cvodes_step(model, _CLOSE, _CLOSE * float(objective.scale.min(initial=1.0))))
    output = ca.Function("h", [model.x, model.u, model.p, model.w], [ca.densify(model.h)])
    found = []
    for r, (record, p) in enumerate(zip(problem.records, problem.model_parameters(outcome.point.theta), strict=True)):
        calm = np.zeros((len(record), len(model.disturbances)))
        start = outcome.point.nodes[layout.first[r]]
        if not (np.isfinite(start).all() and np.isfinite(p).all()):
            return None
        states = flown(model, record, start, p, calm, run)
        if not np.isfinite(states).all():
            return None
        many = np.tile(p[:, None], len(record))
        found.append(output.map(len(record))(states.T, record.matrix(model.inputs).T, many, calm.T).full().T)
    return tuple(found)


def _residuals(problem: Problem, outputs: tuple[np.ndarray, ...]) -> np.ndarray:
    """(samples, o) of all records, zero where nothing was read."""
    pairs = zip((problem.outputs_of(record) for record in problem.records), outputs, strict=True)
    return np.concatenate([np.where(np.isfinite(z), y - z, 0.0) for z, y in pairs])


def log_prior(objective: AnyObjective, outcome: Outcome, given: np.ndarray) -> float:
    """ln of the normal densities of what has a prior: parameters, and initial states whose 1-sigma was `given`
    (records, states)."""
    problem = objective.problem
    point = outcome.point
    known = np.isfinite(problem.prior_std)
    total = _log_normal((point.theta - problem.nominal)[known], problem.prior_std[known])
    if isinstance(objective, Objective) and objective.dynamics is not None:
        given = given & ~objective.exact
        off = point.nodes[objective.layout.first] - objective.centre
        total += _log_normal(off[given], 1.0 / objective.initial_precision[given])
    return total


def _log_normal(off: np.ndarray, std: np.ndarray) -> float:
    return float(-(0.5 * (off / std) ** 2 + np.log(std * math.sqrt(2.0 * math.pi))).sum())
