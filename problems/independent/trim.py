"""Straight and level flight by Newton's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from problems.independent.motion import (
    ATTITUDE,
    POSITION,
    ROTATION,
    STATES,
    SURFACES,
    VELOCITY,
    Craft,
    Inputs,
    acceleration,
    quaternion_of,
)

_ITERATIONS, _SETTLED, _STEP = 30, 1e-12, 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Level:
    """Level flight of each record, (n,) each: the state (17, n), elevator [rad], throttle behind the spool."""

    state: np.ndarray
    alpha: np.ndarray
    elevator: np.ndarray
    throttle: np.ndarray


def level_flight(craft: Craft) -> Level:
    """Angle of attack, elevator and throttle at which nothing accelerates, with heading north and wings level.

    Raises ValueError when Newton's method does not settle.
    """
    records = craft.loading.mass.size
    z = np.tile(np.array([[0.03], [-0.02], [0.4]]), records)
    for _ in range(_ITERATIONS):
        left = imbalance(craft, z)
        slopes = np.stack([(imbalance(craft, z + d) - imbalance(craft, z - d)) / (2.0 * _STEP) for d in _steps(z)], 1)
        change = -np.linalg.solve(np.moveaxis(slopes, -1, 0), left.T[..., None])[..., 0].T
        z = z + change
        if np.abs(change).max() < _SETTLED:
            break
    else:
        raise ValueError(f"{craft.plane.name}: no level flight at {craft.plane.V} m/s")
    return Level(state=_state(craft, z[0]), alpha=z[0], elevator=z[1], throttle=z[2])


def imbalance(craft: Craft, z: np.ndarray) -> np.ndarray:
    """(3, n) accelerations along x and z [m/s2] and in pitch [rad/s2], of alpha, elevator and throttle (3, n)."""
    return accelerations_at(craft, z)[[VELOCITY.start, VELOCITY.start + 2, ROTATION.start + 1]]


def accelerations_at(craft: Craft, z: np.ndarray) -> np.ndarray:
    """(17, n) derivative of the state in level flight, in still air."""
    records = z.shape[1]
    surface = {name: np.zeros((1, records)) for name in SURFACES} | {"delta_e": z[1:2]}
    still = np.zeros((1, 3, records))
    inputs = Inputs(surface=surface, throttle=z[2:3], loss=np.ones((1, records)), wind=still, spin=still)
    return acceleration(craft.from_alpha(z[0]), inputs, 0, _state(craft, z[0]))[0]


def _steps(z: np.ndarray) -> list[np.ndarray]:
    return [np.where(np.arange(3)[:, None] == i, _STEP, 0.0 * z) for i in range(3)]


def _state(craft: Craft, alpha: np.ndarray) -> np.ndarray:
    state = np.zeros((STATES, alpha.size))
    state[POSITION.start + 2] = -craft.plane.altitude
    state[VELOCITY.start] = craft.plane.V * np.cos(alpha)
    state[VELOCITY.start + 2] = craft.plane.V * np.sin(alpha)
    state[ATTITUDE] = quaternion_of(0.0 * alpha, alpha, 0.0 * alpha)
    return state
