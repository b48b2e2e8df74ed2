"""ArduPilot's plane of SITL: the coefficients of libraries/SITL/SIM_Plane as a JSON file, `--model plane:file.json`.

SIM_Plane takes moments for angular accelerations (an inertia of one) and has a mass of 2 kg, in every release. The file
therefore has coefficients of an aircraft of 2 kg and unit inertia with the accelerations of the given one: the area is
s = S 2 kg / m, and moments are divided by the inertia, Ixz included. Inputs are -1 to 1 for `deltaX_max`, with the
signs of ArduPilot: positive turns up, right wing down, nose right.
"""

from __future__ import annotations

import json
import math

import numpy as np

from casid.errors import InputError
from casid.formats.absorbed import absorbed, in_wind_axes, need_derivatives, polar_of
from casid.model.aircraft import Aircraft

_MASS = 2.0  # kg, of SIM_Plane
_TRAVEL = 0.3491  # rad, its deltaX_max: 20 deg
# its blend into stall: half of it at this angle of attack, and so steep that below it lift is linear to rounding.
# Steeper exponents overflow 0.8 rad beyond, where SIM_Plane clips the angle.
_STALL = 0.5
_STEEP = 300.0
_LATERAL = ("0", "beta", "p", "r", "delta_a", "delta_r")
_HELD = {
    "CL": ("0", "alpha", "q", "delta_e"),
    "CD": ("0", "alpha", "alpha^2", "alpha^3", "q"),
    "CY": _LATERAL,
    "Cl": _LATERAL,
    "Cm": ("0", "alpha", "q", "delta_e"),
    "Cn": _LATERAL,
}
_SHORT = {"0": "0", "beta": "b", "p": "p", "r": "r", "delta_a": "deltaa", "delta_r": "deltar"}
_ALWAYS = (
    "moments by products of rates (gyroscopic), which SIM_Plane has not",
    "thrust: SIM_Plane makes its own, 14 m/s2 at full throttle",
    f"lift and drag beyond alpha = {_STALL - 0.05:g} rad or below {_STALL - 0.8:g} rad: SIM_Plane's own stall",
    "sideslip is atan2(v, u), and not asin(v / V)",
)


def ardupilot_text(aircraft: Aircraft) -> tuple[str, tuple[str, ...]]:
    """The file, and what it does not hold, a line each. Raises InputError for aerodynamics that are not derivatives, an
    aircraft that is not symmetric, and a surface without effect on its own axis."""
    need_derivatives(aircraft, "ardupilot-json")
    plain = in_wind_axes(absorbed(aircraft))
    a = plain.aircraft
    polar = polar_of(plain)
    if not a.inertia.symmetric:
        raise InputError(f"'{a.name}': Ixy and Iyz are not zero, which ardupilot-json cannot hold")
    b = 2.0 * a.rate_length_lateral
    c = 2.0 * a.rate_length_pitch
    s = a.area * _MASS / a.mass
    size = {n: math.copysign(_TRAVEL, plain.value(*row)) for n, row in _MAIN.items()}
    scale = {term: size.get(term, 1.0) for term in (*_LATERAL, "alpha", "q", "delta_e")}
    J = a.inertia
    inverse = np.linalg.inv(np.array([[J.Ixx, -J.Ixz], [-J.Ixz, J.Izz]]))
    turning = 0.5 * a.mass * a.moment_length_lateral / b * inverse
    values: dict[str, float | list[float]] = {"s": s, "b": b, "c": c}
    values |= {
        "c_lift_0": plain.value("CL", "0"),
        "c_lift_a": plain.value("CL", "alpha"),
        "c_lift_q": plain.value("CL", "q"),
        "c_lift_deltae": plain.value("CL", "delta_e") * scale["delta_e"],
        "mcoeff": _STEEP,
        "alpha_stall": _STALL,
        "oswald": 1.0 / (math.pi * polar.factor * b**2 / s) if polar.factor else 1e9,
        "c_drag_p": polar.parasitic,
        "c_drag_q": plain.value("CD", "q"),
        "c_drag_deltae": 0.0,
    }
    for term in _LATERAL:
        both = turning @ np.array([plain.value("Cl", term), plain.value("Cn", term)]) * scale[term]
        values[f"c_y_{_SHORT[term]}"] = plain.value("CY", term) * scale[term]
        values[f"c_l_{_SHORT[term]}"], values[f"c_n_{_SHORT[term]}"] = map(float, both)
    pitching = 0.5 * a.mass * a.moment_length_pitch / (c * J.Iyy)
    for term, short in (("0", "0"), ("alpha", "a"), ("q", "q"), ("delta_e", "deltae")):
        values[f"c_m_{short}"] = plain.value("Cm", term) * scale[term] * pitching
    values |= {f"{name}_max": _TRAVEL for name in ("deltaa", "deltae", "deltar")}
    values["CGOffset"] = [0.0, 0.0, 0.0]
    left = [*plain.left, *plain.beyond(_HELD), *([polar.note] if polar.note else []), *_ALWAYS]
    left += [f"thrust line {a.thrust_line_z:.4g} m below the centre of gravity"] if a.thrust_line_z else []
    return _with_head(a, size, left) + json.dumps(values, indent=4) + "\n", tuple(left)


# surface -> the derivative that gives it its sign in ArduPilot: nose up, right wing down, nose right
_MAIN = {"delta_e": ("Cm", "delta_e"), "delta_a": ("Cl", "delta_a"), "delta_r": ("Cn", "delta_r")}


def _with_head(aircraft: Aircraft, size: dict[str, float], left: list[str]) -> str:
    """Comments, which ArduPilot's reader skips: the meaning of the numbers, and what is not in them."""
    inputs = ", ".join(f"{surface} = {value:+.4f} rad" for surface, value in size.items())
    lines = [
        f"{aircraft.name}, written by casid for libraries/SITL/SIM_Plane of ArduPilot",
        f"The aircraft has {aircraft.mass:.6g} kg. Its accelerations are those of one of 2 kg and unit inertia, which",
        "SIM_Plane flies: area and moment coefficients are scaled by mass and inertia.",
        f"A full input stands for {inputs}.",
        "Not held:",
    ]
    head = [f"# {' '.join(line.split())}\n" for line in lines]
    return "".join([*head, *(f"#   {' '.join(line.split())}\n" for line in left)])
