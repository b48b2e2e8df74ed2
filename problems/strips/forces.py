"""Force and moment of the strips and of the propellers, by what each of them meets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from problems.independent.motion import cross
from problems.strips.planes import Plane

_SEPARATES = 0.02  # rad, over which a strip stalls
_SWIRL = 0.12  # sidewash behind a propeller, of the speed that it adds
_TORQUE = 0.06  # of thrust times diameter


@dataclass(frozen=True, eq=False, kw_only=True)
class Flow:
    """What acts at one time, n records side by side.

    velocity, omega  (3, n) of the body through the air at the centre of gravity, and of its rotation
    gust             (3, S, n) velocity of the air at the strips beyond that at the centre of gravity
    surface          (3, n) deflections;  thrust  (n,) of all engines;  rho  (n,)
    downwash         (n,) angle that arrives at the tail; None: the one that leaves the wing now
    washed           (S, n) additional incidence: a flap, a wing that twists
    blunt            (S, n) additional drag
    """

    velocity: np.ndarray
    omega: np.ndarray
    surface: np.ndarray
    thrust: np.ndarray
    rho: np.ndarray
    downwash: np.ndarray | None = None
    gust: np.ndarray | float = 0.0
    washed: np.ndarray | float = 0.0
    blunt: np.ndarray | float = 0.0
    stall_sooner: np.ndarray | float = field(default=0.0)


def aerodynamics(plane: Plane, flow: Flow) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force and moment (3, n) about the centre of gravity, without thrust, and downwash (n,) that leaves the wing."""
    s, n = plane.strips, flow.thrust.size
    v = flow.velocity[:, None] + cross(flow.omega[:, None], s.at.T[:, :, None]) - flow.gust
    v = v + _slipstream(plane, flow)
    u, w = (np.einsum("si,isn->sn", direction, v) for direction in (s.ahead, s.normal))
    angle = np.arctan2(w, u)
    inside = s.incidence[:, None] + s.control @ flow.surface + flow.washed
    wing = s.wing > 0.0
    downwash = np.zeros(n) if flow.downwash is None else flow.downwash
    lift, drag = _section(plane, flow, angle - s.tail[:, None] * downwash + inside)
    leaves = 1.8 / (np.pi * plane.wing[0] / plane.wing[1]) * np.average(lift[wing], axis=0, weights=s.area[wing])
    if flow.downwash is None:
        downwash = leaves
        lift, drag = _section(plane, flow, angle - s.tail[:, None] * downwash + inside)
    angle = angle - s.tail[:, None] * downwash
    pressure = 0.5 * flow.rho * (u**2 + w**2) * s.area[:, None]
    along = pressure * (lift * np.sin(angle) - drag * np.cos(angle))
    across = -pressure * (lift * np.cos(angle) + drag * np.sin(angle))
    force = s.ahead.T[:, :, None] * along + s.normal.T[:, :, None] * across
    about = np.cross(s.normal, s.ahead).T[:, :, None] * (s.moment * s.chord)[:, None] * pressure
    moment = (cross(s.at.T[:, :, None], force) + about).sum(axis=1)
    moment[0] -= _TORQUE * plane.disc * flow.thrust
    return force.sum(axis=1), moment, leaves


def _section(plane: Plane, flow: Flow, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lift and drag coefficients (S, n) of the strips; a separated section carries a quarter of its lift."""
    s = plane.strips
    attached = 1.0 / (1.0 + np.exp((np.abs(angle) - s.stall[:, None] + flow.stall_sooner) / _SEPARATES))
    lift = s.slope[:, None] * np.sin(angle) * (0.5 * (1.0 + np.sqrt(attached))) ** 2
    drag = s.drag[:, None] + s.induced[:, None] * lift**2 + 1.6 * (1.0 - attached) * np.sin(angle) ** 2 + flow.blunt
    return lift, drag


def _slipstream(plane: Plane, flow: Flow) -> np.ndarray | float:
    """(3, S, n) velocity that the propellers add, behind their discs; by momentum theory, half of it at the wing."""
    if not plane.propellers:
        return 0.0
    s, V = plane.strips, flow.velocity[0]
    disc = 0.25 * np.pi * plane.disc**2
    each = flow.thrust / len(plane.propellers)
    added = np.sqrt(V**2 + 2.0 * np.maximum(each, 0.0) / (flow.rho * disc)) - V
    behind = sum(np.abs(s.at[:, 1] - y) < 0.5 * plane.disc for y in plane.propellers) > 0
    part = np.where(s.wing > 0.0, 0.6, 0.9) * behind
    swirl = _SWIRL * part * (s.normal[:, 1] > 0.5) * (len(plane.propellers) == 1)
    return np.stack([part[:, None] * added, swirl[:, None] * added, np.zeros((len(part), V.size))])


def thrust_at(plane: Plane, throttle: np.ndarray, u: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """(n,) thrust of all engines [N]."""
    most, none = plane.thrust
    return throttle * most * (1.0 - u / none) * rho / 1.225
