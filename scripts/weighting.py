"""What is the right weight between equation and output error, and is it worth sweeping it during the iteration?

Question     the combined estimator from pure output to pure equation error: what is traded for what? Does the schedule
             that the paper names as future work gain over a fixed weight, and over multiple shooting? Are weights by
             the inverse noise covariance better than 50/50 by range?
Set-up       cases B, D, F, H, eight manoeuvres, multiple shooting (curve, weights); single shooting with the control
             law in the loop from random starts, as in compare_shooting (schedule).
Expectation  a smooth trade-off; the sweep widens the basin of single shooting; multiple shooting needs none.
             DIR/weighting.html, DIR/weighting.csv (the curve), DIR/run.json. The same command resumes.

    python scripts/weighting.py [--starts 50] [--manoeuvres 1..8] [--jobs N | --scheduler ADDRESS] [--resume]
        [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
from pathlib import Path
from typing import NoReturn

from casid.errors import InputError
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from problems.campaign.run import counted, run_campaign
from problems.campaign.store import ENGINE, open_store, source_digest
from problems.paper.cases import CASES, parse_manoeuvres
from problems.paper.pages import weighting as shown
from problems.paper.pages.page import Section, figure, paragraph, table, write_page
from problems.paper.shooting import AIRCRAFT
from problems.paper.statistics import DERIVATIVE_STATISTICS, MATCHES
from problems.paper.weighting import CURVE_CASES, NOISES, STRATEGIES, WEIGHTS, run, tasks

SOURCES = (*ENGINE, "problems/do328.py", "problems/manoeuvres.py", "problems/paper/[censtw]*.py")
DOMAINS = {
    "equation domain": MATCHES[:3],
    "output domain": MATCHES[3:],
    "derivatives": [name for name in DERIVATIVE_STATISTICS if not name.endswith("0")],
}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Weights of the combined estimator.",
        epilog="Example: python scripts/weighting.py --starts 2 --manoeuvres 1",
    )
    parser.add_argument("--starts", type=int, default=50, help="random starts per strategy and aircraft")
    parser.add_argument("--manoeuvres", default="1..8", help="numbers, like 1..8 or 1,3")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=int, default=2, help="local processes; 0: none besides this one")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a running Dask cluster, tcp://host:port")
    parser.add_argument("--resume", action="store_true", help="insist that DIR holds an earlier run to go on with")
    parser.add_argument("--out", type=out_folder, default=Path("out/weighting"), metavar="DIR")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see weighting.py --help")


def main() -> None:
    given = arguments()
    if given.starts < 0:
        raise InputError(f"--starts {given.starts}: expected a number of random starts, 0 or more")
    todo, made_with = tasks(given.starts, parse_manoeuvres(given.manoeuvres)), provenance(1)
    protocol = {"campaign": "weighting", "sources": source_digest(*SOURCES)}
    with open_store(given.out, protocol, given.resume) as store, progress() as stage:
        report = counted(stage, "estimations")
        run_campaign(todo, run, store, jobs=given.jobs, scheduler=given.scheduler, report=report)
        results = {key: result for key, result in store.results().items() if key in todo}
    curve = shown.curve_rows(results, CURVE_CASES, WEIGHTS, DOMAINS)
    schedule = shown.schedule_rows(results, list(AIRCRAFT), {name: s.words for name, s in STRATEGIES.items()})
    linear = [case for case in CURVE_CASES if not CASES[case].nonlinear]
    weights = shown.statistical_rows(results, linear, NOISES, DOMAINS)
    picture = shown.trade_off(curve, {case: CASES[case].origin for case in CURVE_CASES})
    with whole_folder(given.out) as folder:
        with (folder / "weighting.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([["case", "weight", *DOMAINS], *curve])
        sections = [
            Section(title="From output to equation error", parts=[figure(picture), shown.curve_table(curve, DOMAINS)]),
            Section(
                title="The weight swept during the iteration",
                parts=[
                    paragraph("Right: within 0.05 standard deviations of the optimum of the strategy's last cost."),
                    table(shown.SCHEDULE_HEAD, schedule),
                ],
            ),
            Section(
                title="Statistically right weights",
                parts=[
                    table(["case", "weights", *DOMAINS], weights, "relative to weights by range; below 1 is better")
                ],
            ),
        ]
        lead = ["Indices are geometric means over the members of a domain, of means over the manoeuvres."]
        write_page(folder / "weighting.html", "The weight between equation and output error", lead, sections, made_with)
        write_provenance(made_with, folder / "run.json")
    for row in schedule:
        print(f"{row[0]:13} {row[1]:18} right {row[3]} of {row[5]}, wrong but claimed {row[4]}")
    for row in weights:
        print(f"case {row[0]}, weights by {row[1]:10} " + ", ".join(f"{v:.2f}" for v in row[2:]))
    print(f"page: {given.out / 'weighting.html'}")


if __name__ == "__main__":
    run_script(main)
