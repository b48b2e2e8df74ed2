"""Output error with jax: diffrax simulates, optimistix minimises by Levenberg and Marquardt, compiled as one call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from problems.peers.common import Task


def jax_diffrax(task: Task) -> tuple[np.ndarray, float]:
    """(parameters, cost). Compiled at the first call for a task. Raises ModuleNotFoundError without its packages."""
    start = np.concatenate([task.x0 / task.scale, task.start])
    both, cost = _compiled(task)(start)
    return np.asarray(both)[len(task.x0) :], float(cost)


@cache
def _compiled(task: Task) -> Callable[[np.ndarray], Any]:
    import diffrax  # pyright: ignore[reportMissingImports]
    import jax.numpy as jnp  # pyright: ignore[reportMissingImports]
    import optimistix  # pyright: ignore[reportMissingImports]
    from jax import config, jit  # pyright: ignore[reportAttributeAccessIssue] # found is this file, without jax

    config.update("jax_enable_x64", True)
    t, n = jnp.asarray(task.t), len(task.x0)
    inputs = diffrax.LinearInterpolation(t, jnp.asarray(task.U)) if task.U.shape[1] else None

    def slope(at, x, p):
        return jnp.stack(task.rates(list(x), [] if inputs is None else list(inputs.evaluate(at)), list(p), jnp))

    if task.stiff:
        solver, steps = diffrax.Kvaerno5(), diffrax.PIDController(rtol=1e-8, atol=1e-11)
    else:
        solver, steps = diffrax.Tsit5(), diffrax.StepTo(t)

    def residuals(both, _):
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(slope),
            solver,
            t[0],
            t[-1],
            None if not task.stiff else 1e-5,
            both[:n] * task.scale,
            args=both[n:],
            saveat=diffrax.SaveAt(ts=t),
            stepsize_controller=steps,
            max_steps=20_000,
            adjoint=diffrax.ForwardMode(),
        )
        X = found.ys
        y = jnp.stack(task.outputs(list(X.T), jnp), axis=1)
        prior = (both[:n] * task.scale - task.x0) / task.x0_std
        return jnp.concatenate([((y - task.Z) / task.sigma).ravel(), prior])

    def fitted(start):
        found = optimistix.least_squares(
            residuals,
            optimistix.LevenbergMarquardt(rtol=1e-9, atol=1e-9),
            start,
            max_steps=500,
            options={"jac": "fwd"},
        )
        return found.value, 0.5 * (residuals(found.value, None) ** 2).sum()

    return jit(fitted)
