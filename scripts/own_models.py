"""Are faults found in flights when the model is the aircraft's own file: JSBSim's XML, the F-16's DAVE-ML?

Question     How often is the hidden effect named first, or in the set of the first, and how often is something named in
             clean flights, when nothing of the model's structure is approximated?
Set-up       problems/jsbsim/own_model.py: the flights of problems/blind ("jsbsim", "f16"), with the file that was flown
             as the aircraft file. Cases in turn, 20 hidden and 8 clean of a seed, seeds from `--seed` on; below 1000
             are for development. A run into the folder of an earlier one goes on where that ended.
Expectation  First or in its set 95 %; clean flights without a name.

    python scripts/own_models.py [--of jsbsim|f16] [--seed 1] [--minutes 15] [--cases NAME ...]
                                 [--out DIR]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from casid.errors import InputError
from casid.report.folder import out_folder
from problems.blind.score import NOTHING, score
from problems.blind.solve import solve
from problems.jsbsim.own_model import hide_in_own

CASES = (
    "actuator_lag",
    "clean-1",
    "aero_term",
    "input_delay",
    "sensor_bias",
    "cg_offset",
    "clean-2",
    "sensor_scale",
    "effectiveness_change",
    "clean-3",
    "rate_limit",
    "unsteady_aero",
    "clean-4",
    "sensor_delay",
    "mass",
    "wind_shear",
    "clean-5",
    "vane_position",
    "dead_zone",
    "clean-6",
    "inertia",
    "sensor_lag",
    "clean-7",
    "gust",
    "backlash",
    "thrust_asymmetry",
    "clean-8",
    "configuration_change",
)


_ROWS = "rows.json"


def main() -> None:
    options = argparse.ArgumentParser(
        description=(__doc__ or "").splitlines()[0],
        epilog="Example: python scripts/own_models.py --of jsbsim --minutes 2",
    )
    options.add_argument("--of", choices=("jsbsim", "f16"), default="jsbsim")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--minutes", type=float, default=15.0, help="after which no set is begun")
    options.add_argument("--cases", nargs="+", default=list(CASES))
    options.add_argument("--out", type=out_folder, default=Path("out/own_models"))
    given = options.parse_args()
    rows = _flown_before(given.out)
    done = {(row["of"], row["case"], row["seed"]) for row in rows}
    begin = time.monotonic()
    for case, seed in _in_turn(given.cases, given.seed):
        if time.monotonic() - begin > 60.0 * given.minutes:
            break
        if (given.of, case, seed) in done:
            continue
        try:
            rows.append(_row(given.of, case, seed, given.out / f"{given.of}_{case}_{seed}"))
        except InputError as error:
            print(f"not flown: {error}", flush=True)
            continue
        print(json.dumps(rows[-1]), flush=True)
        (given.out / _ROWS).write_text(json.dumps(rows, indent=1), encoding="utf-8")
    hidden = [row for row in rows if not row["case"].startswith("clean")]
    visible = [row for row in hidden if not row["imitated"]]
    clean = [row for row in rows if row["case"].startswith("clean")]
    print(f"first or in its set: {sum(row['first'] for row in hidden)} of {len(hidden)}")
    print(f"of these, without what free derivatives imitate: {sum(row['first'] for row in visible)} of {len(visible)}")
    print(f"clean flights in which something is named: {sum(row['named'] != NOTHING for row in clean)} of {len(clean)}")


def _flown_before(folder: Path) -> list[dict[str, Any]]:
    """Rows of a run into the same folder, which goes on where that ended."""
    file = folder / _ROWS
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else []


def _in_turn(cases: list[str], seed: int) -> Iterator[tuple[str, int]]:
    while True:
        yield from ((case, seed) for case in cases)
        seed += 1


def _row(of: str, case: str, seed: int, folder: Path) -> dict[str, Any]:
    begin = time.monotonic()
    flown = hide_in_own(of, case, seed, folder)
    found = solve({"folder": str(folder)})
    result = score(flown.answer, found)
    (folder / "found.json").write_text(json.dumps(found, default=str), encoding="utf-8")
    truth = [f"{h.kind}({h.target}{':' + h.term if h.term else ''}) {h.value:.3g}" for h in flown.answer.hidden]
    named = [f"{c['kind']}({c['target']}{':' + c['term'] if c.get('term') else ''})" for c in found.get("causes", [])]
    return {
        "of": of,
        "case": case,
        "seed": seed,
        "aircraft": flown.answer.aircraft,
        "truth": truth,
        "causes": named,
        "imitated": any(h.imitated for h in flown.answer.hidden),
        "first": result.first,
        "named": result.named,
        "verdict": result.verdict,
        "wrong": result.wrong,
        "failed": found.get("failed"),
        "seconds": round(time.monotonic() - begin, 1),
    }


if __name__ == "__main__":
    run_script(main)
