"""The search along a step, of every Gauss-Newton here: output error, filter error, the hypotheses of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def longest(tried: Callable[[float], T | None], shrink: float, shortest: float) -> T | None:
    """What `tried` finds at the longest part of a step that it takes: 1, shrink, shrink^2, ..., above the shortest."""
    length = 1.0
    while length > shortest:
        found = tried(length)
        if found is not None:
            return found
        length *= shrink
    return None
