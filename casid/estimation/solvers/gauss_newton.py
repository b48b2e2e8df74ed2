"""Gauss-Newton on the structured problem: a search by a filter, with full steps where that allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casid.arguments import require
from casid.estimation.solvers.following import FollowingSearch
from casid.estimation.solvers.iteration import NEAR, Iteration
from casid.estimation.solvers.own import AnyObjective, OwnObjective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point, SolverStep, moved, step_length
from casid.estimation.solvers.search import longest, tenfold
from casid.estimation.solvers.solver import Outcome, check_limits
from casid.estimation.solvers.status import CONVERGED, INFEASIBLE, NO_DESCENT, Status, status_of
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

    def minimise(self, objective: AnyObjective) -> Outcome:
        """Minimise the objective; it never raises for a bad course of the iteration, the status states what
        happened."""
        iteration = Iteration(objective, Clock(self.seconds, objective), self.tolerance)
        search = FilterSearch(iteration)
        if isinstance(objective, OwnObjective) and objective.own.follows:
            search = FollowingSearch(iteration, objective)
        return iteration.run(search, self.iterations, patient=self.patient)


_LEAST = 1e-8  # damping beyond none
_MOST = 1e6
_WHOLE = 1e-3  # damping that leaves a step whole
_SHORTEST = 1e-4  # part of a step
# of the last step's length: that goes back; of the squared one: along the last step
_OVERSHOT = 0.5
_ALIGNED = 0.5


class FilterSearch:
    """Full steps where the filter allows, halved ones and damping where it does not.

    The filter is that of Waechter and Biegler (Math. Program. 106, 2006). Cost and violation are not added up: a merit
    function that does refuses good steps along curved constraints.
    """

    def __init__(self, at: Iteration) -> None:
        self.damping = 0.0
        self.filter: list[tuple[float, float]] = []
        self.widest = 100 * max(at.value.violation(), 1.0)
        self.relaxing = isinstance(at.objective, OwnObjective)  # near enough to the solution for residuals to be noise
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
        at.stationarity = step_length(step, at.value)
        at.attracted |= bool(at.stationarity < 0.5 * self.before)
        if not at.objective.noise.levels.fixed and at.value.worst() < 1e-3:
            near = length < NEAR * np.sqrt(2 * at.value.cost) or length < 1e-6 * at.value.noise.levels.size
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
