"""Linearise all samples of all segments: the hot path of Gauss-Newton shooting, behind one narrow interface.

Sizes: K segments, L samples each, n states, f free parameters (of the segment's record), o outputs.
`Shooting.trajectory` simulates; `Shooting.blocks` returns per segment the Gram matrix and gradient of the weighted
output residuals in (start state, free parameters) and the sensitivity of the end state. Both run in the compiled
kernel of the model when there is one, else on CasADi's mapped functions, with the same result to rounding.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from casid.estimation.compiler import Batch, Compilable
from casid.estimation.feedback import SampledFeedback
from casid.estimation.kernel import Kernel, KernelOffer, Packed
from casid.estimation.layout import Layout
from casid.estimation.steps import cached, output_function, sample_derivatives, stage_functions, step_function
from casid.model.system import Model


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Simulated from nodes: states (K, L, n) and outputs y (K, L, o) at the samples, end (K, n) state after the last
    step, squares (K, o) sums of squared residuals where they were gathered on the way; `points`, `gap` are only those
    of collocation: (K, d, n) interior states and what they leave unsatisfied."""

    states: np.ndarray
    y: np.ndarray
    end: np.ndarray
    squares: np.ndarray | None = None
    points: np.ndarray | None = None
    gap: np.ndarray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Blocks:
    """Of each segment:

    rows              gives `jacobian` (K, L*o, n+f) of the weighted outputs in (start state, parameters)
    hessian           (K, n+f, n+f) of 1/2 sum (weighted residual)^2
    channel_gradient  (K, o, n+f) of the same for each output; gradient (K, n+f) is its sum
    a, b, end         the end state (K, n) and its derivatives (K, n, n), (K, n, f)
    covariance        (K, n, n) that process noise adds to the end state; None without
    lift              how interior states follow, only of collocation
    """

    rows: Callable[[], np.ndarray]
    hessian: np.ndarray
    channel_gradient: np.ndarray
    gradient: np.ndarray
    a: np.ndarray
    b: np.ndarray
    end: np.ndarray
    covariance: np.ndarray | None
    lift: Lift | None = None

    @cached_property
    def jacobian(self) -> np.ndarray:
        """(K, L*o, n+f); only the uncertainty needs it, an iteration does not."""
        return self.rows()


class Lift(Protocol):
    """How the interior states of collocation follow a step."""

    def points(self, nodes: np.ndarray, local: np.ndarray, n: int) -> np.ndarray: ...
    def price(self, tied: np.ndarray, multipliers: np.ndarray, scale: np.ndarray) -> float: ...


class Shooting:
    """Simulation and linearisation of a layout's segments by Runge-Kutta steps.

    noise      name -> intensity of process noise (see MultipleShooting), empty without
    feedback   control law in the loop, None without
    """

    points0 = None

    def __init__(
        self, model: Model, free: np.ndarray, layout: Layout, noise: dict[str, float],
        feedback: SampledFeedback | None = None,
    ) -> None:  # fmt: skip
        self.layout, self._model, self._free, self._feedback = layout, model, free, feedback
        self.shape = (layout.segments, layout.length)
        self.noise_names = tuple(noise)
        self.intensity = np.array(list(noise.values()))
        self._packed: Packed | None = None
        key = (tuple(free), self.noise_names, feedback)
        self._offer = cached(
            model, ("kernel", *key),
            lambda: KernelOffer(
                model.name, lambda: stage_functions(model, free, self.noise_names, feedback), len(self.noise_names)
            ),
        )  # fmt: skip

    @cached_property
    def _mapped(self) -> tuple[Batch, Batch, Batch]:
        """Simulation, outputs, derivatives over all samples, by CasADi."""
        model, feedback = self._model, self._feedback
        count, length = self.shape
        step = cached(model, ("compiled step", feedback), lambda: Compilable(step_function(model, feedback)))
        outputs = cached(model, ("compiled outputs",), lambda: Compilable(output_function(model)))
        key = ("compiled derivatives", tuple(self._free), self.noise_names, feedback)
        derivatives = cached(
            model, key, lambda: Compilable(sample_derivatives(model, self._free, self.noise_names, feedback))
        )
        simulate = step.batch(("simulate", length, count), lambda f: f.mapaccum("simulate", length).map(count))
        return simulate, outputs.mapped(count * length), derivatives.mapped(count * length)

    @property
    def kernel(self) -> Kernel | None:
        """The compiled kernel when there is one now."""
        return self._offer.get()

    def trajectory(self, nodes: np.ndarray, parameters: np.ndarray, points: np.ndarray | None = None) -> Trajectory:
        """nodes (K, n), parameters (K, model parameters)."""
        kernel = self.kernel
        if kernel is not None:
            states, y, end, squares = kernel.simulate(self._packed_for(kernel), nodes, parameters)
            return Trajectory(states=states, y=y, end=end, squares=squares)
        begin, data = time.perf_counter(), self.layout
        simulate, outputs, _ = self._mapped
        repeated = np.repeat(parameters, data.length, axis=0)
        after = simulate(nodes, data.u0, data.u1, data.dt, repeated)[0].reshape(*self.shape, -1)
        states = np.concatenate([nodes[:, None], after[:, :-1]], axis=1)
        y = outputs(states, data.u0, repeated)[0].reshape(*self.shape, -1)
        self._offer.spent += time.perf_counter() - begin
        return Trajectory(states=states, y=y.copy(), end=after[:, -1].copy())

    def blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        """Linearised along a trajectory; weights (o,) per output."""
        kernel = self.kernel
        if kernel is not None:
            return self._kernel_blocks(kernel, trajectory, parameters, weights)
        begin = time.perf_counter()
        found = self._mapped_blocks(trajectory, parameters, weights)
        self._offer.spent += time.perf_counter() - begin
        return found

    def _kernel_blocks(
        self, kernel: Kernel, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray
    ) -> Blocks:
        nodes, n = trajectory.states[:, 0], trajectory.end.shape[1]
        packed = self._packed_for(kernel)
        hessian, channel_gradient, transition, end, covariance, _ = kernel.linearise(
            packed, nodes, parameters, weights, self.intensity
        )

        def rows() -> np.ndarray:
            jacobian = kernel.linearise(packed, nodes, parameters, weights, self.intensity, rows=True)[-1]
            return jacobian.reshape(len(nodes), -1, transition.shape[2])

        return Blocks(
            rows=rows, hessian=hessian, channel_gradient=channel_gradient, gradient=channel_gradient.sum(axis=1),
            a=transition[..., :n], b=transition[..., n:], end=end, covariance=covariance,
        )  # fmt: skip

    def _packed_for(self, kernel: Kernel) -> Packed:
        """The data in the kernel's order."""
        if self._packed is None:
            self._packed = kernel.pack(self.layout)
        return self._packed

    def _mapped_blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        data = self.layout
        count, length = self.shape
        n, repeated = trajectory.end.shape[1], np.repeat(parameters, length, axis=0)
        raw = self._mapped[2](trajectory.states, data.u0, data.u1, data.dt, repeated)
        f, v, o = raw[1].shape[1], len(self.intensity), data.z.shape[2]
        a, b, g, c, d = (
            r.reshape(count, length, rows, r.shape[1]) for r, rows in zip(raw, (n, n, n, o, o), strict=True)
        )
        s = np.zeros((length + 1, count, n, n + f))
        s[0, :, :, :n] = np.eye(n)
        covariance = np.zeros((count, n, n)) if v else None
        for i in range(length):
            np.matmul(a[:, i], s[i], out=s[i + 1])
            s[i + 1, :, :, n:] += b[:, i]
            if covariance is not None:
                # noise of intensity sigma, held over dt, has the standard deviation sigma/sqrt(dt)
                gain = g[:, i] * (self.intensity / np.sqrt(np.maximum(data.dt[:, i], 1e-12))[:, None])[:, None, :]
                covariance = a[:, i] @ covariance @ a[:, i].transpose(0, 2, 1) + gain @ gain.transpose(0, 2, 1)
        jacobian = c @ s[:-1].transpose(1, 0, 2, 3)
        jacobian[..., n:] += d
        jacobian *= (weights * data.present)[..., None]
        residual = weights * data.present * (trajectory.y - data.z)
        channel_gradient = np.einsum("klof,klo->kof", jacobian, residual)
        jacobian = jacobian.reshape(count, length * o, n + f)
        hessian = jacobian.transpose(0, 2, 1) @ jacobian
        last = s[length]
        return Blocks(
            rows=lambda: jacobian, hessian=hessian, channel_gradient=channel_gradient,
            gradient=channel_gradient.sum(axis=1), a=last[..., :n], b=last[..., n:],
            end=trajectory.end, covariance=covariance,
        )  # fmt: skip
