"""Does the check of flight data find the faults that were put into them, and does it keep quiet when there are none?

Question     how often is a fault of the data found and mended, told within a set of explanations, refused at the right
             reading, missed, or taken for something else? How often is a clean flight accused?
Set-up       per seed three flights: one of JSBSim, one of the Do 328, both with noise and aircraft files that are 10 to
             30 % off, and a real one where the data are there. In each, clean and with every kind of fault in turn;
             channel, records, size and times come from the seed. Seeds from 1000 on fly other JSBSim aircraft than
             those below. Faults that only the diagnosis names (delays, misalignment, position error, thrust) must not
             be taken for any other by the check; with --diagnose they must be named by it.
Expectation  found, in its set or refused in 98 %; wrong in none; clean flights quiet in all.
             DIR/data_faults.csv (a line per flight and fault) and DIR/data_faults.md (the rates). With --everyday one
             short flight is diagnosed with the faults that engineers meet every week, in data and in the aircraft
             file; DIR/everyday.csv and .md.

    python scripts/data_faults.py [--seeds A..B] [--each N] [--kinds KIND ...] [--diagnose] [--everyday] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from casid.data_check.check import check
from casid.diagnosis.diagnose import diagnose
from casid.errors import CasidError, InputError
from casid.records.thinning import thinned
from casid.report.folder import out_folder
from casid.report.progress import progress
from problems.faults.draw import CHECKED, CLEAN, DIAGNOSED, draw
from problems.faults.everyday import ROWS
from problems.faults.fault import DataFault, with_fault
from problems.faults.flights import HealthyFlight, flights
from problems.faults.score import OUTCOMES, RIGHT, score, score_causes
from problems.faults.visible import as_it_shows

HEAD: tuple[str, ...] = ("seed", "flight", "kind", "target", "value", "records", "outcome", "said")
DIAGNOSED_HZ = 25.0  # to which records are thinned for a whole diagnosis
KINDS = (CLEAN, *CHECKED, *DIAGNOSED)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Faults of the data, found or not.",
        epilog="Example: python scripts/data_faults.py --seeds 1..1 --kinds data_sign",
    )
    parser.add_argument("--seeds", default="1..1", help="A..B; from 1000 on for reported results")
    parser.add_argument("--each", type=int, default=1, metavar="N", help="faults of every kind in every flight")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="of faults")
    parser.add_argument("--diagnose", action="store_true", help="diagnose, too; minutes per flight and fault")
    parser.add_argument("--everyday", action="store_true", help="diagnose the faults of every week in one flight")
    parser.add_argument(
        "--out", type=out_folder, default=Path("out/data_faults"), metavar="DIR", help="folder for the results"
    )
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see data_faults.py --help")


def seeds(text: str) -> range:
    """A..B, both included."""
    first, _, last = text.partition("..")
    if not (first.isdigit() and last.isdigit() and int(first) <= int(last)):
        raise InputError(f"--seeds {text}: expected A..B, like 1..5")
    return range(int(first), int(last) + 1)


def hidden(kind: str, seed: int, each: int, flight: HealthyFlight) -> Iterator[DataFault | None]:
    """The faults of a kind in a flight; one None of clean flights."""
    if kind == CLEAN:
        yield None
        return
    for number in range(each):
        fault = draw(kind, 1000 * seed + number, flight.records)
        if fault is not None:
            yield fault


def outcome(
    fault: DataFault | None, flight: HealthyFlight, seed: int, whole: bool, besides: set[tuple[str, str]]
) -> tuple[str, str]:
    """One of OUTCOMES, and what was said; `besides` gathers what a diagnosis names in the flight without a fault."""
    try:
        healthy = [thinned(record, DIAGNOSED_HZ) for record in flight.records] if whole else flight.records
        records = with_fault(fault, healthy, seed)
        if whole:
            found = diagnose(flight.aircraft, records)
            said = [*(one.sentence for one in found.data), *(one.sentence for one in found.causes)]
            not_judged = [one.what for one in found.not_judged]
            shows = None if fault is None else as_it_shows(fault, healthy, records, found.detectable)
            scored = score_causes(fault, found.data, found.causes, found.verdict, shows, besides, not_judged)
            if fault is None:
                besides |= {(one.kind, one.target) for one in found.causes}
            return scored, " ".join(said)
        checked = check(records, flight.aircraft)
    except InputError as error:
        return "refused", str(error)
    said = " ".join(one.sentence for one in (*checked.findings, *checked.doubts))
    if checked.doubts:
        return ("wrong" if fault is not None else "false alarm"), said
    if fault is not None and fault.kind in DIAGNOSED:
        return ("wrong" if checked.findings else "quiet"), said
    return score(fault, checked.findings), said


def row(seed: int, flight: HealthyFlight, fault: DataFault | None, result: tuple[str, str]) -> dict[str, object]:
    hidden_as = (CLEAN, "", "", "")
    if fault is not None:
        hidden_as = (fault.kind, _target(fault), fault.value, "+".join(fault.records))
    return dict(zip(HEAD, (seed, flight.name, *hidden_as, *result), strict=True))


def _target(fault: DataFault) -> str:
    return fault.target + (f" [{fault.unit}]" if fault.unit else "") + (f" ({fault.term})" if fault.term else "")


def table(rows: Sequence[Mapping[str, object]]) -> str:
    """Rates by kind, in markdown."""
    lines = ["| kind | " + " | ".join(OUTCOMES) + " | right |", "|---" * (len(OUTCOMES) + 2) + "|"]
    for kind in (*KINDS, "all"):
        counted = Counter(str(one["outcome"]) for one in rows if kind in ("all", one["kind"]))
        total = sum(counted.values())
        if total:
            right = sum(counted[name] for name in RIGHT)
            cells = " | ".join(str(counted[name] or "") for name in OUTCOMES)
            lines.append(f"| {kind} | {cells} | {right} of {total}, {100.0 * right / total:.1f} % |")
    return "\n".join(lines) + "\n"


def everyday(out: Path) -> str:
    """Whole diagnoses of the faults of every week; their table in markdown."""
    lines = ["| fault | outcome | verdict | named |", "|---|---|---|---|"]
    with progress() as stage, (out / "everyday.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("fault", "outcome", "verdict", "named", "sentence"))
        for one in ROWS:
            stage(one.name)
            aircraft, records = one.fly()
            try:
                found = diagnose(aircraft, records[:-1], hold_out=records[-1:])
                named = (*found.data, *found.causes)
                told = ", ".join(f"{n.kind}({n.target})" for n in named)
                cells = (one.name, one.outcome(found), found.verdict, told, found.sentence)
            except CasidError as error:
                cells = (one.name, one.refused(error), "", "", str(error))
            writer.writerow(cells)
            file.flush()
            lines.append(f"| {' | '.join(cells[:4])} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    given = arguments()
    given.out.mkdir(parents=True, exist_ok=True)
    if given.everyday:
        text = everyday(given.out)
        (given.out / "everyday.md").write_text(text, encoding="utf-8")
        print(text)
        return
    rows: list[dict[str, object]] = []
    with progress() as stage, (given.out / "data_faults.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(HEAD), lineterminator="\n")
        writer.writeheader()
        for seed in seeds(given.seeds):
            for flight in flights(seed):
                besides = set(flight.own)
                for kind in given.kinds:
                    stage(f"seed {seed}, {flight.name}, {kind}")
                    for fault in hidden(kind, seed, given.each, flight):
                        rows.append(row(seed, flight, fault, outcome(fault, flight, seed, given.diagnose, besides)))
                        writer.writerow(rows[-1])
                        file.flush()
    text = table(rows)
    (given.out / "data_faults.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    run_script(main)
