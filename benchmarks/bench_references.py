"""Does casid reach certified and published optima, and how long does it take beside scipy and IPOPT?

Question     how many of the certified digits of NIST's nonlinear regressions, and of the published optima of COPS,
             Bellman and PEtab, come out from the published starts?
Set-up       problems/references: 27 regressions from two starts each; seven systems of differential equations by
             multiple shooting, with steps as chosen. scipy: least_squares by Levenberg and Marquardt, and on LSODA's
             motion with differences; IPOPT: `Ipopt()` on the regression, on collocation with one cubic per interval.
             Wall-clock seconds of one solution in a warm process.
Expectation  54 of 54 starts to six digits; every published optimum to within the error that the integration may make,
             a tenth of a standard deviation of any estimate.

    python benchmarks/bench_references.py [--data DIR] [--only TEXT ...] [--json FILE]

DIR: folder with the folders `strd` (NIST/ITL StRD) and `references` (COPS, PEtab), CASID_DATA by default; what is not
there is said and left out.
"""

from __future__ import annotations

from casid.cli.start import run_script

import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median

import numpy as np

from casid.errors import InputError
from casid.estimation import Automatic, Collocation, Fit, Ipopt, MultipleShooting, Problem, solve
from problems.bench.table import Row, parser, publish
from problems.references.differential import PUBLISHED, Published
from problems.references.nist import FORMULAS, Reference, read_reference
from problems.references.peers import motion_by_scipy, regression_by_scipy

DIGITS = 6.0


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--data", type=Path, default=os.environ.get("CASID_DATA"), metavar="DIR")
    options.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="problems whose name contains one")
    given = options.parse_args()
    if given.data is None:
        raise InputError("no reference data: give --data DIR, or set CASID_DATA")
    folder, rows = Path(given.data), []
    names = [name for name in FORMULAS if any(text in name for text in given.only)]
    if not (folder / "strd").is_dir():
        print(f"{folder}/strd: not there, NIST's regressions are left out")
    elif names:
        rows += regressions(folder / "strd", names)
    for published in PUBLISHED:
        if not any(text in published.name for text in given.only):
            continue
        if published.file and not (folder / "references" / published.file).is_file():
            print(f"{published.name}: {folder}/references/{published.file} is not there, left out")
            continue
        rows.append(motion(published, folder / "references"))
        print(rows[-1], flush=True)
    publish(rows, given.json)


def regressions(folder: Path, names: list[str]) -> list[Row]:
    """A row for each solver: how many starts it brings to six digits and how long one takes."""
    solvers: dict[str, Callable[[Reference, int], tuple[np.ndarray, str]]] = {
        "casid": lambda r, s: _by_casid(r.problem(s), Automatic()),
        "casid, Ipopt": lambda r, s: _by_casid(r.problem(s), Ipopt()),
        "scipy": lambda r, s: (regression_by_scipy(r, s), "converged"),
    }
    references = [read_reference(folder / f"{name}.dat") for name in names]
    rows = []
    for solver, by in solvers.items():
        digits, seconds, missed, untrue = [], [], [], 0
        for reference in references:
            for start in (0, 1):
                begin = time.perf_counter()
                found, status = by(reference, start)
                seconds.append(time.perf_counter() - begin)
                digits.append(reference.digits(found))
                if digits[-1] < DIGITS:
                    missed.append(f"{reference.name}/{start + 1}")
                    untrue += status == "converged"
        rows.append(
            {
                "problem": "NIST",
                "solver": solver,
                "reached": f"{len(digits) - len(missed)} of {len(digits)}",
                "digits": median(digits),
                "seconds": median(seconds),
                "all_seconds": sum(seconds),
                "wrongly_converged": untrue,
                "missed": " ".join(missed),
            }
        )
        print(rows[-1], flush=True)
    return rows


def _by_casid(problem: Problem, solver: Automatic | Ipopt) -> tuple[np.ndarray, str]:
    fit = solve(problem, solver=solver)
    return np.array(list(fit.values.values())), fit.status


def motion(published: Published, folder: Path) -> Row:
    """Figure, seconds and steps of ours by two transcriptions, figure and seconds of the others."""
    problem = published.make(folder)
    row: dict[str, object] = {"problem": published.name, "kind": published.kind, "published": published.optimum}
    for name, method, solver in (
        ("shooting", MultipleShooting(), Automatic()),
        ("collocation", Collocation(), Automatic()),
        ("Ipopt", Collocation(substeps=1), Ipopt()),
    ):
        solve(problem, method, solver)  # compiled
        begin = time.perf_counter()
        fit = solve(problem, method, solver)
        figure = published.figure(fit)
        row |= {
            name: figure,
            f"{name}_digits": digits_of(figure, published.optimum),
            f"{name}_seconds": time.perf_counter() - begin,
            f"{name}_status": f"{_brief(fit)}, {fit.method} {fit.substeps}",
        }
    begin = time.perf_counter()
    figure = _scipy_figure(published, problem)
    row |= {"scipy": figure, "scipy_digits": digits_of(figure, published.optimum)}
    return row | {"scipy_seconds": time.perf_counter() - begin}


def digits_of(figure: float, optimum: float) -> float:
    """Digits in which a figure is the published one."""
    return -math.log10(max(abs(figure / optimum - 1.0), 1e-16))


def _brief(fit: Fit) -> str:
    return fit.status.partition(":")[0].partition(";")[0]


def _scipy_figure(published: Published, problem: Problem) -> float:
    """What scipy reached, in the published unit."""
    end = motion_by_scipy(problem)
    if published.kind == "sum of squares":
        given = problem.noise.values() if isinstance(problem.noise, Mapping) else [1.0]
        (sigma,) = {sigma for sigma in given if isinstance(sigma, float)}
        return float(end.squares.sum() * sigma**2)
    if problem.noise is None:
        variance = end.squares / end.samples
        return float((0.5 * end.samples * (np.log(2.0 * np.pi * variance) + 1.0)).sum())
    sizes = [
        record[channel][np.isfinite(record[output])]
        for record in problem.records
        for output, channel in problem.sigma_channels.items()
    ]
    return float(0.5 * end.squares.sum() + np.log(np.concatenate(sizes) * np.sqrt(2.0 * np.pi)).sum())


if __name__ == "__main__":
    run_script(main)
