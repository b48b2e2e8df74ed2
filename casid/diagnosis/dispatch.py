"""`diagnose` for an aircraft file, or for a model of any dynamic system."""

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
from casid.model.port import ModelPort as Port
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
    """Diagnose what a simulation gets wrong, with measured records.

    Parameters
    ----------
    simulation
        An `Aircraft` or the name of its file, or the `Model` of any dynamic system (`define_model`).
    records
        Records to be fitted, in SI units and radians, or names of files.
    hold_out
        Records that are never fitted. If none is given, the last record is held out, or the last third of a single one.
    report
        Function that is called with the name of every stage.
    criteria
        Thresholds of the diagnosis; by default `Criteria()`.
    as_recorded
        For an aircraft: the data stay as recorded, and faults are only reported.
    axes
        For an aircraft: the scope, "longitudinal", "lateral" or "full"; by default the largest that the records
        support.
    ports
        For a model: where reality may differ; by default every state derivative, input and output not in `exact`.
    exact
        For a model: names of states with exact equations, and of exact inputs and outputs.
    library
        For a model: the causes that are considered; by default all that any system may have.

    Returns
    -------
    Diagnosis or SystemDiagnosis
        For an aircraft or a model: the named causes with their sizes, and the improvement by each on records that were
        not fitted. Print it for the account; `save` stores it and `write_report` makes a page of it.

    Raises
    ------
    InputError
        For records that lack inputs of the simulation, and for ports of an aircraft, whose ports are fixed.
    EstimationError
        If the model cannot be fitted at all.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> print(found)  # doctest: +SKIP
    >>> cs.write_report(found, "report")  # doctest: +SKIP
    """
    if isinstance(simulation, Model):
        if {"axes", "as_recorded"} & set(options):
            raise InputError("axes and as_recorded are for an aircraft; a Model takes ports, exact and library")
        return diagnose_system(simulation, *arguments, **options)
    if {"ports", "exact", "library"} & set(options):
        raise InputError("ports, exact and library are for a Model; an aircraft has the ports of its mass properties")
    return diagnose_aircraft(simulation, *arguments, **options)
