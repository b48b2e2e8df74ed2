"""What does the simulation get wrong, why, and how much better is the extended model on data it never saw?

Question     the aircraft file flies the recorded inputs; where and why does it miss what was measured?
Set-up       RECORD ... are fitted, --hold-out RECORD ... are only used to judge. Without --hold-out the last record is
             held back, or of a single one its last third. Without any record: the Fokker 50 of casid/cli/demo, whose
             elevator lags its command by 0.12 s, which the aircraft file does not know.
Expectation  DIR/report.html (one page for a person), DIR/diagnosis.json (the same for a program), DIR/extended.toml
             (an aircraft file with the causes that were found), DIR/report_figures, DIR/run.json (made with what).
             Status 0 whatever is found; 2 and one line for bad input.

    python scripts/diagnose.py [RECORD ...] [--aircraft FILE] [--hold-out RECORD ...] [--map CHANNEL=COLUMN:unit]
        [--out DIR] [--seed N] [--quick]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NoReturn

from casid.diagnosis.diagnose import diagnose
from casid.errors import InputError, run_script
from casid.model.aircraft import Aircraft
from casid.records.column_map import ColumnMap
from casid.records.readers import read_records
from casid.records.record import Record
from casid.records.thinning import thinned
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.page import write_report
from casid.report.progress import progress

DEMO = Path(__file__).resolve().parent.parent / "casid" / "cli" / "demo"
QUICK_RATE_HZ = 25.0


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Diagnose what a flight simulation lacks, from flight records.")
    parser.add_argument("records", nargs="*", metavar="RECORD", help="file, or pattern like 'flight/m*.csv'")
    parser.add_argument("--aircraft", type=Path, metavar="FILE", help="aircraft file (TOML)")
    parser.add_argument("--hold-out", nargs="+", default=[], metavar="RECORD", help="records that are never fitted")
    parser.add_argument("--map", action="append", default=[], help="column map: alpha=ALCG:deg, or a TOML file")
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis"), metavar="DIR", help="folder for the results")
    parser.add_argument("--seed", type=int, default=0, help="kept with the results; no step draws random numbers")
    parser.add_argument("--quick", action="store_true", help=f"thin the records to {QUICK_RATE_HZ:.0f} Hz")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see diagnose.py --help")


def flight(given: argparse.Namespace) -> tuple[Aircraft, list[Record], list[Record]]:
    """Aircraft, records to fit and records held out. What is held out is not fitted, also when it is given twice."""
    if given.hold_out and not given.records:
        raise InputError(
            "--hold-out needs records to fit beside it; expected: diagnose.py RECORD ... --hold-out RECORD"
        )
    if given.records and not given.aircraft:
        raise InputError("--aircraft FILE is missing; the records alone do not say what flew")
    columns = ColumnMap.from_options(given.map)
    held_files = [r.source for r in read_records(given.hold_out, columns)] if given.hold_out else []
    files = [r.source for r in read_records(given.records or [DEMO / "m*.csv"], columns)]
    fit_files = [file for file in files if Path(file).resolve() not in {Path(held).resolve() for held in held_files}]
    both = read_records([*fit_files, *held_files], columns)
    if given.quick:
        both = [thinned(record, QUICK_RATE_HZ) for record in both]
    aircraft = Aircraft.read(given.aircraft or DEMO / "aircraft.toml")
    return aircraft, both[: len(fit_files)], both[len(fit_files) :]


def main() -> None:
    given = arguments()
    aircraft, records, held_out = flight(given)
    made_with = provenance(given.seed)
    with whole_folder(given.out) as folder, progress() as stage:
        diagnosis = diagnose(aircraft, records, held_out, report=stage)
        stage("report")
        diagnosis.write(folder / "diagnosis.json")
        diagnosis.extended_aircraft.write(folder / "extended.toml")
        write_provenance(made_with, folder / "run.json")
        started = time.perf_counter()
        write_report(diagnosis, folder, made_with)
        reported = time.perf_counter() - started
    for name, seconds in {**diagnosis.seconds, "report": reported}.items():
        print(f"{seconds:7.1f} s  {name}")
    print(diagnosis)
    print(f"report: {given.out / 'report.html'}")


if __name__ == "__main__":
    run_script(main)
