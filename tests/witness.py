"""Does casid still say the same, number by number, after a change that must not move any?

Question     which numbers of a fixed set of diagnoses and estimations differ from those of an earlier run?
Set-up       diagnoses: the embedded demo, and four sets of four records with hidden effects, flown from fixed seeds:
             two by JSBSim, a gust on the Do 328, two causes at once. HFB-320 and ATTAS, where CASID_DATA names the
             flight data. Estimations of one noisy record of the Do 328 and of the demo by every cost, transcription
             and solver. Of every case: all that its result offers as a document, and the r.m.s. of every channel read.
Expectation  none differs. A number may differ by --tolerance of its scale: of itself; of its standard deviation where
             it has one and that is larger; of 1 for likelihoods, probabilities and correlations, whose unit is 1.
             Seconds are kept and not compared, nor what is zero but for rounding. Status 1 when any number differs.

    python tests/witness.py --out FILE [--only GLOB ...] [--quick]
    python tests/witness.py --against FILE [--out FILE] [--only GLOB ...] [--quick] [--tolerance 1e-6]

FILE is JSON and is written again when a case is finished. --quick: the demo and the estimations only.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

import casid as cs

# isort: split
import numpy as np

from casid.cli.start import run_script
from casid.report.folder import provenance
from problems.blind.sets import fly_set
from problems.every_problem import DEMO, demo_problem
from problems.paper.cases import Condition
from problems.paper.estimation import paper_problem
from problems.paper.truth import fly
from problems.real.attas import aircraft as attas_aircraft
from problems.real.attas import lateral_problem as attas_lateral
from problems.real.attas import records_from as attas_records
from problems.real.hfb320 import problem as hfb320_problem
from problems.real.hfb320 import record_from as hfb320_record
from problems.real.hfb320_aircraft import aircraft as hfb320_aircraft
from problems.real.hfb320_aircraft import longitudinal

SCHEMA = "casid.witness/1"
HFB320 = "hfb320_1_10.asc"
SKIPPED = ("seconds", "stationarity", "defect")  # a clock's, or zero but for rounding
# in natural units: twice a logarithm of a likelihood, a probability, a share of a variance
UNIT_SCALE = frozenset(
    [
        "log_likelihood",
        "log_likelihood_per_sample",
        "statistic",
        "held_out_gain",
        "bic",
        "missing",
        "p_value",
        "whiteness_p",
        "R2",
        "surviving",
        "correlation",
    ]
)
SETS = {  # name -> set, case, seed
    "jsbsim-actuator": ("jsbsim", "actuator_lag", 3),
    "jsbsim-vane": ("jsbsim", "vane_position", 1),
    "do328-gust": ("do328", "gust", 2),
    "two-causes": ("do328", "two-1", 4),
}
STABLE = Condition(case="B", manoeuvre=5, seed=1)
SLOW = Condition(case="H", manoeuvre=1, variant=3, seed=1)  # Gauss-Newton creeps, Newton finishes
SHORT_S = 6.0  # of a record for IPOPT, whose time goes with the samples


@dataclass(frozen=True, kw_only=True)
class Case:
    """`run` returns the document of what was found; `quick`: part of every run; `real`: needs flight data."""

    run: Callable[[], Mapping[str, Any]]
    quick: bool = False
    real: bool = False


def diagnosed(aircraft: cs.Aircraft, records: Sequence[cs.Record], held_out: Sequence[cs.Record] = ()) -> Any:
    """What was read, and diagnosis.json of it."""
    return {"read": {r.name: channels(r) for r in (*records, *held_out)}} | {
        "diagnosis": cs.diagnose(aircraft, list(records), list(held_out)).to_dict()
    }


def channels(record: cs.Record) -> dict[str, float]:
    """Channel -> r.m.s.: whether a difference is in the data already."""
    return {name: float(np.sqrt(np.nanmean(np.square(values)))) for name, values in record.channels.items()}


def demo() -> Any:
    return diagnosed(cs.Aircraft.read(DEMO / "aircraft.toml"), cs.read_records([DEMO / "m*.csv"]))


def blind(of: str, case: str, seed: int) -> Any:
    flown = fly_set(of, case, seed)
    return diagnosed(flown.aircraft, flown.records)


def hfb320(folder: Path) -> Any:
    """As scripts/hfb320.py: output error, filter error, diagnosis."""
    record = hfb320_record(folder / HFB320)
    problem = hfb320_problem(record)
    return diagnosed(hfb320_aircraft(), [longitudinal(record)]) | {
        "output_error": cs.solve(problem).to_dict(),
        "filter_error": cs.solve(replace(problem, cost=moving(w_V=0.0, w_alpha=0.0))).to_dict(),
    }


def attas(folder: Path) -> Any:
    """As scripts/attas.py: the first manoeuvres fitted, their repeats held out."""
    first = [*attas_records(folder, "fAttasAilRud1"), *attas_records(folder, "fAttasElv1")]
    repeat = [*attas_records(folder, "fAttasAilRud2"), *attas_records(folder, "fAttasElv2")]
    estimated = cs.solve(attas_lateral(attas_records(folder, "fAttasAilRud1")))
    return diagnosed(attas_aircraft(), first, repeat) | {"lateral": estimated.to_dict()}


@cache
def problem(cost: str, condition: Condition = STABLE, noise: str = "range", seconds: float = math.inf) -> cs.Problem:
    """One record of the Do 328; weights by range, or noise estimated from the residuals."""
    costs = {"output": cs.OutputError(), "equation": cs.EquationError(), "combined": cs.CombinedError()}
    whole = paper_problem(fly(condition), costs[cost], noise=noise)
    return replace(whole, records=[record.between(-math.inf, seconds) for record in whole.records])


def in_moving_air() -> cs.Problem:
    """With measurement noise and without a prior of the initial state, as filter error takes it."""
    return replace(problem("output", noise="residuals"), initial_state=cs.InitialState())


def moving(**correlation_time: float) -> cs.FilterError:
    """Process noise of disturbances by name."""
    return cs.FilterError(process_noise=correlation_time)


def with_process_noise() -> Any:
    """Soft defects: process noise on the equation of w, measurement noise given."""
    given = cs.solve(problem("output", noise="residuals")).noise
    method = cs.MultipleShooting(interval=25, process_noise={"w": 0.1})
    return cs.solve(replace(problem("output"), noise=dict(given)), method)


def constrained() -> Any:
    """A limit that acts: Cl_p, -1.12 without it, stays above -0.9."""
    return cs.solve(replace(problem("output"), constraints=[cs.limit_parameter("Cl_p", lower=-0.9)]))


def estimations() -> dict[str, Callable[[], Any]]:
    single, multiple, collocation = cs.SingleShooting(), cs.MultipleShooting(), cs.Collocation()
    gauss_newton, ipopt, automatic = cs.GaussNewton(), cs.Ipopt(), cs.Automatic()
    return {
        "output-single-gauss_newton": lambda: cs.solve(problem("output"), single, gauss_newton),
        "output-multiple-gauss_newton": lambda: cs.solve(problem("output"), multiple, gauss_newton),
        "output-collocation-gauss_newton": lambda: cs.solve(problem("output"), collocation, gauss_newton),
        "output-multiple-ipopt": lambda: cs.solve(problem("output", seconds=SHORT_S), multiple, ipopt),
        "output-collocation-ipopt": lambda: cs.solve(problem("output", seconds=SHORT_S), collocation, ipopt),
        "output-multiple-automatic": lambda: cs.solve(problem("output", SLOW), multiple, automatic),
        "output-estimated_noise": lambda: cs.solve(problem("output", noise="residuals")),
        "equation-automatic": lambda: cs.solve(problem("equation")),
        "combined-multiple-automatic": lambda: cs.solve(problem("combined"), multiple, automatic),
        "combined-single-ipopt": lambda: cs.solve(problem("combined", seconds=SHORT_S), single, ipopt),
        "filter_error": lambda: cs.solve(replace(in_moving_air(), cost=moving(wind_z=0.0))),
        "process_noise": with_process_noise,
        "constrained": constrained,
        "priors": lambda: cs.solve(demo_problem()),
    }


def cases(data: Path | None) -> dict[str, Case]:
    """Every case by name; the real ones cannot run without the folder `data`."""
    found = {"demo": Case(run=demo, quick=True)}
    found |= {name: Case(run=partial(blind, *one)) for name, one in SETS.items()}
    flights = {"hfb320": hfb320, "attas": attas}
    found |= {name: Case(run=partial(run, data or Path()), real=True) for name, run in flights.items()}
    return found | {
        f"estimate-{name}": Case(run=partial(_document, run), quick=True) for name, run in estimations().items()
    }


def _document(run: Callable[[], Any]) -> Mapping[str, Any]:
    return run().to_dict()


def flight_data() -> Path | None:
    """The folder that CASID_DATA names, or its `fvsysid`; None when it names none."""
    named = os.environ.get("CASID_DATA")
    if not named:
        return None
    for folder in (Path(named) / "fvsysid", Path(named)):
        if (folder / HFB320).is_file():
            return folder
    raise cs.InputError(f"CASID_DATA={named}: no {HFB320} there; name the folder with the flight records, or unset it")


def plain(found: Any) -> Any:
    """As it comes back from a file; numbers that are not finite as Python's JSON has them."""
    return json.loads(json.dumps(found, default=lambda value: value.tolist()))


def differences(before: Any, now: Any, tolerance: float, where: tuple[str, ...] = (), std: float = 0.0) -> list[str]:
    """A line for everything that is not the same in two documents.

    where   the keys that lead to them;  std  1-sigma of the number there, if it has one
    """
    before, now = _by_name(before), _by_name(now)
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        return _in_mappings(before, now, tolerance, where)
    place = "/".join(where)
    if not (_is_number(before) and _is_number(now)):
        return [] if before == now else [f"{place}: {_short(before)} -> {_short(now)}"]
    scale = max(_size(before), _size(now), std, float(not UNIT_SCALE.isdisjoint(where)))
    apart = abs(before - now)
    if before == now or (before != before and now != now) or apart <= tolerance * scale:  # NaN is NaN
        return []
    return [f"{place}: {before:.12g} -> {now:.12g} ({apart / (scale or 1.0):.2g} of its scale)"]


def _in_mappings(
    before: Mapping[str, Any], now: Mapping[str, Any], tolerance: float, where: tuple[str, ...]
) -> list[str]:
    lines = []
    for key in dict.fromkeys((*before, *now)):
        if key in SKIPPED:
            continue
        if key in before and key in now:
            std = max(_size(before.get("std")), _size(now.get("std"))) if key == "value" else 0.0
            lines += differences(before[key], now[key], tolerance, (*where, key), std)
        else:
            lines.append(f"{'/'.join((*where, key))}: only {'before' if key in before else 'now'}")
    return lines


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _size(value: Any) -> float:
    """Magnitude; 0 for what is no finite number."""
    return abs(value) if _is_number(value) and math.isfinite(value) else 0.0


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]}..."


def _by_name(value: Any) -> Any:
    """A list as a mapping: causes by what they are, so that equally strong ones may change places; else by index."""
    if not isinstance(value, list):
        return value
    found: dict[str, Any] = {}
    for i, one in enumerate(value):
        known = isinstance(one, dict) and "kind" in one
        name = ":".join(str(one[k]) for k in ("kind", "target", "term") if one.get(k)) if known else str(i)
        found[name if name not in found else f"{name}#{i}"] = one
    return found


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Numbers of a fixed set, to be compared before and after a change.")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the numbers there")
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with the numbers of an earlier run")
    parser.add_argument("--only", nargs="+", default=["*"], metavar="GLOB", help="of cases, like demo or 'estimate-*'")
    parser.add_argument("--quick", action="store_true", help="the demo and the estimations only")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="of a number's scale")
    parser.error = _one_line
    given = parser.parse_args()
    if not (given.out or given.against):
        raise cs.InputError("neither --out FILE nor --against FILE; expected at least one of them")
    if not 0.0 <= given.tolerance < 1.0:
        raise cs.InputError(f"--tolerance {given.tolerance}: expected a number from 0 to 1, like 1e-6")
    return given


def _one_line(message: str) -> NoReturn:
    raise cs.InputError(f"{message}; see witness.py --help")


def earlier(path: Path) -> dict[str, Any]:
    """The cases of a file; InputError when it is none of ours."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise cs.InputError(f"{path}: cannot be read as JSON ({fault}); make it by --out {path}") from None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise cs.InputError(f"{path}: expected the schema '{SCHEMA}'; make it by --out {path}")
    return document["cases"]


def chosen(names: Sequence[str], globs: Sequence[str]) -> list[str]:
    found = [name for name in names if any(fnmatchcase(name, glob) for glob in globs)]
    if not found:
        raise cs.InputError(f"--only {' '.join(globs)}: fits none of {', '.join(names)}")
    return found


def write(path: Path, document: Mapping[str, Any]) -> None:
    """Whole or not at all; InputError when nothing can be written there."""
    temporary = path.with_suffix(".tmp")
    try:
        temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        temporary.replace(path)
    except OSError as fault:
        raise cs.InputError(f"{path}: cannot be written ({fault.strerror}); choose another --out") from None


def measured(case: Case) -> dict[str, Any]:
    """What a file has of a case."""
    begin = time.perf_counter()
    found = plain(case.run())
    return {"seconds": round(time.perf_counter() - begin, 2), "found": found}


def compared(name: str, before: Mapping[str, Any], now: Mapping[str, Any], tolerance: float) -> list[str]:
    """Differences of one case of two files; none when neither has it."""
    here = ({name: file[name]["found"]} if name in file else {} for file in (before, now))
    return differences(*here, tolerance=tolerance)


def main() -> int:
    given, data = arguments(), flight_data()
    before = earlier(given.against) if given.against else {}
    every = cases(data)
    names = chosen([name for name, case in every.items() if case.quick or not given.quick], given.only)
    now: dict[str, Any] = {}
    document = {"schema": SCHEMA, "made_with": provenance(0), "cases": now}
    if given.out:
        write(given.out, document)  # a place where it cannot be is told now
    differing = 0
    for name in names:
        if every[name].real and data is None:
            print(f" left out  {name}: CASID_DATA names no flight data")
        else:
            now[name] = measured(every[name])
            print(f"{now[name]['seconds']:7.1f} s  {name}", flush=True)
        if given.out:
            write(given.out, document)
        if given.against:
            lines = compared(name, before, now, given.tolerance)
            differing += len(lines)
            print("".join(f"           {line}\n" for line in lines), end="", flush=True)
    if given.against:
        print(f"{differing} differences in {len(names)} cases, tolerance {given.tolerance:g}")
    return int(differing > 0)


if __name__ == "__main__":
    run_script(main)
