"""Which transcription finds the right optimum, from how far away, and at what price?

Question     single shooting, multiple shooting of 1 to 100 samples, collocation; hard and soft defects: who succeeds?
Set-up       one noisy record each of the stable and the destabilised Do 328, open loop on measured surfaces. Starts:
             0.7 x truth, random ones (U(0,2) x truth, 20 % of the signs flipped), a grid in two derivatives (basin).
Expectation  single shooting fails from most random starts, and always on the unstable aircraft; multiple shooting up to
             25 samples finds the optimum nearly always. DIR/compare_shooting.html and .csv. The same command resumes.

    python scripts/compare_shooting.py [--starts 100] [--method NAME ...] [--no-basin]
        [--jobs N | --scheduler ADDRESS] [--resume] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
from pathlib import Path
from typing import NoReturn

from casid.errors import InputError, unknown
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from problems.campaign.run import counted, run_campaign
from problems.campaign.store import ENGINE, open_store, source_digest
from problems.paper.pages.shooting import HEAD, summary, write_shooting_page
from problems.paper.shooting import AIRCRAFT, BASIN_METHODS, BASIN_PARAMETERS, METHODS, RIGHT, run, tasks

SOURCES = (*ENGINE, "problems/do328.py", "problems/manoeuvres.py", "problems/paper/[censt]*.py")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Compare shooting methods by whether they find the right optimum.",
        epilog="Example: python scripts/compare_shooting.py --starts 2 --no-basin --method single 'multiple 25'",
    )
    parser.add_argument("--starts", type=int, default=100, help="random starts per method and aircraft")
    parser.add_argument("--method", nargs="+", default=list(METHODS), metavar="NAME", help=", ".join(METHODS))
    parser.add_argument("--no-basin", action="store_true", help="leave the grid of the basin pictures out")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=int, default=2, help="local processes; 0: none besides this one")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a running Dask cluster, tcp://host:port")
    parser.add_argument("--resume", action="store_true", help="insist that DIR holds an earlier run to go on with")
    parser.add_argument("--out", type=out_folder, default=Path("out/compare_shooting"), metavar="DIR")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see compare_shooting.py --help")


def main() -> None:
    given = arguments()
    for method in given.method:
        if method not in METHODS:
            raise unknown("method", method, METHODS, "--method")
    if given.starts < 0:
        raise InputError(f"--starts {given.starts}: expected a number of random starts, 0 or more")
    todo, made_with = tasks(given.starts, given.method, not given.no_basin), provenance(1)
    protocol = {"campaign": "compare_shooting", "sources": source_digest(*SOURCES)}
    with open_store(given.out, protocol, given.resume) as store, progress() as stage:
        report = counted(stage, "estimations")
        run_campaign(todo, run, store, jobs=given.jobs, scheduler=given.scheduler, report=report)
        results = {key: result for key, result in store.results().items() if key in todo}
    with whole_folder(given.out) as folder:
        with (folder / "compare_shooting.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(("aircraft", *HEAD))
            for name in AIRCRAFT:
                writer.writerows([name, *row] for row in summary(results, name, given.method))
        write_shooting_page(
            folder / "compare_shooting.html",
            results,
            list(AIRCRAFT),
            given.method,
            (BASIN_METHODS, BASIN_PARAMETERS),
            RIGHT,
            made_with,
        )
        write_provenance(made_with, folder / "run.json")
    for name in AIRCRAFT:
        for row in summary(results, name, given.method):
            print(f"{name:13} {row[0]:13} right {row[1]} of {row[3]}, wrong but claimed {row[2]}")
    print(f"page: {given.out / 'compare_shooting.html'}")


if __name__ == "__main__":
    run_script(main)
