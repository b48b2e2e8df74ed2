"""Does the diagnosis find effects that were hidden from it, and does it keep quiet when there is nothing?

Question     how often is the hidden effect named first, how often something wrong, on clean data, on two effects at
             once, on effects that the catalogue does not have; are sizes and onsets inside their intervals?
Set-up       "do328": the Do 328 flown by casid; "jsbsim": aircraft flown by JSBSim with the effect made there; "f16":
             the F-16 of NASA's check cases, on its tables and in closed loop (CASID_DATA names its files); the same
             with "_instruments": recorded by instruments as they are (`problems.blind.instruments`); "independent": a
             simulator that shares no code with casid (`problems.independent`, five records); "strips": aircraft of
             lifting strips, a third in turbulence, two thirds in closed loop (`problems.strips`); "rotors":
             multirotors of RotorPy (`problems.rotors`, one record, needs casid[rotorpy]). Every other set has
             four records and an aircraft file with derivatives that are 10 to 30 % off; inputs, rates, noise, kind,
             place, size and onset come from the seed. Seeds below 1000 are for development, seeds from 1000 on
             for reported results. The sealed answers are opened only when all diagnoses are done; the process that
             diagnoses is given nothing but the folder with records and aircraft file.
Expectation  "do328": 98 % right, family 99 %; "jsbsim": 95 % and 97 %; clean data without a name.
             DIR/blind.md, DIR/blind.csv (a line per set), DIR/confusion_<set>.csv and .svg, DIR/run.json. Ctrl-C
             makes them of the sets that are finished; the same command resumes, also after worse.

    python scripts/blind.py [--sets do328 jsbsim f16 do328_instruments ...] [--seeds 1..1] [--kinds GLOB ...]
        [--sizes 1 0.5 0.25] [--jobs N | --scheduler ADDRESS] [--resume] [--out DIR]
        [--table FILE] [--criteria FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import csv
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NoReturn

from casid.diagnosis.criteria import Criteria
from casid.errors import InputError
from casid.model.vocabulary import KINDS
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.progress import progress
from casid.report.svg import svg
from problems.blind.calibration import log_score, reliability, stated
from problems.blind.case import OUTSIDE, Answer
from problems.blind.confusion import confusion_matrix
from problems.blind.score import NOTHING, UNEXPLAINED, Score, score
from problems.blind.sets import REPORTING_FROM, SETS, cases_of, generate, set_name
from problems.blind.solve import solve
from problems.blind.table import by_kind, columns, confusion, markdown, power, rows, summary
from problems.campaign.run import counted, run_campaign
from problems.campaign.store import ENGINE, open_store, source_digest

GENERATOR = (
    "problems/blind/*.py",
    "problems/jsbsim/*.py",
    "problems/do328.py",
    "problems/independent/*.py",
    "problems/strips/*.py",
    "problems/rotors/*.py",
    "casid/model/**/*.py",
)
SOLVER = ("casid/diagnosis/**/*.py", *ENGINE)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Blind tests of the diagnosis.",
        epilog="Example: python scripts/blind.py --sets jsbsim --seeds 1..1 --kinds actuator_lag --jobs 0",
    )
    parser.add_argument("--sets", nargs="+", choices=SETS, default=["do328", "jsbsim"])
    parser.add_argument("--seeds", default="1..1", help=f"A..B; from {REPORTING_FROM} on for reported results")
    parser.add_argument("--kinds", nargs="+", default=["*"], metavar="GLOB", help="of cases, like 'sensor_*' or clean*")
    parser.add_argument(
        "--sizes",
        nargs="+",
        type=float,
        default=[1.0],
        metavar="FACTOR",
        help="on the size of what is hidden, for detection against size; the other tables are of size 1",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=int, default=2, help="local processes; 0: none besides this one")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a running Dask cluster, tcp://host:port")
    parser.add_argument("--resume", action="store_true", help="insist that DIR holds an earlier run to go on with")
    parser.add_argument(
        "--out", type=out_folder, default=Path("out/blind"), metavar="DIR", help="folder for the results"
    )
    parser.add_argument("--table", type=Path, metavar="FILE", help="write the Markdown table there too")
    parser.add_argument("--criteria", type=Path, metavar="FILE", help="other values of criteria, in TOML")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see blind.py --help")


def parse_seeds(text: str) -> range:
    """ "3..5" -> 3, 4, 5. InputError for anything else, and for seeds of both kinds."""
    found = re.fullmatch(r"(\d+)(?:\.\.(\d+))?", text)
    if not found:
        raise InputError(f"--seeds {text}: expected A..B, like 1..3")
    first, last = int(found[1]), int(found[2] or found[1])
    if last < first or (first < REPORTING_FROM) != (last < REPORTING_FROM):
        raise InputError(f"--seeds {text}: expected A..B upwards, all below {REPORTING_FROM} or all from it on")
    return range(first, last + 1)


def tasks(
    sets: Sequence[str], seeds: range, globs: Sequence[str], sizes: Sequence[float], out: Path
) -> dict[str, dict[str, Any]]:
    """Name of a set -> task for `generate`. What hides nothing has one size."""
    if min(sizes) <= 0.0:
        raise InputError(f"--sizes {' '.join(map(str, sizes))}: expected factors above zero, like 1 0.5")
    chosen = {of: [case for case in cases_of(of) if any(fnmatchcase(case, glob) for glob in globs)] for of in sets}
    if not any(chosen.values()):
        cases = dict.fromkeys(case for of in sets for case in cases_of(of))
        raise InputError(f"--kinds {' '.join(globs)}: fits none of {', '.join(cases)}")
    where = {"sets": str(out / "sets"), "answers": str(out / "answers")}
    return {
        set_name(of, case, seed, size): {"of": of, "case": case, "seed": seed, "size": size, **where}
        for seed in seeds
        for of in sets
        for case in chosen[of]
        for size in (sizes if case in KINDS else (1.0,))
    }


def run(given: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Generate and diagnose what is not done yet, until it is done or Ctrl-C: the number of sets that were asked for,
    and name -> what was found, of those that are finished."""
    out = given.out.resolve()
    todo = tasks(given.sets, parse_seeds(given.seeds), given.kinds, given.sizes, out)
    how: dict[str, Any] = {"jobs": given.jobs, "scheduler": given.scheduler}
    with progress() as stage:
        with open_store(out / "answers", {"campaign": "blind", "sources": source_digest(*GENERATOR)}) as store:
            run_campaign(todo, generate, store, report=counted(stage, "hiding"), **how)
        protocol = {"campaign": "diagnosis", "sources": source_digest(*SOLVER)}
        other: dict[str, str] = {}
        if given.criteria:
            protocol["criteria"] = repr(Criteria.read(given.criteria).changes)
            other["criteria"] = str(given.criteria.resolve())
        blind = {name: {"folder": str(out / "sets" / name), **other} for name in sorted(todo)}
        with open_store(out, protocol, given.resume) as store:
            with suppress(KeyboardInterrupt):
                run_campaign(blind, solve, store, report=counted(stage, "diagnosing"), **how)
            found = {name: result for name, result in store.results().items() if name in blind}
    return len(todo), found


def main() -> None:
    given = arguments()
    made_with, begin = provenance(0), time.perf_counter()
    wanted, found = run(given)
    if not found:
        raise SystemExit(130)
    scores = {
        name: score(Answer.read(given.out / "answers" / f"{name}.json"), result) for name, result in found.items()
    }
    command = " ".join(["python scripts/blind.py", *_options(given)])
    pairs = [pair for name, s in scores.items() for pair in stated(s.answer, found[name])]
    text = page(list(scores.values()), wanted, command, made_with["commit"])
    score_of_all = f"Log score {log_score(pairs) / len(scores):.2f} nats a set, of all causes; 0 is perfect."
    text += "\n\n".join(["", "## Probabilities", score_of_all, markdown(reliability(pairs))]) + "\n"
    with whole_folder(given.out) as folder:
        (folder / "blind.md").write_text(text, encoding="utf-8")
        write_lines(folder / "blind.csv", [line(name, s, found[name]) for name, s in scores.items()])
        for of in given.sets:
            write_confusion(folder, of, [s for s in scores.values() if s.answer.of == of and s.answer.size == 1.0])
        write_provenance(made_with, folder / "run.json")
    if given.table:
        given.table.write_text(text, encoding="utf-8")
    print(text)
    took = f"{time.perf_counter() - begin:.0f} s in this run"
    print(f"{len(scores)} of {wanted} sets, {took}; table: {given.out / 'blind.md'}")
    if len(scores) < wanted:
        raise SystemExit(130)


def _options(given: argparse.Namespace) -> list[str]:
    sizes = ["--sizes", *(f"{size:g}" for size in given.sizes)]
    kinds = [f"'{glob}'" for glob in given.kinds]
    other = ["--criteria", str(given.criteria)] if given.criteria else []
    return ["--sets", *given.sets, "--seeds", given.seeds, "--kinds", *kinds, *sizes, *other]


def page(scores: Sequence[Score], wanted: int, command: str, commit: str | None) -> str:
    """The results in Markdown; `wanted` is the number of sets that the command asks for."""
    seeds = sorted({s.answer.seed for s in scores})
    use = "reporting" if seeds[0] >= REPORTING_FROM else "development"
    parts = [
        "# Blind tests of the diagnosis",
        f"Made by `{command}` at commit {commit}: {len(scores)} of {wanted} sets finished, seeds {seeds[0]} "
        f"to {seeds[-1]} ({use}). A name is right when kind, "
        "target and term are; causes that the diagnosis says it cannot tell apart count as one. Families: controls, "
        "sensors, aerodynamics, mass and propulsion, air (`problems/blind/case.py`).",
    ]
    for of in SETS:
        every = [s for s in scores if s.answer.of == of]
        if not every:
            continue
        here = [s for s in every if s.answer.size == 1.0]
        parts.append(f"## {of}: {', '.join(sorted({s.answer.aircraft for s in every}))}")
        if here:
            found = [{"what": what, "measured": measured} for what, measured in summary(here)]
            parts += [markdown(found), "### By kind", markdown(by_kind(here))]
        detected = power(every)
        if len(detected) > 1 or not here:
            parts += ["### Detection against size", markdown(detected)]
    return "\n\n".join(parts) + "\n"


def line(name: str, s: Score, found: Mapping[str, Any]) -> dict[str, Any]:
    """A set in one line."""
    hidden = "; ".join(_words(h.__dict__) for h in s.answer.hidden)
    causes = "; ".join(_words(c) for c in found.get("causes", ()))
    return {
        "name": name,
        "of": s.answer.of,
        "case": s.answer.case,
        "seed": s.answer.seed,
        "size": s.answer.size,
        "aircraft": s.answer.aircraft,
        "hidden": hidden,
        "verdict": s.verdict,
        "causes": causes,
        "first": s.first,
        "family": s.same_family,
        "hits": s.hits,
        "wrong": s.wrong,
        "seconds": round(s.seconds, 1),
        "unexplained": " ".join(found.get("unexplained", ())),
        "failed": found.get("failed", ""),
    }


def _words(one: Mapping[str, Any]) -> str:
    inside = (one["target"] or "") + (f":{one['term']}" if one["term"] else "")
    return f"{one['kind']}({inside}) {one['value']:.3g}"


def write_lines(path: Path, table: Sequence[Mapping[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)


def write_confusion(folder: Path, of: str, scores: Sequence[Score]) -> None:
    counts = confusion(scores)
    cells = [
        {"hidden": row, "named": column, "sets": counts.get((row, column), 0)} for row in rows() for column in columns()
    ]
    filled = [cell for cell in cells if cell["sets"]]
    if not filled:
        return  # pairs of effects have no place in it
    write_lines(folder / f"confusion_{of}.csv", filled)
    right = {row: (row,) for row in rows()} | {"clean": (NOTHING,)}
    right |= dict.fromkeys(OUTSIDE, (UNEXPLAINED,))
    drawn = confusion_matrix(counts, rows(), columns(), right, f"Blind tests, {of}")
    (folder / f"confusion_{of}.svg").write_bytes(svg(drawn.figure))


if __name__ == "__main__":
    run_script(main)
