"""Equation-error form of an aircraft model, and what it shares with the model: the effects by their stations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import casadi as ca

from casid.model.aircraft import Aircraft
from casid.model.airframe import unsymmetric_moment
from casid.model.effect import Effect
from casid.model.path import SignalPath, disturbance_names, fly
from casid.model.station import MOVING_AIR
from casid.model.system import EquationForm
from casid.signals import SURFACES


def by_station(effects: Iterable[Effect]) -> dict[str, list]:
    """Station -> functions that change the path there, of symbolic effects."""
    found: dict[str, list] = {}
    for effect in effects:
        if effect.change is not None and effect.station is not None:
            found.setdefault(effect.station, []).append(partial(_apply, effect))
    return found


def _apply(effect: Effect, path: SignalPath) -> None:
    assert effect.change is not None
    further = {key: path.parameter[f"{effect.name}.{key}"] for key in effect.further}
    effect.change(path, {"value": path.parameter[effect.name], **further})


def equation_error(
    aircraft: Aircraft,
    p: ca.SX,
    parameters: Sequence[str],
    names: tuple[str, ...],
    effects: Sequence[Effect],
    known: Sequence[str] = (),
) -> EquationForm:
    """Equation-error form: coefficients computed from measured accelerations (paper eq. 6, 7) against the aerodynamic
    model evaluated on measured air data, rates and surfaces (eq. 8). Accelerometers are moved to the c.g.

    `names` are the coefficients that it has. `known` disturbances act, but for the wind: what is measured of the air
    has it already.
    """
    channels = (
        "V",
        "alpha",
        "beta",
        "p",
        "q",
        "r",
        "ax",
        "ay",
        "az",
        "pdot",
        "qdot",
        "rdot",
        *SURFACES,
        "thrust",
        "rho",
        *(name for name in known if name not in MOVING_AIR),
    )
    m = ca.SX.sym("m", len(channels))
    c = dict(zip(channels, ca.vertsplit(m), strict=True))
    path = fly(
        _measured_path(aircraft, c, dict(zip(parameters, ca.vertsplit(p), strict=True))),
        by_station(e for e in effects if e.in_equations),
    )
    found = _coefficients_from_accelerations(aircraft, path, c)
    target = ca.vertcat(*[found[n] for n in names])
    prediction = ca.vertcat(*[path.coefficient[n] for n in names])
    used = [i for i, uses in enumerate(ca.which_depends(ca.vertcat(target, prediction), m, 1, False)) if uses]
    wanted = ca.SX.sym("wanted", len(used))
    full = ca.SX.zeros(len(channels))
    for k, i in enumerate(used):
        full[i] = wanted[k]
    target, prediction = ca.substitute([target, prediction], [m], [full])
    return EquationForm(
        names=names, channels=tuple(channels[i] for i in used), m=wanted, target=target, prediction=prediction
    )


def _measured_path(aircraft: Aircraft, c: dict[str, ca.SX], parameter: dict[str, ca.SX]) -> SignalPath:
    """The signal path with the measured motion in the place of states."""
    velocity = [
        c["V"] * ca.cos(c["alpha"]) * ca.cos(c["beta"]),
        c["V"] * ca.sin(c["beta"]),
        c["V"] * ca.sin(c["alpha"]) * ca.cos(c["beta"]),
    ]
    return SignalPath(
        aircraft=aircraft,
        inputs=c,
        parameter=parameter,
        state={
            "u": velocity[0],
            "v": velocity[1],
            "w": velocity[2],
            **{s: c[s] for s in "pqr"},
            "phi": ca.SX(0),
            "theta": ca.SX(0),
        },
        disturbance={d: c.get(d, ca.SX(0)) for d in disturbance_names(aircraft.force_axes)},
    )


def _coefficients_from_accelerations(aircraft: Aircraft, path: SignalPath, c: dict) -> dict:
    p, q, r = c["p"], c["q"], c["r"]
    x, y, z = aircraft.accelerometer
    ax = c["ax"] + (q**2 + r**2) * x - (p * q - c["rdot"]) * y - (p * r + c["qdot"]) * z
    ay = c["ay"] - (p * q + c["rdot"]) * x + (p**2 + r**2) * y - (q * r - c["pdot"]) * z
    az = c["az"] - (p * r - c["qdot"]) * x - (q * r + c["pdot"]) * y + (p**2 + q**2) * z
    qS = path.air["qbar"] * aircraft.area
    fx, fy, fz = path.mass * ax - c["thrust"], path.mass * ay, path.mass * az
    Ixx, Iyy, Izz, Ixz = (path.inertia[name] for name in ("Ixx", "Iyy", "Izz", "Ixz"))
    L = Ixx * c["pdot"] - Ixz * c["rdot"] + (Izz - Iyy) * q * r - Ixz * p * q
    M = Iyy * c["qdot"] + (Ixx - Izz) * p * r + Ixz * (p**2 - r**2) - aircraft.thrust_line_z * c["thrust"]
    N = Izz * c["rdot"] - Ixz * c["pdot"] + (Iyy - Ixx) * p * q + Ixz * q * r
    if not aircraft.inertia.symmetric:
        more = unsymmetric_moment(path.inertia, (p, q, r), (c["pdot"], c["qdot"], c["rdot"]))
        L, M, N = L + more[0], M + more[1], N + more[2]
    sa, cos_a = ca.sin(c["alpha"]), ca.cos(c["alpha"])
    return {
        "CL": (fx * sa - fz * cos_a) / qS,
        "CD": -(fx * cos_a + fz * sa) / qS,
        "CX": fx / qS,
        "CZ": fz / qS,
        "CY": fy / qS,
        "Cl": L / (qS * aircraft.moment_length_lateral),
        "Cm": M / (qS * aircraft.moment_length_pitch),
        "Cn": N / (qS * aircraft.moment_length_lateral),
    }
