"""Sets that show the cost of a diagnosis on flights of every kind, and their measurement in a process of its own.

    python -m problems.bench.tail FOLDER      one set that `flown_into` wrote: prints a line of JSON

The measuring part imports nothing of the sets, so that PYTHONPATH may name another commit.
"""

from __future__ import annotations

import json
import os
import pickle
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import casid as cs

_BLIND = (  # generator, case, seed
    ("do328", "gust", 2),
    ("do328", "two-1", 4),
    ("jsbsim", "actuator_lag", 3),
    ("jsbsim", "vane_position", 1),
    ("jsbsim", "turbulence", 2),
    ("jsbsim", "clean-2", 2),
    ("jsbsim_instruments", "sensor_delay", 1),
    ("f16", "clean-1", 1),
    ("f16", "effectiveness_change", 1),
    ("independent", "clean-1", 3),
    ("independent", "backlash", 3),
    ("independent", "gust", 3),
    ("strips", "clean-1", 1),
    ("strips", "one-6", 2),
    ("strips", "two-4", 1),
    ("strips", "stall_break", 1),
)
_REAL = ("hfb320", "attas", "tu144", "twin_otter")

# All that is diagnosed: an aircraft or a model, records, held-out records, further arguments.
Flown = tuple[Any, Sequence[cs.Record], Sequence[cs.Record], Mapping[str, Any]]


def _demo() -> Flown:
    from problems.every_problem import DEMO

    return cs.Aircraft.read(DEMO / "aircraft.toml"), cs.read_records([DEMO / "m*.csv"]), (), {}


def _blind(of: str, case: str, seed: int) -> Flown:
    from problems.blind.sets import fly_set

    found = fly_set(of, case, seed)
    return found.aircraft, found.records, (), {}


def _data() -> Path:
    named = os.environ.get("CASID_DATA", "")
    if not named or not Path(named).is_dir():
        raise cs.InputError("real flights need the flight data; let CASID_DATA name their folder")
    return Path(named)


def _real(name: str) -> Flown:
    folder = _data()
    if name == "attas":
        from problems.real.attas import aircraft, records_from

        first, repeat = (
            [r for log in (f"fAttasAilRud{i}", f"fAttasElv{i}") for r in records_from(folder / "fvsysid", log)]
            for i in (1, 2)
        )
        return aircraft(), first, repeat, {}
    if name == "hfb320":
        from problems.real.hfb320 import record_from
        from problems.real.hfb320_aircraft import aircraft, longitudinal

        return aircraft(), [longitudinal(record_from(folder / "fvsysid" / "hfb320_1_10.asc"))], (), {}
    file, *logs = {
        "tu144": ("tu144_f20_4d.toml", "tu144_f20_4d.csv", "tu144_f20_4f.csv"),
        "twin_otter": ("totter_f1_017.toml", "totter_f1_017.raw.csv", "totter_f1_014.raw.csv"),
    }[name]
    records = cs.read_records([folder / "sidpac" / log for log in logs])
    return cs.Aircraft.read(folder / "sidpac" / file), records, (), {}


def _system() -> Flown:
    from problems.systems.count import flown
    from problems.systems.quadruple_tank import SYSTEM

    return SYSTEM.model(), flown(SYSTEM, 1, False)[1], (), {"ports": SYSTEM.ports(), "library": SYSTEM.library}


def _multirotor() -> Flown:
    from problems.rotors.crazypad import flights

    folder = _data() / "crazypad"
    records = flights(folder / "motor_cut_propeller_M3_3mm_E9_log00.csv.gz")
    return cs.Aircraft.read(folder / "crazyflie.toml"), records, (), {}


SETS: Mapping[str, Callable[[], Flown]] = MappingProxyType(
    {
        "demo": _demo,
        **{f"{of} {case} {seed}": partial(_blind, of, case, seed) for of, case, seed in _BLIND},
        "system": _system,
        "multirotor": _multirotor,
        **{name: partial(_real, name) for name in _REAL},
    }
)


def flown_into(folder: Path, name: str, fly: Callable[[], Flown]) -> None:
    """Write a set into a folder, if it is not there yet: files that any commit reads."""
    if (folder / "records").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    simulation, records, held, _ = fly()
    if isinstance(simulation, cs.Aircraft):
        simulation.write(folder / "aircraft.toml")
    bare = [[(r.name, r.t, dict(r.channels)) for r in some] for some in (records, held)]
    (folder / "of").write_text(name, encoding="utf-8")
    (folder / "records").write_bytes(pickle.dumps(bare))


def measured(folder: Path, tree: Path) -> dict[str, Any]:
    """The cost of the diagnosis of a folder by the package in `tree`, in a process of its own."""
    command = [sys.executable, str(Path(__file__).resolve()), str(folder)]
    environment = os.environ | {"PYTHONPATH": str(tree)}
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"failed": done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"status {done.returncode}"}
    return json.loads(done.stdout.splitlines()[-1])


def _read(folder: Path) -> Flown:
    if not (folder / "aircraft.toml").exists():
        return SETS[(folder / "of").read_text(encoding="utf-8")]()
    bare = pickle.loads((folder / "records").read_bytes())
    records, held = ([cs.Record(name=n, t=t, channels=c) for n, t, c in some] for some in bare)
    return cs.Aircraft.read(folder / "aircraft.toml"), records, held, {}


def _measure(folder: Path) -> dict[str, Any]:
    """Processor time, in all and by stage, memory, fits and evaluations of a diagnosis with its page."""
    from casid.diagnosis.flight import evaluation
    from casid.diagnosis.flight import fit as fits

    simulation, records, held, others = _read(folder)
    counted = {"fits": 0, "evaluations": 0}
    spent: dict[str, float] = {}
    now = {"stage": "", "since": time.process_time()}

    def stage(name: str) -> None:
        at = time.process_time()
        if now["stage"]:
            spent[now["stage"]] = spent.get(now["stage"], 0.0) + at - now["since"]
        now.update(stage=name.split(",")[0], since=at)

    def counting(what: str, work: Callable) -> Callable:
        def run(*given: Any, **named: Any) -> Any:
            counted[what] += 1
            return work(*given, **named)

        return run

    evaluated = counting("evaluations", evaluation.evaluate)
    evaluation.evaluate = evaluated
    fits.evaluate, fits.Work = evaluated, counting("fits", fits.Work)
    begin, wall = time.process_time(), time.perf_counter()
    found = cs.diagnose(simulation, list(records), list(held), stage, **others)
    stage("page")
    diagnosed = time.process_time() - begin
    cs.write_report(found, folder / "page")
    stage("")
    return {
        "processor_s": time.process_time() - begin,
        "without_page_s": diagnosed,
        "seconds": time.perf_counter() - wall,
        "largest_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        **counted,
        "samples": sum(map(len, records)),
        "rounds": len(found.rounds),
        "verdict": found.verdict,
        "named": " + ".join(f"{c.kind}({c.target}{':' + c.term if c.term else ''})" for c in found.causes),
        "stages": {name: round(s, 2) for name, s in spent.items()},
    }


if __name__ == "__main__":
    print(json.dumps(_measure(Path(sys.argv[1]))))
