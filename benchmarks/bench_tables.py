"""How much slower is an aircraft of twenty look-up tables to estimate than a linear one?

Question     What does an aircraft cost that is given as tables over alpha, Mach, sideslip and surfaces?
Set-up       The Do 328 in a record of 20 s (problems/bench/long_flight.py), and the same with twenty tables of one to
             three dimensions (12 breakpoints of alpha, 5 of every other axis) that say what its derivatives say. Of
             both the 28 derivatives are estimated, of the second as increments on its tables, by multiple shooting over
             25 samples. Median processor seconds of one iteration, compiled before.
Expectation  At most three times the seconds of the linear aircraft.

    python benchmarks/bench_tables.py [--repeats 5] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

import casid as cs
from casid.errors import InputError
from casid.estimation import InitialState, OutputError, Problem, solve
from casid.model.aircraft import Aircraft
from problems.bench.long_flight import long_record, noise
from problems.bench.table import parser, processor_seconds_of, publish
from problems.do328 import STABLE, do328

SAMPLES, WARM = 1000, 12  # solves after which the kernel is compiled on any machine
OUTPUTS = ("V", "p", "q", "r", "phi", "theta", "pdot", "qdot", "rdot", "ax", "ay", "az")
ALPHA = np.linspace(-0.2, 0.35, 12)
REACH = {"delta_e": 0.5, "delta_a": 0.5, "delta_r": 0.5, "beta": 0.4, "mach": 0.8}
OVER = {
    "CL": ("alpha,mach", "alpha,delta_e", "alpha*q"),
    "CD": ("alpha,mach", "alpha,delta_e", "alpha,beta,mach"),
    "CY": ("alpha,beta", "alpha,delta_r", "alpha*p"),
    "Cl": ("alpha,beta", "alpha,delta_a", "alpha*p", "alpha*r"),
    "Cm": ("alpha,delta_e,mach", "alpha,mach", "alpha*q"),
    "Cn": ("alpha,beta", "alpha,delta_r", "alpha*r", "alpha*p"),
}
BEND = 1e-4  # of every table, so that none is a plane


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--repeats", type=int, default=5, help="the median counts")
    given = options.parse_args()
    record = long_record(SAMPLES)
    rows = [
        _measure("derivatives", do328(), record, given.repeats),
        _measure("twenty tables", with_tables(do328()), record, given.repeats),
    ]
    for row in rows:
        row["ratio"] = row["seconds_per_iteration"] / rows[0]["seconds_per_iteration"]
    publish(rows, given.json)


def with_tables(aircraft: Aircraft) -> Aircraft:
    """The aircraft with tables for what its derivatives say of their axes; all derivatives are increments of zero."""
    tables = []
    for coefficient, several in OVER.items():
        left = {n.split("_", 1)[1]: v for n, v in aircraft.derivatives.items() if n.split("_", 1)[0] == coefficient}
        for text in several:
            axes, _, times = text.partition("*")
            names = axes.split(",")
            points = [ALPHA if n == "alpha" else np.linspace(-REACH[n], REACH[n], 5) for n in names]
            mesh = np.meshgrid(*points, indexing="ij")
            values = BEND * np.cos(9.0 * mesh[0])
            if times:
                values = values + left.pop(times, 0.0)
            else:
                values = values + sum(left.pop(n, 0.0) * x for n, x in zip(names, mesh, strict=True))
                values = values + left.pop("0", 0.0)
            grid = [axis.tolist() for axis in points]
            tables.append(cs.table(coefficient, names, grid, values, name=f"{coefficient} {text}", times=times or "0"))
    return replace(aircraft, derivatives=dict.fromkeys(aircraft.derivatives, 0.0), tables=tuple(tables))


def _measure(name: str, aircraft: Aircraft, record: cs.Record, repeats: int) -> dict[str, Any]:
    known = noise()
    found = tuple(o for o in OUTPUTS if o in record)
    problem = Problem(
        cs.aircraft_model(aircraft, outputs=found),
        [record],
        free=list(STABLE),
        cost=OutputError(),
        noise={o: known.get(o, 1e-3) for o in found},
        initial_state=InitialState(std=dict.fromkeys(("u", "v", "w"), 1.0)),
    )
    for _ in range(WARM):
        fit = solve(problem)
    if not fit.converged:
        raise InputError(f"{name}: {fit.status}")
    seconds = median(processor_seconds_of(lambda: solve(problem).parameters, repeats))
    return {
        "aircraft": name,
        "tables": len(aircraft.tables),
        "iterations": fit.iterations,
        "seconds": seconds,
        "seconds_per_iteration": seconds / fit.iterations,
    }


if __name__ == "__main__":
    run_script(main)
