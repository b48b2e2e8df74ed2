"""Do the two solvers agree?

Question     does our solver, Gauss-Newton and where that creeps Newton, with derivatives of its own, end where IPOPT
             ends on the same problem written as a nonlinear programme with CasADi's derivatives?
Set-up       every problem of problems/every_problem.py by multiple shooting, each solver from the problem's own start,
             IPOPT with the exact Hessian and, where that does not converge, with that of Gauss-Newton. Where they end
             apart, each starts once more at the other's estimates.
Expectation  estimates equal to 1e-8 of their value or standard deviation (1e-10 for a value of zero), costs to 1e-8
             (1e-8 of a sample's for data without noise). A model that cannot follow its data (cases G, H) may have two
             minima: then our next step at IPOPT's is below 1e-8 standard deviations as well, and each solver, started
             at the other's estimates, ends at one of the two, or at a third that both call an optimum. Estimates say
             nothing of the states: from some, with states as measured, both lose their way; ours alone may not. Where
             IPOPT stopped short from the problem's start it must agree that ours is an optimum. A problem of which
             none of this holds is an error.

    python benchmarks/compare_solvers.py [--data DIR] [--only TEXT ...] [--whole] [--json FILE]

DIR: folder with hfb320_1_10.asc, fAttasElv1.mat ... (see README); without it, those are left out
"""

from __future__ import annotations

from casid.cli.start import run_script

import time
from dataclasses import replace
from pathlib import Path

from casid.errors import InputError
from casid.estimation import Automatic, Fit, Ipopt, Problem, solve
from problems.bench.table import Row, parser, publish
from problems.every_problem import every_problem

SAME, ZERO = 1e-8, 1e-10
OURS = Automatic(tolerance=1e-10)
THEIRS = (
    Ipopt(tolerance=1e-12, iterations=300),
    Ipopt(hessian="gauss-newton", tolerance=1e-12, iterations=300),
)
DISAGREE = "disagree"


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--data", type=Path, metavar="DIR", help="flight records")
    options.add_argument("--only", nargs="+", default=[""], metavar="TEXT", help="problems whose name contains one")
    options.add_argument("--whole", action="store_true", help="all 384 records of the Do 328")
    given = options.parse_args()
    rows, names = [], []
    for name, make in every_problem(given.data, given.whole):
        names.append(name)
        if any(text in name for text in given.only):
            rows.append(compared(name, make()))
            print(f"{name}: {rows[-1]['apart']:.2g} {rows[-1]['found']}", flush=True)
    if not rows:
        raise InputError(
            f"--only {' '.join(given.only)}: no problem is called so; there are {', '.join(names[:8])}, ..."
        )
    publish(rows, given.json)
    wrong = [row["problem"] for row in rows if row["found"] == DISAGREE]
    if wrong:
        raise InputError(f"solvers disagree: {', '.join(wrong)}")


def by_ours(problem: Problem) -> Fit:
    """That of `solve` without a named solver."""
    return solve(problem, solver=OURS)


def by_ipopt(problem: Problem) -> Fit:
    """That of the first Hessian with which IPOPT converges, else of the last."""
    for solver in THEIRS:
        fit = solve(problem, solver=solver)
        if fit.converged:
            break
    return fit


def compared(name: str, problem: Problem) -> Row:
    """apart: the largest difference in units of what is allowed; nan when a solver did not converge."""
    begin = time.perf_counter()
    ours = by_ours(problem)
    between = time.perf_counter()
    theirs = by_ipopt(problem)
    seconds = time.perf_counter() - between
    distance = apart(ours, theirs)
    return {
        "problem": name,
        "apart": distance,
        "found": "same" if distance <= 1.0 else found(problem, ours, theirs),
        "cost": ours.cost,
        "ipopt_cost": theirs.cost,
        "iterations": ours.iterations,
        "ipopt_iterations": theirs.iterations,
        "seconds": between - begin,
        "ipopt_seconds": seconds,
    }


def found(problem: Problem, ours: Fit, theirs: Fit) -> str:
    """What two fits are that ended apart."""
    if theirs.converged and not theirs.stationarity <= SAME:  # by our derivatives
        return DISAGREE
    if not (ours.converged and ours.stationarity <= SAME):
        return DISAGREE
    again = by_ipopt(replace(problem, start=dict(ours.values)))
    if not theirs.converged:
        return "ours, IPOPT stopped" if apart(ours, again) <= 1.0 else DISAGREE
    back = by_ours(replace(problem, start=dict(theirs.values)))
    if not back.converged and by_ipopt(replace(problem, start=dict(theirs.values))).converged:
        return DISAGREE  # ours lost its way where IPOPT, from the same start, does not
    apart_from_both = [end for end in (again, back) if end.converged and not one_of(end, ours, theirs)]
    if not apart_from_both:
        return "two minima"
    return "three minima" if all(agreed(problem, end) for end in apart_from_both) else DISAGREE


def one_of(end: Fit, *fits: Fit) -> bool:
    return any(apart(end, fit) <= 1.0 for fit in fits)


def agreed(problem: Problem, end: Fit) -> bool:
    """Whether a point where one solver ended is an optimum to the other too."""
    return end.stationarity <= SAME and one_of(by_ipopt(replace(problem, start=dict(end.values))), end)


def apart(ours: Fit, theirs: Fit) -> float:
    """Largest difference of two fits' estimates and costs, 1 when just allowed; nan when one has not converged."""
    if not (ours.converged and theirs.converged):
        return float("nan")
    samples = sum(channel.samples for channel in ours.channels.values())
    differences = [abs(ours.cost - theirs.cost) / (SAME * max(ours.cost, samples))]
    for name, value in ours.values.items():
        allowed = max(SAME * max(abs(value), ours[name].std), ZERO)
        differences.append(abs(value - theirs.values[name]) / allowed)
    return max(differences)


if __name__ == "__main__":
    run_script(main)
