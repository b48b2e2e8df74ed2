"""Gauss-Newton on the structured problem: full steps where the filter allows, damping where it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casid.arguments import require
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point, SolverStep, moved
from casid.estimation.solvers.solver import Outcome, check_limits
from casid.estimation.solvers.status import (
    CONVERGED,
    CREEPS,
    DIVERGES,
    INFEASIBLE,
    NO_DESCENT,
    Status,
    out_of_steps,
    status_of,
)
from casid.estimation.solvers.timed import Clock


@dataclass(frozen=True, kw_only=True)
class GaussNewton:
    """Gauss-Newton with a filter line search.

    Attributes
    ----------
    tolerance
        Converged when a further step would move the solution by less than this many of its standard deviations, and the
        defects are below 1e-8 of the typical state.
    iterations
        After how many steps to give up.
    seconds
        After how much time to give up.
    patient
        Whether to go on where steps next to the solution shrink so slowly that it would take a hundred more.

    Examples
    --------
    After the example of `solve`:

    >>> fit = cs.solve(problem, cs.SingleShooting(), cs.GaussNewton(iterations=50))
    >>> fit.solver, round(fit.values["T"], 3)
    ('GaussNewton', 0.4)
    """

    tolerance: float = 1e-6
    iterations: int = 100
    seconds: float = 600.0
    patient: bool = True

    def __post_init__(self) -> None:
        check_limits(self)
        require(self.patient, bool, "GaussNewton: patient", "patient=True or patient=False")

    def minimise(self, objective: Objective) -> Outcome:
        """Minimise the objective; it never raises for a bad course of the iteration, the status says what happened.

        Parameters
        ----------
        objective
            Of the problem as it is transcribed.
        """
        return _Iteration(objective, self).run()


_DEFECT = 1e-8
_WHOLE = 1e-3  # damping that leaves a step whole
_ROUNDED = 1e-4  # standard deviations: a smaller step that finds no descent is rounding
_NEAR = 0.05  # of the residual norm: closer than this the noise is estimated with the parameters
_COURSE, _TOO_MANY = 15, 100  # iterations that are looked at, and those that may still be needed at their rate


class _Iteration:
    """State of one minimisation."""

    def __init__(self, objective: Objective, solver: GaussNewton) -> None:
        self.objective, self.solver = objective, solver
        self.clock = Clock(solver.seconds, objective)
        self.point = objective.start()
        self.value = objective.value(self.point)
        self.damping = 0.0
        self.filter: list[tuple[float, float]] = []
        self.widest = 100 * max(self.value.violation(), 1.0)
        self.estimate_noise = not objective.noise.levels.fixed
        self.near = self.relaxing = False  # near enough to the solution for residuals to be noise
        self.noise_change = np.inf if self.estimate_noise else 0.0
        self.stationarity = np.inf
        self.before = 0.0  # stationarity at the point from which the last step came, if it was whole and undamped
        self.attracted = False
        self.course: list[float] = []  # stationarity of all iterations
        self.multipliers = np.zeros(len(objective.limits))
        self.linear: Linearised | None = None

    def run(self) -> Outcome:
        if not np.isfinite(self.value.cost):
            return self._outcome(DIVERGES, 0)
        for iteration in range(1, self.solver.iterations + 1):
            status = self._iterate()
            if status is not None:
                return self._outcome(status, iteration)
            if not self.solver.patient and self._creeps():
                return self._outcome(CREEPS, iteration)
            if self.clock.is_up():
                return self._outcome(self.clock.status, iteration)
        return self._outcome(out_of_steps(self.solver.iterations), iteration)

    def _iterate(self) -> Status | None:
        """One linearisation and accepted step; a status when that ends the iteration."""
        objective = self.objective
        if self.near and not self.relaxing:
            self.relaxing = True
            self.filter.clear()  # its costs were those at the former noise
        try:
            if self.relaxing:
                self.value, self.noise_change = objective.relaxed(self.point, self.value)
            self.linear = linear = objective.linearise(self.point, self.value)
        except np.linalg.LinAlgError as error:
            return status_of(error)
        self.value = objective.reweighed(self.point, self.value, linear.noise)
        undamped: SolverStep | None = None
        while True:
            try:
                step = objective.step(self.point, self.value, linear, self.damping, self.relaxing)
            except np.linalg.LinAlgError as error:
                if not self._more_damping():
                    return status_of(error)
                continue
            undamped = undamped or step
            if self._judge(step):
                return CONVERGED
            found = self._search(step)
            if found is not None:
                break
            if not self._more_damping():
                if objective.negligible(undamped, self.value, _ROUNDED) and self.value.worst() < _DEFECT:
                    return CONVERGED  # what is left of the step is rounding
                if not step.feasible:
                    return INFEASIBLE
                return NO_DESCENT
            if self.clock.is_late():
                return self.clock.status
        whole = found[2] == 1.0 and self.damping < _WHOLE
        self.before, self.attracted = self.stationarity if whole else 0.0, self.attracted and whole
        self.point, self.value = found[:2]
        self.linear = None
        self.multipliers = step.limit_multipliers
        self.damping = self.damping / 10 if self.damping > 1e-9 else 0.0
        return None

    def _creeps(self) -> bool:
        """Whether the last steps were all near the solution and would take too many more at the rate they shrink."""
        self.course.append(self.stationarity)
        last = self.course[-_COURSE - 1 :]
        if len(last) <= _COURSE or max(last) > _NEAR * np.sqrt(self.value.noise.levels.count):
            return False
        if min(last[0], last[-1]) == 0.0:
            return True
        rate = (last[-1] / last[0]) ** (1.0 / _COURSE)
        return rate >= 1.0 or np.log(self.solver.tolerance / last[-1]) < _TOO_MANY * np.log(rate)

    def _more_damping(self) -> bool:
        self.damping = max(10 * self.damping, 1e-8)
        return self.damping < 1e6

    def _judge(self, step: SolverStep) -> bool:
        """Whether the point is a solution: the step is negligible against the noise, constraints are met."""
        length = np.sqrt(max(step.curvature, 0.0))
        self.stationarity = self.objective.length(step, self.value)
        self.attracted |= bool(self.stationarity < 0.5 * self.before)
        if self.estimate_noise and self.value.worst() < 1e-3:
            self.near |= bool(
                length < _NEAR * np.sqrt(2 * self.value.cost) or length < 1e-6 * self.value.noise.levels.size
            )
        still = self.objective.negligible(step, self.value, self.solver.tolerance)
        settled = self.noise_change < 10 * self.solver.tolerance
        if still and settled and self.value.worst() < _DEFECT and self.damping < _WHOLE:
            self.multipliers = step.limit_multipliers
            return True
        return False

    def _search(self, step: SolverStep) -> tuple[Point, ObjectiveValue, float] | None:
        """The longest of the halved steps that the filter accepts, and its share of the whole.

        The filter is that of Waechter and Biegler (Math. Program. 106, 2006). Cost and violation are not added up: a
        merit function that does refuses good steps along curved constraints.
        """
        cost, violation = self._cost(self.value), self.value.violation()
        rounding = 1e-11 * max(abs(self.value.cost), abs(cost))
        length = 1.0
        for _ in range(14):
            point = moved(self.point, step, length)
            value = self.objective.value(point, self.value.noise)
            new_violation = value.violation()
            new_cost = self._cost(value)
            if np.isfinite(new_cost) and np.isfinite(new_violation):
                # descent of the cost outweighs what the violation is worth: then it is the cost that must fall
                by_cost = -length * step.slope > step.price * violation
                if by_cost:
                    better = new_cost <= cost + 1e-4 * length * step.slope + rounding
                else:
                    fallen = new_cost <= cost - 1e-4 * step.price * violation + rounding
                    better = fallen or new_violation <= (1 - 1e-4) * violation + 1e-12
                if better and new_violation <= self.widest and self._passes(new_violation, new_cost - rounding):
                    if not by_cost:
                        self.filter.append((violation, cost))
                    return point, value, length
            length *= 0.5
        return None

    def _cost(self, value: ObjectiveValue) -> float:
        return self.objective.likelihood_cost(value) if self.relaxing else value.cost

    def _passes(self, violation: float, cost: float) -> bool:
        return all(violation < v or cost < c for v, c in self.filter)

    def _outcome(self, status: Status, iterations: int) -> Outcome:
        return Outcome(
            point=self.point,
            value=self.value,
            status=status,
            iterations=iterations,
            stationarity=float(self.stationarity),
            limit_multipliers=self.multipliers,
            linear=self.linear,
            attracted=self.attracted,
        )
