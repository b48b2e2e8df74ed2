"""Newton's method in the parameters alone, with the whole curvature, where Gauss-Newton creeps or gives up.

Gauss-Newton leaves out the curvature of the residuals, which counts where they are large: a model that cannot follow
its data. Here all other unknowns, states and estimated noise among them, are at their optimum for the parameters, so
that the cost and its exact gradient are functions of the parameters alone. The Hessian is that gradient's differences.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from casid.estimation.solvers.damped import DampedSearch
from casid.estimation.solvers.gauss_newton import GaussNewton
from casid.estimation.solvers.identified import lost
from casid.estimation.solvers.ipopt import Ipopt
from casid.estimation.solvers.iteration import Iteration
from casid.estimation.solvers.nlp import is_programmable
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import AnyObjective, OwnObjective
from casid.estimation.solvers.point import (
    Linearised,
    NoiseState,
    ObjectiveValue,
    Point,
    SolverStep,
    moved,
    negligible,
    step_length,
)
from casid.estimation.solvers.quadratic import jacobi_scale, parameter_step
from casid.estimation.solvers.search import tenfold
from casid.estimation.solvers.solver import Outcome, check_limits
from casid.estimation.solvers.status import (
    CONVERGED,
    FLAT_MINIMUM,
    NO_DESCENT,
    NO_MINIMUM,
    NO_MOTION,
    Results,
    Stage,
    Status,
    out_of_steps,
    status_of,
)
from casid.estimation.solvers.timed import Clock

_APART = 1e-3  # standard deviations between points whose gradients are compared
# standard deviations, relative change of the noise, scaled defect: the other unknowns are at their optimum
_EXACT = 1e-9
_DAMPED = 10  # times as many steps of the methods whose steps are short
_INNER = 50  # steps of the other unknowns
_FLAT = 1e-6  # of the curvature of Gauss-Newton: less is no minimum
_GAIN = 0.01  # of ln(likelihood), as good as its integration is
_BENT = 1e-3  # of it: less curvature downwards changes ln(likelihood) by less than its integration does
_ROUNDED = 1e-4  # standard deviations: a smaller step that finds no descent is rounding
# damping
_LEAST = 1e-3
_MOST = 1e9
_ROUNDING = 1e-15  # of the largest eigenvalue


@dataclass(frozen=True, kw_only=True)
class Automatic:
    """Gauss-Newton, with other methods where it fails.

    Levenberg-Marquardt damping from the start follows if Gauss-Newton stops or diverges. Newton's method with the exact
    Hessian follows if it converges slowly, and judges a point that was not reached by full steps. IPOPT follows under
    path constraints, and for a regression on which the others failed. With process noise there is Gauss-Newton alone.

    Attributes
    ----------
    tolerance
        Converged when a further step would move the solution by less than this many of its standard deviations, and the
        defects are below 1e-8 of the typical state.
    iterations
        Largest number of steps of each method.
    seconds
        Largest time of all methods together [s].

    Examples
    --------
    After the example of `solve`:

    >>> cs.solve(problem, solver=cs.Automatic(iterations=50)).status
    'converged'
    """

    tolerance: float = 1e-6
    iterations: int = 100
    seconds: float = 600.0

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def usual(self) -> GaussNewton:
        """Gauss-Newton that gives up where it creeps."""
        return GaussNewton(tolerance=self.tolerance, iterations=self.iterations, seconds=self.seconds, patient=False)

    def minimise(self, objective: AnyObjective) -> Outcome:
        """Minimise the objective; a bad course of the iteration is stated in the status."""
        begin = time.perf_counter()
        if isinstance(objective, OwnObjective):
            return self._of_own(objective, begin)
        # the covariance of soft defects moves with the point, so that their cost is no function of the parameters
        outcome = replace(self.usual, patient=objective.soft).minimise(objective)
        found = is_found(objective, outcome)
        if objective.problem.path_constraints:  # the cost within them is no function of the parameters alone
            left = self.seconds - (time.perf_counter() - begin)
            other = Ipopt(seconds=left).minimise(objective) if left > 0.0 and not outcome.converged else outcome
            return other if other.converged else outcome
        if objective.soft or (found and outcome.attracted) or time.perf_counter() - begin > self.seconds:
            return outcome
        if not objective.problem.parameters:  # states alone: what Newton adds is curvature of parameters
            return outcome
        if found:  # a start that is stationary already, or a search that ended in rounding
            judged = _Newton(objective, self, outcome, begin + self.seconds).run()
            return judged if judged.status.result in (Results.CONVERGED, Results.NO_MINIMUM) else outcome
        if outcome.status.stage is not Stage.CREEPING:  # there it is the whole curvature that is missing
            clock = Clock(begin + self.seconds - time.perf_counter(), objective)
            damped = Iteration(objective, clock, self.tolerance)
            steps = _DAMPED * self.iterations
            outcome = _better(objective, outcome, damped.run(DampedSearch(), steps, "damped iterations"))
        if outcome.converged and not is_found(objective, outcome):
            return outcome
        outcome = _Newton(objective, self, outcome, begin + self.seconds).run()
        left = self.seconds - (time.perf_counter() - begin)
        programmable = objective.dynamics is None and is_programmable(objective)
        if programmable and left > 0.0 and not is_found(objective, outcome):
            # without states it is quick, and comes through valleys in which Newton's short steps do not end
            last = Ipopt(iterations=2 * _DAMPED * self.iterations, seconds=left).minimise(objective)
            outcome = last if last.converged else outcome
        return outcome

    def _of_own(self, objective: OwnObjective, begin: float) -> Outcome:
        """Minimise by steps of Gauss-Newton, damped ones after them where nothing follows the parameters."""
        outcome = replace(self.usual, patient=True).minimise(objective)
        left = begin + self.seconds - time.perf_counter()
        if is_found(objective, outcome) or objective.own.follows or left <= 0.0:
            return outcome
        damped = Iteration(objective, Clock(left, objective), self.tolerance)
        return _better(objective, outcome, damped.run(DampedSearch(), _DAMPED * self.iterations, "damped iterations"))


def to_second_order(objective: Objective, outcome: Outcome, seconds: float = 600.0) -> Outcome:
    """The outcome of any solver; its status is another one where its stationary point is no minimum.

    Not judged, and left as they are: points under path constraints and soft defects, where the cost is no function of
    the parameters alone.
    """
    known = outcome.attracted or outcome.solver == "Newton" or not objective.problem.parameters
    if not outcome.converged or known or objective.soft or objective.problem.path_constraints:
        return outcome
    if outcome.linear is None and objective.dynamics is not None and not np.isfinite(outcome.stationarity):
        return outcome
    judged = _Newton(objective, Automatic(seconds=seconds), outcome, time.perf_counter() + seconds).run()
    return replace(outcome, status=judged.status) if judged.status.result is Results.NO_MINIMUM else outcome


def is_found(objective: AnyObjective, outcome: Outcome) -> bool:
    """Return True if it converged where the data determine every parameter."""
    if not outcome.converged or outcome.linear is None:
        return outcome.converged
    return not lost(objective, outcome.linear, outcome.limit_multipliers)


def _better(objective: AnyObjective, first: Outcome, second: Outcome) -> Outcome:
    """Return, of two ends, the one that was found, or else the lower one."""
    if is_found(objective, second) or not np.isfinite(first.value.cost):
        return second
    ends = (objective.likelihood_cost(o.value) + o.value.violation() for o in (first, second))
    lower, other = ends
    return second if other < lower else first


@dataclass(frozen=True, eq=False, kw_only=True)
class _Settled:
    """A point whose states and noise are at their optimum for its parameters."""

    point: Point
    value: ObjectiveValue
    linear: Linearised
    cost: float


class _Newton:
    """State of one minimisation; `cost` of a settled point is the one with the noise at its optimum."""

    def __init__(self, objective: Objective, solver: Automatic, begun: Outcome, deadline: float) -> None:
        self.objective = objective
        self.solver = solver
        self.begun = begun
        self.clock = Clock(deadline - time.perf_counter(), objective)
        self.damping = 0.0
        self.multipliers = begun.limit_multipliers

    def run(self) -> Outcome:
        # where the states are far from a motion of the model they start from the measured ones
        measured = replace(self.objective.start(), theta=self.begun.point.theta)
        noise = self.begun.value.noise
        at = self._settled(self.begun.point, noise) or self._settled(measured, noise)
        if at is None:
            return self.begun
        status = None
        iteration = 0
        while status is None and iteration < self.solver.iterations:
            iteration += 1
            try:
                at, status = self._iterate(at)
            except np.linalg.LinAlgError as error:
                status = status_of(error)
        status = status or out_of_steps(self.solver.iterations, "iterations of Newton")
        return self._outcome(at, status, self.begun.iterations + iteration)

    def _iterate(self, at: _Settled) -> tuple[_Settled, Status | None]:
        """One step; a status when that ends the iteration."""
        root = self._root(at)
        exact = self._curvature(at, root)
        if exact is None:
            return at, self.clock.status if self.clock.is_late() else NO_MOTION
        exact += root.T @ self.objective.limits.curvature(at.point.theta, self.multipliers) @ root
        first = self._step(at, root, exact, 0.0)
        if negligible(first, at.value, self.solver.tolerance):
            return at, self._judged(at, root, exact, first)
        level = self._only_flat_left(at, root, exact, first)
        if level and self._judged(at, root, exact, first) is FLAT_MINIMUM:
            return at, FLAT_MINIMUM
        for damping in tenfold(self.damping, _LEAST, _MOST):
            step = first if damping == 0.0 else self._step(at, root, exact, damping)
            found = self._tried(at, step)
            if found is not None:
                self.multipliers = step.limit_multipliers
                self.damping = damping / 10 if damping > _LEAST else 0.0
                return found, None
        if negligible(first, at.value, _ROUNDED):
            return at, self._judged(at, root, exact, first)
        return at, self.clock.status if self.clock.is_late() else NO_DESCENT

    def _root(self, at: _Settled) -> np.ndarray:
        """Directions of unit curvature of Gauss-Newton, each no longer than moves a parameter by its own size."""
        root = _inverse_root(at.linear.hessian)
        size = np.maximum(np.abs(at.point.theta), np.abs(self.objective.problem.start_vector))
        moved_by = np.abs(root) / np.where(size > 0.0, size, np.inf)[:, None]
        return root / np.maximum(moved_by.max(axis=0, initial=0.0), 1.0)

    def _step(self, at: _Settled, root: np.ndarray, exact: np.ndarray, damping: float) -> SolverStep:
        """Downhill also where the curvature is negative: its absolute value, plus `damping` times Gauss-Newton's."""
        objective = self.objective
        values, vectors = np.linalg.eigh(exact)
        curvature = (vectors * (np.maximum(np.abs(values), _FLAT) + damping)) @ vectors.T
        rows, *limits = objective.limits.about(at.point.theta)
        z, multipliers = parameter_step(curvature, root.T @ at.linear.gradient, rows @ root, *limits)
        return objective.step_along(at.linear, root @ z, multipliers)

    def _only_flat_left(self, at: _Settled, root: np.ndarray, exact: np.ndarray, step: SolverStep) -> bool:
        """Return True if a step is negligible but for directions without curvature, in which as many steps as are
        allowed would together gain nothing that counts. There steps shrink by a few percent each."""
        values, vectors = np.linalg.eigh(exact)
        flat = vectors[:, np.abs(values) <= _FLAT]
        along = root @ flat @ (flat.T @ np.linalg.solve(root, step.theta))
        if not flat.size or self._counts(at, abs(float(at.linear.gradient @ step.theta))) > 1.0:
            return False
        rest = self.objective.step_along(at.linear, step.theta - along, step.limit_multipliers)
        return negligible(rest, at.value, self.solver.tolerance)

    def _counts(self, at: _Settled, gain: float) -> float:
        """A gain of one step, in units of what counts: of which as many as are allowed change ln(likelihood), with the
        noise that the residuals have, by more than its integration does."""
        noise = 2.0 * at.value.cost / at.value.noise.levels.count
        return gain * self.solver.iterations / (_GAIN * max(noise, 1e-300))

    def _judged(self, at: _Settled, root: np.ndarray, exact: np.ndarray, step: SolverStep) -> Status:
        """Judge whether a stationary point is a minimum, in the directions that the limits leave free."""
        self.multipliers = step.limit_multipliers
        free = self.objective.limits.free_directions(at.point.theta, step.limit_multipliers)
        basis = np.linalg.qr(np.linalg.inv(root) @ free)[0]
        least = float(np.linalg.eigvalsh(basis.T @ exact @ basis).min(initial=np.inf))
        if least > _FLAT:
            return CONVERGED
        return NO_MINIMUM if least < -_BENT else FLAT_MINIMUM

    def _tried(self, at: _Settled, step: SolverStep) -> _Settled | None:
        """The point after the step, when it is lower or the first within the limits."""
        slope = float(at.linear.gradient @ step.theta)
        found = self._settled(moved(at.point, step, 1.0), at.value.noise)
        rounding = 1e-11 * max(abs(at.cost), abs(at.value.cost))
        beyond = np.abs(at.value.limits).max(initial=0.0) > _EXACT
        if found is not None and (beyond or found.cost <= at.cost + 1e-4 * slope + rounding):
            return found
        return None

    def _curvature(self, at: _Settled, root: np.ndarray) -> np.ndarray | None:
        """(parameters, parameters) Hessian in units of `root`: central differences of the gradient. None when one of
        the points has no motion or when time is up."""
        columns = []
        for direction in root.T:
            if self.clock.is_late():
                return None
            ends = [self._gradient(at, sign * _APART * direction) for sign in (1.0, -1.0)]
            if ends[0] is None or ends[1] is None:
                return None
            columns.append(root.T @ (ends[0] - ends[1]) / (2 * _APART))
        return 0.5 * (np.array(columns) + np.array(columns).T)

    def _gradient(self, at: _Settled, theta: np.ndarray) -> np.ndarray | None:
        nothing = np.zeros(len(self.objective.limits))
        step = self.objective.step_along(at.linear, theta, nothing)
        found = self._settled(moved(at.point, step, 1.0), at.value.noise)
        return None if found is None else found.linear.gradient

    def _settled(self, point: Point, noise: NoiseState) -> _Settled | None:
        """States and noise to their optimum with the parameters as they are; None when they find none."""
        objective = self.objective
        former = np.inf
        fixed = np.zeros_like(point.theta)
        nothing = np.zeros(len(objective.limits))
        value = objective.value(point, noise)
        for _ in range(_INNER):
            if not np.isfinite(value.cost) or self.clock.is_late():
                return None
            try:
                value, change = objective.relaxed(point, value)
                linear = objective.linearise(point, value)
            except np.linalg.LinAlgError:
                return None
            value = objective.reweighed(point, value, linear.noise)
            step = objective.step_along(linear, fixed, nothing)
            apart = max(np.abs(value.defects).max(initial=0.0), np.abs(value.gap).max(initial=0.0))
            # next to the optimum that is rounding
            grown = step.curvature >= former
            former = step.curvature
            still = negligible(step, value, 100 * _EXACT if grown else _EXACT)
            if still and change < _EXACT and apart < _EXACT:
                cost = value.cost if value.noise.levels.fixed else objective.likelihood_cost(value)
                return _Settled(point=point, value=value, linear=linear, cost=cost)
            point = moved(point, step, 1.0)
            value = objective.value(point, value.noise)
        return None

    def _outcome(self, at: _Settled, status: Status, iterations: int) -> Outcome:
        value = at.value
        length = np.nan
        with suppress(np.linalg.LinAlgError):
            length = step_length(self.objective.step(at.point, value, at.linear, 0.0), value)
        return Outcome(
            point=at.point,
            value=value,
            status=status,
            iterations=iterations,
            stationarity=length,
            limit_multipliers=self.multipliers,
            linear=at.linear,
            solver="Newton",
        )


def _inverse_root(matrix: np.ndarray) -> np.ndarray:
    """R with R' matrix R = 1, but for directions in which rounding leaves nothing of the matrix: there it is less.

    Raises numpy.linalg.LinAlgError where the matrix is no number.
    """
    scale = jacobi_scale(matrix)
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    return scale[:, None] * (vectors / np.sqrt(np.maximum(values, _ROUNDING * values[-1])))
