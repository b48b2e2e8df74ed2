"""Small systems with a known truth for the tests of estimation, solved by matrix exponentials and not by our steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from casid.estimation import Problem
from casid.model.system import Model, define_model
from casid.native import compiler
from casid.records.record import Record

TRUTH = {"Za": -1.2, "Zde": -0.15, "Ma": -4.0, "Mq": -1.8, "Mde": -6.0}
START = {name: 0.7 * value for name, value in TRUTH.items()}
NOISE = {"alpha": 0.002, "q": 0.004}
needs_compiler = pytest.mark.skipif(compiler.c_compiler() is None, reason="no C compiler on this machine")


def short_period(nominal: Mapping[str, float] = TRUTH, **options) -> Model:
    """Linear short period: states alpha, q; input delta_e; both states measured."""
    return define_model(
        "short period",
        states=("alpha", "q"),
        inputs=("delta_e",),
        parameters=nominal,
        outputs=("alpha", "q"),
        dynamics=lambda s: {
            "alpha": s.Za * s.alpha + s.q + s.Zde * s.delta_e,
            "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e,
        },
        output=lambda s: {"alpha": s.alpha, "q": s.q},
        **options,
    )


def matrices(values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """A and B of the short period."""
    a = np.array([[values["Za"], 1.0], [values["Ma"], values["Mq"]]])
    return a, np.array([[values["Zde"]], [values["Mde"]]])


def exact(a: np.ndarray, b: np.ndarray, t: np.ndarray, u: np.ndarray, x0: np.ndarray, hold: str) -> np.ndarray:
    """(N, n) states of dx/dt = a x + b u at the samples; u (N, m) held or linear between them."""
    n, m = b.shape
    x = np.zeros((len(t), n))
    x[0] = x0
    for k, dt in enumerate(np.diff(t)):
        slope = (u[k + 1] - u[k]) / dt if hold == "linear" else np.zeros(m)
        big = np.zeros((n + 2 * m, n + 2 * m))
        big[:n, :n], big[:n, n : n + m], big[n : n + m, n + m :] = a, b, np.eye(m)
        x[k + 1] = (expm(big * dt) @ np.concatenate([x[k], u[k], slope]))[:n]
    return x


def elevator(t: np.ndarray) -> np.ndarray:
    """A 3-2-1-1-like sequence of steps of 0.05 rad."""
    edges, signs = (1.0, 2.2, 3.0, 3.4, 3.8), (1.0, -1.0, 1.0, -1.0)
    out = np.zeros(len(t))
    for start, stop, sign in zip(edges[:-1], edges[1:], signs, strict=True):
        out[(t >= start) & (t < stop)] = 0.05 * sign
    return out


def flight(
    name: str = "m1",
    *,
    values: Mapping[str, float] = TRUTH,
    t: np.ndarray | None = None,
    hold: str = "linear",
    noise: Mapping[str, float] | None = None,
    rng: np.random.Generator | None = None,
    x0: tuple[float, float] = (0.01, -0.02),
    gain: float = 1.0,
) -> Record:
    """A flown short period; `noise` 1-sigma per output needs `rng`."""
    t = np.arange(0.0, 8.0, 0.04) if t is None else t
    u = gain * elevator(t)
    x = exact(*matrices(values), t, u[:, None], np.array(x0), hold)
    channels = {"delta_e": u, "alpha": x[:, 0].copy(), "q": x[:, 1].copy()}
    if noise is not None and rng is not None:
        for channel, sigma in noise.items():
            channels[channel] += sigma * rng.standard_normal(len(t))
    return Record(name=name, t=t, channels=channels, hold=hold)


def with_derivatives(record: Record, clean: Record, noise: Mapping[str, float], rng: np.random.Generator) -> Record:
    """`record` with measured alphadot and qdot: those of the noise-free `clean` flight, and noise."""
    a, b = matrices(TRUTH)
    slopes = clean.matrix(["alpha", "q"]) @ a.T + clean["delta_e"][:, None] * b[:, 0]
    names = ("alphadot", "qdot")
    return record.with_channels(
        **{n: slopes[:, i] + noise[n] * rng.standard_normal(len(record)) for i, n in enumerate(names)}
    )


def cut(problem: Problem, samples: int) -> Problem:
    """The problem with the first samples of every record."""
    records = [
        replace(r, t=r.t[:samples], channels={name: v[:samples] for name, v in r.channels.items()})
        for r in problem.records
    ]
    return replace(problem, records=records)
