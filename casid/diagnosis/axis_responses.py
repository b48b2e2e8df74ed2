"""Compute how an aircraft with rotors answers a command about each axis: by its file, and by the records."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from casid.diagnosis.document import AxisResponses
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.effects import effect_of
from casid.model.rotors import Rotors
from casid.records.record import Record

_AXES = {"roll": "p", "pitch": "q", "yaw": "r", "climb": "w"}


def axis_responses(given: Aircraft, extended: Aircraft, records: Sequence[Record]) -> AxisResponses:
    """The answers to steps of the inputs by which the file rolls, pitches, yaws and climbs alone, with 1 rad/s2 or
    1 m/s2, about the mean inputs of the records."""
    rotors = given.required_rotors
    after = _behind(extended)
    at = {name: float(np.mean(np.concatenate([record[name] for record in records]))) for name in rotors.inputs}
    file, found = (_per_input(aircraft, at) for aircraft in (given, extended))
    steps = np.linalg.pinv(file)
    t = np.linspace(0.0, 0.5, 201)
    rise = _rise(rotors, t)
    risen = _rise(after, t)
    return AxisResponses(
        t=t,
        as_given={axis: rise @ (file[i] * steps[:, i]) for i, axis in enumerate(_AXES)},
        extended={axis: risen @ (found[i] * steps[:, i]) for i, axis in enumerate(_AXES)},
    )


def _per_input(aircraft: Aircraft, at: dict[str, float]) -> np.ndarray:
    """(4, rotors) angular accelerations and climbing acceleration per input of each rotor."""
    model = aircraft_model(aircraft)
    slope = ca.Function("slope", [model.x, model.u, model.p, model.w], [ca.jacobian(model.f, model.u)])
    inputs = [at.get(name, 1.0 if name == "rho" else 0.0) for name in model.inputs]
    rest = np.zeros(len(model.states))
    table = slope(rest, inputs, model.nominal_vector(), np.zeros(len(model.disturbances))).full()
    columns = [model.inputs.index(name) for name in aircraft.required_rotors.names]
    rows = [model.states.index(state) for state in _AXES.values()]
    return table[np.ix_(rows, columns)] * np.array([[1.0], [1.0], [1.0], [-1.0]])


def _behind(aircraft: Aircraft) -> Rotors:
    """The rotors with the effects of the aircraft file in their numbers, as far as these hold them."""
    rotors = aircraft.required_rotors
    for value in aircraft.effects:
        make = effect_of(value).forms.into_rotors
        rotors = (make(rotors, aircraft.mass * aircraft.gravity, value.value) if make else None) or rotors
    return rotors


def _rise(rotors: Rotors, t: np.ndarray) -> np.ndarray:
    """(times, rotors) what a unit acceleration behind the delay and the lag of each rotor has added to a rate."""
    columns = []
    for one in rotors.each:
        since = np.maximum(t - one.delay, 0.0)
        columns.append(since + one.lag * np.expm1(-since / one.lag) if one.lag else since)
    return np.stack(columns, axis=1)
