"""Actuators and engine, which follow their commands whatever the aircraft does.

A servo of second order follows the pilot, and its position is what is recorded. Between it and the surface there is a
rigid linkage, or what is hidden: a first-order lag, a limit on the rate, free play.
"""

from __future__ import annotations

import numpy as np

from problems.independent.integrate import step


def follow(command: np.ndarray, dt: float, frequency: float, damping: float) -> np.ndarray:
    """Position of a second-order servo that rests at the first command.

    The command is given every half `dt` [s], along the first axis; the position is returned every `dt`.
    """

    def slope(half: int, x: np.ndarray) -> np.ndarray:
        position, rate = x
        return np.array([rate, frequency**2 * (command[half] - position) - 2.0 * damping * frequency * rate])

    return _followed(slope, np.array([command[0], np.zeros_like(command[0])]), (len(command) - 1) // 2, dt)[:, 0]


def lag(position: np.ndarray, dt: float, time_constant: np.ndarray) -> np.ndarray:
    """First-order lag of a position given every `dt`, straight between samples; 0 is none. One constant per column."""
    acts = time_constant > 0.0
    T = np.where(acts, time_constant, 1.0)
    a = np.exp(-dt / T)
    b = 1.0 - T / dt * (1.0 - a)
    behind = position.copy()
    for k in range(1, len(position)):
        behind[k] = a * behind[k - 1] + (1.0 - a - b) * position[k - 1] + b * position[k]
    return np.where(acts, behind, position)


def spool(command: np.ndarray, dt: float, time_constant: float) -> np.ndarray:
    """Thrust setting behind a throttle that is given every half `dt`; returned every `dt`."""

    def slope(half: int, x: np.ndarray) -> np.ndarray:
        return (command[half] - x) / time_constant

    return _followed(slope, command[0], (len(command) - 1) // 2, dt)


def limited(position: np.ndarray, dt: float, rate: np.ndarray) -> np.ndarray:
    """A position that moves by no more than `rate` [rad/s], infinite for none, after one given every `dt`."""
    after = position.copy()
    for k in range(1, len(position)):
        after[k] = after[k - 1] + np.clip(position[k] - after[k - 1], -rate * dt, rate * dt)
    return after


def played(position: np.ndarray, half_play: np.ndarray) -> np.ndarray:
    """A position behind a free play of `half_play` [rad] to either side; it begins in the middle."""
    after = position.copy()
    for k in range(1, len(position)):
        after[k] = np.clip(after[k - 1], position[k] - half_play, position[k] + half_play)
    return after


def _followed(slope, x: np.ndarray, steps: int, dt: float) -> np.ndarray:
    log = [x]
    for k in range(steps):
        x = step(slope, 2 * k, x, dt)
        log.append(x)
    return np.array(log)
