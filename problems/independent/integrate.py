"""Classical Runge-Kutta steps of fourth order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

# Time is counted in half steps, at which inputs are known.
Slope = Callable[[int, np.ndarray], np.ndarray]


def step(slope: Slope, half: int, x: np.ndarray, dt: float, k1: np.ndarray | None = None) -> np.ndarray:
    """State after one step from half step `half`; `k1` is the slope there, where it is known already."""
    k1 = slope(half, x) if k1 is None else k1
    k2 = slope(half + 1, x + 0.5 * dt * k1)
    k3 = slope(half + 1, x + 0.5 * dt * k2)
    k4 = slope(half + 2, x + dt * k3)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
