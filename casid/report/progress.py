"""Progress of long work: a line that moves on a terminal, plain lines elsewhere; with a course, what time it takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

_TELLS = 0.1  # part of the work that must be done before the time of the rest is estimated
_GROWS = 1.5  # factor by which a time that was announced may grow; beyond it none is


@dataclass(eq=False, kw_only=True)
class Course:
    """The stages of a work with their parts of its time, and the present one."""

    # (name, part of the time) in the order in which they begin. Some may be skipped; others take none of the time
    stages: Sequence[tuple[str, float]]
    limit: float = math.inf  # time that the work may take in all [s]
    _rest: list[tuple[str, float]] = field(init=False)
    _done: float = field(default=0.0, init=False)
    _now: float = field(default=0.0, init=False)
    _least: float = field(default=math.inf, init=False)

    def __post_init__(self) -> None:
        self._rest = list(self.stages)

    def begin(self, stage: str) -> None:
        """Take a stage as begun, and the one before it as over; those between are skipped."""
        names = [name for name, _ in self._rest]
        if stage in names:
            at = names.index(stage)
            self._done, self._now = self._done + self._now, self._rest[at][1]
            self._rest = self._rest[at + 1 :]

    def in_all(self, elapsed: float) -> float:
        """Seconds that the whole is expected to take, as they are announced at the beginning of a stage after `elapsed`
        [s].

        NaN as long as too little is done, once it takes much longer than announced, and beyond the limit.
        """
        whole = self._done + self._now + sum(part for _, part in self._rest)
        if self._done < _TELLS * whole or elapsed >= self.limit:
            return math.nan
        expected = _told(min(elapsed * whole / self._done, self.limit))
        if expected > _GROWS * self._least:
            return math.nan
        self._least = min(self._least, expected)
        return expected

    def line(self, stage: str, elapsed: float) -> str:
        """The words as a stage begins: "refit of the file, about 40 s in all"."""
        self.begin(stage)
        expected = self.in_all(elapsed)
        told = f", about {expected:g} s in all"
        return f"{stage}{told if math.isfinite(expected) and expected > elapsed else ''}"


def _told(seconds: float) -> float:
    """Rounded to the digits that are worth telling, as which times are compared: 2.4 and 3.6 s are told as 2 and 4."""
    return float(f"{seconds:.1g}" if seconds < 10.0 else f"{seconds:.2g}")


@contextmanager
def progress(quiet: bool = False, course: Course | None = None) -> Iterator[Callable[[str], None]]:
    """Give a function that takes the name of every stage as it begins, or a sentence with a colon, which stays.

    If `quiet` it prints nothing.
    """
    console = Console()
    start = time.perf_counter()

    def line(stage: str) -> str:
        return stage if course is None or ":" in stage else course.line(stage, time.perf_counter() - start)

    if quiet:
        yield lambda stage: None
        return
    if not console.is_terminal:
        yield lambda stage: print(f"{time.perf_counter() - start:7.1f} s  {line(stage)}", flush=True)
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def say(stage: str) -> None:
            if ":" in stage:
                bar.console.print(stage)
            else:
                bar.update(task, description=line(stage))

        yield say
