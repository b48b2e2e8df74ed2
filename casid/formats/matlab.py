"""MATLAB and Simulink: the whole aircraft as one struct `aircraft`, in a .mat or as an .m script that makes it."""

from __future__ import annotations

from typing import Any

import numpy as np

from casid.arguments import identifier
from casid.errors import InputError
from casid.formats.absorbed import terms_of
from casid.model.aircraft import Aircraft

_SCALARS = ("name", "mass", "gravity", "area", "moment_length_lateral", "moment_length_pitch")
_SCALARS += ("rate_length_lateral", "rate_length_pitch", "thrust_line_z", "force_axes")
_OF_EFFECTS = ("kind", "target", "term", "value", "std", "unit")
_POSITIONS = ("engine_y", "accelerometer", "alpha_vane", "beta_vane")


def struct_of(aircraft: Aircraft) -> dict[str, Any]:
    """The aircraft as nested plain values; `terms` is a list of coefficient, term, value, `tables` of coefficient,
    axes, breakpoints and values. Raises InputError for aerodynamics that are a function or another simulation's file.
    """
    if aircraft.aerodynamics is not None:
        raise InputError(
            f"'{aircraft.name}': its aerodynamics are a function or another simulation's file, which no struct holds"
        )
    found: dict[str, Any] = {name: getattr(aircraft, name) for name in _SCALARS}
    found |= {name: list(getattr(aircraft, name)) for name in _POSITIONS}
    found["inertia"] = {n: getattr(aircraft.inertia, n) for n in ("Ixx", "Iyy", "Izz", "Ixz", "Ixy", "Iyz")}
    found["trim"], found["noise"] = dict(aircraft.trim), dict(aircraft.noise)
    found["terms"] = [{"coefficient": c, "term": term, "value": value} for c, term, value in terms_of(aircraft)]
    found["tables"] = [
        {
            "name": one.name,
            "coefficient": one.coefficient,
            "axes": list(one.axes),
            "breakpoints": [list(axis) for axis in one.grid.breakpoints],
            "values": np.asarray(one.grid.values, dtype=float).reshape(one.grid.shape),
            "times": one.times,
            "method": one.grid.method,
            "outside": one.grid.outside,
        }
        for one in aircraft.tables
    ]
    found["effects"] = [
        {n: getattr(one, n) for n in _OF_EFFECTS} | {"term": one.term or "", "parameters": dict(one.parameters)}
        for one in aircraft.effects
    ]
    return found


def matlab_text(struct: dict[str, Any]) -> str:
    """The struct as a script."""
    name = _quoted(struct["name"])
    line = " ".join(struct["name"].split())
    lines = [
        f"% {line}, written by casid. SI units and radians; body axes x forward, y right, z down.",
        "",
        "% A coefficient is the sum of its terms, value times monomial, p, q, r made dimensionless with",
        "% rate_length_lateral / V and rate_length_pitch / V, and of its tables.",
        f"clear aircraft; aircraft.name = {name};",
    ]
    for key, value in struct.items():
        if key != "name":
            lines += _assigned(f"aircraft.{key}", value)
    return "\n".join(lines) + "\n"


def mat_of(struct: dict[str, Any]) -> dict[str, Any]:
    """The struct for scipy.io.savemat: lists of structs become arrays of structs."""
    return {key: _for_mat(value) for key, value in struct.items()}


def _for_mat(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _for_mat(one) for key, one in value.items()} or np.zeros((0, 0))
    if isinstance(value, list) and value and isinstance(value[0], dict):
        made = np.empty(len(value), dtype=[(key, object) for key in value[0]])
        for i, one in enumerate(value):
            made[i] = tuple(_for_mat(one[key]) for key in value[0])
        return made
    if isinstance(value, list) and value and isinstance(value[0], (str, list)):
        cell = np.empty(len(value), dtype=object)
        cell[:] = [np.asarray(one, dtype=float) if isinstance(one, list) else one for one in value]
        return cell
    return np.asarray(value, dtype=float) if isinstance(value, list) else value


def _assigned(name: str, value: Any) -> list[str]:
    """Lines that give a name a value."""
    if isinstance(value, dict):
        found = [line for key, one in value.items() for line in _assigned(f"{name}.{identifier(key, name)}", one)]
        return found or [f"{name} = struct();"]
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [line for i, one in enumerate(value, 1) for line in _assigned(f"{name}({i})", one)]
    if isinstance(value, list) and value and isinstance(value[0], (str, list)):
        return [f"{name} = {{{', '.join(_value(one) for one in value)}}};"]
    return [f"{name} = {_value(value)};"]


def _value(value: Any) -> str:
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, np.ndarray) and value.ndim > 2:
        return f"reshape({_value(value.ravel(order='F').tolist())}, {_value(list(value.shape))})"
    if isinstance(value, np.ndarray) and value.ndim == 2:
        return "[" + "; ".join(" ".join(repr(float(v)) for v in row) for row in value) + "]"
    if isinstance(value, (list, np.ndarray)):
        return "[" + " ".join(repr(float(v)) for v in value) + "]"
    return repr(float(value))


def _quoted(text: str) -> str:
    """Return a text as MATLAB has it, which ends neither the quotes nor the line."""
    return "'" + " ".join(text.splitlines()).replace("'", "''") + "'"
