"""Inputs that run along a cubic spline through their samples, for integrators that know linear and held inputs alone.

Within a sample interval that begins at t_k such an input is u_k + c1 (t - t_k) + c2 (t - t_k)^2 + c3 (t - t_k)^3. The
numbers u_k, c1, c2, c3 and t_k are held over the interval, and the time t is linear. So the model gets them as inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
import scipy

from casid.model.system import Model, substituted
from casid.records.record import Record

_BEGIN = "time at the last sample"
_DEGREES = (1, 2, 3)


def cubic_inputs(model: Model, records: Sequence[Record]) -> tuple[str, ...]:
    """Inputs of the model that are cubic in some record."""
    return tuple(n for n in model.inputs if any(record.hold_of(n) == "cubic" for record in records))


def with_splines(model: Model, names: Sequence[str]) -> Model:
    """The model whose inputs `names` are polynomials in the time since the last sample; it takes `splined` records."""
    further = [_BEGIN, *(_coefficient(name, k) for name in names for k in _DEGREES)]
    inputs = (*model.inputs, *(n for n in ("t", *further) if n not in model.inputs))
    u = ca.SX.sym("u", len(inputs))
    at = {name: u[i] for i, name in enumerate(inputs)}
    since = at["t"] - at[_BEGIN]
    run = ca.SX(u[: len(model.inputs)])
    for name in names:
        c1, c2, c3 = (at[_coefficient(name, k)] for k in _DEGREES)
        run[model.inputs.index(name)] += since * (c1 + since * (c2 + since * c3))
    return substituted(model, model.u, run, inputs=inputs, u=u)


def splined(record: Record, names: Sequence[str]) -> Record:
    """The record with what `with_splines` takes."""
    t = record.t
    count = len(record)
    added = {_BEGIN: t}
    hold = {} if isinstance(record.hold, str) else dict(record.hold)
    if isinstance(record.hold, str) and record.hold != "cubic":
        hold = dict.fromkeys(record.channels, record.hold)
    for name in names:
        coefficients = np.zeros((3, count))
        how = record.hold_of(name)
        if how == "cubic" and count > 2:
            coefficients[:, :-1] = scipy.interpolate.CubicSpline(t, record[name]).c[2::-1]
        elif how != "held" and count > 1:
            coefficients[0, :-1] = np.diff(record[name]) / np.diff(t)
        added |= {_coefficient(name, k): coefficients[k - 1] for k in _DEGREES}
        hold[name] = "held"
    return replace(record.with_channels(**added), hold=hold | dict.fromkeys(added, "held"))


def _coefficient(name: str, degree: int) -> str:
    return f"{name}: coefficient of (t - t_k)^{degree}"
