"""Moving air: a discrete gust, and turbulence of Dryden's spectra.

The air's velocity is uniform over the aircraft, except that its gradient along the path and along the span turns it.
"""

from __future__ import annotations

import numpy as np

SCALE_M = 533.0  # of the turbulence, MIL-F-8785C above 2000 ft
_SETTLES = 30.0  # time constants


def gust(t: np.ndarray, onset: float, length: float) -> np.ndarray:
    """(N,) one minus cosine, of unit height, from `onset` [s] for `length` [s]."""
    inside = (t >= onset) & (t <= onset + length)
    return np.where(inside, np.sin(np.pi * (t - onset) / length) ** 2, 0.0)


def along_path(rng: np.random.Generator, count: int, dt: float, sigma: float, T: float) -> np.ndarray:
    """(count,) of r.m.s. `sigma` with the spectrum of the longitudinal velocity, time constant T = L / V; exact for any
    dt [s], stationary."""
    stays = np.exp(-dt / T)
    series = np.empty(count)
    now = rng.standard_normal()
    for k in range(count):
        series[k] = now
        now = stays * now + np.sqrt(1.0 - stays**2) * rng.standard_normal()
    return sigma * series


def across_path(rng: np.random.Generator, count: int, dt: float, sigma: float, T: float) -> np.ndarray:
    """The same of the transverse velocities, sigma sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2 on white noise of unit
    density: two lags in series, stepped with their exact covariance."""
    stays = np.exp(-dt / T)
    move = np.array([[stays, 0.0], [dt / T * stays, stays]])
    settled = np.array([[0.5, 0.25], [0.25, 0.25]]) / T
    root, start = np.linalg.cholesky(settled - move @ settled @ move.T), np.linalg.cholesky(settled)
    z = start @ rng.standard_normal(2)
    series = np.empty(count)
    for k in range(count):
        series[k] = np.sqrt(3.0) * z[0] + (1.0 - np.sqrt(3.0)) * z[1]
        z = move @ z + root @ rng.standard_normal(2)
    return sigma * np.sqrt(T) * series


def turbulence(
    rng: np.random.Generator, count: int, dt: float, sigma: float, V: float, span: float, tail_arm: float
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (count, 3) north, east, down of the air met by an aircraft that flies north, and its rotation (count, 3)
    about the body axes: in pitch and yaw by the velocities at wing and tail, in roll by a spectrum of its own."""
    T, behind = SCALE_M / V, max(round(tail_arm / V / dt), 1)
    u = along_path(rng, count, dt, sigma, T)
    v, w = (across_path(rng, count + behind, dt, sigma, T) for _ in "vw")
    roll_T = 4.0 * span / (np.pi * V)
    roll = sigma * np.sqrt(0.8 * (np.pi * SCALE_M / (4.0 * span)) ** (1.0 / 3.0) / (SCALE_M * V) / (2.0 * roll_T))
    arm = behind * dt * V
    pitch, yaw = -(w[behind:] - w[:-behind]) / arm, (v[behind:] - v[:-behind]) / arm
    p = along_path(rng, count, dt, roll, roll_T)
    return np.stack([u, v[behind:], w[behind:]], axis=1), np.stack([p, pitch, yaw], axis=1)
