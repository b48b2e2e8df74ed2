"""How long does a diagnosis take, and how does that grow with the data?

Question     are four records of 28 s at 50 Hz with 11 channels diagnosed in 20 s on two processors, and a further
             candidate screened in 5 ms? Is the time linear in the length of the records?
Set-up       Do 328 flown with one effect at a time (and none), derivatives of its file 20 % off, noise of a good
             instrumentation. One diagnosis each, in this process; `screening` is the time of one screening of the whole
             catalogue over its candidates, places and shapes tried included. `demo` is the embedded demonstration:
             records of 26 s at 50 Hz with 15 channels. `largest_mb` is what the process had taken at most by then, so
             that only the first row has its own; `saved_mb` the file of `Diagnosis.save`.
Expectation  the hidden effect is the only cause named, or none; anything else is an error, whatever the time.

    python benchmarks/bench_diagnosis.py [--hidden demo clean lag gust turbulence two] [--seconds 14 28 56]
        [--json FILE]

The effects are timed at 28 s; the growth is that of the first of them behind the demonstration.
"""

from __future__ import annotations

from casid.cli.start import run_script

import pickle
import resource
import time
from collections.abc import Mapping, Sequence
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
from problems.bench.table import exponent, parser, publish
from problems.blind import do328 as blind_do328
from problems.blind.case import RECORDS, Hidden
from problems.blind.flown import FLOWN_HZ
from problems.blind.manoeuvres import draw_segments, histories
from problems.every_problem import DEMO
from problems.jsbsim.flight import NOISE

RATE_HZ, SECONDS, OFF, SEED = 50.0, 28.0, 0.2, 1
DEMONSTRATION = "demo"
CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az")
HIDDEN: Mapping[str, tuple[Hidden, ...]] = MappingProxyType(
    {
        DEMONSTRATION: (Hidden(kind="actuator_lag", target="delta_e", value=0.0),),  # of its own size
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


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--hidden", nargs="+", default=list(HIDDEN), help=f"of {', '.join(HIDDEN)}")
    options.add_argument("--seconds", nargs="*", type=float, default=[14.0, 56.0], help="further lengths of record")
    given = options.parse_args()
    for name in given.hidden:
        if name not in HIDDEN:
            raise unknown("hidden effect", name, HIDDEN)
    rows = [_measured(name, SECONDS) for name in given.hidden]
    grows = next((name for name in given.hidden if name != DEMONSTRATION), "")
    rows += [_measured(grows, seconds) for seconds in given.seconds if grows]
    grown = [row for row in rows if row["hidden"] == grows]
    for row in grown:
        row["exponent"] = exponent([r["record_s"] for r in grown], [r["seconds"] for r in grown])
    publish(rows, given.json)
    wrong = [f"{row['hidden']}, {row['record_s']:g} s: {row['named'] or 'nothing'}" for row in rows if not row["right"]]
    if wrong:
        raise InputError(f"not named as hidden: {'; '.join(wrong)}")


def _measured(name: str, seconds: float) -> dict[str, Any]:
    aircraft, records = _demonstration() if name == DEMONSTRATION else _flown(HIDDEN[name], seconds)
    begin, cpu = time.perf_counter(), time.process_time()
    found = diagnose(aircraft, records)
    wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
    wanted = {(one.kind, one.target) for one in HIDDEN[name]}
    named = {(c.kind, c.target) for c in found.causes}
    return {
        "hidden": name,
        "record_s": records[0].duration,
        "samples": sum(map(len, records)),
        "seconds": wall,
        "processor_s": cpu,
        "largest_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "saved_mb": len(pickle.dumps(found, protocol=5)) / 1e6,
        **_screening(found),
        "named": " + ".join(f"{kind}({target})" for kind, target in sorted(named)),
        "right": named == wanted,
    }


def _screening(found: Diagnosis) -> dict[str, Any]:
    """Time of one screening of the whole catalogue, per candidate."""
    evidence = weigh(found.extended.fit)
    effects = catalogue(evidence.fit.flight.aircraft, evidence.fit.flight.outputs)
    begin = time.perf_counter()
    candidates = screen(evidence, effects)
    return {"candidates": len(candidates), "screening_ms": 1e3 * (time.perf_counter() - begin) / len(candidates)}


def _demonstration() -> tuple[Aircraft, list[Record]]:
    return Aircraft.read(DEMO / "aircraft.toml"), read_records([DEMO / "m*.csv"])


def _flown(hidden: Sequence[Hidden], seconds: float) -> tuple[Aircraft, list[Record]]:
    """An aircraft file that is off, and four records."""
    rng = np.random.default_rng([SEED, round(seconds)])
    every, records = round(FLOWN_HZ / RATE_HZ), []
    t = np.arange(round(seconds * FLOWN_HZ) + 1) / FLOWN_HZ
    for i, name in enumerate(RECORDS):
        inputs = draw_segments(rng, seconds, blind_do328.plane().units_s, throttle=True)
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
