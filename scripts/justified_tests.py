"""Does a diagnosis justify the tests that a flight simulation fails, and does its repair lose none?

Question     of hidden faults: is the cause right, is every failed test in tolerance once the simulation is repaired,
             and is no test lost that was in tolerance?
Set-up       aircraft flown by JSBSim with one hidden effect, as in `blind.py --sets jsbsim`: four records, of which
             the first three are fitted, and an aircraft file with derivatives that are 10 to 30 % off. Every manoeuvre
             that a test of 14 CFR Part 60, table A2A, can be flown in is one test, at most ten a fault. A cause is
             right when the hidden one is in the first set that is named. A mass, an inertia or a centre of gravity
             that is wrong in the same way in all records moves the aircraft as other derivatives do: it has no name
             in flight data, and is right when no cause is named and values of its rows have moved.
Expectation  nine of ten causes right; every test in tolerance with the repaired file; none lost.
             DIR/justified.csv (a line per fault), DIR/run.json.

    python scripts/justified_tests.py [--faults 10] [--seed 2401] [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NoReturn

import casid as cs
from casid.acceptance.checks import EXTENDED, GIVEN
from casid.errors import InputError
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from problems.blind.case import Hidden
from problems.blind.score import score
from problems.blind.sets import Set, fly_set
from problems.blind.solve import shortened

# faults that a flight-test engineer meets in a device, in the order in which they are drawn
CASES = (
    "actuator_lag",
    "aero_term",
    "cg_offset",
    "inertia",
    "input_delay",
    "effectiveness_change",
    "unsteady_aero",
    "rate_limit",
    "mass",
    "thrust_line",
)
_TESTS = 10  # of a fault
VALUES = "values of its rows"
# coefficients whose derivatives imitate a loading that all records have: kind and target -> rows
_FORCES = ("CL", "CD", "CX", "CY", "CZ")
_ROWS = {
    ("mass", ""): _FORCES,
    ("inertia", "Ixx"): ("Cl",),
    ("inertia", "Iyy"): ("Cm",),
    ("inertia", "Izz"): ("Cn",),
    ("inertia", "Ixz"): ("Cl", "Cn"),
    ("cg_offset", "x"): ("Cm", "Cn"),
    ("cg_offset", "y"): ("Cl", "Cn"),
    ("cg_offset", "z"): ("Cl", "Cm"),
}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one fault: tests out of tolerance as given and with the repaired file, and tests lost by it."""

    case: str
    aircraft: str
    named: str
    right: bool
    tests: int
    failed_as_given: int
    failed_repaired: int
    not_judged_repaired: int
    lost: int


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Tests that a simulator fails, justified and repaired.",
        epilog="Example: python scripts/justified_tests.py --faults 2",
    )
    parser.add_argument("--faults", type=int, default=len(CASES), help=f"how many, up to {len(CASES)}")
    parser.add_argument("--seed", type=int, default=2401, help="of the flights")
    parser.add_argument("--out", type=out_folder, default=Path("out/justified"), metavar="DIR")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see justified_tests.py --help")


def main() -> None:
    given = arguments()
    if not 1 <= given.faults <= len(CASES):
        raise InputError(f"--faults {given.faults}: expected 1 to {len(CASES)}")
    made_with = provenance(given.seed)
    with progress() as stage, whole_folder(given.out) as folder:
        outcomes = []
        for outcome in outcomes_of(CASES[: given.faults], given.seed):
            outcomes.append(outcome)
            stage(f"{outcome.case}: {outcome.named}, {outcome.failed_as_given} failed, {outcome.failed_repaired} left")
        with (folder / "justified.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(asdict(outcomes[0])))
            writer.writeheader()
            writer.writerows(map(asdict, outcomes))
        write_provenance(made_with, folder / "run.json")
    print(summary(outcomes))


def outcomes_of(cases: tuple[str, ...], seed: int) -> Iterator[Outcome]:
    """Fly, diagnose and judge one fault after another."""
    for case in cases:
        yield judged(fly_set("jsbsim", case, seed))


def judged(flown: Set) -> Outcome:
    """Diagnose a set, and fly every test again with the repaired file."""
    *fitted, held_out = flown.records
    found = cs.diagnose(flown.aircraft, fitted, hold_out=[held_out])
    told = score(flown.answer, shortened(found))
    by_values = told_by_values(flown.answer.hidden[0], found)
    proof = cs.proof_of_match(flown.aircraft, flown.records, diagnosis=found)
    tests = proof.tests[:_TESTS]
    before, after = ([one.sides[label].passed for one in tests] for label in (GIVEN, EXTENDED))
    return Outcome(
        case=flown.answer.case,
        aircraft=flown.answer.aircraft,
        named=VALUES if by_values else told.named,
        right=told.first or by_values,
        tests=len(tests),
        failed_as_given=before.count(False),
        failed_repaired=after.count(False),
        not_judged_repaired=after.count(None),
        lost=sum(one in tests for one in proof.lost),
    )


def told_by_values(hidden: Hidden, found: cs.Diagnosis) -> bool:
    """Tell a loading of all records that has no name, and whose rows have the values that moved."""
    if not hidden.imitated or found.causes:
        return False
    moved = {one["parameter"].split("_")[0] for one in found.to_dict()["moved"]}
    return bool(moved & set(_ROWS[hidden.kind, hidden.target]))


def summary(outcomes: list[Outcome]) -> str:
    """Add up the outcomes."""
    total = {name: sum(getattr(one, name) for one in outcomes) for name in ("right", "tests", "lost")}
    values = sum(one.named == VALUES for one in outcomes)
    failed = sum(one.failed_as_given for one in outcomes), sum(one.failed_repaired for one in outcomes)
    return (
        f"{total['right']} of {len(outcomes)} causes right, {values} of them told by values; "
        f"{failed[0]} of {total['tests']} tests out of tolerance as given, {failed[1]} with the repaired file; "
        f"{total['lost']} lost"
    )


if __name__ == "__main__":
    run_script(main)
