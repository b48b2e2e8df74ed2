"""The motion of a transcription as CasADi expressions, for solvers that take a nonlinear programme."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casid.estimation.transcriptions.dynamics import ProblemSymbols, Simulated
from casid.estimation.transcriptions.layout import Layout
from casid.estimation.transcriptions.steps import dynamics_function, output_function, step_function
from casid.model.system import Model


class SampleSymbols:
    """SX symbols of one sample interval; only `x`, `points` and the free parameters `q` are to be differentiated."""

    def __init__(self, model: Model, free: np.ndarray, degree: int = 0) -> None:
        n = len(model.states)
        m = len(model.inputs)
        count = len(model.parameters)
        self.x, self.points = ca.SX.sym("x", n), ca.SX.sym("c", n, degree)
        self.u0, self.u1, self.dt = ca.SX.sym("u0", m), ca.SX.sym("u1", m), ca.SX.sym("dt")
        self.base, self.q = ca.SX.sym("base", count), ca.SX.sym("q", len(free))
        self.p = ca.SX(self.base)
        for j, i in enumerate(free):
            self.p[int(i)] = self.q[j]


def with_data(name: str, inputs: list, outputs: list, variable: tuple[int, ...]) -> ca.Function:
    """A function of which only the inputs numbered `variable` are differentiated: data need no derivative."""
    return ca.Function(name, inputs, outputs, {"is_diff_in": [i in variable for i in range(len(inputs))]})


def shot(model: Model, free: np.ndarray, layout: Layout, at: ProblemSymbols) -> Simulated:
    """Simulate by Runge-Kutta steps from every node."""
    count = layout.segments
    length = layout.length
    of = SampleSymbols(model, free)
    y = _outputs(model, of)
    advanced = step_function(model)(of.x, of.u0, of.u1, of.dt, of.p)
    step = with_data("step", [of.x, of.u0, of.u1, of.dt, of.base, of.q], [advanced], (0, 5))
    x, b, f = (ca.MX.sym(name, *e.shape) for name, e in (("x", of.x), ("base", of.base), ("q", of.q)))
    u0, u1, dt = (
        ca.MX.sym(name, rows, length) for name, rows in (("u0", of.u0.shape[0]), ("u1", of.u1.shape[0]), ("dt", 1))
    )
    many_b = ca.repmat(b, 1, length)
    many_f = ca.repmat(f, 1, length)
    after = step.mapaccum("segment", length)(x, u0, u1, dt, many_b, many_f)
    states = ca.horzcat(x, after[:, :-1]) if length > 1 else x
    outputs = y.map(length)(states, u0, many_b, many_f)
    segment = with_data("segment", [x, u0, u1, dt, b, f], [states, after[:, -1], outputs], (0, 5))
    states, end, outputs = segment.map(count)(at.nodes, at.u0, at.u1, at.dt, at.base, at.free)
    return Simulated(states=states, end=end, y=outputs, gap=ca.MX(0, 1))


def collocated(
    model: Model, free: np.ndarray, layout: Layout, tau: np.ndarray, c: np.ndarray, at: ProblemSymbols
) -> Simulated:
    """Simulate by polynomials through the state before a step and the interior states after it; tau and c as `radau`
    gives them."""
    degree = len(tau)
    scale = ca.DM(model.scale_vector())
    of = SampleSymbols(model, free, degree)
    f = dynamics_function(model)
    together = ca.horzcat(of.x, of.points)
    equations = [
        together @ ca.DM(c[:, i]) - of.dt * f(of.points[:, i], of.u0 + tau[i] * (of.u1 - of.u0), of.p)
        for i in range(degree)
    ]
    scaled = ca.vertcat(*equations) / ca.repmat(scale, degree, 1)
    inputs = [of.x, of.points, of.u0, of.u1, of.dt, of.base, of.q]
    interval = with_data("interval", inputs, [scaled], (0, 1, 6))
    assert at.points is not None
    length = layout.length
    steps = layout.segments * layout.length
    after = at.points[:, degree - 1 :: degree]
    before = [k // length if k % length == 0 else layout.segments + k - 1 for k in range(steps)]
    states = ca.horzcat(at.nodes, after)[:, before]
    record = [k // length for k in range(steps)]
    base = at.base[:, record]
    own = at.free[:, record]
    gap = ca.vec(interval.map(steps)(states, at.points, at.u0, at.u1, at.dt, base, own))
    y = _outputs(model, of).map(steps)(states, at.u0, base, own)
    return Simulated(states=states, end=after[:, length - 1 :: length], y=y, gap=gap)


def _outputs(model: Model, of: SampleSymbols) -> ca.Function:
    return with_data("outputs", [of.x, of.u0, of.base, of.q], [output_function(model)(of.x, of.u0, of.p)], (0, 3))
