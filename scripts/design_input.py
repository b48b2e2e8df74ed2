"""Does an input designed for the bound beat the standard 3-2-1-1 when both are flown?

Question     same surfaces, limits, duration and noise: how much smaller is the scatter of the estimates?
Set-up       Do 328, longitudinal (elevator) and lateral (aileron, rudder). Standard: the 3-2-1-1 with the best unit and
             the largest size within the limits. Designs: four free pulses per surface, eight, a multisine. Each is
             flown --runs times in simulation with new noise and estimated by output error.
Expectation  designs scatter less in the mean over all parameters, as the bound predicts. DIR/design.html and
             design.csv, and one record per design, DIR/EXPERIMENT_SHAPE.csv.

    python scripts/design_input.py [--experiment NAME ...] [--shape NAME ...] [--criterion D|A] [--runs 200]
        [--starts 2] [--seed 0] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from casid.design import Experiment, InputDesign, Multisine, StepInput, design_input, standard_3211
from casid.errors import InputError, unknown
from casid.records.record import Record
from casid.report.design_figures import designed_histories
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from problems.paper.pages.page import Section, figure, paragraph, table, write_page
from problems.studies.designed_inputs import EXPERIMENTS, flown, scatter_bars, volume, volume_std

SHAPES = {"pulses4": StepInput(pulses=4), "pulses8": StepInput(pulses=8), "multisine": Multisine(lines=8)}
STANDARD = "3-2-1-1"
HEAD = (
    "experiment",
    "input",
    "parameter",
    "truth",
    "bound",
    "measured scatter",
    "bound / standard",
    "scatter / standard",
    "runs",
)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Optimal inputs against the standard 3-2-1-1.",
        epilog="Example: python scripts/design_input.py --experiment longitudinal --shape pulses4 --runs 20",
    )
    parser.add_argument("--experiment", nargs="+", default=list(EXPERIMENTS), metavar="NAME")
    parser.add_argument("--shape", nargs="+", default=list(SHAPES), metavar="NAME", help=", ".join(SHAPES))
    parser.add_argument("--criterion", choices=("D", "A"), default="D")
    parser.add_argument("--runs", type=int, default=200, help="simulated flights of each input")
    parser.add_argument("--starts", type=int, default=2, help="random starts of each design, besides the standard")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=out_folder, default=Path("out/design_input"), metavar="DIR")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see design_input.py --help")


def main() -> None:
    given = arguments()
    for what, names, valid in (("experiment", given.experiment, EXPERIMENTS), ("shape", given.shape, SHAPES)):
        for name in names:
            if name not in valid:
                raise unknown(what, name, valid, f"--{what}")
    fewest = 3 * max(len(EXPERIMENTS[name]().free) for name in given.experiment)
    if given.runs < fewest or given.starts < 1:
        raise InputError(f"--runs {given.runs} --starts {given.starts}: expected at least {fewest} and 1")
    made_with, rows, sections = provenance(given.seed), [], []
    with whole_folder(given.out) as folder, progress() as stage:
        for name in given.experiment:
            experiment = EXPERIMENTS[name]()
            stage(f"{name}: {STANDARD}")
            designs = {STANDARD: standard_3211(experiment, criterion=given.criterion)}
            for shape in given.shape:
                stage(f"{name}: {shape}")
                designs[shape] = design_input(
                    experiment, SHAPES[shape], criterion=given.criterion, starts=given.starts, seed=given.seed
                )
            stage(f"{name}: {given.runs} flights of each")
            estimates = {title: flown(experiment, d, given.runs, given.seed) for title, d in designs.items()}
            own, section, lines = compared(name, experiment, given.criterion, designs, estimates)
            rows += own
            sections.append(section)
            for title, design in designs.items():
                write_record(design.record, folder / f"{name}_{title}.csv")
            print("\n".join(lines))
        with (folder / "design.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([HEAD, *rows])
        lead = ["Inputs designed for the bound, against the standard 3-2-1-1 within the same limits."]
        write_page(folder / "design.html", "Optimal inputs", lead, sections, made_with)
        write_provenance(made_with, folder / "run.json")
    print(f"page: {given.out / 'design.html'}")


def compared(
    name: str, experiment: Experiment, criterion: str, designs: dict[str, InputDesign], estimates: dict[str, np.ndarray]
) -> tuple[list[list[Any]], Section, list[str]]:
    """Rows of the table, section of the page, lines to print."""
    scatter = {title: values.std(axis=0, ddof=1) for title, values in estimates.items()}
    truth = dict(zip(experiment.model.parameters, experiment.model.nominal_vector(experiment.values), strict=True))
    rows, ratios, lines = [], {}, [f"{name}: mean over {len(experiment.free)} parameters, against the {STANDARD}"]
    volumes = {title: volume(values, experiment.sizes, criterion) for title, values in estimates.items()}
    known = {title: volume_std(values, experiment.sizes, criterion) for title, values in estimates.items()}
    for title, design in designs.items():
        pairs = []
        for i, n in enumerate(experiment.free):
            measured = float(scatter[title][i] / scatter[STANDARD][i])
            predicted = design.std[n] / designs[STANDARD].std[n]
            pairs.append((measured, predicted))
            rows.append(
                [
                    name,
                    title,
                    n,
                    float(truth[n]),
                    design.std[n],
                    float(scatter[title][i]),
                    predicted,
                    measured,
                    len(estimates[title]),
                ]
            )
        if title == STANDARD:
            continue
        ratios[title] = pairs
        mean = float(np.exp(volumes[title] - volumes[STANDARD]))
        predicted = float(np.exp(0.5 * (design.cost - designs[STANDARD].cost)))
        chance = 1.96 * mean * float(np.hypot(known[title], known[STANDARD]))
        fewer = sum(m < 1.0 for m, _ in pairs)
        lines.append(
            f"  {title:10} ({design.status}) scatter {mean:.3f} +-{chance:.3f} of the standard's, bound {predicted:.3f}"
            f", smaller for {fewer} of {len(pairs)} parameters; {len(estimates[title])} flights"
        )
    shown = [*experiment.surfaces, *(c for c in experiment.limits if c in designs[STANDARD].record)]
    pictures = [
        designed_histories(name, {title: d.record for title, d in designs.items()}, shown),
        scatter_bars(name, experiment.free, ratios),
    ]
    parts = [paragraph(line) for line in lines] + [figure(p) for p in pictures] + [table(HEAD, rows)]
    return rows, Section(title=name.capitalize(), parts=parts), lines


def write_record(record: Record, path: Path) -> None:
    """Time, inputs and exact outputs, as a flight record."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["t", *record.channels])
        columns = np.column_stack([record.t, *record.channels.values()])
        writer.writerows([f"{value:.10g}" for value in row] for row in columns)


if __name__ == "__main__":
    run_script(main)
