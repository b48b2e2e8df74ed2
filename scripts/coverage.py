"""How often do 95 % intervals contain the truth: with clean inputs, with noisy surfaces, with coloured noise?

Question     of every kind of interval: its coverage, and its width over the scatter that it should describe
Set-up       short period with five unknown derivatives, a flight of 10 s; Do 328, stable and destabilised, with 16, of
             20 s. Each is estimated again and again with new noise; the noise of the surfaces is known to those kinds
             that take it (problems/studies/coverage.py)
Expectation  clean: all kinds within 93-97 %. Noisy surfaces and coloured noise: the kinds that do not know about them
             promise too much. DIR/coverage.csv, DIR/run.json. The same command resumes.

    python scripts/coverage.py [--runs 500] [--draws 99] [--condition NAME ...] [--kind NAME ...]
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
from problems.studies.coverage import CONDITIONS, KINDS, Coverage, run, table, tasks

HEAD = (
    "condition",
    "interval",
    "parameter",
    "runs",
    "failed",
    "coverage",
    "width over scatter",
    "binomial low",
    "binomial high",
)
SOURCES = (*ENGINE, "problems/studies/coverage.py")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Coverage of every kind of 95 % interval by Monte Carlo.",
        epilog="Example: python scripts/coverage.py --runs 20 --draws 19 --kind cramer-rao",
    )
    parser.add_argument("--runs", type=int, default=500, help="flights per condition")
    parser.add_argument("--draws", type=int, default=99, help="draws of each bootstrap")
    parser.add_argument("--condition", nargs="+", default=list(CONDITIONS), metavar="NAME", help=", ".join(CONDITIONS))
    parser.add_argument("--kind", nargs="+", default=list(KINDS), metavar="NAME", help=", ".join(KINDS))
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=int, default=2, help="local processes; 0: none besides this one")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a running Dask cluster, tcp://host:port")
    parser.add_argument("--resume", action="store_true", help="insist that DIR holds an earlier run to go on with")
    parser.add_argument("--out", type=out_folder, default=Path("out/coverage"), metavar="DIR")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see coverage.py --help")


def main() -> None:
    given = arguments()
    for what, names, valid in (("condition", given.condition, CONDITIONS), ("kind", given.kind, KINDS)):
        for name in names:
            if name not in valid:
                raise unknown(what, name, valid, f"--{what}")
    if given.runs < 2 or given.draws < 39:
        raise InputError(f"--runs {given.runs} --draws {given.draws}: expected at least 2 and 39 (a 95 % interval)")
    todo, made_with = tasks(given.condition, given.runs, given.kind, given.draws), provenance(0)
    protocol = {"campaign": "coverage", "kinds": given.kind, "draws": given.draws, "sources": source_digest(*SOURCES)}
    with open_store(given.out, protocol, given.resume) as store, progress() as stage:
        report = counted(stage, "flights")
        run_campaign(todo, run, store, jobs=given.jobs, scheduler=given.scheduler, report=report)
        results = {key: result for key, result in store.results().items() if key in todo}
    rows = table(results)
    with whole_folder(given.out) as folder:
        with (folder / "coverage.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([HEAD, *(line for row in rows for line in cells(row))])
        write_provenance(made_with, folder / "run.json")
    for condition in dict.fromkeys(row.condition for row in rows):
        print(f"\n{condition}: {CONDITIONS[condition].words}")
        for row in (r for r in rows if r.condition == condition):
            worst, best = min(row.parameters.values()), max(row.parameters.values())
            narrow, wide = min(row.width.values()), max(row.width.values())
            print(
                f"  {KINDS[row.kind]:44} {row.share:6.1%} of {row.runs} ({worst:.1%} to {best:.1%}), width/scatter "
                f"{narrow:.2f} to {wide:.2f}" + (f", {row.failed} failed" if row.failed else "")
            )
    print(f"\none parameter at 95 % in {rows[0].runs} runs: {rows[0].low:.1%} to {rows[0].high:.1%} by chance")
    print(f"table: {given.out / 'coverage.csv'}")


def cells(row: Coverage) -> list[list[object]]:
    """A line for each parameter."""
    return [
        [row.condition, KINDS[row.kind], name, row.runs, row.failed]
        + [f"{value:.4f}" for value in (share, row.width[name], row.low, row.high)]
        for name, share in row.parameters.items()
    ]


if __name__ == "__main__":
    run_script(main)
