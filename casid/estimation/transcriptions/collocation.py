"""Direct collocation for Gauss-Newton: interior states are unknowns of their own, eliminated from each linear step.

Sizes: K segments of L steps, d collocation points in each step, n states, f free parameters. The equations of a step:
    sum_r C[r, i] X_r - dt f(X_i, u_i, p) = 0,  i = 1..d,  X_0 the state before, X_d the state after it (Radau points)
Linearised they give dX as an affine function of the steps of the state before and of the parameters. One step after
the other, that turns a segment into a block (end, A, B) of the same shape as one of shooting. The states between the
steps and inside them move with every step of the solver (lifted Newton). So each is an unknown, however long a segment
is. The compiled kernel of the model does it when there is one, else numpy on CasADi's mapped functions, with the same
result to rounding.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.errors import EstimationError
from casid.estimation.transcriptions.collocation_kernel import CollocationKernel, collocation_offer
from casid.estimation.transcriptions.dynamics import Blocks, ProblemSymbols, Simulated, Slab, Trajectory
from casid.estimation.transcriptions.jumps import Jumps
from casid.estimation.transcriptions.kernel import Packed, pack, whitened
from casid.estimation.transcriptions.layout import Layout, watched
from casid.estimation.transcriptions.steps import dynamics_function, output_function, slopes, slopes_function
from casid.estimation.transcriptions.symbolic import collocated
from casid.model.built import cached, compiled
from casid.model.system import Model

CONDENSED = 10  # sample intervals whose states are eliminated together: a matter of time and memory alone
_NEWTON = 20  # steps of Newton's method for one step of the motion
_SOLVED = 1e-8  # of a state: the last step of it
_SLAB = 4096  # samples of which the rows are held at once


def radau(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (d,) in (0, 1], the last one 1, and C (d+1, d): derivative at point i of the polynomial of node r."""
    points = ca.collocation_points(degree, "radau")
    c, _, _ = ca.collocation_coeff(points)
    return np.array(points), np.asarray(c)


@dataclass(frozen=True, eq=False, kw_only=True)
class PlainLift:
    """Response of interior states to a step: correction (K, L, d*n) and gain (K, L, d*n, n+f) on [step of the state
    before; parameter step]; pull (K, L, n), derivative of the cost in the state at each sample. The sums shift (K,
    n+f+2) are as in collocate.c."""

    correction: np.ndarray
    gain: np.ndarray
    pull: np.ndarray
    shift: np.ndarray

    def follow(
        self, nodes: np.ndarray, local: np.ndarray, multipliers: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Follow a step as `CollocationKernel` does."""
        count, n = nodes.shape
        steps = np.empty_like(self.correction)
        before = nodes
        for j in range(steps.shape[1]):
            whole = np.concatenate([before, local], axis=1)
            steps[:, j] = self.correction[:, j] + (self.gain[:, j] @ whole[..., None])[..., 0]
            before = steps[:, j, -n:]
        costate = multipliers
        price = 0.0
        for j in range(steps.shape[1] - 1, -1, -1):
            price = max(price, float(np.abs(costate * scale).max(initial=0.0)))
            costate = self.pull[:, j] + np.einsum("kab,ka->kb", self.gain[:, j, -n:, :n], costate)
        return steps.reshape(count, -1, n), price


class LiftedCollocation:
    """The dynamics of a layout by collocation; same interface as `Shooting`.

    lifted   whether interior states are unknowns. If not, they are the motion from the nodes, each step solved by
             Newton's method: shooting with implicit steps.
    """

    soft = False

    def __init__(self, model: Model, free: np.ndarray, layout: Layout, degree: int, lifted: bool = True) -> None:
        self.layout = layout
        self.degree = degree
        self._model = model
        self._free = free
        self._lifted = lifted
        self.tau, self.c = radau(degree)
        self.shape = (layout.segments, layout.length, degree, len(model.states))
        self._jumps = Jumps(model, free, layout)
        self._packed: Packed | None = None
        key = self._key = tuple(int(i) for i in free)
        self._offer = cached(
            model,
            ("collocation kernel", key, degree),
            lambda: collocation_offer(model.name, _kernel_functions(model, key), self.tau, self.c),
        )

    @property
    def points0(self) -> np.ndarray | None:
        """(K, L d, n) interior states on straight lines between the first guesses of the samples; None where they are
        no unknowns."""
        layout = self.layout
        if not self._lifted:
            return None
        following = np.concatenate([layout.guess[:, 1:], layout.guess[:, -1:]], axis=1)
        following[layout.tied, -1] = layout.guess[layout.tied + 1, 0]
        along = self.tau[:, None] * (following - layout.guess)[:, :, None]
        return (layout.guess[:, :, None] + along).reshape(layout.segments, -1, self.shape[3])

    @property
    def kernel(self) -> CollocationKernel | None:
        """The compiled kernel when there is one now."""
        return self._offer.get()

    def trajectory(self, nodes: np.ndarray, parameters: np.ndarray, points: np.ndarray | None = None) -> Trajectory:
        """nodes (K, n), parameters (K, model parameters), interior states (K, L d, n)."""
        interior = points if points is not None else self.points0
        if interior is None:
            interior = self._motion(nodes, parameters)
        states = self._states(nodes, interior)
        kernel = self.kernel
        if kernel is not None:
            y, gap, squares = kernel.gaps(self._packed_for(kernel), nodes, interior, parameters)
            kept = gap if self._lifted else None
            return self._trajectory(states, y, interior, parameters, kept, squares)
        begin = time.perf_counter()
        count, length, d, n = self.shape
        slope = compiled(self._model, dynamics_function)
        outputs = compiled(self._model, output_function)
        repeated = np.repeat(parameters, length, axis=0)
        many = np.repeat(repeated, d, axis=0)
        slopes = slope.mapped(count * length * d)(interior, self._inputs_at_points(slice(None)), many)[0]
        inside = interior.reshape(count, length, d, n)
        gap = np.einsum("ri,klrn->klin", self.c, np.concatenate([states[:, :, None], inside], axis=2))
        gap -= self.layout.dt[:, :, None, None] * slopes.reshape(inside.shape)
        y = outputs.mapped(count * length)(states, self.layout.u0, repeated)[0].reshape(count, length, -1)
        self._offer.spent += time.perf_counter() - begin
        kept = gap.reshape(interior.shape) if self._lifted else None
        return self._trajectory(states, y.copy(), interior, parameters, kept)

    def _trajectory(
        self,
        states: np.ndarray,
        y: np.ndarray,
        interior: np.ndarray,
        parameters: np.ndarray,
        gap: np.ndarray | None,
        squares: np.ndarray | None = None,
    ) -> Trajectory:
        arrived = interior[:, -1]
        end = self._jumps.end(arrived, parameters)
        return Trajectory(states=states, y=y, arrived=arrived, end=end, squares=squares, points=interior, gap=gap)

    def _motion(self, nodes: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(K, L d, n) interior states of the motion from the nodes; not finite from where there is none."""
        kernel, (count, length, d, n) = self.kernel, self.shape
        if kernel is not None:
            scale = self._model.scale_vector()
            return kernel.motion(self._packed_for(kernel), nodes, parameters, scale, _SOLVED)
        begin = time.perf_counter()
        points = np.empty((count, length, d, n))
        state = nodes
        for j in range(length):
            which = np.arange(count) * length + j
            points[:, j], _ = self.solved(which, state, np.repeat(state[:, None], d, axis=1), parameters)
            state = points[:, j, -1]
        self._offer.spent += time.perf_counter() - begin
        return points.reshape(count, -1, n)

    def blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        """Linearised at a trajectory; weights as of `Shooting.blocks`. Raises numpy.linalg.LinAlgError where a step is
        singular."""
        points = _points_of(trajectory)
        kernel = self.kernel
        if kernel is not None:
            packed = self._packed_for(kernel)
            found = kernel.lift(packed, trajectory.states[:, 0], points, parameters, weights, keep=self._lifted)
        else:
            begin = time.perf_counter()
            found = self._plain(trajectory, parameters, weights, slice(None))
            found = replace(found, rows=None, lift=found.lift if self._lifted else None)
            self._offer.spent += time.perf_counter() - begin
        return self._jumps.blocks(found, trajectory.arrived, parameters)

    def slabs(
        self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray, segments: slice
    ) -> Iterator[Slab]:
        """Yield slabs as `Shooting` does."""
        points = _points_of(trajectory)
        length = self.shape[1]
        kernel = self.kernel
        lanes = 1 if kernel is None else kernel.lanes
        group = max(_SLAB // (lanes * length), 1) * lanes
        for first in range(segments.start // group * group, segments.stop, group):
            own = slice(max(first, segments.start), min(first + group, segments.stop))
            whole = slice(first, min(first + group, self.shape[0]))
            if kernel is None:
                found = self._plain(trajectory, parameters, weights, whole)
            else:
                part = self._packed_for(kernel).part(slice(first // lanes, -(-whole.stop // lanes)), 0, length)
                nodes = trajectory.states[whole, 0]
                found = kernel.lift(part, nodes, points[whole], parameters[whole], weights, rows=True)
            assert found.rows is not None
            yield Slab(segments=own, samples=slice(0, length), rows=found.rows[own.start - first : own.stop - first])

    def watching(self, names: tuple[str, ...]) -> LiftedCollocation:
        """The same motion with the named states and outputs as its outputs."""
        model, layout = watched(self._model, self.layout, names)
        return LiftedCollocation(model, self._free, layout, self.degree)

    def symbolic(self, at: ProblemSymbols) -> Simulated:
        """The polynomials as expressions. Raises EstimationError where their points are no unknowns."""
        if not self._lifted:
            raise EstimationError(
                "solve: implicit shooting solves its steps one by one, which a nonlinear programme does not represent; "
                "use GaussNewton(), or Collocation()"
            )
        found = collocated(self._model, self._free, self.layout, self.tau, self.c, at)
        return replace(found, end=self._jumps.symbolic(found.end, at))

    def refined(self, coarse: LiftedCollocation, nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(K, L d, n) interior states on the polynomials of a coarser one of the same segments and samples."""
        count, length, d, n = self.shape
        states = coarse._states(nodes, points)
        inside = np.concatenate([states[:, :, None], points.reshape(*states.shape[:2], -1, n)], axis=2)
        # a point at the end of a coarse step belongs to that step
        at = ((np.arange(length)[:, None] + self.tau) * (coarse.layout.length / length)).ravel()
        step = np.clip(np.ceil(at).astype(int) - 1, 0, coarse.layout.length - 1)
        table = _lagrange(np.append(0.0, coarse.tau), at - step)
        return np.einsum("rm,kmrn->kmn", table, inside[:, step]).reshape(count, length * d, n)

    def after_samples(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return for all samples but the last of each record (P, n) states a sample interval after the first guess
        of their state, (P, n, n) their derivative by that, and (P, o, n) derivative of the outputs there; parameters
        (records, model parameters). Not finite where there is no motion."""
        layout = self.layout
        n = self.shape[3]
        begin = np.concatenate([sample[:-1] for sample in layout.sample])
        values = parameters[layout.record[begin // layout.length]]
        state = layout.guess.reshape(-1, n)[begin]
        transition = np.tile(np.eye(n), (len(begin), 1, 1))
        for j in range(layout.substeps):
            guess = np.repeat(state[:, None], self.degree, axis=1)
            points, by_state = self.solved(begin + j, state, guess, values)
            state = points[:, -1]
            transition = by_state @ transition
        last = layout.u1.reshape(layout.dt.size, -1)[begin + layout.substeps - 1]
        outputs = compiled(self._model, slopes_function, "h", self._key).mapped(len(begin))(state, last, values)[1]
        return state, transition, outputs.reshape(len(begin), -1, n).copy()

    def local_errors(
        self, nodes: np.ndarray, points: np.ndarray, parameters: np.ndarray, halves: LiftedCollocation
    ) -> np.ndarray:
        """(K, L, n) by how much two half steps from the state before end elsewhere than each step does; `halves` has
        twice the steps. Not finite where a half step has no solution."""
        count, length, _, n = self.shape
        before = self._states(nodes, points).reshape(-1, n)
        guess = halves.refined(self, nodes, points).reshape(count * length, 2, -1, n)
        half = np.arange(count * length)[:, None] * 2 + [0, 1]
        after = before
        repeated = np.repeat(parameters, length, axis=0)
        for k in range(2):
            after = halves.solved(half[:, k], after, guess[:, k], repeated)[0][:, -1]
        return (after - points.reshape(count, length, -1, n)[:, :, -1].reshape(-1, n)).reshape(count, length, n)

    def carried(
        self, trajectory: Trajectory, parameters: np.ndarray, made: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """y (K, L, o) and end (K, n) of a trajectory with an error made (K, L, n) in each step, carried along its
        segment by the linearised motion."""
        points = _points_of(trajectory)
        count, length, d, n = self.shape
        derivatives = compiled(self._model, slopes_function, "f").mapped(count * length * d)
        many = np.repeat(parameters, length * d, axis=0)
        fx = derivatives(points, self._inputs_at_points(slice(None)), many)[1].reshape(-1, d, n, n)
        by_node = np.broadcast_to(self.c[0][:, None, None] * np.eye(n), (len(fx), d, n, n)).reshape(-1, d * n, n)
        solved = np.linalg.solve(self._matrix(self.layout.dt.reshape(-1, 1), fx), by_node)
        transition = -solved[:, -n:].reshape(count, length, n, n)
        off = np.zeros((count, n))
        states = trajectory.states.copy()
        for j in range(length):
            states[:, j] += off
            off = (transition[:, j] @ off[..., None])[..., 0] + made[:, j]
        repeated = np.repeat(parameters, length, axis=0)
        outputs = compiled(self._model, output_function).mapped(count * length)
        y = outputs(states, self.layout.u0, repeated)[0].reshape(trajectory.y.shape)
        return y.copy(), self._jumps.shifted(trajectory, off, parameters)

    def solved(
        self, which: np.ndarray, before: np.ndarray, guess: np.ndarray, parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(P, d, n) points of the steps number `which` (P,) of all, from states before (P, n), by Newton's method from
        a guess, and (P, n, n) derivative of the last one in the state before; parameters (P, model parameters). Not
        finite where it finds none."""
        d, n = guess.shape[1:]
        u = self._inputs_at_points(slice(None))
        u = u.reshape(self.layout.dt.size, *u.shape[2:])[which]
        dt = self.layout.dt.ravel()[which, None, None]
        many = np.repeat(parameters, d, axis=0)
        derivatives = compiled(self._model, slopes_function, "f").mapped(len(which) * d)
        X = guess.copy()
        size = self._model.scale_vector()
        by_state = np.zeros((len(which), n, n))
        by_node = np.tile((self.c[0][:, None, None] * np.eye(n)).reshape(d * n, n), (len(which), 1, 1))
        left = np.full(len(which), np.inf)
        for _ in range(_NEWTON):
            f, fx = (r.reshape(len(which), d, n, -1) for r in derivatives(X, u, many)[:2])
            gap = np.einsum("ri,prn->pin", self.c, np.concatenate([before[:, None], X], axis=1)) - dt * f[..., 0]
            right = np.concatenate([gap.reshape(len(which), d * n, 1), by_node], axis=2)
            try:
                solved = np.linalg.solve(self._matrix(dt[..., 0], fx), right)
            except np.linalg.LinAlgError:
                break
            step = solved[..., 0].reshape(X.shape)
            former = left
            X = X - step
            by_state = -solved[:, -n:, 1:]
            left = (np.abs(step) / np.maximum(np.abs(X), size)).max(axis=(1, 2))
            if not (left > _SOLVED).any() or not (left < former).any():
                break
        good = left <= _SOLVED
        good = good[:, None, None]
        return np.where(good, X, np.nan), np.where(good, by_state, np.nan)

    def _states(self, nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(K, L, n) states before each step."""
        d = self.degree
        return np.concatenate([nodes[:, None], points[:, d - 1 : -1 : d]], axis=1)

    def _inputs_at_points(self, segments: slice) -> np.ndarray:
        """(k, L, d, m)."""
        u0 = self.layout.u0[segments, :, None]
        u1 = self.layout.u1[segments, :, None]
        return u0 + self.tau[:, None] * (u1 - u0)

    def _packed_for(self, kernel: CollocationKernel) -> Packed:
        if self._packed is None:
            self._packed = pack(self.layout, kernel.sizes, kernel.lanes)
        return self._packed

    def _plain(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray, segments: slice) -> Blocks:
        """Blocks of some segments with their rows, and how their interior states follow."""
        data = self.layout
        points = _points_of(trajectory)
        gap = trajectory.gap
        gap = np.zeros_like(points) if gap is None else gap
        states = trajectory.states[segments]
        y = trajectory.y[segments]
        count, length, n = states.shape
        derived = self._derived(states, points[segments], parameters[segments], segments)
        correction, gain = self._eliminated(derived[0], derived[1], gap[segments], segments)
        s = np.tile(np.eye(n, n + len(self._free)), (count, 1, 1))
        offset = np.zeros((count, n))
        sensitivity = []
        offsets = []
        for j in range(length):
            sensitivity.append(s)
            offsets.append(offset)
            last = gain[:, j, -n:]
            s = last[..., :n] @ s
            s[..., n:] += last[..., n:]
            offset = correction[:, j, -n:] + (last[..., :n] @ offset[..., None])[..., 0]
        hx = derived[2]
        hp = derived[3]
        rows = hx @ np.stack(sensitivity, axis=1)
        rows[..., n:] += hp
        pattern = data.pattern[segments]
        rows = whitened(rows, weights, pattern)
        by_state = whitened(hx, weights, pattern)
        moved = (by_state @ np.stack(offsets, axis=1)[..., None])[..., 0]
        residual = whitened(y - data.z[segments], weights, pattern)
        flat = rows.reshape(count, -1, rows.shape[3])
        shift = [np.einsum("klof,klo->kf", rows, moved), (residual * moved).sum((1, 2))[:, None]]
        shift = np.concatenate([*shift, (moved**2).sum((1, 2))[:, None]], axis=1)
        pull = np.einsum("klon,klo->kln", by_state, residual)
        channel_gradient = np.einsum("klof,klo->kof", rows, residual + moved)
        return Blocks(
            hessian=flat.transpose(0, 2, 1) @ flat,
            channel_gradient=channel_gradient,
            gradient=channel_gradient.sum(axis=1),
            transition=s,
            end=points[segments][:, -1] + offset,
            covariance=None,
            lift=PlainLift(correction=correction, gain=gain, pull=pull, shift=shift),
            rows=rows,
        )

    def _derived(
        self, states: np.ndarray, points: np.ndarray, parameters: np.ndarray, segments: slice
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """df/dx, df/dp_free (k, L, d, n, ...) at the points, dh/dx, dh/dp_free (k, L, o, ...) at the samples."""
        count, length, n = states.shape
        d = self.degree
        repeated = np.repeat(parameters, length, axis=0)
        inner = compiled(self._model, slopes_function, "f", self._key).mapped(count * length * d)
        outer = compiled(self._model, slopes_function, "h", self._key).mapped(count * length)
        many = np.repeat(repeated, d, axis=0)
        _, *at_points = inner(points, self._inputs_at_points(segments), many)
        _, *at_samples = outer(states, self.layout.u0[segments], repeated)
        fx, fp = (r.reshape(count, length, d, n, -1).copy() for r in at_points)
        hx, hp = (r.reshape(count, length, self.layout.z.shape[2], -1).copy() for r in at_samples)
        return fx, fp, hx, hp

    def _eliminated(
        self, fx: np.ndarray, fp: np.ndarray, gap: np.ndarray, segments: slice
    ) -> tuple[np.ndarray, np.ndarray]:
        """correction (k, L, d n) and gain (k, L, d n, n+f) of the interior states of every step."""
        count, length, d, n = fx.shape[:4]
        dt = self.layout.dt[segments].reshape(-1, 1, 1)
        matrix = self._matrix(dt[..., 0], fx.reshape(-1, d, n, n))
        by_node = np.broadcast_to(self.c[0][:, None, None] * np.eye(n), (count * length, d, n, n))
        by_parameter = -dt[..., None] * fp.reshape(count * length, d, n, fp.shape[4])
        right = np.concatenate([gap.reshape(-1, d, n, 1), by_node, by_parameter], axis=3)
        solved = -np.linalg.solve(matrix, right.reshape(count * length, d * n, -1))
        solved = solved.reshape(count, length, d * n, -1)
        return solved[..., 0], solved[..., 1:]

    def _matrix(self, dt: np.ndarray, fx: np.ndarray) -> np.ndarray:
        """(P, d n, d n) derivative of the equations of P steps of durations dt (P, 1) in their points."""
        count, d, n = fx.shape[:3]
        matrix = np.zeros((count, d, n, d, n))
        for i in range(d):
            for r in range(d):
                matrix[:, i, :, r, :] = self.c[r + 1, i] * np.eye(n)
            matrix[:, i, :, i, :] -= dt[..., None] * fx[:, i]
        return matrix.reshape(count, d * n, d * n)


def _points_of(trajectory: Trajectory) -> np.ndarray:
    if trajectory.points is None:
        raise EstimationError("collocation: the trajectory has no interior states; it is of another transcription")
    return trajectory.points


def _lagrange(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(nodes, points) value at each point of the polynomial that is 1 at one node and 0 at the others."""
    rows = []
    for r, node in enumerate(nodes):
        others = np.delete(nodes, r)
        rows.append(np.prod((at[:, None] - others) / (node - others), axis=1))
    return np.array(rows)


def _kernel_functions(model: Model, free: Sequence[int]) -> dict[str, ca.Function]:
    """Return the functions that `collocation_source` takes."""
    slope = slopes(model, "f", free)
    output = slopes(model, "h", free)
    results = {"slope": [slope[0]], "output": [output[0]], "slopes": [*slope], "outputs_of": [*output]}
    return {name: ca.Function(name, [model.x, model.u, model.p], ca.cse(r)) for name, r in results.items()}
