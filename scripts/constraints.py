"""What does it take to add what is known to an estimation, and what does it do for a record that excites too little?

Question     bounds, signs, a known static margin, balanced trim moments, a path limit on alpha, parameters tied across
             records: does each rescue the estimate, what is its price (the multiplier), do both solvers agree?
Set-up       Do 328, one poor record (slow, small pitch input; hardly any roll) and for the last case a good one too;
             output error, multiple shooting. Each constraint is one or two lines in problems/paper/constraints.py.
Expectation  without constraint the pitch derivatives are off by half; the static margin or the good record cures it.
             DIR/constraints.html, DIR/constraints.csv. A multiplier is the change of cost per unit of its limit.

    python scripts/constraints.py [--experiment NAME ...] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
from pathlib import Path
from typing import Any, NoReturn

from casid.errors import InputError, unknown
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from problems.paper.constraints import estimate, experiments, limit_words, truth_of, worst_error
from problems.paper.pages.page import Section, paragraph, table, write_page

MEANING = (
    "The multiplier is the rate at which the cost (half the weighted sum of squares) falls when the limit is moved up: "
    "zero for a limit that is not reached. It is checked by solving twice more with the limit moved."
)
CHANGE = 1e-3  # of the cost, by which a limit is moved to check its multiplier
HEAD = ("experiment", "parameter", "truth", "estimate", "standard deviation", "IPOPT minus Gauss-Newton [std]")
PRICES = ("experiment", "what is known", "largest error", "cost", "constraint", "multiplier", "checked by differences")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Constraints that rescue an estimate, and their price.",
        epilog="Example: python scripts/constraints.py --experiment tied",
    )
    parser.add_argument("--experiment", nargs="+", default=list(experiments()), metavar="NAME")
    parser.add_argument("--out", type=out_folder, default=Path("out/constraints"), metavar="DIR")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see constraints.py --help")


def main() -> None:
    given = arguments()
    for name in given.experiment:
        if name not in experiments():
            raise unknown("experiment", name, experiments(), "--experiment")
    made_with, values, costs = provenance(2), [], []
    with progress() as stage:
        for name in given.experiment:
            stage(name)
            own_values, own_costs = solved(name)
            values += own_values
            costs += own_costs
    with whole_folder(given.out) as folder:
        with (folder / "constraints.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([HEAD, *values])
        sections = [
            Section(title="Prices", parts=[paragraph(MEANING), table(PRICES, costs)]),
            Section(title="Estimates", parts=[table(HEAD, values)]),
        ]
        lead = ["What is known beforehand, said as a constraint, on a record that excites too little."]
        write_page(folder / "constraints.html", "Constraints, and their price", lead, sections, made_with)
        write_provenance(made_with, folder / "run.json")
    for name, _, error, cost, _, multiplier, checked in costs:
        price = "" if multiplier is None else f", multiplier {multiplier:.6g}, by differences {checked:.6g}"
        print(f"{name:14} largest error {error:.3f}, cost {cost:.4f}{price}")
    print(f"page: {given.out / 'constraints.html'}")


def solved(name: str) -> tuple[list[list[Any]], list[list[Any]]]:
    """Rows of both tables for one experiment."""
    fit, second = estimate(name), estimate(name, "IPOPT")
    values = [
        [
            name,
            n,
            truth_of(n),
            e.value,
            e.std,
            None if e.std == 0 else (second[n].value - e.value) / e.std,
        ]
        for n, e in fit.parameters.items()
    ]
    words, error = experiments()[name].words, worst_error(fit)
    costs = [[name, words, error, fit.cost, "", None, None]]
    if len(fit.multipliers):
        costs = []
        for i, multiplier in enumerate(fit.multipliers):
            shift = CHANGE / max(abs(multiplier), 1.0)
            above, below = (estimate(name, shift=side * shift, only=i).cost for side in (1, -1))
            rate = (below - above) / (2 * shift)
            costs.append([name, words, error, fit.cost, limit_words(name, i), float(multiplier), rate])
    return values, costs


if __name__ == "__main__":
    run_script(main)
