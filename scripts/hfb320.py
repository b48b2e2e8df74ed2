"""HFB-320, a real flight in turbulence: what do the published estimates rest on, and what does process noise change?

Question     output error explains this record and gives a lift slope of about 3.1 per rad. Is that to be believed?
Set-up       1. output error as published (Dutra, arXiv 1909.02838): eleven derivatives, four biases, free initial state
             2. tests of its residuals: colour, and standard errors that allow for it
             3. diagnosis of the linear aircraft file, the last third held out: with all forces left free, is the air
                moving?
             4. filter error: process noise on speed and angle of attack, all noise variances of highest likelihood
             5. both models fitted to the first two thirds, judged on the last third, which they never saw
Expectation  1. every published value within one standard error; 2. residuals far from white; 3. turbulence;
             4. a lift slope of 4.3 to 4.5; 5. a far higher likelihood and smaller one-step errors with process noise. A
             free simulation need not get better: process noise says what a simulation cannot know.
             DIR/hfb320.json, DIR/figures, DIR/run.json; a table and the time of every stage; DIR/diagnosis.json and
             DIR/report.html. problems/real/hfb320_findings.md says what of it is certain.

    python scripts/hfb320.py PATH [--out DIR]        PATH: hfb320_1_10.asc, or the folder that holds it (see README)
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import json
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.flight.noise import whiteness
from casid.diagnosis.numerics import Numerics
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.estimation import Fit, Problem, solve
from casid.filtering.cost import FilterError
from casid.model.simulate import simulate
from casid.records.record import Record
from casid.report.estimate_figures import autocorrelation, autocorrelations, estimates, histories
from casid.report.figure import Picture
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.page import write_report
from casid.report.progress import progress
from problems.real import hfb320, hfb320_aircraft
from problems.real.pictures import write_pictures

FILE = "hfb320_1_10.asc"
TURBULENCE = {"w_V": 0.0, "w_alpha": 0.0}  # disturbance -> correlation time [s]; 0: white
DERIVATIVES = tuple(hfb320.PUBLISHED)
OUTPUT_ERROR, FILTER_ERROR = "output error", "with process noise"


def residual_tests(channels: tuple[str, ...], residuals: np.ndarray) -> dict[str, dict[str, float]]:
    """Channel -> r.m.s., lag-1 autocorrelation and Ljung-Box p-value of residuals (N, channels)."""
    seen, lags = np.isfinite(residuals), round(Numerics().samples_per_cycle)
    return {
        name: {
            "rms": float(np.sqrt(np.nanmean(residuals[:, i] ** 2))),
            "lag1": float(autocorrelation(residuals[seen[:, i], i], 1)[1]),
            "whiteness_p": whiteness(residuals[:, i : i + 1], seen[:, i : i + 1], lags),
        }
        for i, name in enumerate(channels)
    }


def air(diagnosis: Diagnosis) -> dict[str, float]:
    """Turbulence by kinematics alone: r.m.s. gust [m/s], its 1-sigma, drop of the deviance against calm air."""
    found = diagnosis.turbulence
    return {"sigma": found.sigma, "std": found.std, "gain": found.gain, "named": float(found.named)}


def held_out(record: Record) -> dict[str, Any]:
    """Both models fitted to the first two thirds and judged on the last."""
    cut = record.t[0] + 2.0 / 3.0 * record.duration
    seen, unseen = record.between(-np.inf, cut), record.between(cut, np.inf, "last third")
    judged: dict[str, Any] = {
        "persistence": {"one_step_rms": rms(np.diff(unseen.matrix(hfb320.model().outputs), axis=0))}
    }
    for label, noise in ((OUTPUT_ERROR, {}), (FILTER_ERROR, TURBULENCE)):
        fit = filtered(hfb320.problem(seen), noise)
        here = one_step(unseen, fit)
        judged[label] = {
            "status": fit.status,
            "CL_alpha": fit.values["CL_alpha"],
            "log_likelihood_per_sample": here.log_likelihood / samples(here),
            "fitted_log_likelihood_per_sample": fit.log_likelihood / samples(fit),
            "one_step_rms": rms(here.residuals[unseen.name]),
            "simulation_rms": rms(free_simulation(unseen, fit, here)),
        }
    return judged


def filtered(problem: Problem, process_noise: Mapping[str, float]) -> Fit:
    """The fit of a problem by filter error."""
    return solve(replace(problem, cost=FilterError(process_noise=process_noise)))


def one_step(record: Record, fit: Fit) -> Fit:
    """The prediction of a record from sample to sample, with the parameters and the noise of a fit."""
    sigma = {name: one for name, (one, _) in fit.process_noise.items()}
    cost = FilterError(process_noise={name: tau for name, (_, tau) in fit.process_noise.items()}, sigma=sigma)
    return solve(Problem(hfb320.model(), [record], fixed=fit.values, noise=fit.noise, cost=cost))


def samples(fit: Fit) -> int:
    return sum(channel.samples for channel in fit.channels.values())


def free_simulation(record: Record, fit: Fit, here: Fit) -> np.ndarray:
    """(N, outputs) measured minus simulated without any correction, from the smoothed state at the first sample."""
    model = hfb320.model()
    flown = simulate(model, record, here.states[record.name].trajectory[0], dict(fit.values))
    return record.matrix(model.outputs) - flown.outputs


def rms(errors: np.ndarray) -> dict[str, float]:
    """Output -> r.m.s. of errors (N, outputs)."""
    values = np.sqrt(np.nanmean(errors**2, axis=0))
    return dict(zip(hfb320.model().outputs, values.tolist(), strict=True))


def pictures(record: Record, fit: Fit, turbulent: Fit) -> list[Picture]:
    channels = fit.problem.model.outputs
    residuals = {OUTPUT_ERROR: fit.residuals[record.name], FILTER_ERROR: turbulent.residuals[record.name]}
    measured = record.matrix(channels)
    pairs = {
        "published": [(value, 0.0) for value in hfb320.PUBLISHED.values()],
        OUTPUT_ERROR: [(fit[n].value, fit[n].std_cramer_rao) for n in DERIVATIVES],
        FILTER_ERROR: [(turbulent[n].value, turbulent[n].std_cramer_rao) for n in DERIVATIVES],
    }
    simulated = {OUTPUT_ERROR: fit.predictions[record.name]}
    return [
        autocorrelations(channels, residuals),
        estimates(DERIVATIVES, pairs, "published"),
        histories(record.name, record.t, channels, measured, simulated),
    ]


def table(fit: Fit, turbulent: Fit, results: dict[str, Any]) -> str:
    lines = [f"{'':12} {'published':>10} {OUTPUT_ERROR:>12} {'std':>8} {'corrected':>9} {FILTER_ERROR:>18} {'std':>8}"]
    for name in DERIVATIVES:
        e, published = fit[name], hfb320.PUBLISHED[name]
        lines.append(
            f"{name:12} {published:10.5f} {e.value:12.5f} {e.std_cramer_rao:8.2g} {e.std_corrected:9.2g} "
            f"{turbulent.values[name]:18.5f} {turbulent[name].std_cramer_rao:8.2g}"
        )
    air = results["air"]
    lines += [
        "",
        f"turbulence by kinematics alone: {air['sigma']:.2f} m/s r.m.s. (gain {air['gain']:.0f} in 2 ln L)",
        "",
    ]
    lines += columns(
        "lag-1 autocorrelation",
        {
            f"{OUTPUT_ERROR}, residual": {c: test["lag1"] for c, test in results["residuals"].items()},
            f"{FILTER_ERROR}, innovation": {c: test["lag1"] for c, test in results["innovations"].items()},
        },
    )
    judged = results["held_out"]
    lines += ["", "last third, never fitted: log likelihood per sample"]
    lines += [f"{k:>32} {judged[k]['log_likelihood_per_sample']:10.3f}" for k in (OUTPUT_ERROR, FILTER_ERROR)]
    lines += columns("r.m.s. error, one step", {k: v["one_step_rms"] for k, v in judged.items()})
    simulated = {k: v["simulation_rms"] for k, v in judged.items() if "simulation_rms" in v}
    return "\n".join(lines + columns("r.m.s. error, free simulation", simulated))


def columns(title: str, rows: dict[str, dict[str, float]]) -> list[str]:
    """Lines of a table with one column per output."""
    names = list(next(iter(rows.values())))
    lines = [f"{title:>32} " + " ".join(f"{name:>10}" for name in names)]
    return lines + [f"{label:>32} " + " ".join(f"{row[n]:10.4g}" for n in names) for label, row in rows.items()]


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Output error and filter error on the HFB-320 record.",
        epilog="Example: python scripts/hfb320.py data/fvsysid --out out/hfb320",
    )
    parser.add_argument("path", type=Path, help=f"{FILE}, or the folder that holds it")
    parser.add_argument("--out", type=out_folder, default=Path("out/hfb320"), help="folder for the results")
    given = parser.parse_args()
    path = given.path / FILE if given.path.is_dir() else given.path
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected {FILE}, see README under 'Flight data'")
    record, made_with = hfb320.record_from(path), provenance(0)
    with whole_folder(given.out) as folder, progress() as stage:
        clock = Clock(stage)
        problem: Problem = clock.run("reading", hfb320.problem, record)
        fit = clock.run("output error", solve, problem)
        tests = clock.run("residual tests", residual_tests, problem.model.outputs, fit.residuals[record.name])
        longitudinal = hfb320_aircraft.longitudinal(record)
        diagnosis = clock.run("diagnosis", diagnose, hfb320_aircraft.aircraft(), [longitudinal])
        turbulent = clock.run("filter error", filtered, problem, TURBULENCE)
        white = residual_tests(problem.model.outputs, turbulent.innovations[record.name])
        judged = clock.run("held-out third", held_out, record)
        results = {
            "schema": "casid.hfb320/1",
            "published": hfb320.PUBLISHED,
            "output_error": fit.to_dict(),
            "residuals": tests,
            "air": air(diagnosis),
            "filter_error": turbulent.to_dict(),
            "innovations": white,
            "held_out": judged,
            "seconds": clock.seconds,
        }
        clock.run("figures", write_pictures, pictures(record, fit, turbulent), folder / "figures")
        (folder / "hfb320.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        diagnosis.write(folder / "diagnosis.json")
        clock.run("report", write_report, diagnosis, folder, made_with)
        write_provenance(made_with, folder / "run.json")
    print(table(fit, turbulent, results))
    print(diagnosis)
    print("\n".join(f"{seconds:7.2f} s  {name}" for name, seconds in clock.seconds.items()))


class Clock:
    """Wall time per stage."""

    def __init__(self, stage: Any) -> None:
        self.seconds: dict[str, float] = {}
        self._stage = stage

    def run(self, name: str, work: Any, *arguments: Any) -> Any:
        self._stage(name)
        begin = time.perf_counter()
        result = work(*arguments)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
        return result


if __name__ == "__main__":
    run_script(main)
