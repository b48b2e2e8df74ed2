"""Healthy flights in which faults are hidden: of JSBSim, of the Do 328, and real ones where the data are there."""

from __future__ import annotations

import os
from collections.abc import Iterator
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


@dataclass(frozen=True, eq=False, kw_only=True)
class HealthyFlight:
    """Records without a known fault, and the aircraft file that belongs to them."""

    name: str
    records: tuple[Record, ...]
    aircraft: Aircraft


def flight_data() -> Path:
    """The folder of the real flight records: CASID_DATA, or ../shared/data beside the checkout."""
    return Path(os.environ.get("CASID_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def real_flight(name: str, folder: Path) -> HealthyFlight:
    """A real flight of REAL. Raises InputError when its files are not in the folder."""
    book = folder / "fvsysid" if (folder / "fvsysid").is_dir() else folder
    if name in _ATTAS:
        records = [record for file in _ATTAS[name] for record in attas.records_from(book, file)]
        return HealthyFlight(name=name, records=tuple(records), aircraft=attas.aircraft())
    if name == "hfb320":
        columns = ColumnMap.from_options([f"{channel}={i + 1}" for i, channel in enumerate(hfb320.COLUMNS)])
        record = read_record(book / "hfb320_1_10.asc", columns)
        record = record.with_channels(rho=2.0 * record["qbar"] / record["V"] ** 2)
        return HealthyFlight(name=name, records=(record,), aircraft=hfb320_aircraft.aircraft())
    stem = _SIDPAC[name]
    record = read_record(folder / "sidpac" / f"{stem}.csv")
    return HealthyFlight(name=name, records=(record,), aircraft=Aircraft.read(folder / "sidpac" / f"{stem}.toml"))


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
