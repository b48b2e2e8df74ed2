"""How often does the check of flight data change or doubt records in which nothing is wrong?

Question     what does `check` correct, leave out, report or remark on healthy flights?
Set-up       clean sets of every generator (JSBSim, Do 328, F-16, the independent simulator, lifting strips), one of
             each per seed; with the data there, the real flights of `problems/faults`; and any other records.
Expectation  nothing is changed and nothing is doubted. DIR/false_alarms.md.

    python scripts/false_alarms.py [--seeds A..B] [RECORD ...] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
from collections.abc import Iterator
from pathlib import Path

from casid.data_check.check import DataFindings, check
from casid.errors import InputError
from casid.records.readers import read_record
from casid.report.folder import out_folder
from casid.report.progress import progress
from problems.blind.sets import fly_set
from problems.faults.flights import REAL, flight_data, real_flight

GENERATORS: tuple[str, ...] = ("jsbsim", "do328", "f16", "independent", "strips")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="False alarms of the check.", epilog="Example: python scripts/false_alarms.py --seeds 1..2"
    )
    parser.add_argument("records", nargs="*", type=Path, metavar="RECORD", help="further healthy records")
    parser.add_argument("--seeds", default="1..1", help="A..B")
    parser.add_argument("--out", type=out_folder, default=Path("out/false_alarms"), metavar="DIR", help="folder")
    return parser.parse_args()


def checked(given: argparse.Namespace) -> Iterator[tuple[str, str, DataFindings]]:
    """Source, name of the flight, and what the check found."""
    first, _, last = given.seeds.partition("..")
    if not (first.isdigit() and last.isdigit()):
        raise InputError(f"--seeds {given.seeds}: expected A..B, like 1..5")
    for of in GENERATORS:
        for seed in range(int(first), int(last) + 1):
            try:
                flown = fly_set(of, f"clean-{1 + seed % 4}", seed)
            except InputError:  # no flyable set is drawn by this seed
                continue
            yield of, f"{of} {seed}", check(flown.records, flown.aircraft)
    for name in REAL:
        try:
            flight = real_flight(name, flight_data())
        except InputError:
            continue
        yield "real", name, check(flight.records, flight.aircraft)
    for path in given.records:
        yield "given", path.name, check(read_record(path))


def main() -> None:
    given = arguments()
    counts: dict[str, list[int]] = {}
    said: list[str] = []
    with progress() as stage:
        for source, name, found in checked(given):
            stage(name)
            row = counts.setdefault(source, [0] * 5)
            excluded = [one for one in found.findings if one.handled == "excluded"]
            corrected = [one for one in found.findings if one.handled == "corrected"]
            others = len(found.remarks) + len(found.doubts) + len(found.impossible)
            for i, count in enumerate((1, len(corrected), len(excluded), len(found.reported), others)):
                row[i] += count
            said += [f"- {name}: {one}" for one in found.sentences]
    head = "| source | flights | corrected | left out | reported | remarks and doubts |\n|---|---|---|---|---|---|"
    rows = (f"| {source} | {' | '.join(map(str, row))} |" for source, row in counts.items())
    text = "\n".join([head, *rows, "", *said]) + "\n"
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "false_alarms.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    run_script(main)
