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


def _pair(name: str, truth: dict[str, float], start: list[float], given: dict[str, Any]) -> Pair:
    """Pose the same for casid and for the others; every state is read, and the initial one has a prior. `given` are the
    fields of a Task but for motion, readings, start and scale."""
    t, U, rates, p = given["t"], given["U"], given["rates"], list(truth.values())
    X = solve_ivp(
        lambda at, x: rates(x, [np.interp(at, t, c) for c in U.T], p, np),
        (t[0], t[-1]),
        given["x0"],
        "Radau",
        t,
        rtol=1e-10,
        atol=1e-13,
        max_step=float(t[1] - t[0]) if U.size else np.inf,
    ).y.T
    Z = X + given["sigma"] * np.random.default_rng(1).standard_normal(X.shape)
    task = Task(**given, Z=Z, X=X, start=np.array(start), scale=np.abs(X).max(axis=0), outputs=_everything)
    return _posed(name, truth, task), task


def _posed(name: str, truth: dict[str, float], task: Task) -> Problem:
    """As casid takes it."""
    states, inputs = [f"x{i}" for i in range(len(task.x0))], ["u"] * task.U.shape[1]
    seen = [f"y{i}" for i in range(len(states))]

    def slopes(s: Any) -> dict[str, Any]:
        x, u, p = ([getattr(s, n) for n in names] for names in (states, inputs, truth))
        return dict(zip(states, task.rates(x, u, p, np), strict=True))

    model = define_model(
        name,
        states=states,
        inputs=inputs,
        parameters=truth,
        outputs=seen,
        dynamics=slopes,
        output=lambda s: {y: getattr(s, x) for y, x in zip(seen, states, strict=True)},
        state_scale=dict(zip(states, task.scale, strict=True)),
        guess=lambda _: task.X,
    )
    channels = dict(zip(seen, task.Z.T, strict=True)) | dict(zip(inputs, task.U.T, strict=True))
    known = (dict(zip(states, values, strict=True)) for values in (task.x0, task.x0_std))
    return Problem(
        model,
        [Record(name=name, t=task.t, channels=channels)],
        free=["*"],
        start=dict(zip(truth, task.start, strict=True)),
        noise=dict(zip(seen, task.sigma, strict=True)),
        initial_state=InitialState(**dict(zip(("value", "std"), known, strict=True))),
    )


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

    given = {"t": t, "U": elevator[:, None], "sigma": np.array([0.004, 0.008]), "rates": rates}
    given |= {"x0": np.zeros(2), "x0_std": np.array([0.01, 0.02])}
    return _pair("short period", truth, [0.7 * v for v in truth.values()], given)


@cache
def lotka_volterra() -> Pair:
    """Four rates from 0.95 times the truth, 401 samples in 20 s."""
    t = 0.05 * np.arange(401)
    truth = {"a": 1.5, "b": 1.0, "c": 3.0, "d": 1.0}

    def rates(x: Sequence[Any], _: Sequence[Any], p: Sequence[Any], __: Any) -> list[Any]:
        return [p[0] * x[0] - p[1] * x[0] * x[1], p[3] * x[0] * x[1] - p[2] * x[1]]

    given = {"t": t, "U": np.zeros((len(t), 0)), "sigma": np.array([0.1, 0.1]), "rates": rates}
    given |= {"x0": np.ones(2), "x0_std": np.array([0.2, 0.2])}
    return _pair("Lotka-Volterra", truth, [0.95 * v for v in truth.values()], given)


@cache
def robertson() -> Pair:
    """Three rates over nine orders of magnitude as factors of the truth, 41 samples from 1e-3 to 1e4 s."""
    t = np.concatenate([[0.0], np.logspace(-3.0, 4.0, 41)])
    truth = {"k1": 1.0, "k2": 1.0, "k3": 1.0}

    def rates(x: Sequence[Any], _: Sequence[Any], k: Sequence[Any], __: Any) -> list[Any]:
        r1, r2, r3 = 0.04 * k[0] * x[0], 3e7 * k[1] * x[1] * x[1], 1e4 * k[2] * x[1] * x[2]
        return [r3 - r1, r1 - r2 - r3, r2]

    given = {"t": t, "U": np.zeros((len(t), 0)), "sigma": np.array([0.01, 1e-6, 0.01]), "rates": rates, "stiff": True}
    given |= {"x0": np.array([1.0, 0.0, 0.0]), "x0_std": np.array([1e-3, 1e-9, 1e-3])}
    return _pair("Robertson", truth, [1.3, 0.8, 1.2], given)


SMALL = {"short_period": short_period, "lotka_volterra": lotka_volterra, "robertson": robertson}
