"""Progress of long work: a line that moves on a terminal, plain lines elsewhere; with a course, what time it takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

_TELLS = 0.1  # part of the work that must be done before it tells how long the rest takes


@dataclass(eq=False, kw_only=True)
class Course:
    """The stages of a work with their parts of its time, and where it stands.

    Attributes
    ----------
    stages
        (name, part of the time) in the order in which they begin. Some may be skipped. A stage that is not among them
        adds one, as long as the present one was expected to be.
    """

    stages: Sequence[tuple[str, float]]
    _rest: list[tuple[str, float]] = field(init=False)
    _done: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._rest = list(self.stages)

    def begin(self, stage: str) -> None:
        """A stage begins, and what stands before it is over."""
        names = [name for name, _ in self._rest]
        if stage in names:
            del self._rest[: names.index(stage)]
            self._done.append(self._rest.pop(0)[1])
        else:
            self._done.append(self._done[-1] if self._done else 0.0)

    def step(self) -> str:
        """Of how many: "3/12"."""
        return f"{len(self._done)}/{len(self._done) + len(self._rest)}"

    def in_all(self, elapsed: float) -> float:
        """Seconds that the whole is expected to take, at the beginning of a stage after `elapsed` [s]; NaN as long as
        too little is done to tell."""
        done = sum(self._done[:-1])
        whole = sum(self._done) + sum(part for _, part in self._rest)
        return elapsed * whole / done if done >= _TELLS * whole else math.nan

    def line(self, stage: str, elapsed: float) -> str:
        """What is said as a stage begins: "3/12  refit of the file, roughly 40 s in all"."""
        expected = self.in_all(elapsed)
        told = f", roughly {float(f'{expected:.1g}' if expected < 10 else f'{expected:.2g}'):g} s in all"
        return f"{self.step():>5}  {stage}{told if math.isfinite(expected) else ''}"


@contextmanager
def progress(quiet: bool = False, course: Course | None = None) -> Iterator[Callable[[str], None]]:
    """Gives a function that is told the name of every stage as it begins; `quiet`: it says nothing."""
    console, start = Console(), time.perf_counter()

    def line(stage: str) -> str:
        if course is None:
            return stage
        course.begin(stage)
        return course.line(stage, time.perf_counter() - start)

    if quiet:
        yield lambda stage: None
        return
    if not console.is_terminal:
        yield lambda stage: print(f"{time.perf_counter() - start:7.1f} s  {line(stage)}", flush=True)
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda stage: bar.update(task, description=line(stage))
