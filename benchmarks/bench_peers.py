"""How much faster is an estimation than with the tools that people use, at the same optimum?

Question     seconds of scipy with numpy, scipy with solve_ivp, jax with diffrax and optimistix, CasADi with IPOPT,
             fatrop and HPIPM, acados, opty, pyomo.dae, rockit against ours, warm and at the first call
Set-up       stable Do 328, 1001 samples or the first SAMPLES of them, 16 moment derivatives from 0.7 x truth, known
             noise, initial state under a prior (problems/peers/common.py). Theirs and ours in turn in one process,
             medians of processor time (all run on one thread). Ours is `solve` of a problem, Cramer-Rao bounds in, on
             compiled code and one search, as theirs; theirs has no bounds. acados and jax compile before, as ours does.
             `first_seconds` is the
             first call with that; our own, with an empty cache, is that of `--cold`. A peer that is not installed is
             said and left out (CONTRIBUTING.md says what it takes).
Expectation  ratio 1000 to scipy_rk4, 50 to casadi_ipopt_gn. A peer that ends elsewhere than at our optimum is an error:
             `away` is the distance in standard deviations; pyomo and opty integrate otherwise, so it is not nil there.

    python benchmarks/bench_peers.py [--problems NAME ...] [--peers NAME ...] [--samples SAMPLES] [--repeats 3]
        [--cold] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

import os
import subprocess
import sys
from dataclasses import replace
from statistics import median
from tempfile import TemporaryDirectory

from casid.errors import InputError, unknown
from casid.estimation import Fit, Problem, solve
from problems.bench.table import Row, parser, processor_seconds, processor_seconds_of, publish
from problems.peers.acados import acados
from problems.peers.casadi import casadi_ipopt_cvodes, casadi_ipopt_gn
from problems.peers.common import Task, our_problem, task
from problems.peers.jax import jax_diffrax
from problems.peers.opty import opty
from problems.peers.pyomo import pyomo
from problems.peers.rockit import rockit
from problems.peers.scipy import scipy_ivp, scipy_rk4
from problems.peers.small import SMALL
from problems.peers.staged import casadi_fatrop, casadi_sqp_hpipm

PEERS = {
    "scipy_rk4": scipy_rk4,
    "scipy_ivp": scipy_ivp,
    "casadi_ipopt_gn": casadi_ipopt_gn,
    "casadi_ipopt_cvodes": casadi_ipopt_cvodes,
    "casadi_fatrop": casadi_fatrop,
    "casadi_sqp_hpipm": casadi_sqp_hpipm,
    "acados": acados,
    "opty": opty,
    "pyomo": pyomo,
    "rockit": rockit,
    "jax_diffrax": jax_diffrax,
}
EXPLICIT = ("scipy_rk4", "casadi_ipopt_gn", "casadi_fatrop", "casadi_sqp_hpipm")  # do not follow a stiff motion
STIFF = ("scipy_ivp", "casadi_ipopt_cvodes", "jax_diffrax")
DO328 = ("acados", "opty", "pyomo", "rockit")  # know no other
COMPILED = ("acados", "jax_diffrax")  # once per process, before its time counts
# standard deviations that a peer may be away: ours and theirs integrate alike, or only to the order of the method
SAME = {
    "scipy_rk4": 1e-3,
    "casadi_ipopt_gn": 1e-3,
    "casadi_ipopt_cvodes": 1e-3,
    "casadi_fatrop": 1e-3,
    "casadi_sqp_hpipm": 1e-3,
    "scipy_ivp": 1e-3,
    "acados": 1e-3,
    "opty": 0.2,
    "pyomo": 0.05,
    "rockit": 1e-3,
    "jax_diffrax": 0.1,
}
NEEDS = {
    "acados": "acados with acados_template, with ACADOS_SOURCE_DIR and LD_LIBRARY_PATH as its documentation says",
    "opty": "pip install 'casid[bench]', which builds cyipopt against libipopt",
    "pyomo": "pip install 'casid[bench]', and an executable 'ipopt' on the path",
    "rockit": "pip install rockit-meco",
    "jax_diffrax": "pip install diffrax optimistix",
}
OURS_PER_TURN, WARM = 5, 12


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--problems", nargs="+", default=["do328"], metavar="NAME", help=f"do328, {', '.join(SMALL)}")
    options.add_argument("--peers", nargs="+", default=list(PEERS), metavar="NAME", help=", ".join(PEERS))
    options.add_argument("--samples", type=int, default=1001, help="of the Do 328: a multiple of 25, and one")
    options.add_argument("--repeats", type=int, default=3, help="turns; the median counts")
    options.add_argument("--cold", action="store_true", help="only our first calls, each in a process with no cache")
    options.add_argument("--fresh", action="store_true", help="print the times of the first two calls of one problem")
    given = options.parse_args()
    if given.fresh:
        problem, _ = _posed(given.problems[0], given.samples)
        print(*processor_seconds_of(lambda: solve(problem), 2))
        return
    if given.cold:
        publish([_cold(name, given.samples) for name in given.problems], given.json)
        return
    for name in given.peers:
        if name not in PEERS:
            raise unknown("peer", name, PEERS, "--peers")
    rows = []
    for name in given.problems:
        problem, data = _posed(name, given.samples)
        know = STIFF if data.stiff else (*EXPLICIT, "scipy_ivp", "jax_diffrax", *(DO328 if name == "do328" else ()))
        peers = [peer for peer in given.peers if peer in know]
        for _ in range(WARM):
            fit = solve(problem)
        for peer in peers:
            row = _compare(name, peer, (problem, data), given.repeats, fit)
            if row is not None:
                rows.append(row)
                print(row, flush=True)
    publish(rows, given.json)


def _posed(name: str, samples: int) -> tuple[Problem, Task]:
    """For us and for others."""
    if name == "do328":
        return our_problem(samples), task(samples)
    if name not in SMALL:
        raise unknown("problem", name, ("do328", *SMALL), "--problems")
    return SMALL[name]()


def _cold(name: str, samples: int) -> Row:
    """Our first call and the second, after imports and the problem itself, of a process that has compiled nothing."""
    with TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": folder}
        command = [sys.executable, __file__, "--problems", name, "--samples", str(samples), "--fresh"]
        found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    first, second = map(float, found.stdout.split())
    return {"problem": name, "first_seconds": first, "second_seconds": second}


def _compare(problem: str, name: str, pair: tuple[Problem, Task], repeats: int, fit: Fit) -> Row | None:
    """One row; None when the peer's package is missing."""
    theirs, ours, (own, data) = [], [], pair
    try:
        begin = processor_seconds()
        if name in COMPILED:
            PEERS[name](data)
        first = processor_seconds() - begin
        for _ in range(repeats):
            ours += processor_seconds_of(lambda: solve(replace(own), starts=1).covariance, OURS_PER_TURN)
            begin = processor_seconds()
            parameters, cost = PEERS[name](data)
            theirs.append(processor_seconds() - begin)
    except ModuleNotFoundError as error:
        print(f"{name}: {error}, left out; install {NEEDS.get(name, name)}; see CONTRIBUTING.md, Benchmarks")
        return None
    away = max(abs(p - fit[n].value) / fit[n].std for n, p in zip(own.parameters, parameters, strict=True))
    if not fit.converged or not away < SAME[name]:
        raise InputError(
            f"{name}: ends {away:.2g} standard deviations from our optimum, cost {cost} against {fit.cost}"
        )
    return {
        "problem": problem,
        "peer": name,
        "first_seconds": first if name in COMPILED else theirs[0],
        "seconds": median(theirs),
        "ours_seconds": median(ours),
        "ratio": median(theirs) / median(ours),
        "cost": cost,
        "ours_cost": fit.cost,
        "away": away,
    }


if __name__ == "__main__":
    run_script(main)
