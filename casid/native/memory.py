"""Memory that is kept for the next array instead of going back to the system and coming again, zeroed page by page.

Large arrays that live for one step of an iteration each cost the kernel more than the arithmetic on small ones.
"""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # glibc's malloc.h
_LARGEST = 2**30  # bytes: larger arrays come from the system, and go back to it
_USUAL = 2**17  # of both, before glibc adapts them
_users = 0
_LOCK = threading.Lock()


def _glibc() -> ctypes.CDLL | None:
    """The C library of this process, where it is the one whose allocator can be told."""
    if not sys.platform.startswith("linux"):
        return None
    library = ctypes.CDLL(None)
    return library if hasattr(library, "gnu_get_libc_version") and hasattr(library, "mallopt") else None


@contextmanager
def kept_memory() -> Iterator[None]:
    """Freed memory stays with the process until the last of these blocks ends; without glibc nothing changes."""
    global _users
    library = _glibc()
    if library is None:
        yield
        return
    with _LOCK:
        _users += 1
        library.mallopt(_MMAP_THRESHOLD, _LARGEST)
        library.mallopt(_TRIM_THRESHOLD, _LARGEST)
    try:
        yield
    finally:
        with _LOCK:
            _users -= 1
            if not _users:
                library.mallopt(_MMAP_THRESHOLD, _USUAL)
                library.mallopt(_TRIM_THRESHOLD, _USUAL)
                library.malloc_trim(0)
