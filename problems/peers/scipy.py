"""Output error as most write it: scipy.optimize.least_squares, finite differences, a simulation in numpy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from problems.peers.common import Task, whitened


def scipy_rk4(task: Task) -> tuple[np.ndarray, float]:
    """(parameters, cost): Runge-Kutta of fourth order, one step per sample."""

    def simulate(x0: np.ndarray, p: np.ndarray) -> np.ndarray:
        X = np.empty((len(task.t), len(x0)))
        X[0] = x0
        for k, h in enumerate(np.diff(task.t)):
            x, first, last = X[k], task.U[k], task.U[k + 1]
            middle = 0.5 * (first + last)
            k1 = np.array(task.rates(x, first, p, np))
            k2 = np.array(task.rates(x + 0.5 * h * k1, middle, p, np))
            k3 = np.array(task.rates(x + 0.5 * h * k2, middle, p, np))
            k4 = np.array(task.rates(x + h * k3, last, p, np))
            X[k + 1] = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return X

    return _fit(task, simulate)


def scipy_ivp(task: Task) -> tuple[np.ndarray, float]:
    """The same with solve_ivp (RK45), inputs by interpolation. Its steps are held to the samples: steps that it chooses
    freely change with the parameters, and finite differences of that end nowhere. A stiff motion is Radau's, with steps
    that are chosen for 1e-9."""
    dt = float(task.t[1] - task.t[0])
    how: dict[str, Any] = {"rtol": 1e-6, "atol": 1e-8, "first_step": dt, "max_step": dt}
    if task.stiff:
        how = {"method": "Radau", "rtol": 1e-9, "atol": 1e-12}

    def simulate(x0: np.ndarray, p: np.ndarray) -> np.ndarray:
        def slope(t: float, x: np.ndarray) -> list[float]:
            return task.rates(x, [np.interp(t, task.t, u) for u in task.U.T], p, np)

        span = (task.t[0], task.t[-1])
        return solve_ivp(slope, span, x0, t_eval=task.t, **how).y.T

    return _fit(task, simulate)


def _fit(task: Task, simulate: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> tuple[np.ndarray, float]:
    n = len(task.x0)

    def residuals(both: np.ndarray) -> np.ndarray:
        x0, p = both[:n], both[n:]
        return whitened(task, simulate(x0, p), x0)

    found = least_squares(residuals, np.concatenate([task.x0, task.start]), x_scale="jac", ftol=1e-10, xtol=1e-10)
    return found.x[n:], float(found.cost)
