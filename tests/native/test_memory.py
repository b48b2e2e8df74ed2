"""Memory that a process keeps while it works. Truth: what the system says of the process, by fresh ones."""

from __future__ import annotations

import subprocess
import sys

import pytest

_WORK = """
import resource, sys
import numpy as np
from contextlib import nullcontext
from casid.native.memory import kept_memory

def faults():
    for _ in range(50):
        np.ones(4_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

before = faults()
with kept_memory(), kept_memory():
    first = faults()
    inside = faults() - first
after = faults() - faults()
np.ones(10)
held = int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()
print(inside, held)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="told to glibc")
def test_memory_is_kept_while_casid_works_and_given_back_afterwards() -> None:
    done = subprocess.run([sys.executable, "-c", _WORK], capture_output=True, text=True, check=True)
    inside, held = map(int, done.stdout.split())
    assert inside < 50, "arrays of 32 MB came anew from the system"
    assert held < 200e6
