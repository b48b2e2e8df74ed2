"""Does Table 5 of the paper hold: three estimators, eight cases, and what does multiple shooting change?

Question     the four claims of Oezger, AIAA 2010-34, on equation, output and combined error: confirmed or refuted?
Set-up       cases A-H, eight manoeuvres, three nonlinear variants, five noise realisations: 384 simulated records; each
             is estimated by three estimators in three methods, from 0.7 times the truth. Statistics of eq. 17.
Expectation  A and C exact; no departure with multiple shooting, where the paper lost up to 65 of 120.
             DIR/table5.csv (case,estimator,method,statistic,value), DIR/table5.html (beside the paper's, cell by cell),
             DIR/run.json. Ctrl-C or worse leaves what was finished in DIR/campaign.sqlite; the same command resumes.

    python scripts/table5.py [--cases A..H] [--manoeuvres 1..8] [--method NAME|all] [--jobs N | --scheduler ADDRESS]
        [--cm-alpha 0.08] [--resume] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
import time
from pathlib import Path
from typing import NoReturn

from casid.errors import InputError, unknown
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from problems.campaign.run import counted, run_campaign
from problems.campaign.store import ENGINE, open_store, source_digest
from problems.paper.cases import parse_cases, parse_manoeuvres
from problems.paper.estimation import METHODS
from problems.paper.pages.table import write_table_page
from problems.paper.published import cells_of, claims, published
from problems.paper.run import run, table_rows, tasks
from problems.paper.truth import CM_ALPHA_DESTABILISED

# what the results depend on: a store made with other sources is not mixed with these
SOURCES = (
    *ENGINE,
    "problems/do328.py",
    "problems/manoeuvres.py",
    *(f"problems/paper/{part}.py" for part in ("cases", "nonlinear", "truth", "estimation", "statistics", "run")),
)
COLUMNS: tuple[str, ...] = ("case", "estimator", "method", "statistic", "value")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Table 5 of the paper, by our own run.",
        epilog="Example: python scripts/table5.py --cases A --manoeuvres 1 --method multiple-open",
    )
    parser.add_argument("--cases", default="A..H", help="letters, like A..H or A,C,F")
    parser.add_argument("--manoeuvres", default="1..8", help="numbers, like 1..8 or 1,3")
    parser.add_argument("--method", default="all", help=f"all, or one of {', '.join(METHODS)}")
    parser.add_argument(
        "--cm-alpha",
        type=float,
        default=CM_ALPHA_DESTABILISED,
        help="of the destabilised aircraft, misprinted in Table 3",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=int, default=2, help="local processes; 0: none besides this one")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a running Dask cluster, tcp://host:port")
    parser.add_argument("--resume", action="store_true", help="insist that DIR holds an earlier run to go on with")
    parser.add_argument(
        "--out", type=out_folder, default=Path("out/table5"), metavar="DIR", help="folder for the results"
    )
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see table5.py --help")


def main() -> None:
    given = arguments()
    cases, manoeuvres = parse_cases(given.cases), parse_manoeuvres(given.manoeuvres)
    if given.method != "all" and given.method not in METHODS:
        raise unknown("method", given.method, ("all", *METHODS), "--method")
    methods = tuple(METHODS) if given.method == "all" else (given.method,)
    todo = tasks(cases, manoeuvres, methods, given.cm_alpha)
    protocol = {"campaign": "table5", "Cm_alpha": given.cm_alpha, "sources": source_digest(*SOURCES)}
    made_with, begin = provenance(0), time.perf_counter()
    with open_store(given.out, protocol, given.resume) as store, progress() as stage:
        report = counted(stage, "records and methods")
        run_campaign(todo, run, store, jobs=given.jobs, scheduler=given.scheduler, report=report)
        results, seconds = store.results(), store.seconds()
    spent = sum(seconds[key] for key in todo)
    rows = table_rows(results, cases, manoeuvres, methods)
    timing = f"{len(todo)} tasks, {spent:.0f} s of work in all, {time.perf_counter() - begin:.0f} s in this run."
    with whole_folder(given.out) as folder:
        with (folder / "table5.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        answers = {method: claims(cells_of(rows, method)) for method in methods}
        words = {method: METHODS[method].words for method in methods}
        write_table_page(folder / "table5.html", rows, published(), answers, words, timing, made_with)
        write_provenance(made_with, folder / "run.json")
    for method, answer in answers.items():
        print(f"{method}: " + ", ".join(f"claim {claim.number} {claim.answer}" for claim in answer))
    print(timing)
    print(f"page: {given.out / 'table5.html'}")


if __name__ == "__main__":
    run_script(main)
