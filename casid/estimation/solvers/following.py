"""Gauss-Newton where motion and noise follow the parameters: whole steps, or the longest part that is no loss.

The levels of the noise are at their optimum before every step, with the parameters at theirs. The slope of the log
determinant is worth its cost near the solution only.
"""

from __future__ import annotations

import numpy as np

from casid.estimation.solvers.identified import lost
from casid.estimation.solvers.iteration import Iteration
from casid.estimation.solvers.own import OwnObjective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point, SolverStep, moved, step_length
from casid.estimation.solvers.search import longest
from casid.estimation.solvers.status import CONVERGED, NO_DESCENT, Results, Status

_SMALL_STEP = 0.01  # of a standard error, and of a logarithm of a noise: converged
_NEAR = 1.0  # standard errors: from here on the slope through the covariance is worth its cost
FLAT = 0.05  # of -ln(likelihood): less is no loss
_MET = 1e-8  # scaled limits


class FollowingSearch:
    """Steps of an `OwnObjective` with everything else at its optimum."""

    relaxing = True

    def __init__(self, at: Iteration, objective: OwnObjective) -> None:
        self.objective = objective
        self.noise = at.value.noise  # before the present step
        self.near = False

    def advance(self, at: Iteration, linear: Linearised) -> Status | None:
        """See `Search`."""
        objective = self.objective
        found = None
        for held in (False, True):  # the noise that goes with a step that is too long forbids shorter steps, too
            if held:
                before = objective.reweighed(at.point, at.value, self.noise)
                at.value, _ = objective.relaxed(at.point, before, held=True)
                at.linear = linear = objective.linearise(at.point, at.value)
            step = objective.with_motion(at.value, objective.step(at.point, at.value, linear, 0.0))
            at.stationarity = step_length(step, at.value)
            found = self._tried(at, step)
            if found is not None:
                break
        if found is None:
            return NO_DESCENT
        gone = lost(objective, linear, step.limit_multipliers)
        if gone:
            return self._not_identifiable(at, gone)
        point, value, length = found
        change = max(float(np.sqrt(max(step.curvature, 0.0))), value.noise.change_from(self.noise))
        self.noise = at.value.noise
        at.move(point, value)
        at.multipliers = step.limit_multipliers
        if self.near and length == 1.0 and change < _SMALL_STEP and value.worst() < _MET:
            return CONVERGED
        self.near = self.near or change < _NEAR or length < 1.0
        if self.near:
            at.value = objective.bent(value)
        return None

    def _tried(self, at: Iteration, step: SolverStep) -> tuple[Point, ObjectiveValue, float] | None:
        """The longest part of a step that is no loss; along the most likely motion of the parameters, where alone
        slopes are right."""
        before = self.objective.misfit(at.value)

        def tried(length: float) -> tuple[Point, ObjectiveValue, float] | None:
            point = moved(at.point, step, length)
            value = self.objective.value(point, at.value.noise)
            better = self.objective.misfit(value) < before + FLAT or value.worst() < at.value.worst()
            return (point, value, length) if better and np.isfinite(value.cost) else None

        return longest(tried)

    def _not_identifiable(self, at: Iteration, gone: tuple[str, ...]) -> Status:
        values = zip(self.objective.problem.parameters, at.point.theta, strict=True)
        where = ", ".join(f"{name} = {value:.3g}" for name, value in values if name in gone)
        return Status(
            result=Results.NOT_IDENTIFIABLE,
            reason=f"the data say nothing of {where}",
            remedy="start nearer, fix one, or give a prior",
        )
