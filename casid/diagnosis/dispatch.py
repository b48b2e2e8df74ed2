"""`diagnose`: of an aircraft file, or of a simulation of any dynamic system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, overload

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose import diagnose as diagnose_aircraft
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.systems.diagnose import diagnose_system
from casid.diagnosis.systems.library import Library
from casid.diagnosis.systems.result import SystemDiagnosis
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.port import Port
from casid.model.system import Model
from casid.records.record import Record

Say = Callable[[str], None]


@overload
def diagnose(
    simulation: Aircraft | str | Path,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Say = ...,
    criteria: Criteria | None = None,
    *,
    as_recorded: bool = False,
    axes: str | None = None,
) -> Diagnosis: ...


@overload
def diagnose(
    simulation: Model,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Say = ...,
    criteria: Criteria | None = None,
    *,
    ports: Sequence[Port] | None = None,
    exact: Sequence[str] = (),
    library: Library | None = None,
) -> SystemDiagnosis: ...


def diagnose(simulation: Any, *arguments: Any, **options: Any) -> Diagnosis | SystemDiagnosis:
    """What a simulation gets wrong, given measured records.

    Parameters
    ----------
    simulation
        An `Aircraft` or the name of its file, or the `Model` of any dynamic system (`define_model`).
    records, hold_out, report, criteria, as_recorded, axes
        Of an aircraft: see `casid.diagnosis.diagnose.diagnose`.
    records, hold_out, report, criteria, ports, exact, library
        Of a model: see `casid.diagnosis.systems.diagnose.diagnose_system`.

    Raises
    ------
    InputError
        For records that cannot feed the simulation, and for ports of an aircraft, which has its own.
    """
    if isinstance(simulation, Model):
        if {"axes", "as_recorded"} & set(options):
            raise InputError("axes and as_recorded are for an aircraft; a Model takes ports, exact and library")
        return diagnose_system(simulation, *arguments, **options)
    if {"ports", "exact", "library"} & set(options):
        raise InputError("ports, exact and library are for a Model; an aircraft has the ports of its mass properties")
    return diagnose_aircraft(simulation, *arguments, **options)
