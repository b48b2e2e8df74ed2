"""A corpus of flight records with known hidden effects, to develop and to score a diagnosis on.

    python -m problems.jsbsim.corpus --out FOLDER [--aircraft fokker50 ...] [--case GLOB ...]

writes FOLDER/<aircraft>/<case>/m1.csv .. m4.csv, aircraft.toml (which knows nothing of the effect) and truth.json.
m4 is meant as the hold-out. Needs the optional package jsbsim.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.cli.start import run_script
from casid.records.readers import write_record
from casid.records.record import Record
from problems.jsbsim.airframe import AIRFRAMES, Airframe, airframe
from problems.jsbsim.apriori import aircraft_file
from problems.jsbsim.faults import Fault
from problems.jsbsim.fdm import Log
from problems.jsbsim.flight import Flight, log_of, record_of
from problems.jsbsim.manoeuvres import CARDS

RECORDS: Mapping[str, str] = dict(zip(("m1", "m2", "m3", "m4"), CARDS, strict=True))
DIGITS = {"V": 3, "thrust": 1, "altitude": 1, **dict.fromkeys(("ax", "ay", "az", "pdot", "qdot", "rdot"), 4)}
_ONSETS = {"m1": 12.0, "m2": 8.2, "m3": 10.9, "m4": 13.7}
_TWO = {"m1": 6.5, "m3": 21.0}


@dataclass(frozen=True, kw_only=True)
class Case:
    """A named fault; None: clean.

    onsets    of an event: record -> time [s]; a record without onset is healthy
    records   that have the fault when it is no event; the others are healthy
    """

    name: str
    fault: Fault | None
    onsets: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    records: tuple[str, ...] = tuple(RECORDS)

    @property
    def affected(self) -> tuple[str, ...]:
        """Names of the records that have the fault."""
        if self.fault is None:
            return ()
        return tuple(self.onsets) if self.fault.onset_s is not None else self.records


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Sizes of the faults that go with the size of an aircraft, in the vocabulary's units. `turbulence` is a moderate
    and a light severity, which depend on the altitude."""

    mass: float
    cg: float
    vane: float
    accelerometer: float
    Ixx: float
    engine_y: float
    engine_z: float
    Cm_alpha2: float
    Cm_alphadot: float
    Cn_beta3: float
    Cl_alpha_beta: float
    gust: float
    delay: float
    turbulence: tuple[int, int]


SIZES: Mapping[str, Sizes] = MappingProxyType(
    {
        "fokker50": Sizes(
            mass=1160.0,
            cg=0.25,
            vane=9.0,
            accelerometer=2.0,
            Ixx=96000.0,
            engine_y=1.2,
            engine_z=0.8,
            Cm_alpha2=6.0,
            Cm_alphadot=-5.75,
            Cn_beta3=-6.0,
            Cl_alpha_beta=0.6,
            gust=4.0,
            delay=0.08,
            turbulence=(3, 2),
        ),
        "737": Sizes(
            mass=3900.0,
            cg=0.4,
            vane=14.0,
            accelerometer=3.0,
            Ixx=120000.0,
            engine_y=1.0,
            engine_z=0.8,
            Cm_alpha2=4.0,
            Cm_alphadot=-16.0,
            Cn_beta3=-12.0,
            Cl_alpha_beta=1.0,
            gust=5.0,
            delay=0.08,
            turbulence=(4, 3),
        ),
        "pa28": Sizes(
            mass=72.0,
            cg=0.1,
            vane=2.5,
            accelerometer=0.8,
            Ixx=220.0,
            engine_y=0.3,
            engine_z=0.25,
            Cm_alpha2=5.0,
            Cm_alphadot=-4.0,
            Cn_beta3=-4.0,
            Cl_alpha_beta=0.5,
            gust=2.5,
            delay=0.06,
            turbulence=(3, 2),
        ),
    }
)


def cases(name: str) -> tuple[Case, ...]:
    """All cases of an airframe: clean ones, then one fault each."""
    s = SIZES[name]
    clean = [Case(name=f"clean_{i}", fault=None) for i in (1, 2, 3, 4)]
    return (
        *clean,
        *_control_cases(),
        *_sensor_cases(s),
        *_aircraft_cases(s),
        *_air_cases(s),
        *_some_records(s),
        *_outside(name),
    )


def _always(kind: str, target: str = "", size: float = 0.0, term: str | None = None, frequency_hz: float = 4.0) -> Case:
    words = [kind, target, (term or "").replace("^", "").replace("*", "_")]
    fault = Fault(kind=kind, target=target, term=term, size=size, frequency_hz=frequency_hz)
    return Case(name="_".join(word for word in words if word), fault=fault)


def _event(kind: str, target: str, size: float, onsets: Mapping[str, float], duration_s: float | None = None) -> Case:
    fault = Fault(kind=kind, target=target, size=size, onset_s=0.0, duration_s=duration_s)
    return Case(name=f"{kind}_{target}".replace("+", "_"), fault=fault, onsets=onsets)


def _control_cases() -> Iterator[Case]:
    yield _always("actuator_lag", "delta_e", 0.10)
    yield _always("actuator_lag", "delta_a", 0.12)
    yield _always("input_delay", "delta_r", 0.08)
    yield _always("rate_limit", "delta_e", 0.20)
    yield _always("dead_zone", "delta_r", 0.010)
    yield _always("backlash", "delta_e", 0.007)
    yield _event("effectiveness_change", "delta_r", -0.30, {**_ONSETS, "m2": 10.0})
    yield _event("effectiveness_change", "delta_e", -0.25, {"m1": 12.0, "m3": 10.9})


def _sensor_cases(s: Sizes) -> Iterator[Case]:
    yield _always("sensor_bias", "q", 0.006)
    yield _always("sensor_scale", "beta", 0.10)
    yield _always("sensor_scale", "r", -0.06)
    yield _always("sensor_delay", "inertial", s.delay)
    yield _always("sensor_delay", "alpha", s.delay)
    yield _always("sensor_lag", "beta", 0.15)
    yield _always("vane_position", "alpha", s.vane)
    yield _always("accelerometer_position", "x", s.accelerometer)
    yield _always("structural_mode", "q", 0.02)


def _aircraft_cases(s: Sizes) -> Iterator[Case]:
    yield _always("aero_term", "Cm", s.Cm_alpha2, "alpha^2")
    yield _always("aero_term", "Cl", s.Cl_alpha_beta, "alpha*beta")
    yield _always("aero_term", "Cn", s.Cn_beta3, "beta^3")
    yield _always("unsteady_aero", "Cm", s.Cm_alphadot)
    yield _always("mass", "", s.mass)
    yield _always("cg_offset", "x", s.cg)
    yield _always("inertia", "Ixx", s.Ixx)
    yield _always("thrust_asymmetry", "", s.engine_y)
    yield _always("thrust_line", "", s.engine_z)
    yield _event("configuration_change", "CL+CD", 1.0, _ONSETS)


def _air_cases(s: Sizes) -> Iterator[Case]:
    yield _always("turbulence", "", s.turbulence[0])
    yield replace(_always("turbulence", "", s.turbulence[1]), name="turbulence_light")
    yield _event("gust", "z", s.gust, _TWO)
    yield _event("gust", "y", s.gust, {"m2": 11.5})
    yield _event("wind_shear", "x", 0.35, {"m1": 9.0, "m2": 4.0, "m3": 14.0})


def _some_records(s: Sizes) -> Iterator[Case]:
    yield replace(_always("cg_offset", "x", -s.cg), name="cg_offset_x_in_two", records=("m2", "m3"))
    yield replace(_always("sensor_scale", "beta", -0.12), name="sensor_scale_beta_in_one", records=("m2",))


def _outside(name: str) -> Iterator[Case]:
    if AIRFRAMES[name].engines == 1:  # on a twin the propellers' moments drown
        yield Case(name="outside_propeller_moments", fault=Fault(kind="propeller_moments", size=1.0))


def flights(name: str, case: Case, duration_s: float = 28.0) -> dict[str, Flight]:
    """The four flights of a case; every case has its own seeds."""
    index = [c.name for c in cases(name)].index(case.name)
    base = 1000 * (1 + sorted(AIRFRAMES).index(name)) + 10 * index
    out = {}
    for number, (record, card) in enumerate(RECORDS.items()):
        fault = case.fault
        if record not in case.affected:
            fault = None
        elif fault is not None and fault.onset_s is not None:
            fault = replace(fault, onset_s=case.onsets[record])
        out[record] = Flight(aircraft=name, manoeuvre=card, fault=fault, seed=base + number, duration_s=duration_s)
    return out


def truth(frame: Airframe, case: Case, logs: Mapping[str, Log]) -> dict[str, Any]:
    """What is hidden in a case, in the words and units of the vocabulary; `also_present` is small and always there."""
    fault = case.fault
    general = {
        "aircraft": frame.name,
        "case": case.name,
        "gravity": next(iter(logs.values())).gravity,
        "also_present": [{"kind": "aero_term", "target": c, "term": t, "size": s} for c, t, s in frame.curvature],
    }
    if fault is None:
        return general | {"kind": "clean", "target": "", "term": None, "size": None, "onset_s": None, "records": []}
    size, parameters = fault.size, {}
    target = fault.target
    if fault.kind == "turbulence":
        axes = ("turb_x", "turb_y", "turb_z")
        size = float(np.sqrt(np.mean([np.mean(log.channels[a] ** 2) for log in logs.values() for a in axes])))
        parameters = {"severity": fault.size}
    elif fault.kind == "configuration_change":
        target, size = "+".join(frame.configuration_steps), next(iter(frame.configuration_steps.values()))
        parameters = dict(frame.configuration_steps)
    elif fault.kind == "structural_mode":
        parameters = {"frequency_hz": fault.frequency_hz}
    elif fault.kind == "gust":
        parameters = {"duration_s": fault.duration_s}
    return general | {
        "kind": fault.kind,
        "target": target,
        "term": fault.term,
        "size": size,
        "unit": fault.unit,
        "parameters": parameters,
        "onset_s": dict(case.onsets) or None,
        "records": list(case.affected),
    }


def rounded(record: Record) -> Record:
    """The record with no more digits than its channels carry."""
    digits = {name: DIGITS.get(name, 5) for name in record.channels}
    return record.with_channels(**{name: np.round(record[name], n) + 0.0 for name, n in digits.items()})


def write_case(name: str, case: Case, folder: Path, aircraft_toml: str) -> None:
    """Fly a case and write its records, aircraft file and truth below `folder`."""
    target = folder / name / case.name
    target.mkdir(parents=True, exist_ok=True)
    logs = {}
    for record, flight in flights(name, case).items():
        logs[record] = log_of(flight)
        write_record(rounded(record_of(flight, logs[record])), target / f"{record}.csv")
    (target / "aircraft.toml").write_text(aircraft_toml)
    (target / "truth.json").write_text(json.dumps(truth(airframe(name), case, logs), indent=1) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description="Fly the corpus of hidden effects in JSBSim.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--aircraft", nargs="+", default=list(SIZES), choices=list(SIZES))
    parser.add_argument("--case", nargs="+", default=["*"])
    options = parser.parse_args()
    for name in options.aircraft:
        target = options.out / name / "aircraft.toml"
        target.parent.mkdir(parents=True, exist_ok=True)
        aircraft_file(name, seed=7).write(target)
        for case in cases(name):
            if any(fnmatch(case.name, pattern) for pattern in options.case):
                print(name, case.name, flush=True)
                write_case(name, case, options.out, target.read_text())


if __name__ == "__main__":
    run_script(main)
