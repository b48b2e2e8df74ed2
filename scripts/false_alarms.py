"""How often does the check of flight data change or doubt records in which nothing is wrong?

Question     what does `check` correct, leave out, report or remark on healthy flights?
Set-up       clean sets of every generator (JSBSim, Do 328, F-16, the independent simulator, lifting strips, RotorPy),
             one of each per seed; with the data there, the real flights of `problems/faults`; and any other records.
Expectation  nothing is changed and nothing is doubted. DIR/false_alarms.md also names the flights that are missing.

    python scripts/false_alarms.py [--seeds A..B] [RECORD ...] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from casid.data_check.check import check
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.records.readers import read_record
from casid.records.record import Record
from casid.report.folder import out_folder
from casid.report.progress import progress
from problems.blind.sets import fly_set
from problems.faults.flights import REAL, flight_data, real_flight

Flight = tuple[Sequence[Record], Aircraft | None]
GENERATORS: tuple[str, ...] = ("jsbsim", "do328", "f16", "independent", "strips", "rotors")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="False alarms of the check.", epilog="Example: python scripts/false_alarms.py --seeds 1..2"
    )
    parser.add_argument("records", nargs="*", type=Path, metavar="RECORD", help="further healthy records")
    parser.add_argument("--seeds", default="1..1", help="A..B")
    parser.add_argument("--out", type=out_folder, default=Path("out/false_alarms"), metavar="DIR", help="folder")
    return parser.parse_args()


def flown(given: argparse.Namespace) -> Iterator[tuple[str, str, Callable[[], Flight]]]:
    """Source, name, and how its records and aircraft file are made."""
    first, _, last = given.seeds.partition("..")
    if not (first.isdigit() and last.isdigit()):
        raise InputError(f"--seeds {given.seeds}: expected A..B, like 1..5")
    for of in GENERATORS:
        for seed in range(int(first), int(last) + 1):
            yield of, f"{of} {seed}", partial(clean, of, seed)
    for name in REAL:
        yield "real", name, partial(real, name)
    for path in given.records:
        yield "given", path.name, lambda path=path: ([read_record(path)], None)


def clean(of: str, seed: int) -> Flight:
    """A set of a generator in which nothing is hidden."""
    made = fly_set(of, f"clean-{1 + seed % 4}", seed)
    return made.records, made.aircraft


def real(name: str) -> Flight:
    flight = real_flight(name, flight_data())
    return flight.records, flight.aircraft


def main() -> None:
    given = arguments()
    counts: dict[str, list[int]] = {}
    said, missing = list[str](), list[str]()
    with progress() as stage:
        for source, name, make in flown(given):
            stage(name)
            try:
                records, aircraft = make()
            except InputError as error:  # no flight is drawn by this seed, or its simulator or data are not here
                missing.append(f"- {name}: not flown: {error}")
                continue
            found = check(records, aircraft)
            row = counts.setdefault(source, [0] * 6)
            excluded = [one for one in found.findings if one.handled == "excluded"]
            corrected = [one for one in found.findings if one.handled == "corrected"]
            others = len(found.remarks) + len(found.doubts) + len(found.impossible)
            for i, count in enumerate((1, len(records), len(corrected), len(excluded), len(found.reported), others)):
                row[i] += count
            said += [f"- {name}: {one}" for one in found.sentences]
    head = "| source | flights | records | corrected | left out | reported | remarks and doubts |\n" + "|---" * 7 + "|"
    rows = (f"| {source} | {' | '.join(map(str, row))} |" for source, row in counts.items())
    text = "\n".join([head, *rows, "", *said, *missing]) + "\n"
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "false_alarms.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    run_script(main)
