"""`casid estimate`: derivatives with their errors from flight records."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from casid.cli.options import (
    AsJson,
    Axes,
    Begin,
    End,
    Files,
    Folder,
    Maps,
    Records,
    Whole,
    aircraft_of,
    called_by,
    records_of,
    require_words,
    shared_and_biases,
)
from casid.cli.results import write_json
from casid.diagnosis.document import Called, NextStep
from casid.errors import InputError
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
from casid.estimation.usable import NOT_CONVERGED, NOT_IDENTIFIABLE, STRUCTURE_MISSING, USABLE
from casid.filtering.forces import noise_of_forces
from casid.keeping import plain
from casid.model.aircraft import Aircraft
from casid.model.dynamics import moved_coefficients
from casid.model.flown_records import FlownRecords, axes_of, flown_records, with_estimates
from casid.model.path import aerodynamic_parameters
from casid.records.given import require_flight
from casid.records.record import Record
from casid.report.estimate_figures import autocorrelations, correlations, estimates, histories
from casid.report.figure import Picture
from casid.report.folder import results
from casid.report.progress import progress
from casid.report.result_page import BAD, GOOD, Answer, in_numbers, write_result
from casid.report.sections import Section
from casid.signals import SURFACES

SOLVERS = {"automatic": Automatic(), "gauss-newton": GaussNewton(), "ipopt": Ipopt()}
INTERVAL = 25  # samples


def estimate(
    *records: Records,
    aircraft: Path,
    cost: Literal["output", "equation", "combined", "filter"] = "output",
    equation_weight: float | None = None,
    method: Literal["single", "multiple", "collocation"] = "multiple",
    interval: Whole | None = None,
    solver: Literal["automatic", "gauss-newton", "ipopt"] = "automatic",
    free: Files | None = None,
    axes: Axes | None = None,
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
    out: Folder = Path("out/estimate"),
    as_json: AsJson = False,
) -> None:
    """Estimate the derivatives of an aircraft file from flight records.

    Writes DIR/estimate.json, DIR/model.toml (the aircraft file with the estimates), the page DIR/estimate.html and
    DIR/run.json. The status is 0 also without convergence, which estimate.json states.

    Parameters
    ----------
    aircraft
        The aircraft file (TOML). Its a-priori uncertainty is a prior, its effects act.
    cost
        Cost: output error, equation error, both, or filter error: the innovations of a Kalman filter, for flights in
        turbulence. Forces and moments are then noisy, with the levels of highest likelihood.
    equation_weight
        Weight of the equation part, with --cost combined.
    method
        Transcription of the trajectory.
    interval
        Samples per shooting interval; default 25.
    solver
        Solver; automatic tries Gauss-Newton first.
    free
        Globs of the parameters to estimate; default: all derivatives and terms that move the axes.
    axes
        Default: what the surfaces allow.
    """
    require_words(records, "RECORD", "estimate RECORD ... --aircraft FILE")
    if equation_weight is not None and cost != "combined":
        raise InputError(f"--equation-weight needs --cost combined, got --cost {cost}")
    if interval is not None and method != "multiple":
        raise InputError(f"--interval needs --method multiple, got --method {method}")
    if cost == "filter" and (method != "multiple" or interval is not None):
        raise InputError("--cost filter has a state at every sample; leave --method and --interval out")
    file = aircraft_of(aircraft)
    read = records_of(records, maps, span=(begin, end), flown_by=[file])
    require_flight(read, "estimate")
    if axes is None:
        _say_left_out(file, read)
    with results(out) as folder, progress(quiet=as_json) as stage:
        stage("model")
        applied = flown_records(file, read, axes)
        problem = problem_of(applied, free, cost, equation_weight)
        multiple = MultipleShooting(interval=INTERVAL if interval is None else interval)
        methods = {"single": SingleShooting(), "multiple": multiple, "collocation": Collocation()}
        stage("estimation")
        fit = solve(problem, methods[method], SOLVERS[solver])
        stage("figures")
        answer = answer_of(fit, called_by(records, maps, aircraft, out))
        notes = {record.name: list(record.notes) for record in applied.records}
        further = {"aircraft": file.name, "axes": applied.axes, "notes": notes, "next": plain(answer.next)}
        text = write_json(fit.to_dict() | further, folder / "estimate.json")
        _write_model(file, fit, folder / "model.toml", aircraft)
        more = Section(title="More figures", parts=residuals_and_correlations(applied, fit))
        parts = [*pictures(applied, fit), more, in_numbers(fit, open=False)]
        write_result(folder, "estimate", f"Estimate of {file.name}", answer, parts)
    print(text if as_json else "\n".join(map(str, (fit, *answer.next))))


def _say_left_out(aircraft: Aircraft, records: Sequence[Record]) -> None:
    """Say of which coefficients nothing is estimated, as surfaces are not in the records."""
    axes = axes_of(records)
    of_file = {coefficient for coefficient, _, _ in aerodynamic_parameters(aircraft)}
    left = [c for c in aircraft.coefficients if c in of_file and c not in moved_coefficients(aircraft, axes)]
    missing = [s for s in SURFACES if not all(s in record for record in records)]
    if left:
        print(
            f"note: {', '.join(missing)} not in every record: the motion is taken as {axes}, and no derivatives of "
            f"{', '.join(left)} are estimated",
            file=sys.stderr,
        )


def problem_of(applied: FlownRecords, free: Sequence[str] | None, kind: str, equation_weight: float | None) -> Problem:
    """The estimation problem with a kind of cost."""
    costs = {"output": OutputError, "equation": EquationError, "combined": CombinedError, "filter": OutputError}
    cost = costs[kind]() if equation_weight is None else CombinedError(equation_weight=equation_weight)
    noise = {o: applied.aircraft.noise[o] for o in applied.model.outputs if o in applied.aircraft.noise}
    complete = kind in ("output", "filter") and len(noise) == len(applied.model.outputs)
    noise = noise if complete else None
    shared, biases = shared_and_biases(applied, free)
    made = Problem(applied.model, applied.records, free=shared, per_record=biases, cost=cost, prior=True, noise=noise)
    return replace(made, cost=noise_of_forces(made)) if kind == "filter" else made


_SENTENCES = {
    USABLE: "The estimates can be used",
    STRUCTURE_MISSING: "The model lacks structure; the numbers below are no properties of this aircraft yet",
    NOT_IDENTIFIABLE: "These data do not determine every parameter",
    NOT_CONVERGED: "No solution was found that explains these data; the numbers below are no estimates",
}


def answer_of(fit: Fit, called: Called) -> Answer:
    """Return what an estimate begins with: its verdict, why, and what to do next."""
    worst = min(fit.channels, key=lambda name: fit.channels[name].R2, default="")
    least = f", least R2 {fit.channels[worst].R2:.3g} ({worst})" if worst else ""
    records = len(fit.problem.records)
    count = f"{len(fit.values)} parameters from {records} record{'s' * (records != 1)}"
    again = f"{called.records} --aircraft {called.aircraft}"
    if fit.verdict == USABLE:
        text = "Fly the estimates beside the file as given, on a record that was not fitted:"
        command = f"casid simulate RECORD --aircraft {called.aircraft} {called.inside('model.toml')}"
    elif fit.verdict == NOT_IDENTIFIABLE:
        text = "See which parameters these records determine, and what to fly for the others:"
        command = f"casid identifiability {again} --out {called.inside('identifiability')}"
    else:
        text = "Find what the model lacks, or what is wrong with the data:"
        command = f"casid diagnose {again} --out {called.inside('diagnosis')}"
    return Answer(
        badge=fit.verdict.capitalize(),
        sentence=f"{_SENTENCES[fit.verdict]}: {count}{least}.",
        points=fit.because,
        next=(NextStep(text=text, command=command),),
        colour=GOOD if fit.verdict == USABLE else BAD,
    )


def pictures(applied: FlownRecords, fit: Fit) -> list[Picture]:
    """Estimates beside the file, and histories of every record."""
    names = list(fit.channels)
    known = [e.prior_std if math.isfinite(e.prior_std) else 0.0 for e in fit.parameters.values()]
    pairs = {"a priori": [(e.prior, std) for e, std in zip(fit.parameters.values(), known, strict=True)]}
    pairs |= {"estimated": [(e.value, e.std) for e in fit.parameters.values()]}
    drawn = [estimates(list(fit.parameters), pairs, "a priori")]
    for record in applied.records:
        predicted = fit.predictions[record.name]
        measured = predicted + fit.residuals[record.name]
        drawn.append(histories(record.name, record.t, names, measured, {"estimated model": predicted}))
    return drawn


def residuals_and_correlations(applied: FlownRecords, fit: Fit) -> list[Picture]:
    """Colour of the residuals of the first record, and correlations of the estimates."""
    residual = {"residual": fit.residuals[applied.records[0].name]}
    return [autocorrelations(list(fit.channels), residual), correlations(list(fit.parameters), fit.correlations)]


def _write_model(aircraft: Aircraft, fit: Fit, path: Path, original: Path) -> None:
    """The aircraft file with the estimates and the user's comments; not written when an estimate is not a number."""
    if all(map(math.isfinite, fit.values.values())):
        std = {name: e.std for name, e in fit.parameters.items()}
        like = original if original.suffix.lower() == ".toml" else None
        with_estimates(aircraft, fit.values, std).write(path, like=like)
