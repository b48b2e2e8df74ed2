"""From how far away is the right optimum found, and how long does it take?

Question     of random starts, how many end at the right optimum, at a wrong one that is claimed right, or nowhere?
Set-up       stable and destabilised Do 328, one noisy record each; starts U(0,2) x truth with a fifth of the signs
             flipped, the same for every method (problems/paper/shooting.py). Right: within 0.05 standard deviations of
             the optimum that is found from the truth.
Expectation  multiple shooting over 10 samples nearly always, single shooting seldom, and hardly ever when unstable.

    python benchmarks/bench_basins.py [--starts 20] [--method NAME ...] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

from statistics import median

from casid.errors import InputError, unknown
from problems.bench.table import parser, publish
from problems.paper.shooting import AIRCRAFT, METHODS, run

CHOSEN = ("single", "multiple 25", "multiple 10")


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--starts", type=int, default=20, help="random starts per method and aircraft")
    options.add_argument("--method", nargs="+", default=list(CHOSEN), metavar="NAME", help=", ".join(METHODS))
    given = options.parse_args()
    for method in given.method:
        if method not in METHODS:
            raise unknown("method", method, METHODS, "--method")
    if given.starts < 1:
        raise InputError(f"--starts {given.starts}: expected at least 1")
    publish([_basin(a, method, given.starts) for a in AIRCRAFT for method in given.method], given.json)


def _basin(aircraft: str, method: str, starts: int) -> dict[str, str | int | float | None]:
    results = [run({"aircraft": aircraft, "method": method, "kind": "random", "at": seed}) for seed in range(starts)]
    right = [result for result in results if result["right"]]
    return {
        "aircraft": aircraft,
        "method": method,
        "starts": starts,
        "right": len(right),
        "wrong_but_claimed": sum(result["claimed"] and not result["right"] for result in results),
        "seconds": median(result["seconds"] for result in right) if right else None,
        "iterations": median(result["iterations"] for result in right) if right else None,
    }


if __name__ == "__main__":
    run_script(main)
