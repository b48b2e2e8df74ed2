"""Unknown forces and moments: an aircraft without aerodynamics, and disturbances as large as its motion.

The kinematics must not depend on the coefficients of the aircraft file. If its derivatives were kept, an error of a
moment that exceeds the free moment would distort the trajectory until alpha compensates for it, and every instrument
would appear faulty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from weakref import WeakKeyDictionary

import numpy as np

from casid.diagnosis.criteria import KinematicCriteria
from casid.diagnosis.flight.flight import Flight
from casid.model import station
from casid.model.path import MOMENTS, coefficient_names
from casid.records.record import Record

_RATES: Mapping[str, str] = MappingProxyType({"Cl": "p", "Cm": "q", "Cn": "r"})
_FORCES: Mapping[str, str] = MappingProxyType({"CX": "ax", "CY": "ay", "CZ": "az"})


_ALREADY: WeakKeyDictionary[Flight, Flight] = WeakKeyDictionary()  # keeps the models that were built


def without_aerodynamics(flight: Flight) -> Flight:
    """The flight of an aircraft with constant coefficients in body axes.

    The forces are those that the accelerometers measure on average, and the moments balance the thrust. The result is
    the same object for the same flight.
    """
    if flight in _ALREADY.values():
        return flight
    if flight not in _ALREADY:
        nothing = {"terms": {}, "tables": (), "aerodynamics": None, "effects": ()}
        bare = replace(flight.aircraft, force_axes="body", derivatives=_constants(flight), **nothing)
        _ALREADY[flight] = replace(flight, aircraft=bare, _models={}, _functions={}, _regressors={})
    return _ALREADY[flight]


def _constants(flight: Flight) -> dict[str, float]:
    """Constant coefficients in body axes."""
    aircraft, found = flight.aircraft, dict.fromkeys((f"{c}_0" for c in coefficient_names("body")), 0.0)
    pressure = np.concatenate([0.5 * record["rho"] * _airspeed(flight, record) ** 2 for record in flight.records])
    qS, thrust = pressure * aircraft.area, np.concatenate([record["thrust"] for record in flight.records])
    for coefficient, channel in _FORCES.items():
        if channel in flight.outputs:
            force = aircraft.mass * np.concatenate([record[channel] for record in flight.records])
            force = force - thrust if channel == "ax" else force
            found[f"{coefficient}_0"] = float(np.nanmean(force / qS))
    arm = aircraft.thrust_line_z / aircraft.moment_length_pitch
    return found | {"Cm_0": -float(np.nanmean(arm * thrust / qS))}


def _airspeed(flight: Flight, record: Record) -> np.ndarray:
    """(N,) True airspeed [m/s]; the typical speed if it is not measured."""
    return record["V"] if "V" in record else np.full(len(record), typical_speed(flight))


def free_forces(flight: Flight) -> dict[str, tuple[float, float]]:
    """Coefficient -> r.m.s. and time constant [s] of a Gauss-Markov disturbance that is as large as the motion.

    A larger disturbance of an angular acceleration would follow the noise of the rate, and the lever arm of an
    instrument would be estimated too small.
    """
    aircraft, criteria = flight.aircraft, flight.criteria.kinematics
    qS = 0.5 * float(np.median(flight.records[0]["rho"])) * typical_speed(flight) ** 2 * aircraft.area
    inertia = {"Cl": aircraft.inertia.Ixx, "Cm": aircraft.inertia.Iyy, "Cn": aircraft.inertia.Izz}
    lengths = {"Cm": aircraft.moment_length_pitch}
    free = {}
    for name in coefficient_names(aircraft.force_axes):
        if name in MOMENTS:
            size = _angular_acceleration(flight, _RATES[name], criteria) * inertia[name]
            size /= qS * lengths.get(name, aircraft.moment_length_lateral)
            free[station.coefficient(name)] = (size, criteria.moment_time)
        else:
            free[station.coefficient(name)] = (criteria.force * aircraft.mass / qS, criteria.force_time)
    return free


def typical_speed(flight: Flight) -> float:
    """Median true airspeed [m/s], or that of the trim."""
    V = np.concatenate([record["V"] for record in flight.records if "V" in record] or [np.array([np.nan])])
    return float(np.nanmedian(V)) if np.isfinite(V).any() else flight.aircraft.trim["V"]


def _angular_acceleration(flight: Flight, rate: str, criteria: KinematicCriteria) -> float:
    """1-sigma [rad/s2] of a free angular acceleration.

    It is computed from the increments of the measured rate over the correlation time, as for an integrated first-order
    Gauss-Markov process. The part that the noise of the rate adds to the increments is subtracted.
    """
    if rate not in flight.outputs:
        return criteria.unmeasured_moment
    squares, lasts, time = [], [], criteria.moment_time
    for record in flight.records:
        there = np.isfinite(record[rate])
        t, values = record.t[there], record[rate][there]
        lag = max(1, round(time / float(np.median(np.diff(t))))) if len(t) > 1 else 1
        if len(t) <= lag:
            continue
        squares.append((values[lag:] - values[:-lag]) ** 2)
        lasts.append(float(np.median(t[lag:] - t[:-lag])))
    if not lasts:
        return criteria.unmeasured_moment
    x = float(np.mean(lasts)) / time
    increments = float(np.mean(np.concatenate(squares))) - 2.0 * flight.sigma[rate] ** 2
    variance = increments / (2.0 * time**2 * (x - 1.0 + np.exp(-x)))
    return max(criteria.peak * float(np.sqrt(max(variance, 0.0))), criteria.smallest_moment)
