"""Fly the embedded demonstration records, casid/cli/demo.

Question     none: this makes the data that `casid demo` runs on when it is given no record.
Set-up       a Fokker 50 of JSBSim, four manoeuvres of 26 s at 50 Hz with the noise of ordinary instruments, an aircraft
             file whose derivatives are 10 to 20 per cent off; the elevator follows its command with a lag of 0.12 s,
             of which records and aircraft file know nothing.
Expectation  the same version of jsbsim makes the same files, to the last digit.

    python scripts/make_demo_records.py [--out FOLDER]        needs: pip install 'casid[jsbsim]'
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
from pathlib import Path

from casid.records.readers import write_record
from casid.report.folder import out_folder
from problems.jsbsim.apriori import aircraft_file
from problems.jsbsim.corpus import RECORDS, rounded
from problems.jsbsim.faults import Fault
from problems.jsbsim.flight import Flight, fly

AIRCRAFT = "fokker50"
HIDDEN = Fault(kind="actuator_lag", target="delta_e", size=0.12)
DURATION_S = 26.0
SEED = 2010
DEMO = Path(__file__).resolve().parent.parent / "casid" / "cli" / "demo"


def demo_flight(name: str) -> Flight:
    """The flight behind a record of the demonstration, m1 to m4."""
    seed = SEED + list(RECORDS).index(name)
    return Flight(aircraft=AIRCRAFT, manoeuvre=RECORDS[name], fault=HIDDEN, duration_s=DURATION_S, seed=seed)


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Fly the embedded demonstration records.",
        epilog="Example: python scripts/make_demo_records.py --out out/demo_records",
    )
    parser.add_argument("--out", type=out_folder, default=DEMO, help="folder to write to")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    aircraft_file(AIRCRAFT, seed=SEED).write(folder / "aircraft.toml")
    for name in RECORDS:
        write_record(rounded(fly(demo_flight(name))), folder / f"{name}.csv")
        print(f"{folder / name}.csv")


if __name__ == "__main__":
    run_script(main)
