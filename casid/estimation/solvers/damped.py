"""Levenberg and Marquardt's damping, for starts from which undamped steps run off.

The damping is relative to the largest curvature that each parameter has shown so far (More, Lecture Notes in
Mathematics 630, 1978). A parameter that comes where it has no effect does not fly away from there. How it changes with
the ratio of the gained to the promised descent is that of Nielsen (IMM-REP-1999-05).
"""

from __future__ import annotations

import time

import numpy as np

from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point, SolverStep, moved
from casid.estimation.solvers.solver import Outcome
from casid.estimation.solvers.status import CONVERGED, DIVERGES, NO_DESCENT, Status, out_of_steps, status_of
from casid.estimation.solvers.timed import Clock

_FIRST, _MOST = 1e-3, 1e30  # damping
_SINGULAR = 1e-10  # damping by which it is judged where the undamped step does not exist
_LEAST_GAIN = 1e-4  # of the promised descent
_DEFECT = 1e-8
_ROUNDED = 1e-4  # standard deviations: a smaller step that finds no descent is rounding
_PRICE = 2.0  # times the largest multiplier: what a violated constraint costs


class DampedIteration:
    """State of one minimisation, from the objective's start."""

    def __init__(self, objective: Objective, tolerance: float, iterations: int, deadline: float) -> None:
        self.objective, self.tolerance, self.iterations = objective, tolerance, iterations
        self.clock = Clock(deadline - time.perf_counter(), objective)
        self.point = objective.start()
        self.value = objective.value(self.point)
        self.damping, self.raise_by, self.price = _FIRST, 2.0, 0.0
        self.largest = np.zeros(len(self.point.theta))
        self.stationarity = np.inf
        self.linear: Linearised | None = None
        self.multipliers = np.zeros(len(objective.limits))

    def run(self) -> Outcome:
        """Until a solution, the end of descent, or too many steps; a bad course is said in the status."""
        iteration, status = 0, None if np.isfinite(self.value.cost) else DIVERGES
        while status is None:
            iteration += 1
            status = self._iterate()
            if status is None and iteration >= self.iterations:
                status = out_of_steps(iteration, "damped iterations")
            elif status is None and self.clock.is_up():
                status = self.clock.status
        return Outcome(
            point=self.point,
            value=self.value,
            status=status,
            iterations=iteration,
            stationarity=self.stationarity,
            limit_multipliers=self.multipliers,
            linear=self.linear,
        )

    def _iterate(self) -> Status | None:
        objective = self.objective
        self.value, change = objective.relaxed(self.point, self.value)
        try:
            self.linear = linear = objective.linearise(self.point, self.value)
        except np.linalg.LinAlgError as error:
            return status_of(error)
        self.value = objective.reweighed(self.point, self.value, linear.noise)
        self.largest = np.maximum(self.largest, np.diagonal(linear.hessian))
        settled = change < 10 * self.tolerance and self.value.worst() < _DEFECT
        undamped = self._step(linear, 0.0)
        if undamped is not None:
            self.stationarity, self.multipliers = objective.length(undamped, self.value), undamped.limit_multipliers
            if settled and objective.negligible(undamped, self.value, self.tolerance):
                return CONVERGED
        while self.damping < _MOST:
            found = self._tried(linear)
            if found is not None:
                self.point, self.value = found
                self.linear = None
                return None
            self.damping, self.raise_by = self.damping * self.raise_by, 2.0 * self.raise_by
        last = undamped or self._step(linear, _SINGULAR)
        rounding = last is not None and objective.negligible(last, self.value, _ROUNDED)
        if last is not None:
            self.stationarity, self.multipliers = objective.length(last, self.value), last.limit_multipliers
        return CONVERGED if rounding and self.value.worst() < _DEFECT else NO_DESCENT

    def _step(self, linear: Linearised, damping: float) -> SolverStep | None:
        diagonal = np.maximum(self.largest, 1e-14 * self.largest.max(initial=0.0))
        try:
            return self.objective.step_by(self.point, linear, linear.hessian + damping * np.diag(diagonal))
        except np.linalg.LinAlgError:
            return None

    def _tried(self, linear: Linearised) -> tuple[Point, ObjectiveValue] | None:
        """The point after the damped step, when it is better."""
        step = self._step(linear, self.damping)
        if step is None:
            return None
        self.price = max(self.price, _PRICE * step.price)
        point = moved(self.point, step, 1.0)
        value = self.objective.value(point, self.value.noise)
        promised = -(step.slope + 0.5 * step.curvature) + self.price * self.value.violation()
        gained = self.value.cost - value.cost + self.price * (self.value.violation() - value.violation())
        if not (np.isfinite(value.cost) and promised > 0.0 and gained > _LEAST_GAIN * promised):
            return None
        self.damping *= max(1.0 / 3.0, 1.0 - (2.0 * gained / promised - 1.0) ** 3)
        self.raise_by = 2.0
        return point, value
