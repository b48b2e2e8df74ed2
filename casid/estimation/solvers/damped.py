"""Levenberg and Marquardt's damping, for starts from which undamped steps run off.

The damping is relative to the largest curvature that each parameter has shown so far (More, Lecture Notes in
Mathematics 630, 1978). A parameter that comes where it has no effect does not fly away from there. How it changes with
the ratio of the gained to the promised descent is that of Nielsen (IMM-REP-1999-05).
"""

from __future__ import annotations

import numpy as np

from casid.estimation.solvers.iteration import Iteration
from casid.estimation.solvers.point import Linearised, SolverStep, moved, step_length
from casid.estimation.solvers.quadratic import own_curvature
from casid.estimation.solvers.status import CONVERGED, NO_DESCENT, Status

# damping
_FIRST = 1e-3
_MOST = 1e30
_NONE = 1e-30  # changes no step by more than rounding, and can grow again
_SINGULAR = 1e-10  # damping by which it is judged where the undamped step does not exist
_LEAST_GAIN = 1e-4  # of the promised descent
_PRICE = 2.0  # times the largest multiplier: what a violated constraint costs


class DampedSearch:
    """Steps with as much damping as leaves them a descent."""

    relaxing = True

    def __init__(self) -> None:
        self.damping, self.raise_by, self.price, self.largest = _FIRST, 2.0, 0.0, np.zeros(1)

    def advance(self, at: Iteration, linear: Linearised) -> Status | None:
        """Advance as `Search` asks."""
        self.largest = np.maximum(self.largest, np.diagonal(linear.hessian))
        undamped = self._look(at, linear, 0.0)
        if undamped is not None and at.is_solution(undamped):
            return CONVERGED
        while self.damping < _MOST:
            if self._tried(at, linear):
                return None
            self.damping, self.raise_by = self.damping * self.raise_by, 2.0 * self.raise_by
        last = undamped or self._look(at, linear, _SINGULAR)
        return CONVERGED if last is not None and at.is_rounding(last) else NO_DESCENT

    def _look(self, at: Iteration, linear: Linearised, damping: float) -> SolverStep | None:
        """The step with this damping, which shows how near the solution is."""
        step = self._step(at, linear, damping)
        if step is not None:
            at.stationarity = step_length(step, at.value)
            at.multipliers = step.limit_multipliers
        return step

    def _step(self, at: Iteration, linear: Linearised, damping: float) -> SolverStep | None:
        try:
            return at.objective.step_by(linear, linear.hessian + damping * np.diag(own_curvature(self.largest)))
        except np.linalg.LinAlgError:
            return None

    def _tried(self, at: Iteration, linear: Linearised) -> bool:
        """Return True if the point after the damped step is better; the iteration then moves to it."""
        step = self._step(at, linear, self.damping)
        if step is None:
            return False
        self.price = max(self.price, _PRICE * step.price)
        point = moved(at.point, step, 1.0)
        value = at.objective.value(point, at.value.noise)
        promised = -(step.slope + 0.5 * step.curvature) + self.price * at.value.violation()
        gained = at.value.cost - value.cost + self.price * (at.value.violation() - value.violation())
        if not (np.isfinite(value.cost) and promised > 0.0 and gained > _LEAST_GAIN * promised):
            return False
        self.damping = max(self.damping * max(1.0 / 3.0, 1.0 - (2.0 * gained / promised - 1.0) ** 3), _NONE)
        self.raise_by = 2.0
        at.move(point, value)
        return True
