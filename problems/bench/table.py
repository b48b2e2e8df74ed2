"""What the benchmarks share: medians, one table, one JSON file."""

from __future__ import annotations

import argparse
import json
import math
import resource
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import linear_regression
from typing import Any, NoReturn

from casid.errors import InputError

Row = Mapping[str, Any]


def parser(doc: str | None) -> argparse.ArgumentParser:
    """A parser with --json; a fault of the command line is an InputError of one line."""
    made = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    made.add_argument("--json", type=Path, metavar="FILE", help='write {"rows": [...]} there')

    def refuse(message: str) -> NoReturn:
        raise InputError(f"{message}; see {made.prog} --help")

    made.error = refuse
    return made


def processor_seconds() -> float:
    """Processor time of this process and of the children it has waited for [s]: what else runs does not count."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def processor_seconds_of(work: Callable[[], Any], repeats: int) -> list[float]:
    """Processor time of each repetition [s]."""
    found = []
    for _ in range(repeats):
        begin = processor_seconds()
        work()
        found.append(processor_seconds() - begin)
    return found


def seconds_of(work: Callable[[], Any], repeats: int) -> list[float]:
    """Wall-clock time of each repetition [s]."""
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return found


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float | None:
    """Slope in the logarithms; None of a single point."""
    if len(sizes) < 2:
        return None
    return linear_regression([math.log(s) for s in sizes], [math.log(s) for s in seconds]).slope


def publish(rows: Sequence[Row], path: Path | None) -> None:
    """Print the rows as one table; write them when a path is given."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [names, *([_text(row.get(name)) for name in names] for row in rows)]
    widths = [max(len(line[i]) for line in cells) for i in range(len(names))]
    for line in cells:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"rows": list(rows)}, indent=1) + "\n", encoding="utf-8")


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
