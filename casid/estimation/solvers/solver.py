"""What a solver is, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised, Point, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """Where a solver stopped and why: status is "converged" or says in words what is the matter; `linear` is the
    linearisation at the point when the solver has it.

    stationarity        length of a further Gauss-Newton step in standard deviations of the solution
    limit_multipliers   one per row of the linear constraints, positive at an upper limit
    solver              name of the one that came to this point
    attracted           whether whole steps came ever nearer: a stationary point that attracts steps downhill by any
                        positive definite curvature is a minimum to second order
    """

    point: Point
    value: Value
    status: str
    iterations: int
    stationarity: float
    limit_multipliers: np.ndarray
    linear: Linearised | None = None
    solver: str = "GaussNewton"
    attracted: bool = False


class Solver(Protocol):
    """Minimises an objective. Any object with this method is a solver.

    `Objective` gives it `start()`, `value(point)`, `linearise(point, value)` and the `step(...)` that this promises,
    which already eliminates states; a bad course of the iteration is said in the outcome's status, not raised.
    """

    def minimise(self, objective: Objective) -> Outcome:
        """The point found. Raises EstimationError for an objective that it cannot take."""
        ...
