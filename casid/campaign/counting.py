"""Progress of a campaign in words, not more often than a person reads."""

from __future__ import annotations

import time
from collections.abc import Callable

_STEP_S = 2.0


def counted(stage: Callable[[str], None], what: str) -> Callable[[int, int], None]:
    """A `report` for `run_campaign` that tells `stage` how far the work is and how long it will take."""
    start, last, first = time.perf_counter(), [0.0], list[int]()

    def report(done: int, total: int) -> None:
        now = time.perf_counter()
        first.append(done)
        if done < total and now - last[0] < _STEP_S:
            return
        last[0] = now
        own = done - first[0]
        ahead = f", about {(now - start) / own * (total - done):.0f} s to go" if own and done < total else ""
        found = f" ({first[0]} found finished)" if first[0] else ""
        stage(f"{what} {done} of {total}{found}{ahead}")

    return report
