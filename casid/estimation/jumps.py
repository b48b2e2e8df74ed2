"""Inputs that jump between samples although their record says that they run linearly: would held ones explain more?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.solvers.gauss_newton import GaussNewton
from casid.estimation.solvers.objective import Objective
from casid.estimation.transcriptions.transcription import MultipleShooting
from casid.records.record import Record

_JUMP = 0.2  # of a channel's range, off the straight line between its neighbours: worth a look, and no more
_WORTH = 3.0  # ln(likelihood): odds of twenty to one between two models of as many parameters
_STEPS = 30  # of Gauss-Newton from the estimates


def jump_remarks(objective: Objective, theta: np.ndarray) -> Iterator[str]:
    """A sentence for each input that jumps, runs linearly, and would explain the data better held; of the objective
    that was minimised, with its parameters theta."""
    problem = objective.problem
    sampled = problem.feedback is not None or problem.model.period is not None
    if objective.dynamics is None or objective.soft or sampled:
        return
    names = [name for name in problem.model.inputs if any(_jumps(record, name) for record in problem.records)]
    if not names:
        return
    steps = objective.layout.substeps
    plain = _log_likelihood(problem, theta, steps)
    for name in names:
        held = replace(problem, records=[_held(record, name) for record in problem.records])
        gain = _log_likelihood(held, theta, steps) - plain
        if gain > _WORTH:
            yield (
                f"input '{name}' jumps between samples and is taken as linear there; held, the log likelihood is "
                f"{gain:.3g} higher: write Record(..., hold={{'{name}': 'held'}})"
            )


def _jumps(record: Record, name: str) -> bool:
    if record.hold_of(name) != "linear" or name == "t" or len(record) < 3:
        return False
    t, u = record.t, record[name]
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    off = np.abs(u[1:-1] - u[:-2] - share * (u[2:] - u[:-2]))
    return bool(off.max() > _JUMP * np.ptp(u) > 0.0)


def _held(record: Record, name: str) -> Record:
    hold = dict.fromkeys(record.channels, record.hold) if isinstance(record.hold, str) else dict(record.hold)
    return replace(record, hold=hold | {name: "held"})


def _log_likelihood(problem: Problem, theta: np.ndarray, steps: int) -> float:
    """At the optimum next to theta; minus infinity where there is none."""
    dynamics = MultipleShooting(substeps=steps).dynamics(problem)
    begin = replace(Objective(problem, dynamics).start(), theta=theta)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        value = GaussNewton(iterations=_STEPS).minimise(Objective(problem, dynamics, begin)).value
    found = value.noise.levels.log_likelihood(value.squares)
    return found if math.isfinite(found) else -math.inf
