"""How well are these derivatives known? Every kind of 95 % interval side by side.

Question     of each derivative: Cramer-Rao, corrected for coloured residuals, with the noise of the inputs, profile
             likelihood, parametric bootstrap
Set-up       an aircraft file and flight records; output error, multiple shooting, no prior. With no record: the first
             of the demonstration records.
Expectation  they agree where residuals are white and inputs exact; otherwise the widest tells what is known (see
             scripts/coverage.py). DIR/intervals.csv. The same command resumes.

    python scripts/intervals.py [RECORD ... --aircraft FILE] [--free GLOB ...] [--input-noise delta_e=0.001 ...]
        [--draws 99] [--profile NAME ...] [--jobs N | --scheduler ADDRESS] [--seed 0] [--resume] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
import hashlib
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NoReturn

from casid.analysis import collected, profile
from casid.errors import EstimationError, InputError, unknown
from casid.estimation import Fit
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from problems.campaign.run import counted, run_campaign
from problems.campaign.store import ENGINE, open_store, source_digest
from problems.studies.draws import draw, draw_tasks, fit_of
from problems.studies.input_noise import input_noise_errors

DEMO = Path(__file__).resolve().parent.parent / "casid" / "cli" / "demo"
NORMAL = 1.959963984540054
KINDS = ("Cramer-Rao", "corrected", "noisy inputs", "profile", "bootstrap")
HEAD = ("parameter", "estimate", *(f"{kind} {end}" for kind in KINDS for end in ("low", "high")))
SOURCES = (*ENGINE, "problems/studies/draws.py")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Every kind of 95 % interval of the derivatives of an aircraft.",
        epilog="Example: python scripts/intervals.py casid/cli/demo/m1.csv --aircraft casid/cli/demo/aircraft.toml",
    )
    parser.add_argument("records", nargs="*", metavar="RECORD", help="file, or pattern like 'flight/m*.csv'")
    parser.add_argument("--aircraft", type=Path, metavar="FILE", help="aircraft file (TOML)")
    parser.add_argument("--free", nargs="+", default=[], metavar="GLOB", help="default: all derivatives")
    parser.add_argument("--axes", choices=("full", "longitudinal", "lateral"), help="default: what the surfaces allow")
    parser.add_argument("--map", action="append", default=[], help="column map: alpha=ALCG:deg, or a TOML file")
    parser.add_argument("--input-noise", nargs="+", default=[], metavar="INPUT=SIGMA", help="1-sigma of inputs, SI")
    parser.add_argument("--profile", nargs="*", default=["*"], metavar="GLOB", help="parameters profiled; default: all")
    parser.add_argument("--draws", type=int, default=99, help="draws of the bootstrap; 0: none")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=int, default=2, help="local processes; 0: none besides this one")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a running Dask cluster, tcp://host:port")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true", help="insist that DIR holds an earlier run to go on with")
    parser.add_argument("--out", type=out_folder, default=Path("out/intervals"), metavar="DIR")
    parser.error = _one_line
    return checked(parser.parse_args())


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see intervals.py --help")


def checked(given: argparse.Namespace) -> argparse.Namespace:
    if bool(given.records) != bool(given.aircraft):
        raise InputError("intervals.py: give records and --aircraft FILE together, or neither for the demonstration")
    if not given.records:
        given.records, given.aircraft = [str(DEMO / "m1.csv")], DEMO / "aircraft.toml"
    if given.draws != 0 and given.draws < 39:
        raise InputError(f"--draws {given.draws}: a 95 % interval needs at least 39, or 0 for no bootstrap")
    noise = {}
    for text in given.input_noise:
        name, _, value = text.partition("=")
        try:
            noise[name] = float(value)
        except ValueError:
            raise InputError(f"--input-noise {text}: expected INPUT=SIGMA, like delta_e=0.001") from None
    given.input_noise = noise
    return given


def main() -> None:
    given = arguments()
    made_with = provenance(given.seed)
    records = [str(Path(record).resolve()) for record in given.records]
    first, *_ = tasks = draw_tasks(
        records,
        str(given.aircraft.resolve()),
        max(given.draws, 1),
        given.seed,
        free=given.free,
        axes=given.axes,
        maps=given.map,
        input_noise=given.input_noise,
    )
    with progress() as stage:
        try:
            stage("estimation")
            fit = fit_of(tasks[first])
            ends = analytic(fit, given.input_noise)
            stage("profile likelihood")
            chosen = [n for n in fit.parameters if any(fnmatchcase(n, glob) for glob in given.profile)]
            if given.profile and not chosen:
                raise unknown("parameter", given.profile[0], fit.parameters, "--profile")
            ends["profile"] = {n: (p.lower, p.upper) for n, p in profile(fit, chosen).items()}
            if given.draws:
                ends["bootstrap"] = drawn(given, tasks, fit, counted(stage, "draws"))
        except EstimationError as error:
            raise InputError(str(error)) from None
    with whole_folder(given.out) as folder:
        with (folder / "intervals.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([HEAD, *(row(fit, ends, n) for n in fit.parameters)])
        write_provenance(made_with, folder / "run.json")
    width = max(map(len, fit.parameters))
    print(f"{'half widths':{width}} {'estimate':>11} " + " ".join(f"{kind:>12}" for kind in KINDS if kind in ends))
    for n, e in fit.parameters.items():
        halves = (ends[k][n] if n in ends[k] else (float("nan"),) * 2 for k in KINDS if k in ends)
        print(f"{n:{width}} {e.value:11.5g} " + " ".join(f"{0.5 * (high - low):12.3g}" for low, high in halves))
    print(f"table: {given.out / 'intervals.csv'}")


def analytic(fit: Fit, input_noise: Mapping[str, float]) -> dict[str, dict[str, tuple[float, float]]]:
    """kind -> parameter -> ends, of the kinds that need no further estimation."""
    std = {
        "Cramer-Rao": {n: e.std_cramer_rao for n, e in fit.parameters.items()},
        "corrected": {n: e.std_corrected for n, e in fit.parameters.items()},
    }
    if input_noise:
        std["noisy inputs"] = dict(input_noise_errors(fit, input_noise).std)
    return {
        kind: {n: (fit[n].value - NORMAL * s, fit[n].value + NORMAL * s) for n, s in own.items()}
        for kind, own in std.items()
    }


def drawn(given: argparse.Namespace, tasks: dict, fit: Fit, report) -> dict[str, tuple[float, float]]:
    """parameter -> ends of the bootstrap."""
    protocol = {
        "campaign": "intervals",
        "sources": source_digest(*SOURCES),
        "data": data_digest(given, fit),
        "seed": given.seed,
        "free": list(fit.parameters),
        "input_noise": given.input_noise,
    }
    with open_store(given.out, protocol, given.resume) as store:
        run_campaign(tasks, draw, store, jobs=given.jobs, scheduler=given.scheduler, report=report)
        results = store.results()
    found = collected(fit, (results[key] for key in tasks))
    return {name: found.interval(name) for name in fit.parameters}


def data_digest(given: argparse.Namespace, fit: Fit) -> str:
    """Fingerprint of the aircraft file and of the records as they were read."""
    digest = hashlib.sha256(given.aircraft.read_bytes())
    for record in fit.problem.records:
        for name in ("t", *record.channels):
            digest.update(f"{record.name} {name}".encode() + record[name].tobytes())
    return digest.hexdigest()[:16]


def row(fit: Fit, ends: Mapping[str, Mapping[str, tuple[float, float]]], name: str) -> list[str]:
    cells = [name, f"{fit[name].value:.8g}"]
    for kind in KINDS:
        pair = ends.get(kind, {}).get(name)
        cells += ["", ""] if pair is None else [f"{end:.8g}" for end in pair]
    return cells


if __name__ == "__main__":
    run_script(main)
