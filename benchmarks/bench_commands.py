"""What do whole commands cost?

Question     How much processor time and memory do a design, a proof of match and a look at isolability take, with the
             start of Python, all imports and the page?
Set-up       The files of the demonstration, each command a process of its own on one thread. `match` has four records
             and the extended aircraft of `casid demo`, whose diagnosis is the first row. With --tree the same commands
             of another clone, in turn; the median of the repetitions, and the ratio to it. Kernels are compiled before,
             by a repetition that does not count.
Expectation  `design`, `match` and `isolate` take 5 s or less each.

    python benchmarks/bench_commands.py [NAME ...] [--repeats 3] [--tree DIR] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from types import MappingProxyType
from typing import Any

from casid.cli.options import DEMO
from casid.errors import InputError, unknown
from problems.bench.table import parser, publish

_AIRCRAFT = ("--aircraft", "aircraft.toml")
_FOUR = ("m1.csv", "m2.csv", "m3.csv", "m4.csv")
_DEMO = "demo"
COMMANDS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        _DEMO: ("demo",),
        "match": ("match", *_FOUR, *_AIRCRAFT, "{demo}/extended.toml"),
        "isolate one": ("isolate", *_AIRCRAFT, "--manoeuvre", "m1.csv"),
        "isolate four": ("isolate", *_AIRCRAFT, "--manoeuvre", *_FOUR),
        "design": ("design", *_AIRCRAFT),
        "design lateral": ("design", *_AIRCRAFT, "--axes", "lateral"),
        "design sines": ("design", *_AIRCRAFT, "--axes", "lateral", "--shape", "multisine"),
    }
)


def main() -> None:
    options = parser(__doc__)
    options.add_argument("commands", nargs="*", metavar="NAME", help=f"of {', '.join(COMMANDS)}")
    options.add_argument("--repeats", type=int, default=3, help="runs that count, after a first one")
    options.add_argument("--tree", type=Path, metavar="DIR", help="clone of the commit to compare with")
    given = options.parse_args()
    for name in given.commands:
        if name not in COMMANDS:
            raise unknown("command", name, COMMANDS)
    here = Path(__file__).resolve().parent.parent
    trees = [here, *([given.tree.resolve()] if given.tree else [])]
    with tempfile.TemporaryDirectory() as out:
        _run(COMMANDS[_DEMO], here, Path(out), _DEMO)
        publish([_row(name, trees, Path(out), given.repeats) for name in given.commands or COMMANDS], given.json)


def _row(name: str, trees: Sequence[Path], out: Path, repeats: int) -> dict[str, Any]:
    runs = [[_run(COMMANDS[name], tree, out, "run") for tree in trees] for _ in range(1 + repeats)][1:]
    seconds = [median(run[i][0] for run in runs) for i in range(len(trees))]
    row = {"command": name, "processor_s": seconds[0], "largest_mb": median(run[0][1] for run in runs)}
    if len(trees) > 1:
        row |= {"before_s": seconds[1], "before_mb": median(run[1][1] for run in runs)}
        row["ratio"] = median(run[0][0] / run[1][0] for run in runs)
    return row


def _run(command: Sequence[str], tree: Path, out: Path, name: str) -> tuple[float, float]:
    """Processor time [s] and largest memory [MB] of a command of the package in a folder."""
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    words = [word.format(demo=out / _DEMO) for word in command]
    process = subprocess.Popen(
        [sys.executable, "-m", "casid", *words, "--out", str(out / name)],
        cwd=DEMO,
        env=os.environ | threads | {"PYTHONPATH": str(tree)},
        stdout=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1):  # 1: a match that is out of tolerance
        raise InputError(f"casid {' '.join(words)} ended with status {process.returncode}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


if __name__ == "__main__":
    run_script(main)
