"""Figures 1-6 of the paper for case H, ours: how the three estimators match, and what each derivative contributes.

Question     where does the linear model miss nonlinear, destabilised, noisy truth, and which estimator misses least?
Set-up       one record of case H (or another), estimated from 0.7 x truth; all is drawn against noise-free truth.
Expectation  1 coefficients, 2 outputs, 3-5 the terms of Cl, Cm, Cn in time, 6 the terms over their own variable.
             The numbering is ours, as the paper's figures are only known by their subject.
             DIR/figure_1.svg ... figure_6.svg, DIR/paper_figures.html, DIR/run.json.

    python scripts/paper_figures.py [--case H] [--manoeuvre 1] [--variant 2] [--seed 1] [--method multiple-open]
        [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
from pathlib import Path
from typing import NoReturn

from casid.errors import InputError, unknown
from casid.report.figure import Picture
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from casid.report.svg import svg
from problems.do328 import MOMENT_DERIVATIVES
from problems.paper.cases import CASES, Condition, conditions
from problems.paper.estimation import ESTIMATORS, METHODS, estimate
from problems.paper.pages.figures import histories, output_labels, outputs_scaled, over_variable
from problems.paper.pages.page import Section, figure, write_page
from problems.paper.statistics import coefficients, departed, linear_contributions, simulated, true_regressors
from problems.paper.truth import COEFFICIENTS, OUTPUTS, Flight, fly

NUMBERS = {"Cl": 3, "Cm": 4, "Cn": 5}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Figures 1-6 of the paper, ours.",
        epilog="Example: python scripts/paper_figures.py --case H --manoeuvre 1",
    )
    parser.add_argument("--case", default="H", help="letter A to H")
    parser.add_argument("--manoeuvre", type=int, default=1, help="1 to 8")
    parser.add_argument("--variant", type=int, default=2, help="of the nonlinear terms, 1 to 3; 0 in A to D")
    parser.add_argument("--seed", type=int, default=1, help="of the noise, 1 to 5; 0 in A, C, E, G")
    parser.add_argument("--method", default="multiple-open", help=", ".join(METHODS))
    parser.add_argument("--out", type=out_folder, default=Path("out/paper_figures"), metavar="DIR")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see paper_figures.py --help")


def condition(given: argparse.Namespace) -> Condition:
    """The record that was asked for, if the paper's cases have it."""
    if given.case not in CASES:
        raise unknown("case", given.case, CASES, "--case")
    asked = Condition(case=given.case, manoeuvre=given.manoeuvre, variant=given.variant, seed=given.seed)
    there = list(conditions([given.case], range(1, 9)))
    if asked not in there:
        raise InputError(
            f"case {given.case} has no record {asked.name}; its first is {there[0].name}, its last "
            f"{there[-1].name} (case-manoeuvre-variant-seed)"
        )
    return asked


def main() -> None:
    given = arguments()
    chosen, made_with = condition(given), provenance(given.seed)
    if given.method not in METHODS:
        raise unknown("method", given.method, METHODS, "--method")
    with progress() as stage:
        stage(f"simulating {chosen.name}")
        flight, values = fly(chosen), {}
        for estimator in ESTIMATORS:
            stage(f"{estimator} error")
            values[estimator] = estimate(flight, estimator, given.method).values
    drawn = [(picture, svg(picture.figure)) for picture in figures(flight, values)]
    with whole_folder(given.out) as folder:
        for picture, painted in drawn:
            (folder / f"{picture.name}.svg").write_bytes(painted)
        sections = [Section(title=f"Case {given.case}", parts=[figure(picture, painted) for picture, painted in drawn])]
        lead = [f"Record {chosen.name}: {CASES[given.case].origin}. {METHODS[given.method].words}."]
        write_page(folder / "paper_figures.html", "Figures 1-6 of the paper, ours", lead, sections, made_with)
        write_provenance(made_with, folder / "run.json")
    print(f"page: {given.out / 'paper_figures.html'}")


def figures(flight: Flight, values: dict[str, dict[str, float]]) -> list[Picture]:
    """The six pictures."""
    t, truth = flight.exact.t, flight.contributions
    terms = {estimator: linear_contributions(flight, own) for estimator, own in values.items()}
    sums = {e: coefficients(own) for e, own in terms.items()}
    motions = {e: simulated(flight, own) for e, own in values.items()}
    flown = {e: outputs_scaled(motion, OUTPUTS) for e, motion in motions.items() if not departed(motion)}
    drawn = [
        histories(
            "figure_1",
            "1. Equation domain",
            "Moment coefficients of the linear model on the true signals.",
            t,
            flight.coefficients,
            sums,
            {c: c for c in COEFFICIENTS},
        ),
        histories(
            "figure_2",
            "2. Output domain",
            "Flight of the linear model by the exact stick, with the control law "
            "where the aircraft has one; a departed flight is not drawn.",
            t,
            outputs_scaled(flight.exact.matrix(OUTPUTS), OUTPUTS),
            flown,
            output_labels(OUTPUTS),
        ),
    ]
    for coefficient, number in NUMBERS.items():
        names = [n for n in MOMENT_DERIVATIVES if n.startswith(coefficient) and not n.endswith("_0")]
        drawn.append(
            histories(
                f"figure_{number}",
                f"{number}. Terms of {coefficient}",
                f"Contribution of each term to {coefficient}.",
                t,
                {n: truth[n] for n in names},
                {e: {n: own[n] for n in names} for e, own in terms.items()},
                {n: n.split("_", 1)[1] for n in names},
            )
        )
    names = [n for n in MOMENT_DERIVATIVES if not n.endswith("_0")]
    x = true_regressors(flight)
    drawn.append(
        over_variable(
            "figure_6",
            "6. Terms over their own variable",
            "Angles in rad, rates dimensionless. The spread of the true "
            "points comes from products with other variables.",
            {n: x[n.split("_", 1)[1]] for n in names},
            {n: truth[n] for n in names},
            {e: {n: own[n] for n in names} for e, own in terms.items()},
        )
    )
    return drawn


if __name__ == "__main__":
    run_script(main)
