"""Does casid come to the published optima of systems biology from far starts, and does an independent integrator agree?

Question     from the published parameters, from twice and from five times these: which likelihood is reached, which
             status is said, in what time, and is it the likelihood that LSODA gives for the same parameters?
Set-up       problems of the PEtab benchmark collection by `read_petab`, and an aircraft's short period whose optimum is
             known on paper (problems/references/short_period.py); all parameters times the factor, within their
             bounds; the default method, and STARTS starts. scipy: least squares (L-BFGS-B where noise is estimated) on
             LSODA's motion with differences, from the same start and from further draws for as long as casid took.
             pyPESTO: Fides on AMICI's likelihood, likewise, its ends by LSODA. Wall-clock seconds; of casid reading and
             compiling are in, of AMICI not.
Expectation  nothing ends below its start, and nothing is said to have converged that LSODA contradicts by more than
             0.01.

    python benchmarks/bench_petab.py [--data DIR] [--only TEXT ...] [--factor F ...] [--starts N] [--pypesto PYTHON]
                                     [--json FILE]

DIR: folder with the folder `petab` of the collection, CASID_DATA by default; without it the short period alone.
PYTHON: the Python of an environment with pypesto, amici, fides and petab; without it there is no such column.
"""

from __future__ import annotations

from casid.cli.start import run_script

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import casid as cs
from casid.errors import InputError
from casid.estimation import Problem
from casid.estimation.starts import drawn
from problems.bench.table import Row, parser, publish
from problems.references import by_pypesto, short_period
from problems.references.petab import PUBLISHED, TOLERANCES, Likelihood, minimum_by_scipy, times

LEAST = 10.0  # s that the others have at least
APART = 0.01  # of -ln(likelihood)


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--data", type=Path, default=os.environ.get("CASID_DATA"), metavar="DIR")
    options.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="problems whose name contains one")
    options.add_argument("--factor", nargs="+", type=float, default=[1.0, 2.0, 5.0], metavar="F")
    options.add_argument("--starts", type=int, default=8, metavar="N")
    options.add_argument("--pypesto", metavar="PYTHON", help="a Python that has pypesto and amici")
    given = options.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for file, published in files(given.data, Path(folder)):
            if not any(text in file.stem for text in given.only):
                continue
            if not file.is_file():
                print(f"{file.stem}: {file} is not there, left out")
                continue
            for factor in given.factor:
                rows.append(one(file, published, factor, given.starts, given.pypesto))
                print(rows[-1], flush=True)
    publish(rows, given.json)


def files(data: Path | None, folder: Path) -> Iterator[tuple[Path, float]]:
    """YAML files, and -ln(likelihood) at the best parameters that are known; our own is written into the folder."""
    yield short_period.write(folder), short_period.optimum().cost
    if data is not None:
        for name, published in PUBLISHED.items():
            yield Path(data) / "petab" / name / f"{name}.yaml", published


def one(file: Path, published: float, factor: float, starts: int, python: str | None) -> Row:
    """A problem from one start."""
    problem = cs.read_petab(file)
    posed = times(problem, factor)
    likelihood = Likelihood(problem, TOLERANCES.get(file.stem, 1e-10))
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
    others = _by_scipy(posed, max(seconds, LEAST), starts)
    if python is not None:
        others |= _by_pypesto(python, file, posed, max(seconds, LEAST), likelihood)
    return {**row, **others}


def _by_scipy(problem: Problem, seconds: float, starts: int) -> dict[str, float]:
    """scipy's best from the start, and from further draws until the time is up."""
    begin, best = time.perf_counter(), math.inf
    for start in [dict(problem.start), *drawn(problem, starts - 1, 0)]:
        left = seconds - (time.perf_counter() - begin)
        if left <= 0.0:
            break
        best = min(best, minimum_by_scipy(problem, start, left).cost)
    return {"scipy": best, "scipy seconds": time.perf_counter() - begin}


def _by_pypesto(
    python: str, file: Path, problem: Problem, seconds: float, likelihood: Likelihood
) -> dict[str, float | str]:
    """pyPESTO's best, in a process of its own."""
    script = [python, "-P", str(by_pypesto.__file__), str(file), json.dumps(dict(problem.start)), str(seconds)]
    ended = subprocess.run(script, capture_output=True, text=True, check=False)
    if ended.returncode:
        print(ended.stderr, file=sys.stderr)
        raise InputError(f"pyPESTO: {file.stem} ended with {ended.returncode}, see above")
    found = json.loads(ended.stdout)
    return {"pyPESTO": likelihood(found["values"]), "pyPESTO's": found["cost"], "pyPESTO starts": found["starts"]}


if __name__ == "__main__":
    run_script(main)
