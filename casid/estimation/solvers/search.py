"""The search along a step, of every Gauss-Newton here: output error, filter error, the hypotheses of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def longest(tried: Callable[[float], T | None], shrink: float, shortest: float, first: float = 1.0) -> T | None:
    """What `tried` finds at the longest part of a step that it takes: first, then each shrunk, above the shortest."""
    length = first
    while length > shortest:
        found = tried(length)
        if found is not None:
            return found
        length *= shrink
    return None
