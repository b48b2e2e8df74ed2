"""Fly all records of a set side by side: a rigid body of strips, its servos and engine, and who flies it.

The state has one column per record: position north, east, down; velocity in body axes; quaternion; angular velocity;
twist of the wing and its rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from problems.independent.atmosphere import G0, air_at
from problems.independent.integrate import step
from problems.independent.motion import angles_of, cross, quaternion_of, rotation_matrix
from problems.strips.effects import RECORDS, Effect, Linkage
from problems.strips.forces import Flow, aerodynamics, thrust_at
from problems.strips.pilots import Flyer
from problems.strips.planes import Plane

STEP_S = 0.01
_SPOOL_S = 0.6
_OMEGA = slice(10, 13)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trim:
    """Straight and level flight: angles [rad], surfaces (3,), part of the throttle, thrust [N]."""

    alpha: float
    phi: float
    surface: np.ndarray
    throttle: float
    thrust: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Task:
    """How records are flown: inputs (steps + 1, 3, n) and throttle (steps + 1, n) beside trim; air velocity and its
    gradient over the span (steps + 1, 3, n) in body axes; who flies, and a seed."""

    inputs: np.ndarray
    throttle: np.ndarray
    air: np.ndarray
    gradient: np.ndarray
    delayed: bool
    way: str
    seed: int


def trim(plane: Plane) -> Trim:
    """Newton's method on alpha, bank, surfaces and throttle, without sideslip. ValueError when it does not settle."""
    z = np.array([0.04, 0.0, 0.0, 0.0, 0.0, 0.5])
    for _ in range(60):
        left = _imbalance(plane, z)
        slopes = np.stack([(_imbalance(plane, z + d) - _imbalance(plane, z - d)) / 2e-6 for d in 1e-6 * np.eye(6)], 1)
        change = np.linalg.solve(slopes, left)
        z = z - change
        if np.abs(change).max() < 1e-11:
            rho = air_at(np.array([plane.altitude]))[0]
            thrust = thrust_at(plane, z[5:], plane.V * np.cos(z[:1]), rho)
            return Trim(alpha=z[0], phi=z[1], surface=z[2:5], throttle=z[5], thrust=float(thrust[0]))
    raise ValueError(f"{plane.name}: no level flight at {plane.V} m/s")


def _imbalance(plane: Plane, z: np.ndarray) -> np.ndarray:
    alpha, phi = z[:1], z[1:2]
    velocity = plane.V * np.stack([np.cos(alpha), 0.0 * alpha, np.sin(alpha)])
    rho = air_at(np.array([plane.altitude]))[0]
    thrust = thrust_at(plane, z[5:], velocity[0], rho)
    flow = Flow(velocity=velocity, omega=np.zeros((3, 1)), surface=z[2:5, None], thrust=thrust, rho=rho)
    force, moment, _ = aerodynamics(plane, flow)
    force[0] += thrust
    moment[1] += plane.thrust_z * thrust
    gravity = np.stack([-np.sin(alpha), np.cos(alpha) * np.sin(phi), np.cos(alpha) * np.cos(phi)])
    return np.concatenate([force[:, 0] / plane.mass + G0 * gravity[:, 0], plane.area * moment[:, 0] / 1e4])


def fly(plane: Plane, level: Trim, task: Task, effects: Sequence[Effect]) -> dict[str, np.ndarray]:
    """What is known at every step, (steps + 1, ..., n) each: `x` the state, `force` the specific force, `turning` the
    angular acceleration, `V`, `alpha`, `beta`, `air` velocity through it (3), `rho`, `thrust`, `servo` (3), aerodynamic
    `coefficients` of force and moment in body axes (6), and `acting` surfaces (3)."""
    world = _World(plane, level, task, effects)
    x, log = world.start, dict[str, list[np.ndarray]]()
    for k in range(len(task.inputs)):
        world.act(k, x)
        slope, seen = world.acceleration(0, x)
        for name, values in {"x": x, **seen}.items():
            log.setdefault(name, []).append(values)
        world.remember(seen)
        if k + 1 < len(task.inputs):
            x = step(lambda half, y: world.acceleration(half, y)[0], 0, x, STEP_S, slope)
            x[6:10] /= np.sqrt(np.sum(x[6:10] ** 2, axis=0))
    return {name: np.array(values) for name, values in log.items()}


class _World:
    """Everything that has a memory, between two steps: servos, linkage, engine, downwash on its way, the air."""

    def __init__(self, plane: Plane, level: Trim, task: Task, effects: Sequence[Effect]) -> None:
        n = len(RECORDS)
        self.plane, self.level, self.task, self.effects = plane, level, task, effects
        self.mass, self.cg = np.full(n, plane.mass), np.zeros((3, n))
        for one in effects:
            if one.kind == "mass":
                self.mass = self.mass + one.value * one.has
            if one.kind == "cg_offset":
                self.cg["xyz".index(one.target)] += one.value * one.has
        flat = np.full(n, level.alpha)
        self.start = np.zeros((15, n))
        self.start[2] = -plane.altitude
        self.start[3], self.start[5] = plane.V * np.cos(flat), plane.V * np.sin(flat)
        self.start[6:10] = quaternion_of(np.full(n, level.phi), flat, 0.0 * flat)
        at_rest = np.repeat(level.surface[:, None], n, axis=1)
        self.servo, self.spool = (at_rest.copy(), at_rest.copy()), np.full((2, n), level.throttle)
        self.linkage = Linkage(effects, at_rest, STEP_S)
        self.acting = np.stack([at_rest, at_rest])
        self.flyer = Flyer(task.way, plane, (len(task.inputs), n), STEP_S, task.seed)
        self.behind = max(round((plane.wing[2] - plane.tail[2]) / plane.V / STEP_S), 2)
        self.washes: list[np.ndarray] = []
        self.axes: dict[int, np.ndarray] = {}
        hum = np.random.default_rng([task.seed, 7])
        self.phase, self.swell = hum.uniform(0.0, 6.28, (2, n))

    def act(self, k: int, x: np.ndarray) -> None:
        """Commands at step k move the servos, surfaces and engine until the next one."""
        self.k = k
        phi, theta, _ = angles_of(x[6:10])
        rates = dict(zip("pqr", x[_OMEGA], strict=True))
        now = {"phi": phi - self.level.phi, "theta": theta - self.level.alpha, **rates}
        command = self.level.surface[:, None] + self.task.inputs[k] + self.flyer.act(k, now)
        position = self.servo[1]
        after = position + (1.0 - np.exp(-self.plane.servo * STEP_S)) * (command - position)
        self.servo = (position, after)
        self.acting = np.stack([self.acting[1], self.linkage.moved((k + 1) * STEP_S, after, rates)])
        setting = self.level.throttle * (1.0 + self.task.throttle[k])
        self.spool = np.stack([self.spool[1], self.spool[1] + STEP_S / _SPOOL_S * (setting - self.spool[1])])

    def remember(self, seen: Mapping[str, np.ndarray]) -> None:
        """The downwash that leaves the wing at a step."""
        self.washes.append(seen["leaves"])

    def acceleration(self, half: int, x: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Derivative of the state `half` half steps after step k, and what is known there."""
        plane, part, t = self.plane, 0.5 * half, (self.k + 0.5 * half) * STEP_S
        R = rotation_matrix(x[6:10])
        air, gust = self._air(t, R)
        velocity, omega = x[3:6] - air, x[_OMEGA]
        rho, _ = air_at(-x[2])
        V = np.sqrt(np.sum(velocity**2, axis=0))
        surface = (1.0 - part) * self.acting[0] + part * self.acting[1]
        thrust = thrust_at(plane, (1.0 - part) * self.spool[0] + part * self.spool[1], velocity[0], rho)
        flow = Flow(
            velocity=velocity,
            omega=omega,
            surface=surface,
            thrust=thrust,
            rho=rho,
            downwash=self._arriving(part),
            gust=gust,
            **self._changed(t, x),
        )
        force, moment, leaves = aerodynamics(plane, flow)
        lengths = np.array([[plane.wing[0]], [plane.wing[1]], [plane.wing[0]]])
        scale = 0.5 * rho * V**2 * plane.area
        coefficients = np.concatenate([force / scale, moment / scale / lengths])
        pull, line = self._pull(t, thrust)
        force[0] += pull
        moment[1] += line * pull
        moment += self._moment(t, omega) - cross(self.cg, force)
        J, specific = plane.tensor, force / self.mass
        turning = np.linalg.solve(J, moment - cross(omega, J @ omega))
        a, b, c, d = x[6:10]
        p, q, r = omega
        attitude = np.array(
            [-b * p - c * q - d * r, a * p + c * r - d * q, a * q - b * r + d * p, a * r + b * q - c * p]
        )
        slope = np.concatenate(
            [
                np.einsum("jin,jn->in", R, x[3:6]),
                specific + G0 * R[:, 2] - cross(omega, x[3:6]),
                0.5 * attitude,
                turning,
                self._twisting(x, velocity),
            ]
        )
        seen = {"force": specific, "turning": turning, "V": V, "air": velocity, "rho": rho, "thrust": thrust}
        seen |= {"alpha": np.arctan2(velocity[2], velocity[0]), "beta": np.arcsin(velocity[1] / V), "leaves": leaves}
        return slope, seen | {"servo": self.servo[0], "acting": self.acting[0], "coefficients": coefficients}

    def _arriving(self, part: float) -> np.ndarray | None:
        """The downwash that left the wing when the air that is at the tail now was there."""
        if not self.washes:
            return None
        at = len(self.washes) + part - self.behind
        low = int(np.floor(at))
        first, second = (self.washes[min(max(i, 0), len(self.washes) - 1)] for i in (low, low + 1))
        return first + (at - low) * (second - first)

    def _air(self, t: float, R: np.ndarray) -> tuple[np.ndarray, np.ndarray | float]:
        """(3, n) velocity of the air at the centre of gravity, body axes, and (3, S, n) beyond it at the strips."""
        s, at = self.plane.strips, t / STEP_S
        here = _between(self.task.air, at)
        gust = 0.0
        if self.task.delayed:
            gust = np.zeros((3, len(s.area), len(RECORDS)))
            late = np.maximum(s.at[:, 0].max() - s.at[:, 0], 0.0) / self.plane.V / STEP_S
            for back in np.unique(np.round(late)):
                gust[:, np.round(late) == back] = (_between(self.task.air, at - back) - here)[:, None]
            gust += s.at[:, 1][None, :, None] * _between(self.task.gradient, at)[:, None]
        for i, one in enumerate(self.effects):
            if one.kind == "wind_shear":
                here = here + one.value * np.where(one.has > 0.0, np.maximum(t - one.onset, 0.0), 0.0) * R[:, 0]
            if one.kind == "gust":
                inside = (t >= one.onset) & (t <= one.onset + one.parameters["length"])
                axes = self.axes.setdefault(i, np.zeros((3, len(RECORDS))))
                begins = inside & (np.abs(axes).max(axis=0) == 0.0)
                axes[:, begins] = R["xyz".index(one.target)][:, begins]
                shape = np.sin(np.pi * (t - np.where(inside, one.onset, t)) / one.parameters["length"]) ** 2
                here = here + one.value * shape * inside * np.einsum("ijn,jn->in", R, axes)
        return here, gust

    def _changed(self, t: float, x: np.ndarray) -> dict[str, np.ndarray]:
        """What the strips have besides: a flap that runs out, a wing that twists, an outer wing that stalls sooner."""
        s, found = self.plane.strips, {}
        out = np.abs(s.at[:, 1]) / (0.5 * self.plane.wing[0])
        for one in self.effects:
            if one.kind == "configuration_change":
                runs = np.clip((t - one.onset) / one.parameters["ramp"], 0.0, 1.0) * one.has
                inner = s.wing * (out < 0.55)
                found |= {
                    "washed": np.outer(inner, one.value * runs),
                    "blunt": np.outer(inner, 0.25 * one.value * runs),
                }
            if one.kind == "wing_bending":
                found["washed"] = np.outer(s.wing * out, 2.0 * x[13])
            if one.kind == "stall_break":
                sooner = s.stall - self.level.alpha - s.incidence - 0.045 * one.value
                found["stall_sooner"] = (s.wing * (out > 0.5) * (s.at[:, 1] < 0.0) * sooner)[:, None]
        return found

    def _pull(self, t: float, thrust: np.ndarray) -> tuple[np.ndarray, float]:
        line = self.plane.thrust_z
        for one in self.effects:
            if one.kind == "thrust_line":
                line += one.value
            if one.kind == "thrust_scale":
                thrust = thrust * (1.0 + one.value)
            if one.kind == "effectiveness_change" and one.target == "thrust":
                thrust = thrust * (1.0 + one.value * (t >= one.onset))
        return thrust, line

    def _moment(self, t: float, omega: np.ndarray) -> np.ndarray:
        moment = np.zeros_like(omega)
        for one in self.effects:
            if one.kind == "rotor_gyroscope":  # an angular momentum along x
                moment += one.value * np.stack([0.0 * omega[0], -omega[2], omega[1]])
            if one.kind == "propeller_hum":
                swells = 0.5 + 0.5 * np.sin(2.0 * np.pi * t / 9.0 + self.swell)
                hums = np.sin(2.0 * np.pi * 1.5 * one.parameters["frequency_hz"] * t + self.phase)
                moment[1] += 0.12 * one.value * self.plane.inertia[1] * swells * hums
        return moment

    def _twisting(self, x: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Twist of a wing that yields by a quarter of a change of its incidence, as a lightly damped mode."""
        for one in self.effects:
            if one.kind == "wing_bending":
                w = 2.0 * np.pi * one.parameters["frequency_hz"]
                change = np.arctan2(velocity[2], velocity[0]) - self.level.alpha
                return np.stack([x[14], -(w**2) * (x[13] + 0.25 * one.value * change) - 0.1 * w * x[14]])
        return np.zeros((2, x.shape[1]))


def _between(series: np.ndarray, at: float) -> np.ndarray:
    """A series between its samples; its ends beyond them."""
    at = min(max(at, 0.0), len(series) - 1.0)
    low = min(int(at), len(series) - 2)
    return series[low] + (at - low) * (series[low + 1] - series[low])
