"""Do the two solvers agree?

Question     does our Gauss-Newton, with derivatives of its own, end where IPOPT ends on the same problem written as a
             nonlinear programme with CasADi's derivatives?
Set-up       every problem of problems/every_problem.py by multiple shooting, each solver from the problem's own start.
Expectation  estimates equal to 1e-8 of their value or standard deviation (1e-10 for a value of zero), costs to 1e-8
             (1e-8 of a sample's for data without noise); a problem that does not is an error.

    python scripts/compare_solvers.py [--data DIR] [--only TEXT] [--whole] [--json FILE]

DIR: folder with hfb320_1_10.asc, fAttasElv1.mat ... (see README); without it, those are left out
"""

from __future__ import annotations

import time
from pathlib import Path

from casid.errors import InputError, run_script
from casid.estimation import Fit, GaussNewton, Ipopt, Problem, solve
from problems.bench import Row, parser, publish
from problems.every_problem import every_problem

SAME, ZERO = 1e-8, 1e-10
OURS, THEIRS = GaussNewton(tolerance=1e-10), Ipopt(hessian="gauss-newton", tolerance=1e-10)


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--data", type=Path, metavar="DIR", help="flight records")
    options.add_argument("--only", default="", metavar="TEXT", help="problems whose name contains it")
    options.add_argument("--whole", action="store_true", help="all 384 records of the Do 328")
    given = options.parse_args()
    rows = []
    for name, make in every_problem(given.data, given.whole):
        if given.only in name:
            rows.append(compared(name, make()))
            print(f"{name}: {rows[-1]['apart']:.2g}", flush=True)
    publish(rows, given.json)
    apart = [row["problem"] for row in rows if not row["apart"] <= 1.0]
    if apart:
        raise InputError(f"solvers disagree: {', '.join(apart)}")


def compared(name: str, problem: Problem) -> Row:
    """apart: the largest difference in units of what is allowed; nan when a solver did not converge."""
    begin = time.perf_counter()
    ours = solve(problem, solver=OURS)
    between = time.perf_counter()
    theirs = solve(problem, solver=THEIRS)
    seconds = time.perf_counter() - between
    return {
        "problem": name, "apart": apart(ours, theirs) if ours.converged and theirs.converged else float("nan"),
        "cost": ours.cost, "ipopt_cost": theirs.cost, "iterations": ours.iterations,
        "ipopt_iterations": theirs.iterations, "seconds": between - begin, "ipopt_seconds": seconds,
    }  # fmt: skip


def apart(ours: Fit, theirs: Fit) -> float:
    """Largest difference of two fits' estimates and costs, 1 when it is just allowed."""
    samples = sum(channel.samples for channel in ours.channels.values())
    found = [abs(ours.cost - theirs.cost) / (SAME * max(ours.cost, samples))]
    for name, value in ours.values.items():
        allowed = max(SAME * max(abs(value), ours[name].std), ZERO)
        found.append(abs(value - theirs.values[name]) / allowed)
    return max(found)


if __name__ == "__main__":
    run_script(main)
