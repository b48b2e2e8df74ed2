"""Does casid come to the published optima of systems biology from far starts, and does an independent integrator agree?

Question     from the published parameters, from twice and from five times these: which likelihood is reached, which
             status is said, in what time, and is it the likelihood that LSODA gives for the same parameters?
Set-up       problems of the PEtab benchmark collection by `read_petab`; all parameters times the factor, within their
             bounds; the default method, and STARTS starts. scipy: least squares (L-BFGS-B where noise is estimated) on
             LSODA's motion with differences, from the same start and from further draws for as long as casid took.
             Wall-clock seconds, reading and compiling included.
Expectation  nothing ends below its start, and nothing is said to have converged that LSODA contradicts by more than
             0.01.

    python benchmarks/bench_petab.py [--data DIR] [--only TEXT ...] [--factor F ...] [--starts N] [--json FILE]

DIR: folder with the folder `petab` of the collection, CASID_DATA by default.
"""

from __future__ import annotations

from casid.cli.start import run_script

import math
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import casid as cs
from casid.errors import InputError
from casid.estimation import Problem
from casid.estimation.starts import drawn
from problems.bench.table import Row, parser, publish
from problems.references.petab import PUBLISHED, TOLERANCES, Likelihood, minimum_by_scipy

LEAST = 10.0  # s that scipy has at least
APART = 0.01  # of -ln(likelihood)


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--data", type=Path, default=os.environ.get("CASID_DATA"), metavar="DIR")
    options.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="problems whose name contains one")
    options.add_argument("--factor", nargs="+", type=float, default=[1.0, 2.0, 5.0], metavar="F")
    options.add_argument("--starts", type=int, default=8, metavar="N")
    given = options.parse_args()
    if given.data is None:
        raise InputError("no PEtab problems: give --data DIR, or set CASID_DATA")
    rows = []
    for name, published in PUBLISHED.items():
        file = Path(given.data) / "petab" / name / f"{name}.yaml"
        if not any(text in name for text in given.only):
            continue
        if not file.is_file():
            print(f"{name}: {file} is not there, left out")
            continue
        for factor in given.factor:
            rows.append(one(file, published, factor, given.starts))
            print(rows[-1], flush=True)
    publish(rows, given.json)


def one(file: Path, published: float, factor: float, starts: int) -> Row:
    """A problem from one start."""
    problem = cs.read_petab(file)
    posed = times(problem, factor)
    likelihood = Likelihood(problem, TOLERANCES[file.stem])
    begin = time.perf_counter()
    fit = cs.solve(posed, starts=starts if factor != 1.0 else 1)
    seconds = time.perf_counter() - begin
    own, start = -fit.log_likelihood, likelihood(dict(posed.start))
    checked = likelihood(fit.values)
    row: Row = {
        "problem": file.stem,
        "factor": factor,
        "published": published,
        "start": start,
        "casid": own,
        "by LSODA": checked,
        "status": fit.status.partition(";")[0][:60],
        "seconds": seconds,
        "worse than start": checked > start + APART,
        "wrongly converged": fit.converged and not abs(own - checked) < APART,
    }
    return {**row, **_by_scipy(posed, max(seconds, LEAST), starts)}


def times(problem: Problem, factor: float) -> Problem:
    """With all parameters of the start times a factor, within their bounds."""
    start = {n: float(v) * factor for n, v in zip(problem.parameters, problem.start_vector, strict=True)}
    for row, lower, upper in zip(*problem.linear_rows, strict=True):
        name = problem.parameters[int(np.flatnonzero(row)[0])]
        start[name] = min(max(start[name], lower), upper)
    return replace(problem, start=start)


def _by_scipy(problem: Problem, seconds: float, starts: int) -> Row:
    """scipy's best from the start, and from further draws until the time is up."""
    begin, best = time.perf_counter(), math.inf
    for start in [dict(problem.start), *drawn(problem, starts - 1, 0)]:
        left = seconds - (time.perf_counter() - begin)
        if left <= 0.0:
            break
        best = min(best, minimum_by_scipy(problem, start, left).cost)
    return {"scipy": best, "scipy seconds": time.perf_counter() - begin}


if __name__ == "__main__":
    run_script(main)
