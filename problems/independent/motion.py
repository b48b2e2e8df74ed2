"""Equations of motion: a rigid body over a flat earth, attitude as a quaternion, several records side by side.

The state has one column per record: position north, east, down [m]; velocity in body axes [m/s]; quaternion from earth
to body axes; angular velocity [rad/s]; position [m] and rate of a sloshing mass; twist [rad] of the wing and its rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from problems.independent.atmosphere import G0, air_at
from problems.independent.integrate import step
from problems.independent.planes import Plane

STEP_S = 1.0 / 100.0
POSITION, VELOCITY, ATTITUDE, ROTATION = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
SLOSH, TWIST, STATES = slice(13, 15), slice(15, 17), 17
SURFACES = ("delta_e", "delta_a", "delta_r")


@dataclass(frozen=True, eq=False, kw_only=True)
class Loading:
    """What the records have, (n,) or (3, n) each: mass, and the position of the centre of gravity from the reference
    point, about which the tables give moments and from which engines and instruments are measured."""

    mass: np.ndarray
    cg: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Slosh:
    """A part of the mass that swings sideways at `place` [m] and is fixed along the other axes.

    The rotation of the aircraft does not drive the swing.
    """

    mass: float
    frequency: float
    damping: float
    place: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Bend:
    """A wing that twists by -`share` of a change of the angle of attack, as a second-order mode; frequency [rad/s]."""

    share: float
    frequency: float
    damping: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Inputs:
    """What acts from outside, at every half step: (halves, n) each, the wind (halves, 3, n).

    surface    name -> deflection [rad];  throttle   part of the largest thrust, behind the spool
    loss       factor on the thrust that acts;  wind  velocity of the air, earth axes [m/s];  spin  its rotation [rad/s]
    """

    surface: Mapping[str, np.ndarray]
    throttle: np.ndarray
    loss: np.ndarray
    wind: np.ndarray
    spin: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Craft:
    """An aircraft with its loading and what the tables do not have.

    extra     coefficient -> (factor, variables whose product it multiplies)
    alpha_0   (n,) angle of attack from which a wing bends
    """

    plane: Plane
    loading: Loading
    extra: Mapping[str, Sequence[tuple[float, tuple[str, ...]]]] = field(default_factory=dict)
    slosh: Slosh | None = None
    bend: Bend | None = None
    alpha_0: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def from_alpha(self, alpha: np.ndarray) -> Craft:
        """The same with a wing that rests at `alpha`."""
        return replace(self, alpha_0=alpha)


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """(3, 3, n) from earth to body axes."""
    a, b, c, d = quaternion
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)],
            [2.0 * (b * c - a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d + a * b)],
            [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a - b * b - c * c + d * d],
        ]
    )


def quaternion_of(phi: np.ndarray, theta: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """(4, n) from the angles of bank, pitch and heading."""
    (a, b, c), (x, y, z) = (tuple(f(0.5 * angle) for angle in (phi, theta, psi)) for f in (np.cos, np.sin))
    return np.array(
        [a * b * c + x * y * z, x * b * c - a * y * z, a * y * c + x * b * z, a * b * z - x * y * c]
    ) * np.ones(np.broadcast(phi, theta, psi).shape)


def angles_of(quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """phi, theta, psi [rad], (n,) each."""
    R = rotation_matrix(quaternion)
    return np.arctan2(R[1, 2], R[2, 2]), np.arcsin(np.clip(-R[0, 2], -1.0, 1.0)), np.arctan2(R[0, 1], R[0, 0])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, n) vector product of columns."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def acceleration(craft: Craft, inputs: Inputs, half: int, x: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Derivative of the state at a half step, and what instruments may read: `force` (3, n) the specific force [m/s2],
    `turning` (3, n) the angular acceleration, (n,) each V, alpha, beta, rho and the `thrust` of the engine model."""
    R = rotation_matrix(x[ATTITUDE])
    velocity, omega = x[VELOCITY], x[ROTATION]
    air = velocity - np.einsum("ijn,jn->in", R, inputs.wind[half])
    V = np.sqrt(np.sum(air**2, axis=0))
    alpha, beta = np.arctan2(air[2], air[0]), np.arcsin(air[1] / V)
    rho, sound = air_at(-x[2])
    surfaces = {name: values[half] for name, values in inputs.surface.items()}
    seen = {"alpha": alpha, "beta": beta, "mach": V / sound, **surfaces}
    p, q, r = omega - inputs.spin[half]
    plane, loading = craft.plane, craft.loading
    seen |= {"p": p * plane.span / (2.0 * V), "q": q * plane.chord / (2.0 * V), "r": r * plane.span / (2.0 * V)}
    thrust = inputs.throttle[half] * plane.thrust.at(seen) * rho / 1.225
    aero, moment = _aerodynamics(craft, seen, 0.5 * rho * V**2 * plane.area, x[TWIST][0])
    pull = inputs.loss[half] * thrust
    force = aero + np.array([pull, 0.0 * pull, 0.0 * pull])
    moment[1] += plane.thrust_z * pull
    moment -= cross(loading.cg, force)
    specific, inside = force / loading.mass, np.zeros((4, V.size))
    if craft.slosh is not None:
        inside[:2], specific[1], swing = _sloshing(craft.slosh, force[1], loading.mass, x[SLOSH])
        moment += cross(np.array([[c] for c in craft.slosh.place]) - loading.cg, swing)
    if craft.bend is not None:
        inside[2:] = _bending(craft.bend, alpha - craft.alpha_0, x[TWIST])
    J = plane.tensor
    turning = np.linalg.solve(J, moment - cross(omega, J @ omega))
    slope = np.concatenate(
        [
            np.einsum("jin,jn->in", R, velocity),
            specific + G0 * R[:, 2] - cross(omega, velocity),
            _attitude_rate(x[ATTITUDE], omega),
            turning,
            inside,
        ]
    )
    return slope, {
        "force": specific,
        "turning": turning,
        "V": V,
        "alpha": alpha,
        "beta": beta,
        "rho": rho,
        "thrust": thrust,
    }


def _aerodynamics(
    craft: Craft, seen: dict[str, np.ndarray], qS: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment (3, n) about the reference point, body axes. The tables of the wing's lift, drag and pitching
    moment see its twist."""
    C = craft.plane.coefficients(seen if craft.bend is None else seen | {"alpha": seen["alpha"] + twist})
    for name, terms in craft.extra.items():
        for factor, variables in terms:
            C[name] = C[name] + factor * np.prod([seen[v] for v in variables], axis=0)
    sin, cos = np.sin(seen["alpha"]), np.cos(seen["alpha"])
    force = qS * np.array([C["CL"] * sin - C["CD"] * cos, C["CY"], -C["CL"] * cos - C["CD"] * sin])
    lengths = np.array([[craft.plane.span], [craft.plane.chord], [craft.plane.span]])
    return force, qS * lengths * np.array([C["Cl"], C["Cm"], C["Cn"]])


def _attitude_rate(quaternion: np.ndarray, omega: np.ndarray) -> np.ndarray:
    a, b, c, d = quaternion
    p, q, r = omega
    return 0.5 * np.array([-b * p - c * q - d * r, a * p + c * r - d * q, a * q - b * r + d * p, a * r + b * q - c * p])


def _sloshing(
    slosh: Slosh, side: np.ndarray, mass: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivative of its state, specific side force of the aircraft, force (3, n) of the swing on the aircraft: the
    aircraft without the swinging mass is pushed by the air and by the spring, the mass by the spring."""
    place, rate = state
    spring = slosh.frequency**2 * place + 2.0 * slosh.damping * slosh.frequency * rate
    specific = (side + slosh.mass * spring) / (mass - slosh.mass)
    swing = -specific - spring
    push = -slosh.mass * swing
    return np.array([rate, swing]), specific, np.array([0.0 * push, push, 0.0 * push])


def _bending(bend: Bend, change: np.ndarray, state: np.ndarray) -> np.ndarray:
    twist, rate = state
    w = bend.frequency
    return np.array([rate, -(w**2) * (twist + bend.share * change) - 2.0 * bend.damping * w * rate])


def integrate(craft: Craft, inputs: Inputs, start: np.ndarray, steps: int) -> dict[str, np.ndarray]:
    """States `x` (steps + 1, 17, n) and readings, (steps + 1, ...) each, at every step of STEP_S."""
    x, log = start.copy(), dict[str, list[np.ndarray]]()
    for k in range(steps + 1):
        slope, seen = acceleration(craft, inputs, 2 * k, x)
        for name, values in {"x": x, **seen}.items():
            log.setdefault(name, []).append(values)
        if k < steps:
            x = step(lambda half, y: acceleration(craft, inputs, half, y)[0], 2 * k, x, STEP_S, slope)
            x[ATTITUDE] /= np.sqrt(np.sum(x[ATTITUDE] ** 2, axis=0))
    return {name: np.array(values) for name, values in log.items()}
