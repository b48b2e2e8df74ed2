"""Freed memory."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import pytest

from casid.native.memory import return_freed_memory


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc", reason="another C library returns its memory by itself, or never"
)
def test_what_is_free_between_arrays_in_use_is_returned() -> None:
    """Truth: the pages that the system counts. Arrays of 0.1 MB lie in one heap, which ends at the last one in use."""

    def resident_mb() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

    return_freed_memory()
    begun = resident_mb()
    arrays = [np.ones(12_500) for _ in range(1_000)]
    kept = arrays[::50]
    assert resident_mb() > begun + 80.0
    del arrays
    return_freed_memory()
    assert resident_mb() < begun + 20.0 and len(kept) == 20
