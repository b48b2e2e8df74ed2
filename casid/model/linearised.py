"""Tables and own aerodynamics as derivatives at a flight point, for what wants to compare with numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from casid.model.aircraft import Aircraft
from casid.model.path import given_coefficients, speed_of_sound
from casid.model.terms import VARIABLES, derivative_term
from casid.records.record import Record
from casid.signals import SURFACES

_ANGLE = 0.35  # rad: a median beyond is no flight that derivatives describe
_USUAL = {"V": 100.0, "rho": 1.0, "thrust": 0.0}  # where neither file nor records give a value


def given_slopes(aircraft: Aircraft, records: Iterable[Record] = ()) -> dict[str, float]:
    """Name of each derivative of the file -> its slope by tables and own aerodynamics at the trim of the file, or at
    the medians of the records. Of a constant, so that the tangent is right there. Empty for a file without these."""
    if aircraft.aerodynamics is None and not aircraft.tables:
        return {}
    point = _point(aircraft, tuple(records))
    x = {name: ca.SX.sym(name) for name in VARIABLES}
    at = {name: 0.0 for name in VARIABLES} | {name: point[name] for name in ("alpha", *SURFACES)}
    qbar = 0.5 * point["rho"] * point["V"] ** 2
    at |= {"mach": point["V"] / float(speed_of_sound(point["rho"])), "Tc": point["thrust"] / (qbar * aircraft.area)}
    further = {"airspeed": point["V"], "qbar": qbar, "rho": point["rho"], "thrust": point["thrust"]}
    knots = {name: value for one in aircraft.tables for name, value in one.knots.items()}
    total: dict[str, ca.SX] = {}
    for coefficient, value in given_coefficients(aircraft, {**x, **further}, knots):
        total[coefficient] = total.get(coefficient, ca.SX(0.0)) + ca.SX(value)
    symbols = ca.vertcat(*x.values())
    slopes: dict[str, float] = {}
    for coefficient, value in total.items():
        f = ca.Function("slopes", [symbols], [value, ca.jacobian(value, symbols)])
        level, gradient = (np.array(part).ravel() for part in f(list(at.values())))
        by: dict[str, float] = dict(zip(VARIABLES, gradient.tolist(), strict=True))
        known = [n for n in aircraft.derivatives if derivative_term(n)[0] == coefficient]
        terms = {n: derivative_term(n)[1].name for n in known}
        slopes |= {n: by[term] for n, term in terms.items() if term != "0"}
        if f"{coefficient}_0" in known:
            slopes[f"{coefficient}_0"] = float(level[0]) - sum(by[t] * at[t] for t in terms.values() if t != "0")
    return slopes


def linearised(aircraft: Aircraft, records: Iterable[Record] = ()) -> Aircraft:
    """The aircraft with the derivatives that it has at a flight point in place of tables and own aerodynamics."""
    slopes = given_slopes(aircraft, records)
    if not slopes:
        return aircraft
    whole = {name: value + slopes.get(name, 0.0) for name, value in aircraft.derivatives.items()}
    return replace(aircraft, derivatives=whole, tables=(), aerodynamics=None)


def _point(aircraft: Aircraft, records: tuple[Record, ...]) -> Mapping[str, float]:
    """V, rho, alpha, thrust and surfaces of the flight point."""
    found = {}
    for name in ("V", "rho", "alpha", "thrust", *SURFACES):
        series = [record[name][np.isfinite(record[name])] for record in records if name in record]
        values = np.concatenate(series) if series else np.zeros(0)
        median = float(np.median(values)) if values.size else _USUAL.get(name, 0.0)
        found[name] = aircraft.trim.get(name, median)
    for name in ("alpha", *SURFACES):
        found[name] = float(np.clip(found[name], -_ANGLE, _ANGLE))
    return {name: value if value > 0.0 or name not in ("V", "rho") else _USUAL[name] for name, value in found.items()}
