"""Progress of long work: a line that moves on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


@contextmanager
def progress(quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Gives a function that is told the name of every stage as it begins; `quiet`: it says nothing."""
    console = Console()
    if quiet:
        yield lambda stage: None
        return
    if not console.is_terminal:
        start = time.perf_counter()
        yield lambda stage: print(f"{time.perf_counter() - start:7.1f} s  {stage}", flush=True)
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda stage: bar.update(task, description=stage)
