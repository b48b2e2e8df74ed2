"""The search along a step, of every Gauss-Newton here: output error, filter error, the hypotheses of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def longest(
    tried: Callable[[float], T | None], shrink: float = 0.4, shortest: float = 0.01, first: float = 1.0
) -> T | None:
    """Return what `tried` finds at the longest part of a step that it takes: first, then each shrunk, above the
    shortest. By default as where a motion follows the parameters."""
    length = first
    while length > shortest:
        found = tried(length)
        if found is not None:
            return found
        length *= shrink
    return None


def tenfold(first: float, least: float, most: float) -> list[float]:
    """Return the dampings of a step that are tried one after the other: `first`, then `least` or ten times the one
    before, as long as they are below `most`."""
    found = [first]
    while (larger := max(10.0 * found[-1], least)) < most:
        found.append(larger)
    return found


def rises_from_the_start(refused: Sequence[tuple[float, np.ndarray]]) -> bool:
    """Return True if quantities that must fall along a step rise from its beginning, by their rises at two parts of it,
    the longer first: at the longer one at least in proportion, and along the parabola through both as it begins.

    No shorter part decreases them then: the sensitivities are those of another function, as of a late reading, whose
    series is made of the motion before the step.
    """
    if len(refused) < 2:
        return False
    (long, far), (short, near) = refused
    steep = near / short
    steeper = far / long
    begins = steep - (steeper - steep) * short / (long - short)
    return bool(np.all(steeper >= steep) and np.all(begins > 0.0))
