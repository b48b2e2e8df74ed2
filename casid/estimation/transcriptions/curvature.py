"""First and second derivatives of a shot in its start state and free parameters, sample by sample.

A general derivative of a simulation follows every direction through every sample, forward and back. Here the
sensitivities S = d(state)/d(start state, free parameters) go forward once, and the multipliers of the states come back
once. The Hessian is the sum over samples and stages of Runge-Kutta of Z' (second derivative there) Z, Z = [S; 0 1].
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from casid.estimation.transcriptions.dynamics import ShotDerivatives
from casid.estimation.transcriptions.steps import STAGES, dynamics_function, output_function
from casid.estimation.transcriptions.symbolic import SampleSymbols
from casid.model.built import cached
from casid.model.system import Model


def shot_derivatives(model: Model, free: np.ndarray, length: int, count: int) -> ShotDerivatives:
    """The derivatives of `count` segments of `length` samples."""
    n = len(model.states)
    nf = len(model.states) + len(free)
    o = len(model.outputs)
    ahead, back = cached(model, ("curvature", tuple(free)), lambda: (_ahead(model, free), _back(model, free)))
    given = [ca.MX.sym("x", n), *(ca.MX.sym("u", len(model.inputs), length) for _ in range(2))]
    given += [ca.MX.sym("dt", 1, length), ca.MX.sym("base", len(model.parameters)), ca.MX.sym("q", len(free))]
    x, u0, u1, dt, base, q = given
    data = u0, u1, dt, ca.repmat(base, 1, length), ca.repmat(q, 1, length)
    begin = ca.vertcat(x, ca.vec(ca.MX(ca.DM(np.eye(n, nf)))))
    states = ahead.mapaccum(length)(begin, *data)
    first = ca.Function("first", given, [states[n:, -1]])
    a = ca.MX.sym("a", n)
    mu = ca.MX.sym("mu", o, length)
    c = ca.MX.sym("c", o, length)
    before = ca.horzcat(begin, states[:, :-1]) if length > 1 else begin
    backward = [e[:, list(range(length))[::-1]] for e in (before, *data, mu, c)]
    found = back.mapaccum(length)(ca.vertcat(a, ca.MX.zeros(nf * nf)), *backward)
    upper = np.flatnonzero(np.triu(np.ones((nf, nf))).ravel(order="F"))
    second = ca.Function("second", [*given, a, mu, c], [found[n:, -1][upper.tolist()]])
    return ShotDerivatives(first=first.map(count), second=second.map(count))


class _Sample:
    """One sample interval: small functions of the model's expressions, and matrix products around them, which in
    CasADi's virtual machine cost a third of the same written out."""

    def __init__(self, model: Model, free: np.ndarray) -> None:
        of = SampleSymbols(model, free)
        self.n, self.f = of.x.shape[0], len(free)
        self.data = [ca.MX.sym("d", *e.shape) for e in (of.u0, of.u1, of.dt, of.base, of.q)]
        f = dynamics_function(model)(of.x, of.u0, of.p)
        y = ca.densify(output_function(model)(of.x, of.u0, of.p))
        given = [of.x, of.u0, of.base, of.q]
        whole = ca.vertcat(of.x, of.q)
        weight = ca.SX.sym("k", self.n)
        mu = ca.SX.sym("mu", y.shape[0])
        self.slope = ca.Function("slope", given, ca.cse([ca.densify(f), *self._split(ca.jacobian(f, whole))]))
        bent = ca.hessian(weight.T @ f, whole)[0]
        through = [ca.densify(ca.jacobian(f, of.x).T @ weight)]
        self.bent = ca.Function("bent", [*given, weight], ca.cse(through + self._blocks(bent)))
        bent = ca.hessian(mu.T @ y, whole)[0]
        rows = ca.jacobian(y, whole)
        through = [ca.densify(ca.jacobian(y, of.x).T @ mu)]
        found = through + self._split(rows) + self._blocks(bent)
        self.seen = ca.Function("seen", [*given, mu], ca.cse(found))

    def _split(self, rows: ca.SX) -> list[ca.SX]:
        return [rows[:, : self.n], rows[:, self.n :]]

    def _blocks(self, hessian: ca.SX) -> list[ca.SX]:
        return [hessian[: self.n, : self.n], hessian[: self.n, self.n :], hessian[self.n :, self.n :]]

    def beside(self, by_free: ca.MX) -> ca.MX:
        """Columns of nothing for the start state, then those of the free parameters."""
        return ca.horzcat(ca.MX(by_free.shape[0], self.n), by_free)

    def congruent(self, s: ca.MX, xx: ca.MX, xq: ca.MX, qq: ca.MX) -> ca.MX:
        """Z' H Z for Z = [s; 0 1], of H by its blocks."""
        upper = ca.densify(xx @ s + self.beside(xq))
        lower = xq.T @ s + self.beside(qq)
        return s.T @ upper + ca.vertcat(ca.MX(self.n, self.n + self.f), lower)

    def stages(self, x: ca.MX, s: ca.MX) -> tuple[ca.MX, ca.MX, list[tuple[list[ca.MX], ca.MX]]]:
        """State and sensitivity after a step from (x, s); where each stage takes its slope, and the sensitivity
        there."""
        u0, u1, dt, base, q = self.data
        after = x
        s_after = s
        k = ca.MX(self.n, 1)
        ks = ca.MX(*s.shape)
        at = []
        for reach, share in STAGES:
            s_here = ca.densify(s + reach * dt * ks)
            at.append(([x + reach * dt * k, u0 + reach * (u1 - u0), base, q], s_here))
            k, fx, fq = self.slope(*at[-1][0])
            ks = ca.densify(fx @ s_here + self.beside(fq))
            after = after + share / 6 * dt * k
            s_after = s_after + share / 6 * dt * ks
        return after, s_after, at


def _ahead(model: Model, free: np.ndarray) -> ca.Function:
    """(state and sensitivity, data) -> the same one sample later."""
    sample = _Sample(model, free)
    n = sample.n
    nf = sample.n + sample.f
    both = ca.MX.sym("xs", n + n * nf)
    after, s_after, _ = sample.stages(both[:n], ca.reshape(both[n:], n, nf))
    return ca.Function("ahead", [both, *sample.data], [ca.vertcat(after, ca.vec(s_after))])


def _back(model: Model, free: np.ndarray) -> ca.Function:
    """(multipliers of the state after it and Hessian so far, state and sensitivity before it, data, multipliers and
    curvature of the outputs) -> (multipliers of the state before it, Hessian with this sample)."""
    sample = _Sample(model, free)
    o = len(model.outputs)
    n = sample.n
    nf = sample.n + sample.f
    later = ca.MX.sym("ah", n + nf * nf)
    both = ca.MX.sym("xs", n + n * nf)
    mu = ca.MX.sym("mu", o)
    c = ca.MX.sym("c", o)
    a = later[:n]
    x = both[:n]
    s = ca.reshape(both[n:], n, nf)
    u0, _, dt, base, q = sample.data
    back, by_state, by_free, *blocks = sample.seen(x, u0, base, q, mu)
    rows = ca.densify(by_state @ s + sample.beside(by_free))
    total = rows.T @ (ca.repmat(c, 1, nf) * rows) + sample.congruent(s, *blocks)
    before = a + back
    following = 0.0
    into = ca.MX(n, 1)
    for (reach, share), (where, s_here) in reversed(list(zip(STAGES, sample.stages(x, s)[2], strict=True))):
        # a slope counts in the state after the step, and in where the stage behind takes its own
        into, *blocks = sample.bent(*where, dt * (share / 6 * a + following * into))
        total += sample.congruent(s_here, *blocks)
        before = before + into
        following = reach
    found = ca.vertcat(before, later[n:] + ca.vec(total))
    return ca.Function("back", [later, both, *sample.data, mu, c], [found])
