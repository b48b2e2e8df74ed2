"""How do time and memory of an estimation grow with the length of a record, the number of records and of states?

Question     is an estimation linear in the samples up to 64000 (20 minutes at 50 Hz), and in the records up to 100?
             What does an iteration cost with 60 states and 40 parameters, in those of 30 and 20?
Set-up       stable Do 328 in long flights (problems/bench/long_flight.py), 16 moment derivatives from 0.7 x truth,
             multiple shooting over 25 samples. Median processor seconds of `solve` with all standard errors; peak of
             the arrays that live at once (tracemalloc, a run of its own), that of the standard errors with noisy
             surfaces, which come after, and of the whole process so far. States: chains of masses
             (problems/bench/chain.py), 1001 samples, two parameters for every three states.
Expectation  exponent of seconds per iteration over samples at most 1.1, over states at most 2; below 1 GB. At each size
             the estimate is right: `away` is the largest distance from the truth in standard deviations.

    python benchmarks/bench_scaling.py [--samples 250 ... 64000] [--records 1 ... 100] [--states 30 60] [--repeats 3]
                                       [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

import resource
import tracemalloc
from collections.abc import Callable, Mapping
from statistics import median
from typing import Any

from casid.errors import InputError
from casid.estimation import Fit, Problem, solve
from problems.bench.chain import chain_problem, chain_truth
from problems.bench.long_flight import long_problem
from problems.bench.table import exponent, parser, processor_seconds_of, publish
from problems.do328 import MOMENT_DERIVATIVES, STABLE
from problems.paper.truth import SURFACES
from problems.studies.input_noise import input_noise_errors

SAMPLES = (250, 500, 1000, 2000, 4000, 8000, 16000, 32000, 64000)
RECORDS = (1, 3, 10, 30, 100)
STATES = (30, 60)
WARM = 12  # solves after which the kernel is compiled on any machine
CHAIN_WARM = 2  # of a chain, which takes longer
SURFACE_NOISE = 5e-4  # rad
FAR = 6.0  # standard deviations from the truth that no right estimate of some tens is


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--samples", nargs="*", type=int, default=list(SAMPLES), help="lengths of the one record")
    options.add_argument("--records", nargs="*", type=int, default=list(RECORDS), help="numbers of records of 20 s")
    options.add_argument("--states", nargs="*", type=int, default=list(STATES), help="of chains of masses")
    options.add_argument("--repeats", type=int, default=3, help="the median counts")
    given = options.parse_args()
    if given.samples or given.records:
        _warm(long_problem(1000), WARM)
    rows = [_of_flight("samples", long_problem(n), given.repeats) for n in given.samples]
    rows += [_of_flight("records", long_problem(1000, n), given.repeats) for n in given.records]
    rows += [_of_chain(n, given.repeats) for n in given.states]
    for series in ("samples", "records", "states"):
        own = [row for row in rows if row["series"] == series]
        for row in own:
            row["exponent"] = exponent([r[series] for r in own], [r["seconds_per_iteration"] for r in own])
    publish(rows, given.json)


def _warm(problem: Problem, solves: int) -> None:
    for _ in range(solves):
        solve(problem)


def _of_flight(series: str, problem: Problem, repeats: int) -> dict[str, Any]:
    fit = solve(problem)
    row = _measure(series, fit, {name: STABLE[name] for name in MOMENT_DERIVATIVES}, repeats)
    peak = _peak_bytes(lambda: input_noise_errors(fit, dict.fromkeys(SURFACES, SURFACE_NOISE)))
    return row | {"noisy_surfaces_megabytes": peak / 1e6}


def _of_chain(states: int, repeats: int) -> dict[str, Any]:
    parameters = 2 * states // 3
    problem = chain_problem(states, parameters)
    _warm(problem, CHAIN_WARM)
    return _measure("states", solve(problem), chain_truth(parameters), repeats)


def _measure(series: str, fit: Fit, truth: Mapping[str, float], repeats: int) -> dict[str, Any]:
    problem = fit.problem
    away = max(abs(fit[name].value - value) / fit[name].std for name, value in truth.items())
    if not fit.converged or away > FAR:
        raise InputError(f"{series}: {fit.status}, {away:.2g} standard deviations from the truth")
    seconds = median(processor_seconds_of(lambda: solve(problem).parameters, repeats))
    peak = _peak_bytes(lambda: solve(problem).parameters)
    samples, records = len(problem.records[0]), len(problem.records)
    return {
        "series": series,
        "samples": samples,
        "records": records,
        "states": len(problem.model.states),
        "parameters": len(truth),
        "seconds": seconds,
        "iterations": fit.iterations,
        "seconds_per_iteration": seconds / fit.iterations,
        "peak_megabytes": peak / 1e6,
        "peak_bytes_per_sample": peak / (samples * records),
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
