"""Direct collocation with opty: symbolic equations of motion, the midpoint rule, IPOPT through cyipopt.

The midpoint rule on the samples of 50 Hz ends 0.45 standard deviations away; with one more node between two samples it
is 4 times as exact.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from problems.peers.common import INPUTS, STATES, Task, outputs, rates

NODES_PER_SAMPLE = 2
SCALE = (144.0, 5.0, 5.0, 0.2, 0.1, 0.1, 0.3, 0.1)


def opty(task: Task) -> tuple[np.ndarray, float]:
    """(parameters (16,), cost). Raises ModuleNotFoundError without opty or cyipopt."""
    programme, start = build(task)
    programme.add_option("tol", 1e-8)
    programme.add_option("print_level", 0)
    free, information = programme.solve(start)
    return np.asarray(free)[-16:], float(information["obj_val"])


def build(task: Task):
    """(opty's Problem, start): free are the scaled states at all nodes one after the other, then the parameters."""
    import sympy as sm  # pyright: ignore[reportMissingImports]
    from opty.direct_collocation import Problem  # pyright: ignore[reportMissingImports]

    t, n = sm.Symbol("t"), NODES_PER_SAMPLE * (len(task.t) - 1) + 1
    nodes = np.linspace(task.t[0], task.t[-1], n)
    between = [np.stack([np.interp(nodes, task.t, v) for v in values.T], axis=1) for values in (task.X, task.U)]
    states = [sm.Function(name)(t) for name in STATES]
    inputs = [sm.Function(name)(t) for name in INPUTS]
    parameters = sm.symbols([f"c{i:02d}" for i in range(16)])
    functions = SimpleNamespace(
        sin=sm.sin, cos=sm.cos, sqrt=sm.sqrt, atan=sm.atan, asin=sm.asin
    )  # the names that `rates` asks for
    scaled = [x * s for x, s in zip(states, SCALE, strict=True)]
    slopes = rates(scaled, inputs, parameters, functions)
    motion = sm.Matrix([x.diff(t) - f / s for x, f, s in zip(states, slopes, SCALE, strict=True)])
    plain = sm.symbols(f"x:{len(STATES)}")
    seen = sm.Matrix(outputs([x * s for x, s in zip(plain, SCALE, strict=True)], functions))
    output = sm.lambdify([plain], seen.T.tolist()[0])
    slope = sm.lambdify([plain], seen.jacobian(plain).tolist())

    def residuals(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        X = free[: 8 * n].reshape(8, n)[:, ::NODES_PER_SAMPLE]
        white = (np.stack(output(X), axis=1) - task.Z) / task.sigma
        return white, (X[:, 0] * SCALE - task.x0) / task.x0_std

    def cost(free: np.ndarray) -> float:
        white, prior = residuals(free)
        return 0.5 * float((white**2).sum() + prior @ prior)

    def gradient(free: np.ndarray) -> np.ndarray:
        white, prior = residuals(free)
        found = np.zeros_like(free)
        by_state = found[: 8 * n].reshape(8, n)[:, ::NODES_PER_SAMPLE]
        for i, row in enumerate(slope(free[: 8 * n].reshape(8, n)[:, ::NODES_PER_SAMPLE])):
            for j, value in enumerate(row):
                by_state[j] += value * white[:, i] / task.sigma[i]
        by_state[:, 0] += prior * SCALE / task.x0_std
        return found

    programme = Problem(
        cost,
        gradient,
        motion,
        states,
        n,
        float(nodes[1] - nodes[0]),
        known_trajectory_map=dict(zip(inputs, between[1].T, strict=True)),
        time_symbol=t,
        integration_method="midpoint",
    )
    order = [parameters.index(p) for p in programme.collocator.unknown_parameters]
    if order != list(range(16)):
        raise ValueError(f"opty orders the parameters as {order}; expected the order of their names")
    return programme, np.concatenate([(between[0] / SCALE).T.ravel(), task.start])
