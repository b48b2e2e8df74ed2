"""The loop of every method that steps by a linearisation, whoever chooses the steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from casid.estimation.solvers.own import AnyObjective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point, SolverStep, negligible
from casid.estimation.solvers.solver import Outcome
from casid.estimation.solvers.status import CREEPS, DIVERGES, Status, out_of_steps, status_of
from casid.estimation.solvers.timed import Clock

_DEFECT = 1e-8
_ROUNDED = 1e-4  # standard deviations: a smaller step that finds no descent is rounding
NEAR = 0.05  # of the residual norm: closer than this the noise is estimated with the parameters
# iterations that are looked at, and those that may still be needed at their rate
_COURSE = 15
_TOO_MANY = 100


class Search(Protocol):
    """Finds the next point of an iteration."""

    relaxing: bool  # whether the noise follows the residuals

    def advance(self, at: Iteration, linear: Linearised) -> Status | None:
        """Move to a better point by the linearisation at the present one; a status when that ends the iteration."""
        ...


class Iteration:
    """State of one minimisation from a point, the objective's start if None: its point with value and linearisation."""

    def __init__(self, objective: AnyObjective, clock: Clock, tolerance: float, begin: Point | None = None) -> None:
        self.objective = objective
        self.clock = clock
        self.tolerance = tolerance
        self.point = begin or objective.start()
        self.value = objective.value(self.point)
        self.linear: Linearised | None = None
        self.multipliers = np.zeros(len(objective.limits))
        self.noise_change = 0.0 if objective.noise.levels.fixed else np.inf
        self.stationarity = np.inf
        self.attracted = False
        self.course: list[float] = []  # stationarity of all iterations

    def run(
        self,
        search: Search,
        iterations: int,
        kind: str = "iterations",
        patient: bool = True,
        until: Callable[[Point], bool] | None = None,
    ) -> Outcome:
        """Iterate until a solution, the end of descent, or too many steps; a bad course is said in the status.
        `until` is asked at every point whether to give up there."""
        count = 0
        status = None if np.isfinite(self.value.cost) else DIVERGES
        while status is None:
            count += 1
            status = self._advanced(search)
            given_up = (status is None and not patient and self._creeps()) or (until is not None and until(self.point))
            if status is None and given_up:
                status = CREEPS
            elif status is None and self.clock.is_up():
                status = self.clock.status
            elif status is None and count >= iterations:
                status = out_of_steps(count, kind)
        return Outcome(
            point=self.point,
            value=self.value,
            status=status,
            iterations=count,
            stationarity=float(self.stationarity),
            limit_multipliers=self.multipliers,
            linear=self.linear,
            attracted=self.attracted,
        )

    def _advanced(self, search: Search) -> Status | None:
        """One linearisation and what the search makes of it."""
        objective = self.objective
        try:
            if search.relaxing:
                self.value, self.noise_change = objective.relaxed(self.point, self.value)
            self.linear = linear = objective.linearise(self.point, self.value)
        except np.linalg.LinAlgError as error:
            return status_of(error)
        self.value = objective.reweighed(self.point, self.value, linear.noise)
        return search.advance(self, linear)

    def move(self, point: Point, value: ObjectiveValue) -> None:
        """Go to another point."""
        self.point = point
        self.value = value
        self.linear = None

    def is_solution(self, step: SolverStep) -> bool:
        """Return True if the step is negligible against the noise, the noise has settled, and constraints are met."""
        still = negligible(step, self.value, self.tolerance)
        return still and self.noise_change < 10 * self.tolerance and self.value.worst() < _DEFECT

    def is_rounding(self, step: SolverStep) -> bool:
        """Return True if what is left of a step that finds no descent is rounding."""
        return negligible(step, self.value, _ROUNDED) and self.value.worst() < _DEFECT

    def _creeps(self) -> bool:
        """Return True if the last steps were all near the solution and would take too many more at the rate they
        shrink."""
        self.course.append(self.stationarity)
        last = self.course[-_COURSE - 1 :]
        if len(last) <= _COURSE or max(last) > NEAR * np.sqrt(self.value.noise.levels.count):
            return False
        if min(last[0], last[-1]) == 0.0:
            return True
        rate = (last[-1] / last[0]) ** (1.0 / _COURSE)
        return rate >= 1.0 or np.log(self.tolerance / last[-1]) < _TOO_MANY * np.log(rate)
