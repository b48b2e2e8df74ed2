"""Threads inside the linear algebra: one while casid works, for on small matrices more cost more than they give.

The number that the caller has is put back afterwards; environment variables stay as they are.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController

_LOCK = threading.Lock()
_INSIDE: list[Any] = []  # one entry for every block that runs, the first with the caller's numbers


@contextmanager
def single_threaded() -> Iterator[None]:
    """A block, or as `@single_threaded()` a function, whose linear algebra has one thread; blocks may overlap."""
    with _LOCK:
        _INSIDE.append(None if _INSIDE else _libraries().limit(limits=1))
    try:
        yield
    finally:
        with _LOCK:
            if len(_INSIDE) == 1:
                _INSIDE[0].restore_original_limits()
            _INSIDE.pop()


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS of numpy and of scipy, each of which brings its own; to find them takes milliseconds."""
    import scipy.linalg  # noqa: F401  loads that of scipy

    return ThreadpoolController().select(user_api="blas")
