"""How long does a diagnosis take, how much memory, and how does that grow with the data?

Question     are four records of 26 s at 50 Hz with 15 channels diagnosed in 8 s of processor time and 0.6 GB, six of
             100 s at 10 Hz in 40 s and 0.8 GB, half an hour at 50 Hz in 2 GB? Is it linear in the samples, and how
             much does a cache without compiled kernels cost?
Set-up       one diagnosis in a process of its own for each row, whose largest memory is that of the row. `demo` is the
             embedded demonstration, `cold` the same without compiled kernels. The others: Do 328 flown with one effect
             at a time (and none), derivatives of its file 20 % off, noise of a good instrumentation, 11 channels.
             `screening` is the time of one screening of the whole catalogue over its candidates, places and shapes
             tried included; `saved_mb` the file of `Diagnosis.save`.
Expectation  the hidden effect is the only cause named, or none; anything else is an error, whatever the time.

    python benchmarks/bench_diagnosis.py [demo cold clean lag gust turbulence two growth six half_hour] [--json FILE]
    python benchmarks/bench_diagnosis.py tail [--only GLOB ...] [--out DIR] [--tree DIR] [--json FILE]

`growth` is the lag in records of 7, 14, 28 and 56 s; without arguments all but `half_hour` and `tail`. `tail` is 24
sets of all generators and of real flights (`problems/bench/tail.py`), each with its page: a line for each, and for all
the median, the 90 % quantile and the worst. It can be interrupted; the same command goes on. `--tree` names a clone of
another commit, whose package diagnoses the same records.
"""

from __future__ import annotations

from casid.cli.start import run_script

import json
import math
import multiprocessing
import os
import pickle
import resource
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.screening import screen
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError, unknown
from casid.model.aircraft import Aircraft
from casid.model.effects import catalogue
from casid.records.readers import read_records
from casid.records.record import Record
from problems.bench import tail
from problems.bench.table import exponent, parser, processor_seconds, publish
from problems.blind import do328 as blind_do328
from problems.blind.case import RECORDS, Hidden
from problems.blind.flown import FLOWN_HZ
from problems.blind.manoeuvres import draw_segments, histories
from problems.every_problem import DEMO
from problems.jsbsim.flight import NOISE

OFF, SEED = 0.2, 1
CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az")
HIDDEN: Mapping[str, tuple[Hidden, ...]] = MappingProxyType(
    {
        "clean": (),
        "lag": (Hidden(kind="actuator_lag", target="delta_e", value=0.12),),
        "gust": (
            Hidden(
                kind="gust", target="z", value=5.0, records=("m2",), onset_s={"m2": 11.0}, parameters={"length": 1.6}
            ),
        ),
        "turbulence": (Hidden(kind="turbulence", value=1.0),),
        "two": (
            Hidden(kind="sensor_delay", target="beta", value=0.1),
            Hidden(kind="effectiveness_change", target="delta_a", value=-0.3, records=("m1",), onset_s={"m1": 8.0}),
        ),
    }
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A row: what is hidden, in how many records, of which length and rate; without any rate the demonstration."""

    hidden: str
    seconds: float = 28.0
    rate_hz: float = 50.0
    records: int = 4
    demonstration: bool = False
    cold: bool = False


_GROWTH = "growth"
CASES: Mapping[str, tuple[Case, ...]] = MappingProxyType(
    {
        "demo": (Case(hidden="lag", demonstration=True),),
        "cold": (Case(hidden="lag", demonstration=True, cold=True),),
        **{name: (Case(hidden=name),) for name in HIDDEN},
        _GROWTH: tuple(Case(hidden="lag", seconds=seconds) for seconds in (7.0, 14.0, 28.0, 56.0)),
        "six": (Case(hidden="lag", seconds=100.0, rate_hz=10.0, records=6),),
        "half_hour": (Case(hidden="lag", seconds=100.0, records=18),),
    }
)
_NOT_UNASKED, _TAIL = "half_hour", "tail"
_FAST = Case(hidden="lag", seconds=45.0, rate_hz=100.0, records=2)  # read faster than its motion needs


def main() -> None:
    options = parser(__doc__)
    options.add_argument("cases", nargs="*", metavar="case", help=f"of {', '.join(CASES)}")
    options.add_argument("--only", nargs="+", default=["*"], metavar="GLOB", help="of the sets of `tail`")
    options.add_argument(
        "--out", type=Path, default=Path("out/tail"), metavar="DIR", help="where `tail` keeps its work"
    )
    options.add_argument("--tree", type=Path, default=Path(), metavar="DIR", help="clone of the commit that diagnoses")
    given = options.parse_args()
    if given.cases == [_TAIL]:
        publish(_tail(given.only, given.out.resolve(), given.tree.resolve()), given.json)
        return
    for name in given.cases:
        if name not in CASES:
            raise unknown("case", name, CASES)
    rows = []
    for name in given.cases or [name for name in CASES if name != _NOT_UNASKED]:
        own = [_alone(name, case) for case in CASES[name]]
        for row in own if name == _GROWTH else ():
            for what in ("processor_s", "largest_mb"):
                row[f"exponent_{what}"] = exponent([r["samples"] for r in own], [r[what] for r in own])
        rows += own
    publish(rows, given.json)
    wrong = [
        f"{row['case']}, {row['samples']} samples: {row['named'] or 'nothing'}" for row in rows if not row["right"]
    ]
    if wrong:
        raise InputError(f"not named as hidden: {'; '.join(wrong)}")


def _tail(only: Sequence[str], out: Path, tree: Path) -> list[dict[str, Any]]:
    """The rows of `tail`, and of all sets the quantiles of what was measured."""
    commit = subprocess.check_output(["git", "describe", "--always", "--dirty"], cwd=tree, text=True).strip()
    sets = {**tail.SETS, "fast": lambda: (*_flown(_FAST), (), {})}
    rows = []
    for name in (one for one in sets if any(fnmatchcase(one, glob) for glob in only)):
        folder = out / name.replace(" ", "-")
        tail.flown_into(folder, name, sets[name])
        kept = folder / f"{commit}.json"
        if not kept.exists():
            kept.write_text(json.dumps(tail.measured(folder, tree)), encoding="utf-8")
        found = json.loads(kept.read_text(encoding="utf-8"))
        print(f"{name}: {found.get('processor_s', math.nan):.1f} s, {found.get('stages')}", flush=True)
        rows.append({"set": name} | {k: v for k, v in found.items() if k != "stages"})
    done = [row for row in rows if "processor_s" in row]
    for title, part in (("median", 0.5), ("90 %", 0.9), ("worst", 1.0)):
        numbers = ("processor_s", "without_page_s", "seconds", "largest_mb", "fits", "evaluations")
        rows.append({"set": title} | {n: float(np.quantile([r[n] for r in done], part)) for n in numbers if done})
    return rows


def _alone(name: str, case: Case) -> dict[str, Any]:
    """A row, measured in a new process."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return {"case": name} | pool.submit(_measured, case).result()


def _measured(case: Case) -> dict[str, Any]:
    if case.cold:
        os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp()
    aircraft, records = _demonstration() if case.demonstration else _flown(case)
    begin, cpu = time.perf_counter(), processor_seconds()
    found = diagnose(aircraft, records)
    wall, cpu = time.perf_counter() - begin, processor_seconds() - cpu
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    wanted = {(one.kind, one.target) for one in HIDDEN[case.hidden]}
    named = {(c.kind, c.target) for c in found.causes}
    return {
        "records": len(records),
        "record_s": records[0].duration,
        "samples": sum(map(len, records)),
        "seconds": wall,
        "processor_s": cpu,
        "largest_mb": largest,
        "saved_mb": len(pickle.dumps(found, protocol=5)) / 1e6,
        **_screening(found),
        "named": " + ".join(f"{kind}({target})" for kind, target in sorted(named)),
        "right": named == wanted,
    }


def _screening(found: Diagnosis) -> dict[str, Any]:
    """Time of one screening of the whole catalogue, per candidate."""
    evidence = weigh(found.extended.fit)
    flight = evidence.fit.flight
    effects = catalogue(flight.aircraft, flight.outputs)
    begin = time.perf_counter()
    candidates = screen(evidence, effects)
    return {"candidates": len(candidates), "screening_ms": 1e3 * (time.perf_counter() - begin) / len(candidates)}


def _demonstration() -> tuple[Aircraft, list[Record]]:
    return Aircraft.read(DEMO / "aircraft.toml"), read_records([DEMO / "m*.csv"])


def _flown(case: Case) -> tuple[Aircraft, list[Record]]:
    """An aircraft file that is off, and records."""
    rng = np.random.default_rng([SEED, round(case.seconds)])
    every, records = round(FLOWN_HZ / case.rate_hz), []
    t = np.arange(round(case.seconds * FLOWN_HZ) + 1) / FLOWN_HZ
    names = [f"m{i + 1}" for i in range(case.records)]
    hidden = [replace(one, records=tuple(names)) if one.records == RECORDS else one for one in HIDDEN[case.hidden]]
    for i, name in enumerate(names):
        inputs = draw_segments(rng, case.seconds, blind_do328.plane().units_s, throttle=True)
        flown = blind_do328.plane().fly(name, t, histories(inputs, t, blind_do328.plane().sizes), hidden, seed=SEED + i)
        read = {}
        for channel in (*CHANNELS, "delta_e", "delta_a", "delta_r", "thrust", "rho"):
            exact = flown[channel][::every]
            sigma = NOISE[channel] * (float(np.mean(exact)) if channel == "thrust" else 1.0)
            read[channel] = exact + sigma * rng.standard_normal(len(exact))
        records.append(Record(name=name, t=t[::every], channels=read))
    aircraft = blind_do328.plane().aircraft
    off = {n: v * (1.0 + OFF * rng.choice([-1.0, 1.0])) for n, v in aircraft.derivatives.items()}
    return aircraft.with_derivatives(off), records


if __name__ == "__main__":
    run_script(main)
