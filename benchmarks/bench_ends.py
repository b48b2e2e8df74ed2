"""Is "converged" true: does another start find more, and does LSODA contradict?

Question     of the ends of problems that newcomers pose, each from three starts with the settings by default: which are
             said to have converged though a more likely end is known, or though LSODA has another likelihood there?
Set-up       problems/references/ends.py; an end is wrong where it is said to have converged and -ln(likelihood x prior)
             is more than 0.1 above the lowest of all starts and of `starts=8`, or more than 0.01 from LSODA's.
Expectation  none.

    python benchmarks/bench_ends.py [--data DIR] [--only TEXT ...] [--seconds S] [--json FILE]

DIR: folder with the folders `references` and `petab`, CASID_DATA by default; what is not there is left out.
"""

from __future__ import annotations

from casid.cli.start import run_script

import os
import time
from collections.abc import Iterator
from pathlib import Path

from casid.estimation import Automatic, Results, solve
from problems.bench.table import Row, parser, publish
from problems.references.ends import Posed, by_lsoda, posed

LOWER, APART = 0.1, 0.01  # of -ln(likelihood x prior), and of -ln(likelihood) by LSODA


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--data", type=Path, default=os.environ.get("CASID_DATA"), metavar="DIR")
    options.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="problems whose name contains one")
    options.add_argument("--seconds", type=float, default=60.0, metavar="S", help="of each start")
    given = options.parse_args()
    rows: list[Row] = []
    for problem in posed(given.data):
        if any(text in problem.name for text in given.only):
            for row in ends(problem, given.seconds):
                rows.append(row)
                print(row, flush=True)
    wrong = [f"{row['problem']}/{row['start']}" for row in rows if row["wrong"]]
    publish(rows, given.json)
    print(f"{len(wrong)} of {len(rows)} ends wrong: {', '.join(wrong) or 'none'}")


def ends(problem: Posed, seconds: float) -> Iterator[Row]:
    """A row for each start."""
    starts, fits, took = problem.starts(), [], []
    for one in starts:
        begin = time.process_time()
        fits.append(solve(one, solver=Automatic(seconds=seconds)))
        took.append(time.process_time() - begin)
    more = solve(starts[1], solver=Automatic(seconds=4.0 * seconds), starts=8)  # of which no value is zero
    found = (Results.CONVERGED, Results.ANOTHER_MINIMUM)
    best = min((-fit.log_posterior for fit in (*fits, more) if fit.result in found), default=float("nan"))
    for number, (one, fit, spent) in enumerate(zip(starts, fits, took, strict=True), start=1):
        above = -fit.log_posterior - best
        off = by_lsoda(one, fit) + fit.log_likelihood if problem.judged else 0.0
        yield {
            "problem": problem.name,
            "start": number,
            "minus_ln_L": -fit.log_likelihood,
            "above_best": above,
            "from_lsoda": off,
            "seconds_of_processor": spent,
            "wrong": fit.converged and not (above < LOWER and abs(off) < APART),
            "status": fit.status,
        }


if __name__ == "__main__":
    run_script(main)
