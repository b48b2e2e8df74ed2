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
from casid.model.system import Model, runge_kutta

# stages of Runge and Kutta's method: where in the step, and share in sixths of it
STAGES = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))


def _symbols(model: Model) -> list[ca.SX]:
    """x, u0, u1, dt, p; those of the model where it has them."""
    return [model.x, model.u, ca.SX.sym("u1", len(model.inputs)), ca.SX.sym("dt"), model.p]


def free_parameters(model: Model, free: Sequence[int] | np.ndarray) -> ca.SX:
    """The symbols of parameters by their index in the model."""
    return ca.vertcat(*[model.p[int(i)] for i in free])


def slopes(model: Model, of: str, free: Sequence[int] | np.ndarray) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The right-hand side "f" or the outputs "h", without disturbances, and its derivatives in states and free
    parameters."""
    value = ca.densify(quiet(model, getattr(model, of)))
    return value, ca.jacobian(value, model.x), ca.jacobian(value, free_parameters(model, free))


def slopes_function(model: Model, of: str, free: Sequence[int] = ()) -> ca.Function:
    """(x, u, p) -> what `slopes` gives, transposed (numpy row order)."""
    results = [ca.densify(e.T) for e in slopes(model, of, free)]
    return ca.Function("slopes", [model.x, model.u, model.p], ca.cse(results))


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


def output_function(model: Model) -> ca.Function:
    """h(x, u, p) without disturbances."""
    return ca.Function("outputs", [model.x, model.u, model.p], [ca.densify(quiet(model, model.h))])


def step_function(model: Model, feedback: SampledFeedback | None = None) -> ca.Function:
    """(x, u0, u1, dt, p) -> x at the end of the step; with feedback the plant gets what the law makes of (x, u0)."""

    def build() -> ca.Function:
        x, u0, u1, dt, p = _symbols(model)
        f = dynamics_function(model)
        first, last = (feedback.at(x, u0),) * 2 if feedback else (u0, u1)
        if model.period is not None:
            after = ca.if_else(dt > 0.0, f(x, u0, p), x)
        else:
            after = runge_kutta(f, x, (first, (first + last) / 2, last), dt, p)
        return ca.Function("step", [x, u0, u1, dt, p], [ca.cse(ca.densify(after))])

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
        symbols, _, stages = _stages(model, free, noise, feedback)
        a, bg, _ = stages[0]
        if model.period is None:  # the chain rule through the stages: half the instructions of a blind derivative
            dt = symbols[3]
            eye = ca.SX.eye(len(model.states))
            ks = sum_s = ca.SX(*eye.shape)
            kq = sum_q = ca.SX(*bg.shape)
            for (reach, share), (fx, fq, e) in zip(STAGES, stages, strict=True):
                ks = fx @ (eye + reach * dt * ks) + e
                kq = fx @ (reach * dt * kq) + fq
                sum_s = sum_s + share * ks
                sum_q = sum_q + share * kq
            a = eye + dt / 6 * sum_s
            bg = dt / 6 * sum_q
        _, c, d = slopes(model, "h", free)
        results = [ca.densify(e.T) for e in (a, bg[:, : len(free)], bg[:, len(free) :], c, d)]
        return ca.Function("derivatives", symbols, ca.cse(results))

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
        symbols, after, stages = _stages(model, free, noise, feedback)
        outputs = slopes(model, "h", free)
        plain = [step_function(model, feedback)(*symbols), outputs[0]]
        linear = [after, *outputs, *(part for stage in stages for part in stage)]
        return ca.Function("advance", symbols, ca.cse(plain)), ca.Function("derive", symbols, ca.cse(linear))

    return cached(model, ("stage functions", tuple(free), noise, feedback), build)


def _stages(
    model: Model, free: Sequence[int] | np.ndarray, noise: tuple[str, ...], feedback: SampledFeedback | None
) -> tuple[list[ca.SX], ca.SX, list[tuple[ca.SX, ca.SX, ca.SX]]]:
    """(x, u0, u1, dt, p) of a sample interval, x at its end, and F, Q, E of its stages, see `stage_functions`."""
    x, first, last, dt, p = symbols = _symbols(model)
    slope = _slope(model, free, noise)
    law = ca.SX(first.shape[0], x.shape[0])
    if feedback is not None:
        first = last = feedback.at(x, first)
        law = ca.sparsify(ca.jacobian(first, x))
    if model.period is not None:
        _, fx, fq, _ = slope(x, first, p)
        goes = ca.if_else(dt > 0.0, 1.0, 0.0)
        by_state = goes * fx + (1.0 - goes) * ca.SX.eye(x.shape[0])
        by_free = ca.horzcat(goes * fq[:, : len(free)], ca.sqrt(dt) * fq[:, len(free) :])
        return symbols, step_function(model)(*symbols), [(by_state, by_free, law)]
    middle = (first + last) / 2
    after = x
    k = ca.SX.zeros(x.shape[0])
    stages = []
    for (reach, share), u in zip(STAGES, (first, middle, middle, last), strict=True):
        k, fx, fq, fu = slope(x + reach * dt * k, u, p)
        after = after + share * dt / 6 * k
        stages.append((fx, fq, ca.sparsify(fu @ law)))
    return symbols, ca.densify(after), stages


def _slope(model: Model, free: Sequence[int] | np.ndarray, noise: tuple[str, ...]) -> ca.Function:
    """(x, u, p) -> f, df/dx, df/d(p_free, noise), df/du."""
    v, f = noise_vector(model, noise)
    q = ca.vertcat(free_parameters(model, free), v)
    results = (f, ca.jacobian(f, model.x), ca.jacobian(f, q), ca.jacobian(f, model.u))
    quietly = [ca.substitute(e, v, ca.SX.zeros(len(noise))) for e in results]
    return ca.Function("slope", [model.x, model.u, model.p], quietly)
