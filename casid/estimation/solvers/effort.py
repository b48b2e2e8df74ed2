"""Evaluations of an objective, counted: the size of an iteration that does not depend on the load of the machine."""

from __future__ import annotations

import math


class Effort:
    """Simulations and linearisations `spent`, of those that are `allowed`; all objectives of one attempt share it."""

    def __init__(self, allowed: float = math.inf) -> None:
        self.allowed = allowed
        self.spent = 0

    def add(self) -> None:
        """Count one more."""
        self.spent += 1

    def grant(self, evaluations: int) -> None:
        """Allow so many from now on, if fewer are left."""
        self.allowed = max(self.allowed, self.spent + evaluations)

    @property
    def is_spent(self) -> bool:
        """Return True if no more are allowed."""
        return self.spent >= self.allowed
