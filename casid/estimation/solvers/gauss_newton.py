"""Gauss-Newton on the structured problem: one iteration, and a search by a filter with full steps where that allows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from casid.arguments import require
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point, SolverStep, moved
from casid.estimation.solvers.search import longest, tenfold
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
        """Minimise the objective; it never raises for a bad course of the iteration, the status states what
        happened."""
        iteration = Iteration(objective, Clock(self.seconds, objective), self.tolerance)
        return iteration.run(FilterSearch(iteration), self.iterations, patient=self.patient)


_DEFECT = 1e-8
_LEAST = 1e-8  # damping beyond none
_MOST = 1e6
_WHOLE = 1e-3  # damping that leaves a step whole
_ROUNDED = 1e-4  # standard deviations: a smaller step that finds no descent is rounding
_SHORTEST = 1e-4  # part of a step
_NEAR = 0.05  # of the residual norm: closer than this the noise is estimated with the parameters
# of the last step's length: that goes back; of the squared one: along the last step
_OVERSHOT = 0.5
_ALIGNED = 0.5
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
    """State of one minimisation from the objective's start: its point with value and linearisation."""

    def __init__(self, objective: Objective, clock: Clock, tolerance: float) -> None:
        self.objective = objective
        self.clock = clock
        self.tolerance = tolerance
        self.point = objective.start()
        self.value = objective.value(self.point)
        self.linear: Linearised | None = None
        self.multipliers = np.zeros(len(objective.limits))
        self.noise_change = 0.0 if objective.noise.levels.fixed else np.inf
        self.stationarity = np.inf
        self.attracted = False
        self.course: list[float] = []  # stationarity of all iterations

    def run(self, search: Search, iterations: int, kind: str = "iterations", patient: bool = True) -> Outcome:
        """Iterate until a solution, the end of descent, or too many steps; a bad course is stated in the status."""
        count = 0
        status = None if np.isfinite(self.value.cost) else DIVERGES
        while status is None:
            count += 1
            status = self._advanced(search)
            if status is None and not patient and self._creeps():
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
        still = self.objective.negligible(step, self.value, self.tolerance)
        return still and self.noise_change < 10 * self.tolerance and self.value.worst() < _DEFECT

    def is_rounding(self, step: SolverStep) -> bool:
        """Return True if what is left of a step that finds no descent is rounding."""
        return self.objective.negligible(step, self.value, _ROUNDED) and self.value.worst() < _DEFECT

    def _creeps(self) -> bool:
        """Return True if the last steps were all near the solution and would take too many more at the rate they
        shrink."""
        self.course.append(self.stationarity)
        last = self.course[-_COURSE - 1 :]
        if len(last) <= _COURSE or max(last) > _NEAR * np.sqrt(self.value.noise.levels.count):
            return False
        if min(last[0], last[-1]) == 0.0:
            return True
        rate = (last[-1] / last[0]) ** (1.0 / _COURSE)
        return rate >= 1.0 or np.log(self.tolerance / last[-1]) < _TOO_MANY * np.log(rate)


class FilterSearch:
    """Full steps where the filter allows, halved ones and damping where it does not.

    The filter is that of Waechter and Biegler (Math. Program. 106, 2006). Cost and violation are not added up: a merit
    function that does refuses good steps along curved constraints.
    """

    def __init__(self, at: Iteration) -> None:
        self.damping = 0.0
        self.filter: list[tuple[float, float]] = []
        self.widest = 100 * max(at.value.violation(), 1.0)
        self.relaxing = False  # near enough to the solution for residuals to be noise
        self.before = 0.0  # stationarity at the point from which the last step came, if it was whole and undamped
        self.last: tuple[np.ndarray, float] | None = None  # step of the parameters before, and its share that was taken

    def advance(self, at: Iteration, linear: Linearised) -> Status | None:
        """Advance as `Search` asks."""
        undamped: SolverStep | None = None
        relaxing = self.relaxing
        failed = NO_DESCENT
        for damping in tenfold(self.damping, _LEAST, _MOST):
            self.damping = damping
            if undamped is not None and at.clock.is_late():
                return at.clock.status
            try:
                step = at.objective.step(at.point, at.value, linear, damping, relaxing)
            except np.linalg.LinAlgError as error:
                failed = status_of(error)
                continue
            undamped = undamped or step
            self._look(at, step)
            if self.damping < _WHOLE and at.is_solution(step):
                at.multipliers = step.limit_multipliers
                return CONVERGED
            found = self._found(at, step, relaxing, self._first_length(linear, step.theta))
            if found is not None:
                self._take(at, step, found)
                if self.relaxing and not relaxing:
                    self.filter.clear()  # its costs were those at the former noise
                return None
            failed = NO_DESCENT if step.feasible else INFEASIBLE
        return CONVERGED if undamped is not None and at.is_rounding(undamped) else failed

    def _take(self, at: Iteration, step: SolverStep, found: tuple[Point, ObjectiveValue, float]) -> None:
        """Move to the point that was found along a step."""
        point, value, length = found
        self.last = (step.theta, length) if self.damping < _WHOLE else None
        whole = length == 1.0 and self.damping < _WHOLE
        self.before = at.stationarity if whole else 0.0
        at.attracted = at.attracted and whole
        at.move(point, value)
        at.multipliers = step.limit_multipliers
        self.damping = self.damping / 10 if self.damping > 1e-9 else 0.0

    def _look(self, at: Iteration, step: SolverStep) -> None:
        """Record how near the solution is."""
        length = np.sqrt(max(step.curvature, 0.0))
        at.stationarity = at.objective.length(step, at.value)
        at.attracted |= bool(at.stationarity < 0.5 * self.before)
        if not at.objective.noise.levels.fixed and at.value.worst() < 1e-3:
            near = length < _NEAR * np.sqrt(2 * at.value.cost) or length < 1e-6 * at.value.noise.levels.size
            self.relaxing |= bool(near)

    def _first_length(self, linear: Linearised, step: np.ndarray) -> float:
        """Share of a step that is tried first: of one that goes back over the last, what meets the optimum between.

        Where the residuals are large their curvature, which Gauss-Newton leaves out, may be above its Hessian. Whole
        steps then swing about the optimum, farther each time, and the filter accepts them.
        """
        if self.last is None or self.damping >= _WHOLE:
            return 1.0
        last, share = self.last
        along, before, now = (float(a @ linear.hessian @ b) for a, b in ((step, last), (last, last), (step, step)))
        if not along < -_OVERSHOT * before or not along**2 > _ALIGNED * before * now:
            return 1.0
        return min(share / (1.0 - along / before), 1.0)

    def _found(
        self, at: Iteration, step: SolverStep, relaxing: bool, first: float
    ) -> tuple[Point, ObjectiveValue, float] | None:
        """The longest of the halved steps that the filter accepts, and its share of the whole."""

        def cost_of(value: ObjectiveValue) -> float:
            return at.objective.likelihood_cost(value) if relaxing else value.cost

        cost = cost_of(at.value)
        violation = at.value.violation()
        rounding = 1e-11 * max(abs(at.value.cost), abs(cost))

        def tried(length: float) -> tuple[Point, ObjectiveValue, float] | None:
            point = moved(at.point, step, length)
            value = at.objective.value(point, at.value.noise)
            new_violation = value.violation()
            new_cost = cost_of(value)
            if not (np.isfinite(new_cost) and np.isfinite(new_violation)):
                return None
            # descent of the cost outweighs what the violation is worth: then it is the cost that must fall
            by_cost = -length * step.slope > step.price * violation
            if by_cost:
                better = new_cost <= cost + 1e-4 * length * step.slope + rounding
            else:
                fallen = new_cost <= cost - 1e-4 * step.price * violation + rounding
                better = fallen or new_violation <= (1 - 1e-4) * violation + 1e-12
            passes = all(new_violation < v or new_cost - rounding < c for v, c in self.filter)
            if not (better and new_violation <= self.widest and passes):
                return None
            if not by_cost:
                self.filter.append((violation, cost))
            return point, value, length

        return longest(tried, 0.5, _SHORTEST, first)
