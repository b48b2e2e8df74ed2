"""Work shared out among processors, for code that lets go of Python's lock: compiled loops, BLAS."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

import numpy as np

from casid.native.threads import single_threaded

Task = TypeVar("Task")
Result = TypeVar("Result")
_THREAD = threading.local()  # `processors` of one of `side_by_side`


def processors() -> int:
    """Processors that are `available`; its part of them in a thread that runs `side_by_side` with others."""
    own = getattr(_THREAD, "processors", 0)
    return own if own > 0 else available()


def available() -> int:
    """Processors that this process may use, or OMP_NUM_THREADS if that is fewer."""
    present = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return min(present, int(asked)) if asked.isdigit() and int(asked) > 0 else present


def share_out(parts: int, run: Callable[[int, int], None]) -> None:
    """Call run(first, last), which must not raise, on stretches of all parts, one a processor. Threads are begun for
    each call, in 0.1 ms: a pool would not live through a fork."""
    if parts == 0:
        return
    bounds = np.linspace(0, parts, min(processors(), parts) + 1).astype(int).tolist()
    others = [threading.Thread(target=run, args=stretch) for stretch in pairwise(bounds[1:])]
    for other in others:
        other.start()
    run(*bounds[:2])
    for other in others:
        other.join()


def side_by_side(run: Callable[[Task], Result], tasks: Sequence[Task]) -> list[Result]:
    """run(task) of each, in their order, as many at once as there are processors; each has its part of those, and
    linear algebra one thread. Raises what the first of them raises."""
    mine = processors()
    workers = min(mine, len(tasks))
    if workers < 2:
        return [run(task) for task in tasks]

    def alone(task: Task) -> Result:
        _THREAD.processors = mine // workers
        return run(task)

    with single_threaded(), ThreadPoolExecutor(workers) as pool:
        return list(pool.map(alone, tasks))
