"""Estimate the derivatives of an aircraft file from flight records.

Question     which values explain the measured outputs (output error), the forces and moments (equation error), or both
             (combined, paper eq. 11-15), how certain are they, and how well do they explain each channel?
Set-up       --free names what is estimated, by globs; default: all derivatives and terms that move the axes. Instrument
             biases (bias_q ...) have an own value per record. Effects of the aircraft file act; a symbolic one can be
             freed by its name, e.g. --free 'Cm_*' 'cg_offset(x)'. The a-priori uncertainty of the file is a prior.
             --defects soft takes the forces and moments as noisy; the variances are those of highest likelihood.
Expectation  DIR/estimate.json, DIR/model.toml (the aircraft file with the estimates; biases belong to the records and
             stand in estimate.json alone), DIR/figures, DIR/run.json. Status 0, also without convergence, which
             estimate.json says in words; 2 and one line for bad input.

    python scripts/estimate.py RECORD ... --aircraft FILE [--cost output|equation|combined] [--equation-weight 0.5]
        [--method single|multiple|collocation] [--interval N] [--defects hard|soft]
        [--solver automatic|gauss-newton|ipopt] [--free GLOB ...] [--axes full|longitudinal|lateral]
        [--map CHANNEL=COLUMN:unit] [--out DIR]
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any, NoReturn

from casid.errors import EstimationError, InputError, run_script
from casid.estimation import (
    Automatic,
    Collocation,
    CombinedError,
    EquationError,
    Fit,
    GaussNewton,
    Ipopt,
    MultipleShooting,
    OutputError,
    Problem,
    SingleShooting,
    solve,
)
from casid.filtering.filter_error import FilterFit
from casid.filtering.soft_defects import noise_of_forces, with_measurement_noise
from casid.model.aircraft import Aircraft
from casid.model.applied import Applied, apply_effects, default_free, with_estimates
from casid.records.column_map import ColumnMap
from casid.records.readers import read_records
from casid.report.estimate_figures import autocorrelations, correlations, estimates, histories, write_pictures
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.progress import progress
from casid.report.style import Picture

SOLVERS = {"automatic": Automatic(), "gauss-newton": GaussNewton(), "ipopt": Ipopt()}
INTERVAL = 25  # samples; soft defects default to 1, where noise enters at every sample


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Estimate derivatives of an aircraft file from flight records.")
    parser.add_argument("records", nargs="+", metavar="RECORD", help="file, or pattern like 'flight/m*.csv'")
    parser.add_argument("--aircraft", type=Path, required=True, metavar="FILE", help="aircraft file (TOML)")
    parser.add_argument("--cost", choices=("output", "equation", "combined"), default="output")
    parser.add_argument("--equation-weight", type=float, metavar="W", help="of the equation part, with --cost combined")
    parser.add_argument("--method", choices=("single", "multiple", "collocation"), default="multiple")
    parser.add_argument("--interval", type=int, metavar="N", help=f"samples per shooting interval; default {INTERVAL}")
    parser.add_argument("--defects", choices=("hard", "soft"), default="hard", help="soft: process noise")
    parser.add_argument("--solver", choices=tuple(SOLVERS), default="automatic")
    parser.add_argument("--free", nargs="+", metavar="GLOB", help="parameters to estimate; default: all derivatives")
    parser.add_argument("--axes", choices=("full", "longitudinal", "lateral"), help="default: what the surfaces allow")
    parser.add_argument("--map", action="append", default=[], help="column map: alpha=ALCG:deg, or a TOML file")
    parser.add_argument("--out", type=Path, default=Path("out/estimate"), metavar="DIR", help="folder for the results")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see estimate.py --help")


def checked(given: argparse.Namespace) -> argparse.Namespace:
    """Options that contradict each other are said, not ignored."""
    if given.equation_weight is not None and given.cost != "combined":
        raise InputError(f"--equation-weight needs --cost combined, got --cost {given.cost}")
    if given.interval is not None and given.method != "multiple":
        raise InputError(f"--interval needs --method multiple, got --method {given.method}")
    if given.defects == "soft" and (given.method != "multiple" or given.cost != "output"):
        raise InputError(
            f"--defects soft needs --method multiple and --cost output, got {given.method} and {given.cost}"
        )
    return given


def problem_of(given: argparse.Namespace, applied: Applied) -> Problem:
    """The estimation problem of the options."""
    cost = {"output": OutputError, "equation": EquationError, "combined": CombinedError}[given.cost]()
    if given.equation_weight is not None:
        cost = CombinedError(equation_weight=given.equation_weight)
    if given.cost != "output" and applied.unseen_by_equations:
        raise InputError(
            f"--cost {given.cost}: {', '.join(applied.unseen_by_equations)} of the aircraft file cannot act in the "
            "equations, which take the measured signals as they are; use --cost output"
        )
    noise = {o: applied.aircraft.noise[o] for o in applied.model.outputs if o in applied.aircraft.noise}
    complete = given.cost == "output" and len(noise) == len(applied.model.outputs)
    globs = given.free or default_free(applied)
    biases = [glob for glob in globs if glob.startswith("bias_")]
    shared = [glob for glob in globs if glob not in biases]
    noise = noise if complete else None
    return Problem(applied.model, applied.records, free=shared, per_record=biases, cost=cost, prior=True, noise=noise)


def estimate(given: argparse.Namespace, problem: Problem) -> tuple[Fit, FilterFit | None]:
    """The fit, and with soft defects the filter-error fit that gave its noise."""
    solver = SOLVERS[given.solver]
    if given.defects == "soft":
        found = noise_of_forces(problem)
        method = MultipleShooting(
            interval=1 if given.interval is None else given.interval, process_noise=found.intensities
        )
        return solve(with_measurement_noise(problem, found), method, solver), found
    multiple = MultipleShooting(interval=INTERVAL if given.interval is None else given.interval)
    methods = {"single": SingleShooting(), "multiple": multiple, "collocation": Collocation()}
    return solve(problem, methods[given.method], solver), None


def document(given: argparse.Namespace, applied: Applied, fit: Fit, found: FilterFit | None) -> dict[str, Any]:
    """The content of estimate.json."""
    further: dict[str, Any] = {"aircraft": applied.aircraft.name, "axes": applied.axes, "defects": given.defects}
    further["notes"] = {record.name: list(record.notes) for record in applied.records}
    if found is not None:
        further["filter_error"] = found.to_dict()
    return fit.to_dict() | further


def pictures(applied: Applied, fit: Fit) -> list[Picture]:
    names = list(fit.channels)
    first = applied.records[0].name
    drawn = [correlations(list(fit.parameters), fit.correlations)]
    drawn.append(autocorrelations(names, {"residual": fit.residuals[first]}))
    pairs = {"a priori": [(e.prior, 0.0) for e in fit.parameters.values()]}
    pairs |= {"estimated": [(e.value, e.std_corrected) for e in fit.parameters.values()]}
    drawn.append(estimates(list(fit.parameters), pairs, "a priori"))
    for record in applied.records:
        predicted = fit.predictions[record.name]
        measured = predicted + fit.residuals[record.name]
        drawn.append(histories(record.name, record.t, names, measured, {"estimated model": predicted}))
    return drawn


def main() -> None:
    given = checked(arguments())
    aircraft = Aircraft.read(given.aircraft)
    records = read_records(given.records, ColumnMap.from_options(given.map))
    made_with = provenance(0)
    with whole_folder(given.out) as folder, progress() as stage:
        try:
            stage("model")
            applied = apply_effects(aircraft, records, given.axes)
            problem = problem_of(given, applied)
            stage("estimation")
            fit, found = estimate(given, problem)
        except EstimationError as error:
            raise InputError(str(error)) from None
        stage("figures")
        (folder / "estimate.json").write_text(json.dumps(document(given, applied, fit, found), indent=1) + "\n")
        write_provenance(made_with, folder / "run.json")
        write_model(aircraft, fit, folder / "model.toml")
        write_pictures(pictures(applied, fit), folder / "figures")
    print(fit)


def write_model(aircraft: Aircraft, fit: Fit, path: Path) -> None:
    """The aircraft file with the estimates; not written when an estimate is not a number."""
    if all(map(math.isfinite, fit.values.values())):
        std = {name: e.std_corrected for name, e in fit.parameters.items()}
        with_estimates(aircraft, fit.values, std).write(path)


if __name__ == "__main__":
    run_script(main)
