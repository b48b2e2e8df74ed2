"""Limit a minimisation in seconds and in evaluations."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import Any

from casid.arguments import require
from casid.estimation.solvers.effort import Effort
from casid.estimation.solvers.own import AnyObjective
from casid.estimation.solvers.solver import Outcome, Solver
from casid.estimation.solvers.status import Status, out_of_steps, out_of_time

_LEAST_SECONDS = 1e-3
_SAME = 0.97  # of the seconds: with as much left a solver is taken as it is, for IPOPT keeps one programme for each


class Clock:
    """Says when an iteration has to end: when another step as long as the last one would be too long, or when the
    evaluations of `objective` are spent."""

    def __init__(self, seconds: float, objective: AnyObjective) -> None:
        self._last = time.perf_counter()
        self._seconds = seconds
        self._effort = objective.effort
        self.deadline = self._last + seconds

    def is_up(self) -> bool:
        """To be asked after every step."""
        now = time.perf_counter()
        took = now - self._last
        self._last = now
        return now + took > self.deadline or self._effort.is_spent

    def is_late(self) -> bool:
        """To be asked within a step."""
        return time.perf_counter() > self.deadline or self._effort.is_spent

    @property
    def status(self) -> Status:
        """Reason of the end."""
        if self._effort.is_spent:
            return out_of_steps(self._effort.spent, "evaluations")
        return out_of_time(self._seconds)


@dataclass(frozen=True, eq=False)
class Timed:
    """A solver that all its runs together give no more than so many `seconds`, which end at a deadline, and no more
    evaluations than an `effort` allows."""

    solver: Solver
    seconds: float
    deadline: float
    effort: Effort = field(default_factory=Effort)

    @property
    def left(self) -> float:
        """Seconds; none where the evaluations are spent."""
        return 0.0 if self.effort.is_spent else self.deadline - time.perf_counter()

    def with_solver(self, solver: Solver) -> Timed:
        """Another solver with the same deadline."""
        return replace(self, solver=solver)

    def allowed(self, evaluations: float) -> Timed:
        """The same with a count of its own, of so many evaluations."""
        return replace(self, effort=Effort(evaluations))

    def limited(self) -> Solver:
        """The solver with no more seconds than are left."""
        seconds: Any = getattr(self.solver, "seconds", math.inf)
        left = max(self.deadline - time.perf_counter(), _LEAST_SECONDS)
        limited: Any = self.solver
        return replace(limited, seconds=left) if left < _SAME * seconds else limited

    def minimise(self, objective: AnyObjective) -> Outcome:
        """Minimise as the solver does, within the time that is left; an end by time states the whole of it."""
        limited: Any = self.limited()
        found = limited.minimise(objective)
        name = f"{type(self.solver).__name__}.minimise"
        found = require(found, Outcome, f"solve: what {name} returned", "a casid.estimation.solvers.solver.Outcome")
        by_time = found.status == out_of_time(getattr(limited, "seconds", math.inf))
        return replace(found, status=out_of_time(self.seconds)) if by_time else found


def timed(solver: Solver, begin: float) -> Timed:
    """Limit a solver from `begin` of `time.perf_counter` on; a solver of one's own without `seconds` has no limit."""
    seconds = float(getattr(solver, "seconds", math.inf))
    return Timed(solver, seconds, begin + seconds)
