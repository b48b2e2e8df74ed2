"""Linearise all samples of all segments: the hot path of Gauss-Newton shooting, behind one narrow interface.

Sizes: K segments, L samples each, n states, f free parameters (of the segment's record), o outputs.
`Shooting.trajectory` simulates; `Shooting.blocks` returns per segment the Gram matrix and gradient of the whitened
output residuals in (start state, free parameters) and the sensitivity of the end state. Both run in the compiled
kernel of the model when there is one, else on CasADi's mapped functions, with the same result to rounding.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from casid.errors import EstimationError
from casid.estimation.transcriptions.curvature import shot_derivatives
from casid.estimation.transcriptions.dynamics import Blocks, ProblemSymbols, Simulated, Slab, Trajectory
from casid.estimation.transcriptions.jumps import Jumps
from casid.estimation.transcriptions.kernel import Kernel, Packed, pack, shooting_offer, whitened
from casid.estimation.transcriptions.layout import Layout, watched
from casid.estimation.transcriptions.steps import output_function, sample_derivatives, stage_functions, step_function
from casid.estimation.transcriptions.symbolic import shot
from casid.model.built import cached, compiled
from casid.model.feedback import SampledFeedback
from casid.model.system import Model
from casid.native.compiler import Batch

_SLAB_SAMPLES = 4096  # that CasADi holds at once, and of which there are derivatives


class Shooting:
    """Simulation and linearisation of a layout's segments by Runge-Kutta steps.

    noise      name -> intensity of process noise (see MultipleShooting), empty without
    feedback   control law in the loop, None without
    """

    points0: np.ndarray | None = None

    def __init__(
        self,
        model: Model,
        free: np.ndarray,
        layout: Layout,
        noise: dict[str, float],
        feedback: SampledFeedback | None = None,
    ) -> None:
        self.layout = layout
        self._model = model
        self._free = free
        self._feedback = feedback
        self.shape = (layout.segments, layout.length)
        self._jumps = Jumps(model, free, layout)
        self.noise_names = tuple(noise)
        self.intensity = np.array(list(noise.values()))
        self._packed: Packed | None = None
        key = (tuple(free), self.noise_names, feedback)
        self._offer = cached(
            model,
            ("kernel", *key),
            lambda: shooting_offer(
                model.name, lambda: stage_functions(model, free, self.noise_names, feedback), len(self.noise_names)
            ),
        )

    @cached_property
    def _mapped(self) -> tuple[Batch, Batch, Batch]:
        """Simulation of a group of segments, outputs of its samples, derivatives over a slab, by CasADi."""
        model = self._model
        feedback = self._feedback
        count, length = self.shape
        step = compiled(model, step_function, feedback)
        outputs = compiled(model, output_function)
        derivatives = compiled(model, sample_derivatives, tuple(self._free), self.noise_names, feedback)
        group = self._group
        simulate = step.accumulated(length, group)
        return simulate, outputs.mapped(group * length), derivatives.mapped(min(count * length, _SLAB_SAMPLES))

    @property
    def _group(self) -> int:
        """Segments that CasADi simulates in one call."""
        return min(self.shape[0], max(_SLAB_SAMPLES // self.shape[1], 1))

    @property
    def soft(self) -> bool:
        """Return True if defects are random with a covariance."""
        return bool(self.noise_names)

    @property
    def kernel(self) -> Kernel | None:
        """The compiled kernel when there is one now."""
        return self._offer.get()

    def trajectory(self, nodes: np.ndarray, parameters: np.ndarray, points: np.ndarray | None = None) -> Trajectory:
        """nodes (K, n), parameters (K, model parameters)."""
        kernel = self.kernel
        if kernel is not None:
            states, y, end, squares = kernel.simulate(self._packed_for(kernel), nodes, parameters)
            after_jump = self._jumps.end(end, parameters)
            return Trajectory(states=states, y=y, arrived=end, end=after_jump, squares=squares)
        begin = time.perf_counter()
        data = self.layout
        simulate, outputs, _ = self._mapped
        count, length = self.shape
        states = np.empty((count, length, nodes.shape[1]))
        y = np.empty((count, length, data.z.shape[2]))
        end = np.empty_like(nodes)
        for first in range(0, count, self._group):
            # the size of a batch is fixed: the last one is filled up with the last segment
            own = np.minimum(np.arange(first, first + self._group), count - 1)
            repeated = np.repeat(parameters[own], length, axis=0)
            after = simulate(nodes[own], data.u0[own], data.u1[own], data.dt[own], repeated)[0]
            after = after.reshape(len(own), *states.shape[1:])
            states[own, 0] = nodes[own]
            states[own, 1:] = after[:, :-1]
            end[own] = after[:, -1]
            y[own] = outputs(states[own], data.u0[own], repeated)[0].reshape(len(own), *y.shape[1:])
        self._offer.spent += time.perf_counter() - begin
        return Trajectory(states=states, y=y, arrived=end, end=self._jumps.end(end, parameters))

    def blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        """Linearised along a trajectory; weights (patterns, o, o): the lower triangle that whitens the residuals of
        each pattern of present samples, zero in the rows and columns of what is missing."""
        kernel = self.kernel
        if kernel is not None:
            nodes = trajectory.states[:, 0]
            packed = self._packed_for(kernel)
            blocks = kernel.linearise(packed, nodes, parameters, weights, self.intensity)
        else:
            begin = time.perf_counter()
            blocks = self._mapped_blocks(trajectory, parameters, weights)
            self._offer.spent += time.perf_counter() - begin
        return self._jumps.blocks(blocks, trajectory.arrived, parameters)

    def slabs(
        self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray, segments: slice
    ) -> Iterator[Slab]:
        """The rows of some segments in the order of time. Arguments as of `blocks`."""
        kernel = self.kernel
        if kernel is None:
            for slab, _, _ in self._mapped_slabs(trajectory, parameters, weights, segments):
                yield slab
            return
        packed = self._packed_for(kernel)
        lanes = kernel.lanes
        before = np.empty(0)
        for own, samples in _plan(segments, self.shape[1], lanes):
            blocks = slice(own.start // lanes, -(-own.stop // lanes))
            covered = slice(blocks.start * lanes, min(blocks.stop * lanes, self.shape[0]))
            found = kernel.linearise(
                packed.part(blocks, samples.start, samples.stop),
                trajectory.states[covered, samples.start],
                parameters[covered],
                weights,
                self.intensity,
                rows=True,
            )
            inner = slice(own.start - covered.start, own.stop - covered.start)
            assert found.rows is not None
            rows = found.rows[inner]
            after = found.transition[inner]
            if samples.start > 0:
                rows = _chained(rows, before[:, None])
                after = _chained(after, before)
            before = after
            yield Slab(segments=own, samples=samples, rows=rows)

    def watching(self, names: tuple[str, ...]) -> Shooting:
        """The same motion with the named states and outputs as its outputs."""
        model, layout = watched(self._model, self.layout, names)
        return Shooting(model, self._free, layout, {}, self._feedback)

    def symbolic(self, at: ProblemSymbols) -> Simulated:
        """The simulation as expressions. Raises EstimationError for a control law in the loop."""
        if self._feedback is not None:
            raise EstimationError(
                "solve: a digital control law in the loop jumps at the samples, which a nonlinear programme does not "
                "represent; use GaussNewton()"
            )
        found = shot(self._model, self._free, self.layout, at)
        if self._model.period is not None or self._jumps:
            return replace(found, end=self._jumps.symbolic(found.end, at))
        count, length = self.shape
        return replace(found, derivatives=shot_derivatives(self._model, self._free, length, count))

    def _packed_for(self, kernel: Kernel) -> Packed:
        """The data in the kernel's order."""
        if self._packed is None:
            self._packed = pack(self.layout, kernel.sizes, kernel.lanes)
        return self._packed

    def _mapped_blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        data, (count, _) = self.layout, self.shape
        n = trajectory.end.shape[1]
        o = data.z.shape[2]
        nf = n + len(self._free)
        hessian = np.zeros((count, nf, nf))
        channel_gradient = np.zeros((count, o, nf))
        transition = np.empty((count, n, nf))
        covariance = np.empty((count, n, n)) if len(self.intensity) else None
        for slab, after, spread in self._mapped_slabs(trajectory, parameters, weights, slice(0, count)):
            at = slab.segments, slab.samples
            residual = whitened(trajectory.y[at] - data.z[at], weights, data.pattern[at])
            channel_gradient[slab.segments] += np.einsum("klof,klo->kof", slab.rows, residual)
            flat = slab.rows.reshape(len(slab.rows), -1, nf)
            hessian[slab.segments] += flat.transpose(0, 2, 1) @ flat
            transition[slab.segments] = after
            if covariance is not None:
                covariance[slab.segments] = spread
        return Blocks(
            hessian=hessian,
            channel_gradient=channel_gradient,
            gradient=channel_gradient.sum(axis=1),
            transition=transition,
            end=trajectory.arrived,
            covariance=covariance,
        )

    def _mapped_slabs(
        self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray, segments: slice
    ) -> Iterator[tuple[Slab, np.ndarray, np.ndarray]]:
        """Each slab, the sensitivity (k, n, n+f) of the state after it, and the covariance (k, n, n) it has then."""
        n = trajectory.end.shape[1]
        for own, samples in _plan(segments, self.shape[1], 1):
            at = (own, samples)
            size = own.stop - own.start
            if samples.start == 0:
                s = np.tile(np.eye(n, n + len(self._free)), (size, 1, 1))
                spread = np.zeros((size, n, n))
            a, b, g, c, d = self._derivatives(trajectory, parameters, own, samples)
            states = np.empty((size, samples.stop - samples.start, *s.shape[1:]))
            for i in range(states.shape[1]):
                states[:, i] = s
                s = a[:, i] @ s
                s[..., n:] += b[:, i]
                if len(self.intensity):
                    # noise of intensity sigma, held over dt, has the standard deviation sigma/sqrt(dt)
                    dt = np.maximum(self.layout.dt[own, samples.start + i], 1e-12)
                    gain = g[:, i] * (self.intensity / np.sqrt(dt)[:, None])[:, None, :]
                    spread = a[:, i] @ spread @ a[:, i].transpose(0, 2, 1) + gain @ gain.transpose(0, 2, 1)
            rows = c @ states
            rows[..., n:] += d
            yield Slab(segments=own, samples=samples, rows=whitened(rows, weights, self.layout.pattern[at])), s, spread

    def _derivatives(
        self, trajectory: Trajectory, parameters: np.ndarray, segments: slice, samples: slice
    ) -> list[np.ndarray]:
        """(k, l, rows, columns) of A, B, G, C, D."""
        data = self.layout
        at = (segments, samples)
        k, length = data.dt[at].shape
        batch = self._mapped[2]
        given = [trajectory.states[at], data.u0[at], data.u1[at], data.dt[at][..., None]]
        flat = [v.reshape(k * length, -1) for v in given] + [np.repeat(parameters[segments], length, axis=0)]
        total = min(data.dt.size, _SLAB_SAMPLES)  # the size of a batch is fixed
        raw = batch(*(np.concatenate([v, np.repeat(v[-1:], total - k * length, axis=0)]) for v in flat))
        n = trajectory.end.shape[1]
        o = data.z.shape[2]
        heights = (n, n, n, o, o)
        parts = (r.reshape(total, rows, r.shape[1])[: k * length] for r, rows in zip(raw, heights, strict=True))
        return [p.reshape(k, length, *p.shape[1:]) for p in parts]


def _plan(segments: slice, length: int, lanes: int) -> Iterator[tuple[slice, slice]]:
    """Groups of segments, or spans of samples of one segment after the other, in the order of time and of bounded size;
    a group ends where a block of `lanes` segments does."""
    group = max(_SLAB_SAMPLES // (lanes * length), 1) * lanes if length <= _SLAB_SAMPLES else 1
    first = segments.start
    while first < segments.stop:
        last = min((first // group + 1) * group, segments.stop)
        for begin in range(0, length, _SLAB_SAMPLES):
            yield slice(first, last), slice(begin, min(begin + _SLAB_SAMPLES, length))
        first = last


def _chained(later: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Derivatives in (start, parameters) from those in (a state on the way, parameters)."""
    n = before.shape[-2]
    found = later[..., :n] @ before
    found[..., n:] += later[..., n:]
    return found
