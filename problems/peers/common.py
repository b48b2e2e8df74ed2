"""One estimation for everybody: the stable Do 328, 16 moment derivatives from 0.7 x truth, 20 s at 50 Hz.

What a competitor gets is here without CasADi and without casid's model: arrays, and the equations of motion written
out by hand, as a user of plain Python has to. Output error with known noise, surfaces linear between samples, initial
state free under a prior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType, ModuleType
from typing import Any

import numpy as np

from casid.estimation import OutputError, Problem
from problems.do328 import MOMENT_DERIVATIVES, STABLE
from problems.paper.cases import Condition
from problems.paper.estimation import INITIAL_STD, START_FACTOR, paper_problem
from problems.paper.truth import OUTPUTS, fly, noise_sigma

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta")
INPUTS = ("delta_e", "delta_a", "delta_r", "thrust", "rho")
TRUTH = MappingProxyType({name: STABLE[name] for name in MOMENT_DERIVATIVES})
MASS, GRAVITY, AREA, CHORD, HALF_SPAN = 10500.0, 9.81, 40.0, 2.04, 10.4
Vector = Sequence[Any] | np.ndarray
IXX, IYY, IZZ, IXZ = 103e3, 158e3, 240e3, 12.5e3


@dataclass(frozen=True, eq=False, kw_only=True)
class Task:
    """t (N,) [s], U (N, m) inputs, Z (N, o) outputs, sigma (o,); x0 (n,) and its std: prior of the initial state;
    X (N, n) the trajectory that the measurements suggest; start (p,); scale (n,) of the states; `rates` of x, u, p and
    the functions of a module, `outputs` of x and these."""

    t: np.ndarray
    U: np.ndarray
    Z: np.ndarray
    sigma: np.ndarray
    x0: np.ndarray
    x0_std: np.ndarray
    X: np.ndarray
    start: np.ndarray
    scale: np.ndarray
    rates: Callable[..., list[Any]]
    outputs: Callable[..., list[Any]]
    stiff: bool = False


@cache
def our_problem(samples: int = 1001) -> Problem:
    """The estimation as casid takes it, over the first samples of the record."""
    flight = fly(Condition(case="B", manoeuvre=5, seed=1))
    sigma = noise_sigma(flight.exact)
    problem = paper_problem(flight, OutputError(), noise={name: sigma[name] for name in OUTPUTS})
    record = problem.records[0]
    cut = {name: values[:samples] for name, values in record.channels.items()}
    return replace(problem, records=(replace(record, t=record.t[:samples], channels=cut, hold="linear"),))


def task(samples: int = 1001) -> Task:
    """The same as arrays."""
    problem = our_problem(samples)
    record, noise = problem.records[0], problem.noise
    assert isinstance(noise, dict)
    X = problem.model.guess(record)
    return Task(
        t=record.t,
        U=record.matrix(INPUTS),
        Z=record.matrix(OUTPUTS),
        sigma=np.array([noise[n] for n in OUTPUTS]),
        x0=X[0],
        x0_std=np.array([INITIAL_STD[n] for n in STATES]),
        X=X,
        start=START_FACTOR * np.array(list(TRUTH.values())),
        scale=np.array([144.0, 5.0, 5.0, 0.2, 0.1, 0.1, 0.3, 0.1]),
        rates=rates,
        outputs=outputs,
    )


def rates(x: Vector, u: Vector, p: Vector, m: ModuleType | Any) -> list[Any]:
    """dx/dt of the 8 states; p the 16 moment derivatives in the order of TRUTH; m gives sin, sqrt, ... (numpy, casadi,
    sympy, pyomo)."""
    vx, vy, vz, P, Q, R, phi, theta = x
    delta_e, delta_a, delta_r, thrust, rho = u
    V = m.sqrt(vx * vx + vy * vy + vz * vz)
    alpha, beta = arctan(m)(vz / vx), arcsin(m)(vy / V)
    ps, rs, qc = P * HALF_SPAN / V, R * HALF_SPAN / V, Q * CHORD / V
    qS = 0.5 * rho * V * V * AREA
    CL = 0.221 + 6.0 * alpha + 0.349 * delta_e + 4.39 * qc
    CD = 0.027 - 0.002 * alpha
    CY = -1.195 * beta + 0.389 * delta_r + 0.109 * ps + 0.576 * rs
    Cl = p[0] + p[1] * ps + p[2] * rs + p[3] * beta + p[4] * delta_a + p[5] * delta_r
    Cm = p[6] + p[7] * alpha + p[8] * delta_e + p[9] * qc
    Cn = p[10] + p[11] * ps + p[12] * rs + p[13] * beta + p[14] * delta_a + p[15] * delta_r
    sa, ca, sf, cf, st, ct = m.sin(alpha), m.cos(alpha), m.sin(phi), m.cos(phi), m.sin(theta), m.cos(theta)
    ax = (qS * (CL * sa - CD * ca) + thrust) / MASS - GRAVITY * st
    ay = qS * CY / MASS + GRAVITY * ct * sf
    az = -qS * (CL * ca + CD * sa) / MASS + GRAVITY * ct * cf
    L = qS * HALF_SPAN * Cl - (IZZ - IYY) * Q * R + IXZ * P * Q
    M = qS * CHORD * Cm - (IXX - IZZ) * P * R - IXZ * (P * P - R * R)
    N = qS * HALF_SPAN * Cn - (IYY - IXX) * P * Q - IXZ * Q * R
    determinant = IXX * IZZ - IXZ * IXZ
    turn = Q * sf + R * cf
    return [
        ax + R * vy - Q * vz,
        ay - R * vx + P * vz,
        az + Q * vx - P * vy,
        (IZZ * L + IXZ * N) / determinant,
        M / IYY,
        (IXZ * L + IXX * N) / determinant,
        P + turn * st / ct,
        Q * cf - R * sf,
    ]


def outputs(x: Vector, m: ModuleType | Any) -> list[Any]:
    """alpha, beta, p, q, r."""
    vx, vy, vz, P, Q, R, _, _ = x
    return [arctan(m)(vz / vx), arcsin(m)(vy / m.sqrt(vx * vx + vy * vy + vz * vz)), P, Q, R]


def arctan(m: ModuleType | Any) -> Callable[[Any], Any]:
    """The inverse tangent under the name that numpy or everybody else has for it."""
    return m.arctan if hasattr(m, "arctan") else m.atan


def arcsin(m: ModuleType | Any) -> Callable[[Any], Any]:
    """As `arctan`."""
    return m.arcsin if hasattr(m, "arcsin") else m.asin


def whitened(task: Task, X: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Residuals of a simulated trajectory (N, 8), then those of the prior; half their squared norm is the cost."""
    y = np.stack(task.outputs(list(X.T), np), axis=1)
    return np.concatenate([((y - task.Z) / task.sigma).ravel(), (x0 - task.x0) / task.x0_std])
