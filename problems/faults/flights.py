"""Healthy flights in which faults are hidden: of JSBSim, of the Do 328, and real ones where the data are there."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.records.column_map import ColumnMap
from casid.records.readers import read_record
from casid.records.record import Record
from problems.blind.sets import fly_set
from problems.real import attas, hfb320, hfb320_aircraft

REAL: tuple[str, ...] = (
    "attas elevator",
    "attas lateral",
    "hfb320",
    "totter 014",
    "totter 017",
    "tu144 4d",
    "tu144 4f",
)
_ATTAS = {"attas elevator": ("fAttasElv1", "fAttasElv2"), "attas lateral": ("fAttasAil1", "fAttasRud1")}
_SIDPAC = {
    "totter 014": "totter_f1_014",
    "totter 017": "totter_f1_017",
    "tu144 4d": "tu144_f20_4d",
    "tu144 4f": "tu144_f20_4f",
}


_LATE = ("sensor_delay", "sensor_lag", "vane_position")
# What the instruments of these flights have of their own, by aircraft and by flight: under "Certain" in the findings of
# `problems/real`, or borne out by regressions outside the package, with what the data do not tell from it.
_OWN: Mapping[str, frozenset[tuple[str, str]]] = {
    "attas": frozenset(
        {(kind, target) for kind in _LATE for target in ("V", "alpha", "beta", "air_data")}
        | {("sensor_scale", target) for target in ("p", "q", "r", "phi", "theta", "psi", "inertial", "attitude")}
        | {("sensor_bias", target) for target in "pqr"}
        | {("sensor_delay", target) for target in ("p", "psi")}
        | {("accelerometer_position", "y")}
    ),
    "hfb320": frozenset({("turbulence", ""), *((kind, target) for kind in _LATE for target in ("alpha", "air_data"))}),
    "totter": frozenset(
        {("input_delay", "delta_a"), ("actuator_lag", "delta_a"), ("sensor_scale", "beta"), ("sensor_scale", "r")}
        | {(kind, "beta") for kind in _LATE}
        | {("sensor_delay", "p"), ("sensor_lag", "p")}
    ),
    "totter 014": frozenset({("sensor_scale", "p"), ("sensor_scale", "phi")}),
    "tu144": frozenset(
        {("input_delay", "delta_e"), ("actuator_lag", "delta_e"), ("sensor_scale", "theta"), ("sensor_scale", "alpha")}
        | {("sensor_bias", "ax"), ("sensor_bias", "theta"), ("sensor_misalignment", "inertial")}
        | {(kind, target) for kind in _LATE for target in ("alpha", "air_data")}
    ),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class HealthyFlight:
    """Records, and the aircraft file that belongs to them; `own` are kind and target of what a real flight has."""

    name: str
    records: tuple[Record, ...]
    aircraft: Aircraft
    own: frozenset[tuple[str, str]] = frozenset()


def flight_data() -> Path:
    """The folder of the real flight records: CASID_DATA, or ../shared/data beside the checkout."""
    return Path(os.environ.get("CASID_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def real_flight(name: str, folder: Path) -> HealthyFlight:
    """A real flight of REAL. Raises InputError when its files are not in the folder."""
    own = _OWN[name.split()[0]] | _OWN.get(name, frozenset())
    book = folder / "fvsysid" if (folder / "fvsysid").is_dir() else folder
    if name in _ATTAS:
        records = [record for file in _ATTAS[name] for record in attas.records_from(book, file)]
        return HealthyFlight(name=name, records=tuple(records), aircraft=attas.aircraft(), own=own)
    if name == "hfb320":
        columns = ColumnMap.from_options([f"{channel}={i + 1}" for i, channel in enumerate(hfb320.COLUMNS)])
        record = read_record(book / "hfb320_1_10.asc", columns)
        record = record.with_channels(rho=2.0 * record["qbar"] / record["V"] ** 2)
        return HealthyFlight(name=name, records=(record,), aircraft=hfb320_aircraft.aircraft(), own=own)
    stem = _SIDPAC[name]
    record = read_record(folder / "sidpac" / f"{stem}.csv")
    aircraft = Aircraft.read(folder / "sidpac" / f"{stem}.toml")
    return HealthyFlight(name=name, records=(record,), aircraft=aircraft, own=own)


def flights(seed: int) -> Iterator[HealthyFlight]:
    """The flights of a seed: one of JSBSim, one of the Do 328, one real one."""
    for of in ("jsbsim", "do328"):
        if of == "jsbsim" and find_spec("jsbsim") is None:
            continue
        flown = fly_set(of, f"clean-{1 + seed % 10}", seed)
        yield HealthyFlight(name=f"{of} {flown.aircraft.name}", records=flown.records, aircraft=flown.aircraft)
    name = REAL[int(np.random.default_rng([seed, 3]).integers(len(REAL)))]
    try:
        yield real_flight(name, flight_data())
    except InputError:
        return
