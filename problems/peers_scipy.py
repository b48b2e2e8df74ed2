"""Output error as most write it: scipy.optimize.least_squares, finite differences, a simulation in numpy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from problems.peers import Task, rates, whitened


def scipy_rk4(task: Task) -> tuple[np.ndarray, float]:
    """(parameters (16,), cost): Runge-Kutta of fourth order, one step per sample."""

    def simulate(x0: np.ndarray, p: np.ndarray) -> np.ndarray:
        X = np.empty((len(task.t), 8))
        X[0] = x0
        for k, h in enumerate(np.diff(task.t)):
            x, first, last = X[k], task.U[k], task.U[k + 1]
            middle = 0.5 * (first + last)
            k1 = np.array(rates(x, first, p, np))
            k2 = np.array(rates(x + 0.5 * h * k1, middle, p, np))
            k3 = np.array(rates(x + 0.5 * h * k2, middle, p, np))
            k4 = np.array(rates(x + h * k3, last, p, np))
            X[k + 1] = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return X

    return _fit(task, simulate)


def scipy_ivp(task: Task) -> tuple[np.ndarray, float]:
    """The same with solve_ivp (RK45), inputs by interpolation. Finite differences of an adaptive integration need a
    step well above its tolerance: with scipy's own step the estimation ends nowhere."""

    def simulate(x0: np.ndarray, p: np.ndarray) -> np.ndarray:
        def slope(t: float, x: np.ndarray) -> list[float]:
            return rates(x, [np.interp(t, task.t, u) for u in task.U.T], p, np)

        span = (task.t[0], task.t[-1])
        return solve_ivp(slope, span, x0, t_eval=task.t, rtol=1e-8, atol=1e-10, max_step=0.02).y.T

    return _fit(task, simulate, step=1e-4)


def _fit(
    task: Task, simulate: Callable[[np.ndarray, np.ndarray], np.ndarray], step: float | None = None
) -> tuple[np.ndarray, float]:
    """step of the finite differences: None is scipy's own, on the unknowns as they are; otherwise on the unknowns in
    units of their size, all starting at one, because scipy takes it relative to their values."""
    start = np.concatenate([task.x0, task.start])
    size = np.concatenate([task.x0_std, np.maximum(np.abs(task.start), 0.01)])
    first = start if step is None else np.ones(len(start))

    def physical(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both = z if step is None else start + size * (z - 1.0)
        return both[:8], both[8:]

    def residuals(z: np.ndarray) -> np.ndarray:
        x0, p = physical(z)
        return whitened(task, simulate(x0, p), x0)

    found = least_squares(residuals, first, x_scale="jac", ftol=1e-10, xtol=1e-10, diff_step=step)
    return physical(found.x)[1], float(found.cost)
