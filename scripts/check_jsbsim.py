"""Does casid compute what JSBSim computes, for every aircraft that the jsbsim package ships?

Question     Are aerodynamics, mass properties and equations of motion of `Aircraft.from_jsbsim` those of JSBSim?
Set-up       problems/jsbsim/agreement.py: every stock aircraft without control system and engines; random states,
             surfaces and settings. Compared are the six aerodynamic coefficients, the rates of u v w p q r, and the
             states of a glide of 20 s at two step sizes of JSBSim.
Expectation  1e-6 relative, or a reason; the difference of the glides shrinks with JSBSim's step.

    python scripts/check_jsbsim.py [AIRCRAFT ...] [--states 1000] [--out problems/jsbsim/aircraft.md]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from problems.jsbsim.agreement import Rig, compare, file_of, gliding, rig

REQUIRED = 1e-6
GLIDES = ("737", "c310", "T37", "A4", "fokker100", "f15")
STEPS_HZ, SECONDS = (125, 500), 20.0
_NEVER = "JSBSim ends its process, without control system and engines"


def main() -> None:
    options = argparse.ArgumentParser(
        description=(__doc__ or "").splitlines()[0],
        epilog="Example: python scripts/check_jsbsim.py c172x --states 50",
    )
    options.add_argument("aircraft", nargs="*", help="names of stock aircraft; default: all")
    options.add_argument("--states", type=int, default=1000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--out", type=Path, help="write the table there, as Markdown")
    options.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.one:
        print(json.dumps(_checked(given.aircraft[0], given.states, given.seed)))
        return
    folder = file_of("any").parent.parent
    names = given.aircraft or sorted(p.name for p in folder.iterdir() if (p / f"{p.name}.xml").is_file())
    rows = []
    for name in names:
        rows.append({"name": name, **_in_a_process(name, given.states, given.seed)})
        print(json.dumps(rows[-1]), flush=True)
    if given.out:
        given.out.write_text(_markdown(rows, given.states, given.seed), encoding="utf-8")


def _in_a_process(name: str, states: int, seed: int) -> dict[str, Any]:
    """JSBSim may end the process that it runs in."""
    command = [sys.executable, __file__, name, "--one", "--states", str(states), "--seed", str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    return json.loads(lines[-1]) if lines else {"reason": _NEVER}


def _checked(name: str, states: int, seed: int) -> dict[str, Any]:
    try:
        one = rig(name)
        found = compare(one, states, seed)
    except InputError as error:
        return {"reason": str(error).rpartition(f"{name}.xml: ")[2]}
    row: dict[str, Any] = {"coefficients": found.coefficients, "rates": found.rates, "held": sorted(one.held)}
    if found.rates > REQUIRED:
        row["reason"] = _why(one, found.coefficients)
    if name in GLIDES:
        row["glide"] = [_glide(one, rate) for rate in STEPS_HZ]
    return row


def _why(one: Rig, coefficients: float) -> str:
    if coefficients > REQUIRED:
        if "position/h-sl-ft" in one.own.text:
            return "its tables are over the altitude, which casid has from the density, by the standard atmosphere"
        return "the coefficients differ, not known why"
    fdm, own = one.fdm, one.aircraft.inertia
    slug_ft2 = 14.593902937206364 * 0.3048**2
    if abs(fdm["inertia/iyy-slugs_ft2"] * slug_ft2 / own.Iyy - 1.0) > REQUIRED:
        return "JSBSim counts an inertia of its tanks that casid does not"
    return "not known"


def _glide(one: Rig, rate: int) -> float:
    """Largest difference of a state over the range that it has in the glide."""
    theirs, ours = gliding(one, rate, SECONDS)
    return float(np.max(np.abs(ours - theirs).max(axis=0) / np.ptp(theirs, axis=0)))


def _markdown(rows: list[dict[str, Any]], states: int, seed: int) -> str:
    good = [row for row in rows if row.get("rates", np.inf) <= REQUIRED]
    lines = [
        "# Stock aircraft of JSBSim as casid reads them",
        "",
        f"Written by `scripts/check_jsbsim.py --states {states} --seed {seed} --out problems/jsbsim/aircraft.md`.",
        "Largest relative differences at random states; `problems/jsbsim/agreement.py` says how they are compared.",
        "",
        f"{len(good)} of {len(rows)} agree within {REQUIRED:g}:",
        "",
        "| aircraft | coefficients | rates of the state | glide of 20 s, JSBSim at 125 and 500 Hz | held |",
        "|---|---|---|---|---|",
    ]
    for row in good:
        glide = ", ".join(f"{value:.1e}" for value in row.get("glide", []))
        held = ", ".join(row["held"])
        lines.append(f"| {row['name']} | {row['coefficients']:.1e} | {row['rates']:.1e} | {glide} | {held} |")
    lines += ["", "The others:", "", "| aircraft | coefficients | rates of the state | why |", "|---|---|---|---|"]
    for row in rows:
        if row not in good:
            sizes = [f"{row[key]:.1e}" if key in row else "" for key in ("coefficients", "rates")]
            lines.append(f"| {row['name']} | {' | '.join(sizes)} | {row.get('reason', '')} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    run_script(main)
