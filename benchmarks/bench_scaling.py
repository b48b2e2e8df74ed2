"""How do time and memory of an estimation grow with the length of a record and with the number of records?

Question     is an estimation linear in the samples up to 64000 (20 minutes at 50 Hz), and in the records up to 100?
Set-up       stable Do 328 in long flights (problems/bench/long_flight.py), 16 moment derivatives from 0.7 x truth,
             multiple shooting over 25 samples. Median seconds of `solve` with all standard errors; peak of the arrays
             that live at once (tracemalloc, a run of its own), that of the standard errors with noisy surfaces, which
             come after, and of the whole process so far.
Expectation  exponent of seconds per iteration over samples at most 1.1; below 1 GB. At each size the estimate is right:
             `away` is the largest distance from the truth in standard deviations.

    python benchmarks/bench_scaling.py [--samples 250 ... 64000] [--records 1 ... 100] [--repeats 3] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

import resource
import tracemalloc
from collections.abc import Callable
from statistics import median
from typing import Any

from casid.analysis import input_noise_errors
from casid.errors import InputError
from casid.estimation import Problem, solve
from problems.bench.long_flight import long_problem
from problems.bench.table import exponent, parser, publish, seconds_of
from problems.do328 import MOMENT_DERIVATIVES, STABLE
from problems.paper.truth import SURFACES

SAMPLES = (250, 500, 1000, 2000, 4000, 8000, 16000, 32000, 64000)
RECORDS = (1, 3, 10, 30, 100)
WARM = 12  # solves after which the kernel is compiled on any machine
SURFACE_NOISE = 5e-4  # rad
FAR = 6.0  # standard deviations from the truth that no right estimate of 16 is


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--samples", nargs="*", type=int, default=list(SAMPLES), help="lengths of the one record")
    options.add_argument("--records", nargs="*", type=int, default=list(RECORDS), help="numbers of records of 20 s")
    options.add_argument("--repeats", type=int, default=3, help="the median counts")
    given = options.parse_args()
    warm = long_problem(1000)
    for _ in range(WARM):
        solve(warm)
    rows = [_measure("samples", long_problem(n), given.repeats) for n in given.samples]
    rows += [_measure("records", long_problem(1000, n), given.repeats) for n in given.records]
    for series in ("samples", "records"):
        own = [row for row in rows if row["series"] == series]
        for row in own:
            row["exponent"] = exponent([r[series] for r in own], [r["seconds_per_iteration"] for r in own])
    publish(rows, given.json)


def _measure(series: str, problem: Problem, repeats: int) -> dict[str, Any]:
    fit = solve(problem)
    away = max(abs(fit[n].value - STABLE[n]) / fit[n].std for n in MOMENT_DERIVATIVES)
    if not fit.converged or away > FAR:
        raise InputError(f"{series}: {fit.status}, {away:.2g} standard deviations from the truth")
    seconds = median(seconds_of(lambda: solve(problem).parameters, repeats))
    peak = _peak_bytes(lambda: solve(problem).parameters)
    surfaces_peak = _peak_bytes(lambda: input_noise_errors(fit, dict.fromkeys(SURFACES, SURFACE_NOISE)))
    samples, records = len(problem.records[0]), len(problem.records)
    return {
        "series": series,
        "samples": samples,
        "records": records,
        "seconds": seconds,
        "iterations": fit.iterations,
        "seconds_per_iteration": seconds / fit.iterations,
        "peak_megabytes": peak / 1e6,
        "peak_bytes_per_sample": peak / (samples * records),
        "noisy_surfaces_megabytes": surfaces_peak / 1e6,
        "process_megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "away": away,
    }


def _peak_bytes(work: Callable[[], Any]) -> int:
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


if __name__ == "__main__":
    run_script(main)
