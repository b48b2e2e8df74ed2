"""Three small problems for everybody: a linear short period, predator and prey, and Robertson's stiff reaction."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from casid.estimation import InitialState, Problem
from casid.model.system import define_model
from casid.records.record import Record
from problems.peers.common import Task

Pair = tuple[Problem, Task]


def _pair(
    name: str,
    parts: tuple[Any, Any],
    truth: dict[str, float],
    start: Sequence[float],
    t: np.ndarray,
    begin: tuple[np.ndarray, np.ndarray],
    sigma: np.ndarray,
    u: np.ndarray | None = None,
    stiff: bool = False,
) -> Pair:
    """The same for casid and for the others; every state is read, and the initial one has a prior."""
    (rates, outputs), (x0, x0_std), n = parts, begin, len(begin[0])
    U = np.zeros((len(t), 0)) if u is None else u[:, None]
    p = list(truth.values())
    X = solve_ivp(
        lambda at, x: rates(x, [np.interp(at, t, c) for c in U.T], p, np),
        (t[0], t[-1]),
        x0,
        "Radau",
        t,
        rtol=1e-10,
        atol=1e-13,
        max_step=np.inf if stiff else float(t[1] - t[0]),
    ).y.T
    Z = np.stack(outputs(list(X.T), np), axis=1)
    Z = Z + sigma * np.random.default_rng(1).standard_normal(Z.shape)
    states, seen, inputs = [f"x{i}" for i in range(n)], [f"y{i}" for i in range(len(sigma))], ["u"] * U.shape[1]
    scale = np.abs(X).max(axis=0)
    model = define_model(
        name,
        states=states,
        inputs=inputs,
        parameters=truth,
        outputs=seen,
        dynamics=lambda s: dict(
            zip(
                states,
                rates(
                    [getattr(s, x) for x in states], [getattr(s, v) for v in inputs], [getattr(s, k) for k in truth], np
                ),
                strict=True,
            )
        ),
        output=lambda s: dict(zip(seen, outputs([getattr(s, x) for x in states], np), strict=True)),
        state_scale=dict(zip(states, scale, strict=True)),
        guess=lambda _, X=X: X,
    )
    channels = dict(zip(seen, Z.T, strict=True)) | dict(zip(inputs, U.T, strict=True))
    problem = Problem(
        model,
        [Record(name=name, t=t, channels=channels)],
        free=["*"],
        start=dict(zip(truth, start, strict=True)),
        noise=dict(zip(seen, sigma, strict=True)),
        initial_state=InitialState(
            value=dict(zip(states, x0, strict=True)), std=dict(zip(states, x0_std, strict=True))
        ),
    )
    task = Task(
        t=t,
        U=U,
        Z=Z,
        sigma=sigma,
        x0=x0,
        x0_std=x0_std,
        X=X,
        start=np.array(start),
        scale=scale,
        rates=rates,
        outputs=outputs,
        stiff=stiff,
    )
    return problem, task


def _everything(x: Sequence[Any], _: ModuleType | Any) -> list[Any]:
    return list(x)


@cache
def short_period() -> Pair:
    """Angle of attack and pitch rate, five derivatives from 0.7 times the truth, 20 s at 50 Hz."""
    t = 0.02 * np.arange(1001)
    elevator = 0.03 * (np.sign(np.sin(0.9 * t)) + np.sin(2.3 * t))
    truth = {"Za": -1.1, "Zd": -0.12, "Ma": -5.5, "Mq": -1.6, "Md": -7.0}

    def rates(x: Sequence[Any], u: Sequence[Any], p: Sequence[Any], _: Any) -> list[Any]:
        return [p[0] * x[0] + x[1] + p[1] * u[0], p[2] * x[0] + p[3] * x[1] + p[4] * u[0]]

    begin = np.zeros(2), np.array([0.01, 0.02])
    start = [0.7 * v for v in truth.values()]
    return _pair("short period", (rates, _everything), truth, start, t, begin, np.array([0.004, 0.008]), u=elevator)


@cache
def lotka_volterra() -> Pair:
    """Four rates from 0.95 times the truth, 401 samples in 20 s."""
    t = 0.05 * np.arange(401)
    truth = {"a": 1.5, "b": 1.0, "c": 3.0, "d": 1.0}

    def rates(x: Sequence[Any], _: Sequence[Any], p: Sequence[Any], __: Any) -> list[Any]:
        return [p[0] * x[0] - p[1] * x[0] * x[1], p[3] * x[0] * x[1] - p[2] * x[1]]

    begin, start = (np.array([1.0, 1.0]), np.array([0.2, 0.2])), [0.95 * v for v in truth.values()]
    return _pair("Lotka-Volterra", (rates, _everything), truth, start, t, begin, np.array([0.1, 0.1]))


@cache
def robertson() -> Pair:
    """Three rates over nine orders of magnitude as factors of the truth, 41 samples from 1e-3 to 1e4 s."""
    t = np.concatenate([[0.0], np.logspace(-3.0, 4.0, 41)])
    truth = {"k1": 1.0, "k2": 1.0, "k3": 1.0}

    def rates(x: Sequence[Any], _: Sequence[Any], k: Sequence[Any], __: Any) -> list[Any]:
        r1, r2, r3 = 0.04 * k[0] * x[0], 3e7 * k[1] * x[1] * x[1], 1e4 * k[2] * x[1] * x[2]
        return [r3 - r1, r1 - r2 - r3, r2]

    begin = np.array([1.0, 0.0, 0.0]), np.array([1e-3, 1e-9, 1e-3])
    sigma = np.array([0.01, 1e-6, 0.01])
    return _pair("Robertson", (rates, _everything), truth, [1.3, 0.8, 1.2], t, begin, sigma, stiff=True)


SMALL = {"short_period": short_period, "lotka_volterra": lotka_volterra, "robertson": robertson}
