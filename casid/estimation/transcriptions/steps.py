"""One sample interval of a model as CasADi functions: fourth-order Runge-Kutta step, outputs, their derivatives.

Inputs run linearly from u0 to u1 within the step (u1 = u0 when they are held); disturbances are constant over it. A
model in discrete time takes its own step, with u0. A step of no duration changes nothing: layouts are padded with such.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from casid.errors import unknown
from casid.model.built import cached
from casid.model.feedback import SampledFeedback
from casid.model.system import Model


def rk4(f: ca.Function, x: ca.SX, u0: ca.SX, u1: ca.SX, dt: ca.SX, *rest: ca.SX) -> ca.SX:
    """State at the end of the step of duration `dt` [s]; `f(x, u, *rest)` is dx/dt."""
    um = (u0 + u1) / 2
    k1 = f(x, u0, *rest)
    k2 = f(x + dt / 2 * k1, um, *rest)
    k3 = f(x + dt / 2 * k2, um, *rest)
    k4 = f(x + dt * k3, u1, *rest)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _advanced(model: Model, x: ca.SX, u0: ca.SX, u1: ca.SX, dt: ca.SX, p: ca.SX) -> ca.SX:
    """State at the end of the step."""
    f = dynamics_function(model)
    return rk4(f, x, u0, u1, dt, p) if model.period is None else ca.if_else(dt > 0.0, f(x, u0, p), x)


def _symbols(model: Model) -> tuple[ca.SX, ...]:
    n = len(model.states)
    m = len(model.inputs)
    q = len(model.parameters)
    return ca.SX.sym("x", n), ca.SX.sym("u0", m), ca.SX.sym("u1", m), ca.SX.sym("dt"), ca.SX.sym("p", q)


def noise_vector(model: Model, names: Sequence[str]) -> tuple[ca.SX, ca.SX]:
    """(v, f with v): noise v on the named states' equations, or through the named disturbances."""
    v = ca.SX.sym("v", len(names))
    w = ca.SX.zeros(len(model.disturbances))
    f = ca.SX(model.f)
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


def rates_function(model: Model) -> ca.Function:
    """(x, u, p) -> df/dx without disturbances, transposed (numpy row order)."""
    slope = ca.jacobian(quiet(model, model.f), model.x)
    return ca.Function("rates", [model.x, model.u, model.p], [ca.densify(slope.T)])


def output_function(model: Model) -> ca.Function:
    """h(x, u, p) without disturbances."""
    return ca.Function("outputs", [model.x, model.u, model.p], [ca.densify(quiet(model, model.h))])


def step_function(model: Model, feedback: SampledFeedback | None = None) -> ca.Function:
    """(x, u0, u1, dt, p) -> x at the end of the step; with feedback the plant gets what the law makes of (x, u0)."""

    def build() -> ca.Function:
        x, u0, u1, dt, p = _symbols(model)
        first, last = (feedback.at(x, u0),) * 2 if feedback else (u0, u1)
        out = ca.densify(_advanced(model, x, first, last, dt, p))
        return ca.Function("step", [x, u0, u1, dt, p], [ca.cse(out)])

    return cached(model, ("step", feedback), build)


def sample_derivatives(
    model: Model, free: Sequence[int] | np.ndarray, noise: tuple[str, ...], feedback: SampledFeedback | None = None
) -> ca.Function:
    """(x, u0, u1, dt, p) -> A, B, G of the step, C, D of the outputs at its start, all transposed (numpy row order).

    A = dx+/dx, B = dx+/dp_free, G = dx+/dv of the noise held over the step, C = dy/dx, D = dy/dp_free. In discrete
    time G is sqrt(dt) dx+/dv: what uses it divides by sqrt(dt), as is right for noise that is white in continuous time.
    With feedback A includes the path through the law.
    """

    def build() -> ca.Function:
        x, u0, u1, dt, p = symbols = _symbols(model)
        slope = _slope(model, free, noise)
        if model.period is not None:
            a, bg = _discrete(slope, len(free), x, u0, dt, p)
        elif feedback is None:
            a, bg = _chained_rk4(slope, x, u0, u1, dt, p)
        else:
            received = ca.SX.sym("received", u0.shape[0])
            a, bg = _chained_rk4(slope, x, received, received, dt, p)
            through = ca.jacobian(rk4(dynamics_function(model), x, received, received, dt, p), received)
            a += through @ ca.jacobian(feedback.at(x, u0), x)
            a, bg = ca.substitute([a, bg], [received], [feedback.at(x, u0)])
        _, c, d = _output_derivatives(model, free)(x, u0, p)
        results = [ca.densify(e.T) for e in (a, bg[:, : len(free)], bg[:, len(free) :], c, d)]
        return ca.Function("derivatives", list(symbols), ca.cse(results))

    return cached(model, ("derivatives", tuple(free), noise, feedback), build)


def stage_functions(
    model: Model, free: Sequence[int] | np.ndarray, noise: tuple[str, ...], feedback: SampledFeedback | None = None
) -> tuple[ca.Function, ca.Function]:
    """Build the functions of one sample: (x, u0, u1, dt, p) -> (x+, y), and (x, u0, u1, dt, p) -> (x+, y, C, D, then
    for each of the four stages F = df/dx, Q = df/d(p_free, noise) and E = df/du times the slope of the law); sparse.

    A column s of sensitivities follows the stages as the state does: k1 = F1 s + E1 s + Q1, k2 = F2 (s + dt/2 k1) +
    E2 s + Q2, ... That takes a fifth of the instructions of A and B of the whole step. In discrete time there is one
    stage, and s+ = F1 s + Q1.
    """

    def build() -> tuple[ca.Function, ca.Function]:
        x, u0, u1, dt, p = symbols = _symbols(model)
        plain = [step_function(model, feedback)(*symbols), output_function(model)(x, u0, p)]
        law = ca.SX(u0.shape[0], x.shape[0])
        first = u0
        last = u1
        if feedback is not None:
            first = last = feedback.at(x, u0)
            law = ca.sparsify(ca.jacobian(first, x))
        middle = (first + last) / 2
        slope = _slope(model, free, noise)
        if model.period is not None:
            a, bg = _discrete(slope, len(free), x, u0, dt, p)
            linear = [plain[0], *_output_derivatives(model, free)(x, u0, p), a, bg, law]
            return (
                ca.Function("advance", list(symbols), ca.cse(plain)),
                ca.Function("derive", list(symbols), ca.cse(linear)),
            )
        after = x
        k = ca.SX.zeros(x.shape[0])
        stages = []
        for reach, share, u in ((0.0, 1, first), (0.5, 2, middle), (0.5, 2, middle), (1.0, 1, last)):
            k, fx, fq, fu = slope(x + reach * dt * k, u, p)
            after += share * dt / 6 * k
            stages += [fx, fq, ca.sparsify(fu @ law)]
        linear: list[ca.SX] = [ca.densify(after), *_output_derivatives(model, free)(x, u0, p), *stages]
        return (
            ca.Function("advance", list(symbols), ca.cse(plain)),
            ca.Function("derive", list(symbols), ca.cse(linear)),
        )

    return cached(model, ("stage functions", tuple(free), noise, feedback), build)


def _slope(model: Model, free: Sequence[int] | np.ndarray, noise: tuple[str, ...]) -> ca.Function:
    """(x, u, p) -> f, df/dx, df/d(p_free, noise), df/du."""
    v, f = noise_vector(model, noise)
    q = ca.vertcat(*[model.p[int(i)] for i in free], v)
    results = (f, ca.jacobian(f, model.x), ca.jacobian(f, q), ca.jacobian(f, model.u))
    quietly = [ca.substitute(e, v, ca.SX.zeros(len(noise))) for e in results]
    return ca.Function("slope", [model.x, model.u, model.p], quietly)


def _output_derivatives(model: Model, free: Sequence[int] | np.ndarray) -> ca.Function:
    """(x, u, p) -> y, C, D."""
    h = quiet(model, model.h)
    by_p = ca.jacobian(h, ca.vertcat(*[model.p[int(i)] for i in free]))
    return ca.Function("outputs", [model.x, model.u, model.p], [ca.densify(h), ca.jacobian(h, model.x), by_p])


def _discrete(slope: ca.Function, free: int, x: ca.SX, u0: ca.SX, dt: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Derivatives of the step in discrete time, those of noise times sqrt(dt)."""
    _, fx, fq, _ = slope(x, u0, p)
    goes = ca.if_else(dt > 0.0, 1.0, 0.0)
    return goes * fx + (1.0 - goes) * ca.SX.eye(x.shape[0]), ca.horzcat(goes * fq[:, :free], ca.sqrt(dt) * fq[:, free:])


def _chained_rk4(slope: ca.Function, x, u0, u1, dt, p) -> tuple[ca.SX, ca.SX]:
    """Derivatives of the step by the chain rule through its stages: half the instructions of a blind derivative."""
    um = (u0 + u1) / 2
    eye = ca.SX.eye(x.shape[0])
    k1, a1, b1, _ = slope(x, u0, p)
    k2, fx, fq, _ = slope(x + dt / 2 * k1, um, p)
    a2 = fx @ (eye + dt / 2 * a1)
    b2 = fq + fx @ (dt / 2 * b1)
    k3, fx, fq, _ = slope(x + dt / 2 * k2, um, p)
    a3 = fx @ (eye + dt / 2 * a2)
    b3 = fq + fx @ (dt / 2 * b2)
    _, fx, fq, _ = slope(x + dt * k3, u1, p)
    a4 = fx @ (eye + dt * a3)
    b4 = fq + fx @ (dt * b3)
    return eye + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4), dt / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
