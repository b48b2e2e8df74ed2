"""Define the interface of a solver, and its outcome."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from casid.arguments import number, whole
from casid.estimation.solvers.own import AnyObjective
from casid.estimation.solvers.point import Linearised, ObjectiveValue, Point
from casid.estimation.solvers.status import Status


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """Point at which a solver stopped, and why; `linear` is the linearisation there when the solver has it."""

    point: Point
    value: ObjectiveValue
    status: Status
    iterations: int
    stationarity: float  # length of a further Gauss-Newton step in standard deviations of the solution
    limit_multipliers: np.ndarray  # one per row of the linear constraints, positive at an upper limit
    linear: Linearised | None = None
    solver: str = "GaussNewton"  # name of the one that came to this point
    # whether whole steps came ever nearer: a stationary point that attracts steps downhill by any positive definite
    # curvature is a minimum to second order
    attracted: bool = False

    @property
    def converged(self) -> bool:
        """Return True if the solver calls its point a solution."""
        return self.status.converged


def linear_at(objective: AnyObjective, outcome: Outcome) -> Linearised | None:
    """The linearisation where a solver stopped; None where there is none."""
    if outcome.linear is None:
        with suppress(np.linalg.LinAlgError):
            return objective.linearise(outcome.point, outcome.value)
    return outcome.linear


def check_limits(solver: Any) -> None:
    """Raise InputError unless tolerance and seconds of a solver are positive and iterations a whole number from 1."""
    name = type(solver).__name__
    number(solver.tolerance, f"{name}: tolerance", positive=True)
    whole(solver.iterations, f"{name}: iterations")
    number(solver.seconds, f"{name}: seconds", positive=True)


class Solver(Protocol):
    """Minimises an objective. Any object with this method is a solver.

    It is an `Objective`, or an `OwnObjective` where the cost makes its likelihood itself, with `start()`,
    `value(point)`, `linearise(point, value)` and the `step(...)` that this promises, which already eliminates states. A
    bad course of the iteration is stated in the outcome's status, not raised.
    """

    def minimise(self, objective: Any) -> Outcome:
        """The point found. Raises EstimationError for an objective that it cannot take."""
        ...
