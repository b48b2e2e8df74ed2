"""Describe how an iteration ended: a result with its reason and what to do about it, from the loop to the fit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np


class Results(Enum):
    """Result of a solution. The value of each states what to do; `Fit.reason` and `Fit.remedy` have the particulars.

    Examples
    --------
    After the example of `solve`:

    >>> fit.result is cs.Results.CONVERGED
    True
    >>> print(cs.Results.NO_MINIMUM.value)
    The gradient vanishes where there is no minimum: start elsewhere.
    """

    CONVERGED = "A minimum of the cost that nothing contradicts."
    ANOTHER_MINIMUM = (
        "A minimum, and there is likely a lower one: use MultipleShooting(interval=1), Collocation() or "
        "solve(..., starts=20)."
    )
    NO_MINIMUM = "The gradient vanishes where there is no minimum: start elsewhere."
    NOT_IDENTIFIABLE = "The data do not determine every parameter: fix one, give a prior, or record more."
    NO_DERIVATIVE = (
        "A parameter moves the predictions only in jumps, so that its derivative is zero: make the transition smooth, "
        "or fix it."
    )
    STOPPED = "A limit was reached before the solution: raise iterations= or seconds=, or start nearer."
    DEPARTED = (
        "The simulation or a parameter ran off: use MultipleShooting() or Collocation(), check start values, units and "
        "time, or give bounds."
    )
    INFEASIBLE = "The constraints cannot be satisfied together: relax one."
    FAILED = "No step improves the fit, which is no minimum: start elsewhere."


_HEADS = {
    Results.ANOTHER_MINIMUM: "another minimum likely",
    Results.NOT_IDENTIFIABLE: "not identifiable",
    Results.NO_DERIVATIVE: "no derivative",
    Results.STOPPED: "stopped",
    Results.DEPARTED: "departed",
}


class Stage(Enum):
    """Place within a result where an iteration ended, which decides what is tried next and what is reported."""

    PLAIN = 0
    CREEPING = 1  # steps shrink too slowly
    AT_START = 2  # nothing is finite at the start values
    FLAT = 3  # a minimum without curvature in some direction
    SINGULAR = 4  # a step does not exist
    COARSE = 5  # steps of integration are too long


@dataclass(frozen=True, kw_only=True)
class Status:
    """A result, why, and what to do; the last is that of the result where it is empty."""

    result: Results
    reason: str = ""
    remedy: str = ""
    stage: Stage = Stage.PLAIN

    @property
    def converged(self) -> bool:
        """Return True if the point is a solution."""
        return self.result is Results.CONVERGED

    @property
    def text(self) -> str:
        """The status in words, on one line."""
        if self.converged:
            return "converged"
        head = _HEADS.get(self.result, "failed")
        return "; ".join(part for part in (f"{head}: {self.reason}" if self.reason else head, self.remedy) if part)


CONVERGED = Status(result=Results.CONVERGED)
CREEPS = Status(result=Results.STOPPED, reason="the steps shrink too slowly", stage=Stage.CREEPING)
DIVERGES = Status(result=Results.DEPARTED, reason="the simulation diverges at the start values", stage=Stage.AT_START)
FLAT_MINIMUM = Status(result=Results.NOT_IDENTIFIABLE, reason="a minimum that is flat", stage=Stage.FLAT)
NO_MINIMUM = Status(result=Results.NO_MINIMUM, reason="a stationary point that is no minimum")
NO_MOTION = Status(
    result=Results.NOT_IDENTIFIABLE, reason="the model has no motion next to the present one", stage=Stage.SINGULAR
)
NO_DESCENT = Status(
    result=Results.FAILED,
    reason="no step from here improves the fit, and it is no optimum",
    remedy="start elsewhere",
)
INFEASIBLE = Status(result=Results.INFEASIBLE, reason="the constraints cannot be satisfied together")


def out_of_time(seconds: float) -> Status:
    """For a limit of seconds."""
    return Status(result=Results.STOPPED, reason=f"the time of {seconds:.3g} s is over")


def out_of_steps(count: int, kind: str = "iterations") -> Status:
    """For a limit of steps of some kind."""
    return Status(result=Results.STOPPED, reason=f"after {count} {kind}, not converged")


def too_coarse(doubt: str) -> Status:
    """For a solution whose integration is in doubt."""
    return Status(result=Results.STOPPED, reason=doubt, stage=Stage.COARSE)


class NoStepError(np.linalg.LinAlgError):
    """A step that constraints forbid."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.reason)
        self.status = status


NOT_NUMBERS = Status(result=Results.FAILED, reason="the constraints are no numbers here")


def status_of(error: np.linalg.LinAlgError) -> Status:
    """For a step that does not exist."""
    if isinstance(error, NoStepError):
        return error.status
    return Status(result=Results.NOT_IDENTIFIABLE, reason=str(error), stage=Stage.SINGULAR)
