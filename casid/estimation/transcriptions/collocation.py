"""Direct collocation for Gauss-Newton: interior states are unknowns of their own, eliminated from each linear step.

Sizes: K sample intervals, d collocation points in each, n states, f free parameters. The equations of an interval are
    sum_r C[r, i] X_r - dt f(X_i, u_i, p) = 0,  i = 1..d,  X_0 the node, X_d = X(end)  (Radau points)
The linearised equations give dX as an affine function of node and parameter step, which turns the interval into a
block (end, A, B) of the same shape as a shooting step's. The interior states move with every step (lifted Newton).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.errors import EstimationError
from casid.estimation.transcriptions.dynamics import Blocks, ProblemSymbols, Simulated, Slab, Trajectory
from casid.estimation.transcriptions.kernel import whitened
from casid.estimation.transcriptions.layout import Layout
from casid.estimation.transcriptions.steps import compiled, dynamics_function, output_function, quiet
from casid.estimation.transcriptions.symbolic import collocated
from casid.model.system import Model

_NEWTON = 12  # steps of Newton's method for two steps of the motion
_SOLVED = 1e-6  # of the states: what may be left of its equations


def radau(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (d,) in (0, 1], the last one 1, and C (d+1, d): derivative at point i of the polynomial of node r."""
    points = ca.collocation_points(degree, "radau")
    c, _, _ = ca.collocation_coeff(points)
    return np.array(points), np.asarray(c)


@dataclass(frozen=True, eq=False, kw_only=True)
class CollocationLift:
    """How interior states follow a step: correction (K, d*n) and gain (K, d*n, n+f) on [node step; parameter step];
    matrix (K, d*n, d*n) derivative of the equations in the interior states."""

    correction: np.ndarray
    gain: np.ndarray
    matrix: np.ndarray

    def points(self, nodes: np.ndarray, local: np.ndarray, n: int) -> np.ndarray:
        """(K, d, n) step of the interior states for steps of nodes (K, n) and parameters (K, f)."""
        whole = np.concatenate([nodes, local], axis=1)
        step = self.correction + (self.gain @ whole[..., None])[..., 0]
        return step.reshape(len(nodes), -1, n)

    def price(self, tied: np.ndarray, multipliers: np.ndarray, scale: np.ndarray) -> float:
        """Largest scaled multiplier of the collocation equations, from those of the defects (T, n)."""
        n = len(scale)
        right = np.zeros((len(tied), self.matrix.shape[1], 1))
        right[:, -n:, 0] = multipliers
        found = np.linalg.solve(self.matrix[tied].transpose(0, 2, 1), right)
        return float(np.abs(found.reshape(len(tied), -1, n) * scale).max(initial=0.0))


class LiftedCollocation:
    """The dynamics of a layout with one sample per segment, by collocation; same interface as `Shooting`."""

    soft, kernel = False, None

    def __init__(self, model: Model, free: np.ndarray, layout: Layout, degree: int) -> None:
        self.layout, self.degree, self._model, self._free = layout, degree, model, free
        count, n = layout.segments, len(model.states)
        self.tau, self.c = radau(degree)
        following = layout.guess[:, 0].copy()
        following[layout.tied] = layout.guess[layout.tied + 1, 0]
        start = layout.guess[:, 0]
        self.points0: np.ndarray | None = start[:, None] + self.tau[:, None] * (following - start)[:, None]
        u0, u1 = layout.u0[:, 0, None], layout.u1[:, 0, None]
        self.u = u0 + self.tau[:, None] * (u1 - u0)
        self.shape = (count, degree, n)
        slope, outputs = compiled(model, dynamics_function), compiled(model, output_function)
        derivatives = compiled(model, _derivative_function, tuple(free))
        self._slope = slope.mapped(count * degree)
        self._outputs = outputs.mapped(count)
        self._derivatives = derivatives.mapped(count * degree)

    def trajectory(self, nodes: np.ndarray, parameters: np.ndarray, points: np.ndarray | None = None) -> Trajectory:
        """nodes (K, n), parameters (K, model parameters), interior states (K, d, n)."""
        interior = self.points0 if points is None else points
        assert interior is not None
        count, degree, n = self.shape
        repeated = np.repeat(parameters, degree, axis=0)
        slopes = self._slope(interior, self.u, repeated)[0].reshape(count, degree, n)
        together = np.concatenate([nodes[:, None], interior], axis=1)
        gap = np.einsum("ri,krn->kin", self.c, together) - self.layout.dt[:, :, None] * slopes
        y = self._outputs(nodes, self.layout.u0, parameters)[0].reshape(count, 1, -1)
        return Trajectory(states=nodes[:, None], y=y.copy(), end=interior[:, -1], points=interior, gap=gap)

    def ends_of_pairs(self, start: np.ndarray, pair: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(P, n) states after two steps, `pair` (P,) and the one behind it, from start (P, n): the same equations by
        Newton's method, with nodes that follow. Parameters as of `trajectory`. Not finite where it finds none."""
        count, degree, n = self.shape
        nodes, repeated = np.zeros((count, n)), np.repeat(parameters, degree, axis=0)
        nodes[pair] = nodes[pair + 1] = start
        points = np.repeat(nodes[:, None], degree, axis=1)
        for _ in range(_NEWTON):
            gap = self.trajectory(nodes, parameters, points).gap
            assert gap is not None
            fx, fp, _, _ = (r.copy() for r in self._derivatives(points, self.u, repeated))
            try:
                lift = self._lift(fx.reshape(count, degree, n, n), fp.reshape(count, degree, n, -1), gap)
            except np.linalg.LinAlgError:
                return np.full_like(start, np.nan)
            points = points + lift.correction.reshape(count, degree, n)
            nodes[pair + 1] = points[pair, -1]
        left = self.trajectory(nodes, parameters, points).gap
        assert left is not None
        size = np.abs(points).max(axis=(0, 1)) + 1e-300
        good = (np.abs(left) <= _SOLVED * size).all(axis=(1, 2))
        return np.where((good[pair] & good[pair + 1])[:, None], points[pair + 1, -1], np.nan)

    def blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        """Linearised at a trajectory; weights as of `Shooting.blocks`."""
        count, degree, n = self.shape
        data = self.layout
        repeated = np.repeat(parameters, degree, axis=0)
        # interior points have no output, the node has no collocation equation: two passes of one function
        points, gap = trajectory.points, trajectory.gap
        if points is None or gap is None:
            raise EstimationError("collocation: the trajectory has no interior states; it is of another transcription")
        fx, fp, _, _ = (r.copy() for r in self._derivatives(points, self.u, repeated))
        lift = self._lift(fx.reshape(count, degree, n, n), fp.reshape(count, degree, n, -1), gap)
        jacobian = self._rows(trajectory, repeated, weights)
        residual = whitened((trajectory.y - data.z)[:, 0], weights, data.pattern[:, 0])
        by_channel = jacobian * residual[..., None]
        return Blocks(
            hessian=jacobian.transpose(0, 2, 1) @ jacobian,
            channel_gradient=by_channel,
            gradient=by_channel.sum(axis=1),
            transition=lift.gain[:, -n:],
            end=trajectory.end + lift.correction[:, -n:],
            covariance=None,
            lift=lift,
        )

    def slabs(
        self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray, segments: slice
    ) -> Iterator[Slab]:
        """As of `Shooting`, in one piece: every sample has unknowns of its own here."""
        repeated = np.repeat(parameters, self.degree, axis=0)
        rows = self._rows(trajectory, repeated, weights)[segments, None]
        yield Slab(segments=segments, samples=slice(0, 1), rows=rows)

    def symbolic(self, at: ProblemSymbols) -> Simulated:
        """The polynomials as expressions."""
        return collocated(self._model, self._free, self.layout, self.tau, self.c, at)

    def _rows(self, trajectory: Trajectory, repeated: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(K, o, n+f) derivatives of the whitened outputs at the nodes; parameters repeated for every point."""
        count, degree, _ = self.shape
        at_nodes = np.repeat(trajectory.states[:, 0], degree, axis=0)
        inputs = np.repeat(self.layout.u0[:, 0], degree, axis=0)
        _, _, hx, hp = self._derivatives(at_nodes, inputs, repeated)
        o = self.layout.z.shape[2]
        jacobian = np.concatenate([r.reshape(count, degree, o, r.shape[1])[:, 0] for r in (hx, hp)], axis=2)
        return whitened(jacobian, weights, self.layout.pattern[:, 0])

    def _lift(self, fx: np.ndarray, fp: np.ndarray, gap: np.ndarray) -> CollocationLift:
        count, degree, n = self.shape
        dt = self.layout.dt[:, :, None, None]
        matrix = np.zeros((count, degree, n, degree, n))
        for i in range(degree):
            for r in range(degree):
                matrix[:, i, :, r, :] = self.c[r + 1, i] * np.eye(n)
            matrix[:, i, :, i, :] -= dt[:, 0] * fx[:, i]
        matrix = matrix.reshape(count, degree * n, degree * n)
        by_node = np.broadcast_to(self.c[0][:, None, None] * np.eye(n), (count, degree, n, n))
        right = np.concatenate([gap.reshape(count, degree, n, 1), by_node, -dt * fp], axis=3)
        solved = -np.linalg.solve(matrix, right.reshape(count, degree * n, -1))
        return CollocationLift(correction=solved[..., 0], gain=solved[..., 1:], matrix=matrix)


def _derivative_function(model: Model, free: Sequence[int]) -> ca.Function:
    """(x, u, p) -> df/dx, df/dp_free, dh/dx, dh/dp_free, transposed (numpy row order)."""
    f, h = quiet(model, model.f), quiet(model, model.h)
    p_free = ca.vertcat(*[model.p[int(i)] for i in free])
    jacobians = [ca.jacobian(e, v) for e in (f, h) for v in (model.x, p_free)]
    results = [ca.densify(j.T) for j in jacobians]
    return ca.Function("slopes", [model.x, model.u, model.p], ca.cse(results))
