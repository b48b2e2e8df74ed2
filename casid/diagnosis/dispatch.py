"""`diagnose`: of an aircraft file, or of a simulation of any dynamic system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import overload

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
    simulation: Aircraft, records: Sequence[Record], hold_out: Sequence[Record] = (), report: Say = ...
) -> Diagnosis: ...


@overload
def diagnose(
    simulation: Model,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Say = ...,
    *,
    ports: Sequence[Port] | None = None,
    exact: Sequence[str] = (),
    library: Library | None = None,
) -> SystemDiagnosis: ...


def diagnose(
    simulation: Aircraft | Model,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Say = lambda stage: None,
    *,
    ports: Sequence[Port] | None = None,
    exact: Sequence[str] = (),
    library: Library | None = None,
) -> Diagnosis | SystemDiagnosis:
    """What a simulation gets wrong, given measured records.

    simulation  an `Aircraft`, or the `Model` of any dynamic system (`define_model`)
    hold_out    records that are never fitted; when none is given one record, or the last third of a single one, is held
                back
    report      is called with the name of every stage
    ports       of a Model, where reality may differ: default every state derivative, input and output but those whose
                equations are `exact`, that is beyond doubt
    library     of a Model, the causes that are considered; default all that any system may have
    Raises InputError for records that cannot feed the model, and for ports of an aircraft, which has its own.
    """
    if isinstance(simulation, Model):
        return diagnose_system(simulation, records, hold_out, ports=ports, exact=exact, library=library, report=report)
    if ports is not None or exact or library is not None:
        raise InputError("ports, exact and library are for a Model; an aircraft has the ports of its mass properties")
    return diagnose_aircraft(simulation, records, hold_out, report)
