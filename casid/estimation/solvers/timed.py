"""How long a minimisation may take."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.solver import Outcome, Solver

_LEAST_SECONDS = 1e-3
_SAME = 0.97  # of the seconds: with as much left a solver is taken as it is, for IPOPT keeps one programme for each


class Clock:
    """Says when an iteration has to end: when another step as long as the last one would be too long."""

    def __init__(self, seconds: float) -> None:
        self._last = time.perf_counter()
        self.deadline = self._last + seconds

    def is_up(self) -> bool:
        """To be asked after every step."""
        now = time.perf_counter()
        took, self._last = now - self._last, now
        return now + took > self.deadline


@dataclass(frozen=True, eq=False)
class Timed:
    """A solver that all its runs together give no more than its `seconds`, counted from a beginning."""

    solver: Solver
    deadline: float

    @property
    def left(self) -> float:
        """Seconds."""
        return self.deadline - time.perf_counter()

    def with_solver(self, solver: Solver) -> Timed:
        """Another solver with the same deadline."""
        return replace(self, solver=solver)

    def limited(self) -> Solver:
        """The solver with no more seconds than are left."""
        seconds: Any = getattr(self.solver, "seconds", math.inf)
        left = max(self.left, _LEAST_SECONDS)
        limited: Any = self.solver
        return replace(limited, seconds=left) if left < _SAME * seconds else limited

    def minimise(self, objective: Objective) -> Outcome:
        """As the solver does, within the time that is left."""
        return self.limited().minimise(objective)


def timed(solver: Solver, begin: float) -> Timed:
    """From `begin` of `time.perf_counter` on; a solver of one's own without `seconds` has no limit."""
    return Timed(solver, begin + float(getattr(solver, "seconds", math.inf)))
