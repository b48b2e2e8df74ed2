"""Which propeller of a nano-quadrotor is cut, and how much would not have shown?

Question     does a diagnosis name the rotor whose propeller was cut, and nothing in normal flights?
Set-up       logs of CrazyPAD (Data 2024, 9, 79) in a folder, with the file of Foerster 2015. The normal logs of an
             airframe make its simulation; each log is then diagnosed alone, a normal one with the simulation that the
             other normal logs make.
Expectation  cuts of 2 + 2 mm and more on one propeller: that rotor; normal flights and 1 + 1 mm: nothing, with the size
             that would have shown. A line per log.

    python scripts/crazypad.py FOLDER [--logs GLOB ...]
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import casid as cs
from casid.errors import CasidError, InputError
from casid.model.rotors import effectiveness
from problems.rotors.crazypad import airframe, effectiveness_in, flights, with_decks

HEAD = ("log", "verdict", "named", "M1", "M2", "M3", "M4", "would not have shown", "s")
LEAST = 3  # normal logs, of which one is left out


def frame_of(path: Path) -> str:
    """The airframe of a log by its name, which ends in E8_log00."""
    return path.name.rsplit("_", 2)[-2]


def told(aircraft: cs.Aircraft, path: Path) -> Iterator[str]:
    """The cells of one log."""
    begin = time.process_time()
    yield path.name.removesuffix(".csv.gz")
    try:
        found = cs.diagnose(aircraft, flights(path))
    except CasidError as error:
        yield str(error)
        return
    assert aircraft.rotors is not None
    yield found.verdict
    sets = ("".join(f" or {o['kind']}({o['target']})" for o in one.indistinguishable_from) for one in found.causes)
    named = [f"{c.kind}({c.target}) {c.value:+.3g}{rest}" for c, rest in zip(found.causes, sets, strict=True)]
    yield "; ".join([*named, *(f"missing: {one.words}" for one in found.unexplained)]) or "nothing"
    for one in aircraft.rotors.each:
        yield f"{100.0 * (found.flight[effectiveness(one.name)].value / one.effectiveness - 1.0):+.0f} %"
    yield "; ".join(one.what for one in found.not_judged)
    yield f"{time.process_time() - begin:.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").split("\n", maxsplit=1)[0],
        epilog="Example: python scripts/crazypad.py ../shared/data/crazypad --logs 'motor_*M3*'",
    )
    parser.add_argument("folder", type=Path, help="with crazyflie.toml and the logs as .csv.gz")
    parser.add_argument("--logs", nargs="+", default=["motor_*"], metavar="GLOB", help="those that are diagnosed")
    given = parser.parse_args()
    logs = sorted({path for glob in given.logs for path in given.folder.glob(f"{glob}.csv.gz")})
    if not logs:
        raise InputError(f"{given.folder}: no log {' '.join(given.logs)}; expected the files of CrazyPAD as .csv.gz")
    base = with_decks(cs.Aircraft.read(given.folder / "crazyflie.toml"))
    normal: dict[str, dict[Path, list[float]]] = {}
    for frame in sorted(set(map(frame_of, logs))):
        paths = sorted(given.folder.glob(f"*_normal_flight_{frame}_*.csv.gz"))
        normal[frame] = {path: effectiveness_in(base, flights(path)) for path in paths}
    print(f"| {' | '.join(HEAD)} |\n{'|---' * len(HEAD)}|", flush=True)
    for path in logs:
        others = [values for name, values in normal[frame_of(path)].items() if name != path]
        if len(others) < LEAST - 1:
            raise InputError(f"{path.name}: {len(others)} other normal logs, expected {LEAST - 1} or more")
        print(f"| {' | '.join(told(airframe(base, others), path))} |", flush=True)


if __name__ == "__main__":
    run_script(main)
