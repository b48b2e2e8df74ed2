"""One sample interval of a model as CasADi functions: fourth-order Runge-Kutta step, outputs, their derivatives.

Inputs run linearly from u0 to u1 within the step (u1 = u0 when they are held); disturbances are constant over it.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from casid.errors import unknown
from casid.estimation.feedback import SampledFeedback
from casid.model.system import Model

_CACHE: WeakKeyDictionary[Model, dict] = WeakKeyDictionary()


def cached(model: Model, key: tuple, build):
    """What `build()` gives, kept as long as the model lives: a Monte Carlo over one model builds once."""
    store = _CACHE.setdefault(model, {})
    if key not in store:
        store[key] = build()
    return store[key]


def rk4(f: ca.Function, x: ca.SX, u0: ca.SX, u1: ca.SX, dt: ca.SX, *rest: ca.SX) -> ca.SX:
    """State at the end of the step of duration `dt` [s]; `f(x, u, *rest)` is dx/dt."""
    um = (u0 + u1) / 2
    k1 = f(x, u0, *rest)
    k2 = f(x + dt / 2 * k1, um, *rest)
    k3 = f(x + dt / 2 * k2, um, *rest)
    k4 = f(x + dt * k3, u1, *rest)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _symbols(model: Model) -> tuple[ca.SX, ...]:
    n, m, q = len(model.states), len(model.inputs), len(model.parameters)
    return ca.SX.sym("x", n), ca.SX.sym("u0", m), ca.SX.sym("u1", m), ca.SX.sym("dt"), ca.SX.sym("p", q)


def noise_vector(model: Model, names: Sequence[str]) -> tuple[ca.SX, ca.SX]:
    """(v, f with v): noise v on the named states' equations, or through the named disturbances."""
    v = ca.SX.sym("v", len(names))
    w, f = ca.SX.zeros(len(model.disturbances)), ca.SX(model.f)
    for i, name in enumerate(names):
        if name in model.states:
            f[model.states.index(name)] += v[i]
        elif name in model.disturbances:
            w[model.disturbances.index(name)] = v[i]
        else:
            raise unknown("state or disturbance", name, (*model.states, *model.disturbances), "process noise")
    return v, ca.substitute(f, model.w, w) if model.disturbances else f


def quiet(model: Model, expression: ca.SX) -> ca.SX:
    """The expression with all disturbances zero."""
    return (
        ca.substitute(expression, model.w, ca.SX.zeros(len(model.disturbances))) if model.disturbances else expression
    )


def dynamics_function(model: Model) -> ca.Function:
    """f(x, u, p) without disturbances."""
    return ca.Function("f", [model.x, model.u, model.p], [quiet(model, model.f)])


def output_function(model: Model) -> ca.Function:
    """h(x, u, p) without disturbances."""
    return ca.Function("outputs", [model.x, model.u, model.p], [ca.densify(quiet(model, model.h))])


def step_function(model: Model, feedback: SampledFeedback | None = None) -> ca.Function:
    """(x, u0, u1, dt, p) -> x at the end of the step; with feedback the plant gets what the law makes of (x, u0)."""

    def build() -> ca.Function:
        x, u0, u1, dt, p = _symbols(model)
        first, last = (feedback.at(x, u0),) * 2 if feedback else (u0, u1)
        out = ca.densify(rk4(dynamics_function(model), x, first, last, dt, p))
        return ca.Function("step", [x, u0, u1, dt, p], [ca.cse(out)])

    return cached(model, ("step", feedback), build)


def sample_derivatives(
    model: Model, free: np.ndarray, noise: tuple[str, ...], feedback: SampledFeedback | None = None
) -> ca.Function:
    """(x, u0, u1, dt, p) -> A, B, G of the step, C, D of the outputs at its start, all transposed (numpy row order).

    A = dx+/dx, B = dx+/dp_free, G = dx+/dv of the noise held over the step, C = dy/dx, D = dy/dp_free.
    With feedback A includes the path through the law.
    """

    def build() -> ca.Function:
        x, u0, u1, dt, p = _symbols(model)
        v, f = noise_vector(model, noise)
        q = ca.vertcat(*[model.p[int(i)] for i in free], v)
        arguments = [model.x, model.u, model.p]
        jacobians = [
            ca.substitute(e, v, ca.SX.zeros(len(noise))) for e in (f, ca.jacobian(f, model.x), ca.jacobian(f, q))
        ]
        slope = ca.Function("slope", arguments, jacobians)
        if feedback is None:
            a, b = _chained_rk4(slope, x, u0, u1, dt, p)
        else:
            received = ca.SX.sym("received", u0.shape[0])
            a, b = _chained_rk4(slope, x, received, received, dt, p)
            through = ca.jacobian(rk4(dynamics_function(model), x, received, received, dt, p), received)
            a += through @ ca.jacobian(feedback.at(x, u0), x)
            a, b = ca.substitute([a, b], [received], [feedback.at(x, u0)])
        h = quiet(model, model.h)
        free_p = ca.vertcat(*[model.p[int(i)] for i in free])
        outputs = ca.Function("h", arguments, [ca.jacobian(h, model.x), ca.jacobian(h, free_p)])
        c, d = outputs(x, u0, p)
        count = len(free)
        results = [ca.densify(e.T) for e in (a, b[:, :count], b[:, count:], c, d)]
        return ca.Function("derivatives", [x, u0, u1, dt, p], ca.cse(results))

    return cached(model, ("derivatives", tuple(free), noise, feedback), build)


def _chained_rk4(slope: ca.Function, x, u0, u1, dt, p) -> tuple[ca.SX, ca.SX]:
    """Derivatives of the step by the chain rule through its stages: half the instructions of a blind derivative."""
    um, eye = (u0 + u1) / 2, ca.SX.eye(x.shape[0])
    k1, a1, b1 = slope(x, u0, p)
    k2, fx, fq = slope(x + dt / 2 * k1, um, p)
    a2, b2 = fx @ (eye + dt / 2 * a1), fq + fx @ (dt / 2 * b1)
    k3, fx, fq = slope(x + dt / 2 * k2, um, p)
    a3, b3 = fx @ (eye + dt / 2 * a2), fq + fx @ (dt / 2 * b2)
    _, fx, fq = slope(x + dt * k3, u1, p)
    a4, b4 = fx @ (eye + dt * a3), fq + fx @ (dt * b3)
    return eye + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4), dt / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
