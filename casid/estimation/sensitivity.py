"""Linearise all samples of all segments: the hot path of Gauss-Newton shooting, behind one narrow interface.

Sizes: K segments, L samples each, n states, f free parameters (of the segment's record), o outputs.
`Shooting.trajectory` simulates; `Shooting.blocks` returns per segment the Gram matrix and gradient of the weighted
output residuals in (start state, free parameters) and the sensitivity of the end state. A faster kernel replaces
this module and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from casid.estimation.compiler import Compilable
from casid.estimation.feedback import SampledFeedback
from casid.estimation.layout import Layout
from casid.estimation.steps import cached, output_function, sample_derivatives, step_function
from casid.model.system import Model


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Simulated from nodes: states (K, L, n) and outputs y (K, L, o) at the samples, end (K, n) state after the last
    step; `points`, `gap` are only those of collocation: (K, d, n) interior states and what they leave unsatisfied."""

    states: np.ndarray
    y: np.ndarray
    end: np.ndarray
    points: np.ndarray | None = None
    gap: np.ndarray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Blocks:
    """Of each segment:

    jacobian          (K, L*o, n+f) of the weighted outputs in (start state, parameters)
    hessian           (K, n+f, n+f) of 1/2 sum (weighted residual)^2
    channel_gradient  (K, o, n+f) of the same for each output; gradient (K, n+f) is its sum
    a, b, end         the end state (K, n) and its derivatives (K, n, n), (K, n, f)
    covariance        (K, n, n) that process noise adds to the end state; None without
    lift              how interior states follow, only of collocation
    """

    jacobian: np.ndarray
    hessian: np.ndarray
    channel_gradient: np.ndarray
    gradient: np.ndarray
    a: np.ndarray
    b: np.ndarray
    end: np.ndarray
    covariance: np.ndarray | None
    lift: Lift | None = None


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
        self.layout = layout
        count, length = layout.segments, layout.length
        self.shape = (count, length)
        self.noise_names = tuple(noise)
        self.intensity = np.array(list(noise.values()))
        step = cached(model, ("compiled step", feedback), lambda: Compilable(step_function(model, feedback)))
        outputs = cached(model, ("compiled outputs",), lambda: Compilable(output_function(model)))
        key = ("compiled derivatives", tuple(free), self.noise_names, feedback)
        derivatives = cached(
            model, key, lambda: Compilable(sample_derivatives(model, free, self.noise_names, feedback))
        )
        key = ("simulate", length, count)
        self._simulate = step.batch(key, lambda f: f.mapaccum("simulate", length).map(count))
        self._outputs = outputs.mapped(count * length)
        self._derivatives = derivatives.mapped(count * length)

    def trajectory(self, nodes: np.ndarray, parameters: np.ndarray, points: np.ndarray | None = None) -> Trajectory:
        """nodes (K, n), parameters (K, model parameters)."""
        data = self.layout
        repeated = np.repeat(parameters, data.length, axis=0)
        after = self._simulate(nodes, data.u0, data.u1, data.dt, repeated)[0].reshape(*self.shape, -1)
        states = np.concatenate([nodes[:, None], after[:, :-1]], axis=1)
        y = self._outputs(states, data.u0, repeated)[0].reshape(*self.shape, -1)
        return Trajectory(states=states, y=y.copy(), end=after[:, -1].copy())

    def blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        """Linearised along a trajectory; weights (o,) per output."""
        data = self.layout
        count, length = self.shape
        n, repeated = trajectory.end.shape[1], np.repeat(parameters, length, axis=0)
        raw = self._derivatives(trajectory.states, data.u0, data.u1, data.dt, repeated)
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
            jacobian=jacobian, hessian=hessian, channel_gradient=channel_gradient,
            gradient=channel_gradient.sum(axis=1), a=last[..., :n], b=last[..., n:],
            end=trajectory.end, covariance=covariance,
        )  # fmt: skip
