"""Identification of aircraft from flight data.

The public names below load the room they live in when they are first used, so that `import casid` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from casid.native import threads  # noqa: F401  before anything loads numpy

if TYPE_CHECKING:
    from casid.diagnosis.diagnose import diagnose
    from casid.errors import CasidError, EstimationError, InputError
    from casid.estimation import (
        Automatic,
        Collocation,
        CombinedError,
        EquationError,
        GaussNewton,
        InitialState,
        Ipopt,
        MultipleShooting,
        OutputError,
        Problem,
        RangeWeights,
        SingleShooting,
        linear,
        parameter,
        path,
        solve,
    )
    from casid.filtering.filter_error import filter_error
    from casid.model.aircraft import Aircraft
    from casid.model.dynamics import aircraft_model, flight_inputs
    from casid.model.simulate import simulate
    from casid.model.system import Model, define_model
    from casid.model.trim import trim
    from casid.records import Record, read_record, read_records, write_record
    from casid.report.page import write_report

_ROOMS = {
    "casid.errors": ("CasidError", "EstimationError", "InputError"),
    "casid.records": ("Record", "read_record", "read_records", "write_record"),
    "casid.model.aircraft": ("Aircraft",),
    "casid.model.dynamics": ("aircraft_model", "flight_inputs"),
    "casid.model.simulate": ("simulate",),
    "casid.model.system": ("Model", "define_model"),
    "casid.model.trim": ("trim",),
    "casid.estimation": (
        "Automatic",
        "Collocation",
        "CombinedError",
        "EquationError",
        "GaussNewton",
        "InitialState",
        "Ipopt",
        "MultipleShooting",
        "OutputError",
        "Problem",
        "RangeWeights",
        "SingleShooting",
        "linear",
        "parameter",
        "path",
        "solve",
    ),
    "casid.filtering.filter_error": ("filter_error",),
    "casid.diagnosis.diagnose": ("diagnose",),
    "casid.report.page": ("write_report",),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [
    "Aircraft",
    "Automatic",
    "CasidError",
    "Collocation",
    "CombinedError",
    "EquationError",
    "EstimationError",
    "GaussNewton",
    "InitialState",
    "InputError",
    "Ipopt",
    "Model",
    "MultipleShooting",
    "OutputError",
    "Problem",
    "RangeWeights",
    "Record",
    "SingleShooting",
    "aircraft_model",
    "define_model",
    "diagnose",
    "filter_error",
    "flight_inputs",
    "linear",
    "parameter",
    "path",
    "read_record",
    "read_records",
    "simulate",
    "solve",
    "trim",
    "write_record",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'casid' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
