"""Limits on functions of the parameters: linear ones, bounds among them, and nonlinear ones, with exact derivatives."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casid.estimation.checks import parameter_function
from casid.estimation.constraints import LinearConstraint, NonlinearConstraint
from casid.estimation.problem import Problem
from casid.estimation.solvers.quadratic import free_directions

_KEPT = 1e-6  # as near a solver comes to a bound that holds: of the bound, or of what is limited where it is zero


class ParameterLimits:
    """lower <= c(theta) <= upper of a problem, in the order of its constraints. A constraint with per-record parameters
    has a row for every record.

    lower, upper   (rows,)
    single         per row the parameter that alone is limited there, by a bound; None for any other constraint
    size           (rows,) magnitude of what is limited: of the start values, or of the limits where that is larger
    """

    def __init__(self, problem: Problem) -> None:
        count = len(problem.parameters)
        lower = []
        upper = []
        rows = []
        curved: list[ca.SX] = []
        theta = ca.SX.sym("theta", count)
        for constraint in problem.constraints:
            if isinstance(constraint, LinearConstraint):
                own = problem.linear_rows_of(constraint)
                parts = [ca.SX(0)] * len(own)
            elif isinstance(constraint, NonlinearConstraint):
                parts = _functions(problem, constraint, theta)
                own = [np.zeros(count)] * len(parts)
            else:
                continue
            rows += own
            curved += parts
            lower += [constraint.lower] * len(own)
            upper += [constraint.upper] * len(own)
        self.linear = np.reshape(rows, (len(rows), count))
        alone = [np.flatnonzero(row).tolist() for row in self.linear]
        self.single: list[int | None] = [which[0] if len(which) == 1 else None for which in alone]
        self.lower, self.upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
        self._curved: tuple[ca.Function, ca.Function, ca.Function] | None = None
        if any(isinstance(c, NonlinearConstraint) for c in problem.constraints):
            self._curved = _derivatives(theta, ca.vertcat(*curved))
        function = "" if self._curved is None else self._curved[0].serialize()
        self.size = self._sizes(problem)
        self.key = (self.linear.tobytes(), self.lower.tobytes(), self.upper.tobytes(), function)

    def __len__(self) -> int:
        return len(self.lower)

    def _sizes(self, problem: Problem) -> np.ndarray:
        values, rows = self.at(problem.start_vector)
        known = np.maximum(np.abs(problem.start_vector), np.abs(problem.nominal))
        limits = np.array([self.lower, self.upper])
        size = np.maximum(np.abs(values), np.abs(rows) @ known)
        size = np.maximum(size, np.abs(np.where(np.isfinite(limits), limits, 0.0)).max(axis=0, initial=0.0))
        return np.where(np.isfinite(size) & (size > 0.0), size, 1.0)

    def beyond(self, theta: np.ndarray) -> np.ndarray:
        """Return how far parameters are beyond the limits (rows,), in sizes of what is limited."""
        at = self.at(theta)[0]
        return (np.maximum(at - self.upper, 0.0) + np.minimum(at - self.lower, 0.0)) / self.size

    def kept(self, theta: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Return parameters with the bound itself for those that one holds, or that are beyond it by rounding."""
        kept = theta.copy()
        with np.errstate(divide="ignore", invalid="ignore"):
            for row, i in enumerate(self.single):
                if i is None:
                    continue
                factor = self.linear[row, i]
                for limit, outward in ((self.lower[row], -1.0), (self.upper[row], 1.0)):
                    past = outward * (factor * theta[i] - limit)
                    inside = _KEPT * (abs(limit) or self.size[row]) if outward * multipliers[row] > 0.0 else 0.0
                    if -inside < past < _KEPT * self.size[row]:
                        kept[i] = limit / factor
        return kept

    def at(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(values (rows,), Jacobian (rows, parameters)) at parameters (parameters,)."""
        values = self.linear @ theta
        rows = self.linear
        if self._curved is not None:
            value, slope = self._curved[1](theta)
            values = values + value.full()[:, 0]
            rows = rows + slope.full()
        return values, rows

    def about(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(rows, lower, upper) of the linearised limits on a change of the parameters from theta."""
        at, rows = self.at(theta)
        return rows, self.lower - at, self.upper - at

    def free_directions(self, theta: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(parameters, directions) that the limits leave free at theta: those with a multiplier and equalities hold."""
        return free_directions(self.at(theta)[1], np.where(self.lower == self.upper, 1.0, multipliers))

    def curvature(self, theta: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(parameters, parameters) second derivative of multipliers' c(theta)."""
        if self._curved is None:
            return np.zeros((len(theta), len(theta)))
        return self._curved[2](theta, multipliers).full()

    def symbolic(self, theta: ca.MX) -> ca.MX:
        """c(theta) as an expression."""
        found = ca.DM(self.linear) @ theta
        if self._curved is None:
            return found
        value = self._curved[0](theta)
        assert isinstance(value, ca.MX)
        return found + value


def _derivatives(theta: ca.SX, c: ca.SX) -> tuple[ca.Function, ca.Function, ca.Function]:
    """theta -> c; theta -> c and its Jacobian; (theta, multipliers) -> Hessian of multipliers' c."""
    multipliers = ca.SX.sym("m", c.shape[0])
    hessian = ca.hessian(multipliers.T @ c, theta)[0]
    return (
        ca.Function("c", [theta], [ca.densify(c)]),
        ca.Function("dc", [theta], [ca.densify(c), ca.densify(ca.jacobian(c, theta))]),
        ca.Function("ddc", [theta, multipliers], [ca.densify(hessian)]),
    )


def _functions(problem: Problem, constraint: NonlinearConstraint, theta: ca.SX) -> list[ca.SX]:
    """A nonlinear constraint in the unknowns theta, for every record that has its own."""
    model = problem.model
    expression = parameter_function(constraint.function, model)
    base = problem.model_parameters(np.zeros(len(problem.parameters)))
    local = [model.parameters.index(name) for name in problem.local]
    varies = local and any(ca.which_depends(expression, ca.vertcat(*[model.p[i] for i in local]), 1, False))
    # a fixed value may differ between records too
    records = range(len(problem.records)) if varies or (base != base[0]).any() else (0,)
    found = []
    for r in records:
        p = ca.SX(base[r])
        for i, column in zip(problem.free_index, problem.columns(r), strict=True):
            p[int(i)] = theta[int(column)]
        found.append(ca.substitute(expression, model.p, p))
    return found
