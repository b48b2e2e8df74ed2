"""Immediate effect of the surfaces on the accelerations, by the derivatives of an aircraft file.

A surface that reverses from one sample to the next makes a jump in the accelerations before the aircraft turns. Such a
sample looks like an outlier, but is not one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casid.model.aircraft import Aircraft
from casid.model.dynamics import standard_density
from casid.records.record import Record
from casid.signals import SURFACES

_FORCES: Mapping[str, str] = {"CX": "ax", "CY": "ay", "CZ": "az"}
_OF_LIFT: Mapping[str, str] = {"CD": "ax", "CY": "ay", "CL": "az"}  # along body axes at small angles, less than zero


def answers(record: Record, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """Acceleration -> (N,) immediate effect of the recorded surfaces [SI]; empty if airspeed or density is unknown."""
    pressure = _pressure(record, aircraft)
    if pressure is None:
        return {}
    qS = pressure * aircraft.area
    force = {name: 0.0 * qS for name in _FORCES.values()}
    sides = _FORCES if aircraft.force_axes == "body" else _OF_LIFT
    for coefficient, channel in sides.items():
        sign = 1.0 if coefficient in _FORCES else -1.0
        force[channel] = sign * qS * _by_surfaces(record, aircraft, coefficient) / aircraft.mass
    lengths = (aircraft.moment_length_lateral, aircraft.moment_length_pitch, aircraft.moment_length_lateral)
    moments = [
        qS * length * _by_surfaces(record, aircraft, c) for c, length in zip(("Cl", "Cm", "Cn"), lengths, strict=True)
    ]
    inertia = aircraft.inertia
    tensor = np.array(
        [
            [inertia.Ixx, -inertia.Ixy, -inertia.Ixz],
            [-inertia.Ixy, inertia.Iyy, -inertia.Iyz],
            [-inertia.Ixz, -inertia.Iyz, inertia.Izz],
        ]
    )
    turning = dict(zip(("pdot", "qdot", "rdot"), np.linalg.solve(tensor, np.stack(moments)), strict=True))
    found = {name: series for name, series in (force | turning).items() if name in record}
    return {name: series for name, series in found.items() if np.isfinite(series).all()}


def _by_surfaces(record: Record, aircraft: Aircraft, coefficient: str) -> np.ndarray:
    """(N,) part of a coefficient by the deflections."""
    derivatives = aircraft.derivatives
    parts = [derivatives.get(f"{coefficient}_{s}", 0.0) * record[s] for s in SURFACES if s in record]
    return np.sum(parts, axis=0) if parts else np.zeros(len(record))


def _pressure(record: Record, aircraft: Aircraft) -> np.ndarray | None:
    """(N,) dynamic pressure [Pa] by what is recorded, or else by the trim."""
    V = _filled(record, "V", aircraft.trim.get("V"))
    rho = _filled(record, "rho", aircraft.trim.get("rho"))
    if rho is None:
        altitude = _filled(record, "altitude", aircraft.trim.get("altitude"))
        rho = None if altitude is None else standard_density(altitude)
    return None if V is None or rho is None else 0.5 * rho * V**2


def _filled(record: Record, name: str, otherwise: float | None) -> np.ndarray | None:
    """(N,) a channel with straight lines across missing samples, or a constant."""
    if name in record and (there := np.isfinite(record[name])).any():
        return np.interp(record.t, record.t[there], record[name][there])
    return None if otherwise is None else np.full(len(record), otherwise)
