"""How much faster is a campaign on two processes than on one?

Question     what do starting processes, handing out tasks and keeping results cost?
Set-up       Monte Carlo of the paper's noisy cases: every task simulates a record, estimates it by three estimators
             with multiple shooting, and compares; a fresh store for each run. One untimed task of each case first fills
             the cache of compiled code.
Expectation  nearly as many times as there are processors: estimations do not know each other.

    python benchmarks/bench_campaign.py [--jobs 1 2] [--cases B,D,F,H] [--tasks N] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

import os
import tempfile
import time

from casid.errors import InputError
from problems.bench.table import parser, publish
from problems.campaign.run import run_campaign
from problems.campaign.store import open_store
from problems.paper.cases import parse_cases
from problems.paper.run import run, tasks

METHOD = "multiple-open"


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--jobs", nargs="+", type=int, default=[1, 2], help="numbers of processes")
    options.add_argument("--cases", default="B,D,F,H", help="letters of the cases")
    options.add_argument("--tasks", type=int, metavar="N", help="only the first N records")
    given = options.parse_args()
    every = tasks(parse_cases(given.cases), range(1, 9), [METHOD])
    if given.tasks is not None and not 1 <= given.tasks <= len(every):
        raise InputError(f"--tasks {given.tasks}: expected 1 to {len(every)}")
    chosen = dict(list(every.items())[: given.tasks])
    for task in {task["case"]: task for task in chosen.values()}.values():
        run(task)
    rows, estimates = [], []
    for jobs in given.jobs:
        with tempfile.TemporaryDirectory() as folder, open_store(folder, {"campaign": "bench"}) as store:
            begin = time.perf_counter()
            run_campaign(chosen, run, store, jobs=jobs)
            seconds = time.perf_counter() - begin
            estimates.append({key: result["combined"]["values"] for key, result in store.results().items()})
        if any(_apart(estimates[0][key], estimates[-1][key]) > 1e-6 for key in chosen):
            raise InputError(f"{jobs} processes: another estimate than with {given.jobs[0]}")
        first = rows[0]["seconds"] if rows else seconds
        rows.append(
            {
                "jobs": jobs,
                "processors": os.cpu_count(),
                "tasks": len(chosen),
                "seconds": seconds,
                "seconds_per_task": seconds / len(chosen),
                "speedup": first / seconds,
            }
        )
    publish(rows, given.json)


def _apart(ours: dict[str, float], theirs: dict[str, float]) -> float:
    size = max(map(abs, ours.values()))
    return max(abs(ours[name] - theirs[name]) for name in ours) / size


if __name__ == "__main__":
    run_script(main)
