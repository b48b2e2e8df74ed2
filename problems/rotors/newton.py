"""A multirotor in closed loop by Newton and Euler in numpy, with nothing of casid: the truth of tests.

Body axes x forward, y right, z down. A cascade of position, attitude and rates drives the rotors by what a designer
believes of them; thrust of each rotor, mass and wing may be otherwise, from the start or from a time on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

G, STEP, EVERY, SECONDS = 9.80665, 0.0025, 4, 20.0  # records at 100 Hz
BREEZE = 0.15  # m/s2, r.m.s. acceleration by gusts
NOISE = {"p": 0.005, "phi": 0.002, "ax": 0.05, "v_north": 0.02, "north": 0.01}
OF_A_KIND = {
    "p": ("p", "q", "r"),
    "phi": ("phi", "theta", "psi"),
    "ax": ("ax", "ay", "az"),
    "v_north": ("v_north", "v_east", "v_down"),
    "north": ("north", "east", "altitude"),
}


@dataclass(frozen=True, kw_only=True)
class Craft:
    """What flies: places (n, 3) and spins (n,) of the rotors, thrust (time, inputs (n,)) [N] of each, mass by time."""

    places: np.ndarray
    spins: np.ndarray
    mass: Callable[[float], float]
    inertia: np.ndarray
    thrust: Callable[[float, np.ndarray], np.ndarray]
    input_for: Callable[[np.ndarray], np.ndarray]  # the designer's input for a thrust [N]
    torque: float
    lag: float
    drag: np.ndarray = field(default_factory=lambda: np.zeros(3))
    # (velocity against the air in body axes, density) -> force [N] and moment [N m] of a wing
    wing: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None


def quad(arm: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and spins of four rotors: front right, rear right, rear left, front left."""
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)], dtype=float)
    return np.column_stack([arm * signs, np.zeros(4)]), np.array([1.0, -1.0, 1.0, -1.0])


def flight(
    craft: Craft, seed: int, *, size: float = 1.0, speed: float = 0.0, gains: tuple[float, float] = (80.0, 16.0)
) -> dict[str, np.ndarray]:
    """Channel -> series at 100 Hz of a flight of 20 s.

    size   of the sines that are flown [m], about a point that goes north at a `speed` [m/s]
    gains  of the attitude [1/s2] and of the rates [1/s]
    """
    rng = np.random.default_rng(seed)
    mass = craft.mass(0.0)
    mix = np.linalg.pinv(
        np.array([[1.0] * len(craft.spins), -craft.places[:, 1], craft.places[:, 0], craft.spins * craft.torque])
    )
    x, v, omega, R = np.zeros(3), np.array([speed, 0.0, 0.0]), np.zeros(3), np.eye(3)
    amplitude = size * rng.uniform(0.6, 1.0, (2, 3)) * [1.0, 1.0, 0.6]
    frequency, phase = rng.uniform([[0.6] * 3, [1.4] * 3], [[1.1] * 3, [2.4] * 3]), rng.uniform(0.0, 6.28, (2, 3))
    gusts, acts = np.zeros(3), craft.input_for(np.full(len(craft.spins), mass * G / len(craft.spins)))
    leaning = np.zeros(3)
    rows: dict[str, list] = {name: [] for name in ("t", "u", "x", "v", "R", "omega", "force")}
    settle = 3.0
    for k in range(int((SECONDS + settle) / STEP)):  # in place: types around a loop take minutes to infer
        t = k * STEP - settle
        angle = frequency * t + phase
        want = np.sum(amplitude * np.sin(angle), axis=0) + [speed * (t + settle), 0.0, 0.0]
        want_v = np.sum(amplitude * frequency * np.cos(angle), axis=0) + [speed, 0.0, 0.0]
        want_a = -np.sum(amplitude * frequency**2 * np.sin(angle), axis=0)
        leaning[:] = leaning + STEP * 1.2 * (want - x)
        pull = want_a + 3.0 * (want_v - v) + 3.5 * (want - x) + leaning - [0.0, 0.0, G]
        down = -pull / np.linalg.norm(pull)
        across = np.cross(down, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        wanted = np.column_stack([np.cross(across, down), across, down])
        off = 0.5 * (wanted.T @ R - R.T @ wanted)
        turn = np.array([off[2, 1], off[0, 2], off[1, 0]])
        moment = craft.inertia @ (-gains[0] * turn * [1.0, 1.0, 0.3] - gains[1] * omega * [1.0, 1.0, 0.5])
        share = mix @ np.array([-mass * pull @ R[:, 2], *moment])
        u = craft.input_for(np.maximum(share, 0.02 * mass * G))
        acts[:] = acts + STEP / craft.lag * (u - acts)
        gusts[:] = gusts + STEP * (-gusts / 0.8) + BREEZE * np.sqrt(2.0 * STEP / 0.8) * rng.normal(size=3)
        thrust, now, J = craft.thrust(t, acts), craft.mass(t), craft.inertia
        air = R.T @ v
        force = np.array([0.0, 0.0, -thrust.sum()]) - craft.drag * air + now * gusts
        torque = np.sum(np.cross(craft.places, np.outer(-thrust, [0.0, 0.0, 1.0])), axis=0)
        torque = torque + [0.0, 0.0, np.sum(craft.spins * craft.torque * thrust)]
        if craft.wing is not None:
            more, about = craft.wing(air)
            force, torque = force + more, torque + about
        if k % EVERY == 0 and t >= 0.0:
            for column, value in zip(rows.values(), (t, u, x, v, R, omega, force / now), strict=True):
                column.append(np.array(value))
        x[:] = x + STEP * v
        v[:] = v + STEP * (R @ force / now + [0.0, 0.0, G])
        omega[:] = omega + STEP * np.linalg.solve(J, torque - np.cross(omega, J @ omega))
        R[:] = R @ Rotation.from_rotvec(STEP * omega).as_matrix()
    psi, theta, phi = Rotation.from_matrix(np.stack(rows["R"])).as_euler("ZYX").T
    table = {"p": np.stack(rows["omega"]), "phi": np.column_stack([phi, theta, np.unwrap(psi)])}
    table |= {"ax": np.stack(rows["force"]), "v_north": np.stack(rows["v"])}
    table |= {"north": np.stack(rows["x"]) * [1.0, 1.0, -1.0]}
    channels = {"t": np.array(rows["t"])}
    for first, values in table.items():
        noisy = values + rng.normal(0.0, NOISE[first], values.shape)
        channels |= dict(zip(OF_A_KIND[first], noisy.T, strict=True))
    return channels | {f"m{i}": series for i, series in enumerate(np.stack(rows["u"]).T, start=1)}
