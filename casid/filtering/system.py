"""The linearised system behind filter error: innovations, their sensitivities, and the slope of the determinant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.transcriptions.steps import sample_derivatives
from casid.filtering.innovations import Batch, Linear, NoiseModel, PointFunctions, linearise, padded
from casid.filtering.kalman import Filter, kalman_filter, residual_column
from casid.model.built import cached
from casid.native.compiler import Compilable

_PARTS = 8  # parameters whose perturbed filters run side by side
_PERTURBATION = 1e-3  # of the standard error of a parameter when the others are known


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterSystem:
    """Data that stay the same over the iterations of a filter-error estimation."""

    problem: Problem
    batch: Batch
    functions: PointFunctions
    correlation_time: Mapping[str, float]  # disturbance -> correlation time [s] of its process noise, 0: white
    measurement: Mapping[str, float] | None  # given measurement noise, or None: unknown

    @cached_property
    def initial_sizes(self) -> dict[str, float]:
        """State -> its largest magnitude in the records."""
        return dict(zip(self.problem.model.states, self.problem.guessed_size.tolist(), strict=True))

    @property
    def measured(self) -> np.ndarray:
        """(N, R, nx) trajectory from the measurements."""
        return padded([self.problem.model.guess(record) for record in self.problem.records])

    def noise(self, log_sigma: np.ndarray) -> NoiseModel:
        """The noise model of a vector of unknowns: measurement (when not given), then process noise."""
        sigma = np.exp(log_sigma)
        tau = self.correlation_time
        outputs = self.problem.model.outputs
        count = 0 if self.measurement is not None else len(outputs)
        measurement = self.measurement or dict(zip(outputs, sigma[:count].tolist(), strict=True))
        process = dict(zip(sorted(tau, key=lambda n: tau[n] > 0.0), sigma[count:].tolist(), strict=True))
        return NoiseModel(
            measurement=measurement,
            white={n: s for n, s in process.items() if not tau[n]},
            coloured={n: (s, tau[n]) for n, s in process.items() if tau[n]},
            initial=self.initial_sizes,
        )

    def linearise(self, theta: np.ndarray, X: np.ndarray) -> Linear:
        """Linearised about X (N, R, nx), with the exact derivatives of the Runge-Kutta step: at low sampling rates
        those of second order in dt shift an optimum by a standard error."""
        P = self.problem.model_parameters(theta)
        return self._exact(linearise(self.functions, self.batch, P, X), self.batch, P)

    def _exact(self, linear: Linear, batch: Batch, P: np.ndarray) -> Linear:
        model = linear.model
        names = tuple(self.correlation_time)
        index = np.array([model.parameters.index(n) for n in self.functions.free], dtype=int)
        key = ("compiled derivatives", tuple(index), names)
        kernel = cached(model, key, lambda: Compilable(sample_derivatives(model, index, names)))
        steps, records, n = linear.defect.shape
        beginning, following = batch.ends(batch.U)
        values = np.broadcast_to(P, (steps, *P.shape))
        found = kernel.mapped(steps * records)(linear.X[:-1], beginning, following, batch.dt, values)
        a, b, g = (found[i].reshape(steps, records, n, -1).copy() for i in range(3))
        inside = batch.live[1:, :, None, None]
        stations = [model.disturbances.index(name) for name in names]
        Bw0 = linear.Bw0.copy()
        Bw0[..., stations] = np.where(inside, g, 0.0) - linear.Bw1[..., stations]
        return replace(linear, A=np.where(inside, a, np.eye(n)), Bp=np.where(inside, b, 0.0), Bw0=Bw0)

    def columns(self, linear: Linear) -> tuple[np.ndarray, np.ndarray]:
        """(Y, F) of the unknown parameters: shared ones act in all records, a per-record one in its own."""
        N, R, ny, _ = linear.Dp.shape
        count = len(self.problem.parameters)
        Y = np.zeros((N, R, ny, count))
        F = np.zeros((N - 1, R, linear.Bp.shape[2], count))
        for r in range(R):
            Y[:, r][..., self.problem.columns(r)] = linear.Dp[:, r]
            F[:, r][..., self.problem.columns(r)] = linear.Bp[:, r]
        return Y, F

    def covariance_slope(self, theta: np.ndarray, linear: Linear, noise: NoiseModel) -> np.ndarray:
        """(parameters,) slope of -2 ln L through the covariance of the innovations, by differences along each
        parameter. Without it the estimate is that of highest joint density with the noise history, off by over a
        standard error in turbulence."""
        residual = residual_column(linear)
        columns = self.columns(linear)
        Y, F = (np.concatenate(pair, axis=3) for pair in zip(residual, columns, strict=True))
        white = kalman_filter(linear, noise).whiten(Y, F)
        curvature = np.einsum("krij,krij->j", white[..., 1:], white[..., 1:])
        steps = _PERTURBATION / np.sqrt(np.maximum(curvature, 1e-300))
        slope = 2.0 * np.einsum("krij,kri->j", white[..., 1:], white[..., 0]) - steps * curvature
        for first in range(0, len(theta), _PARTS):
            chosen = np.arange(first, min(first + _PARTS, len(theta)))
            shifted = [theta, *(theta + steps[i] * np.eye(len(theta))[i] for i in chosen)]
            P = np.concatenate([self.problem.model_parameters(one) for one in shifted])
            many = _tiled(self.batch, len(shifted))
            repeated = np.tile(linear.X, (1, len(shifted), 1))
            moved = self._exact(linearise(self.functions, many, P, repeated), many, P)
            kalman = kalman_filter(moved, noise)
            squares = (kalman.whiten(*residual_column(moved)) ** 2).sum(axis=(0, 2, 3))
            deviance = (kalman.log_determinant.sum(axis=0) + squares).reshape(len(shifted), -1).sum(axis=1)
            slope[chosen] += (deviance[1:] - deviance[0]) / steps[chosen]
        return slope


def _tiled(batch: Batch, count: int) -> Batch:
    """The records of a batch several times over, side by side."""
    arrays = {name: np.concatenate([getattr(batch, name)] * count, axis=1) for name in ("t", "dt", "U", "Z", "live")}
    return replace(batch, names=batch.names * count, held=np.tile(batch.held, (count, 1)), **arrays)


@dataclass(frozen=True, eq=False, kw_only=True)
class Step:
    """A linearised system under a noise model and the Newton step from it."""

    linear: Linear
    filter: Filter
    left: np.ndarray
    change: np.ndarray  # (parameters,) to the optimum of the linearised system; `left` (N, R, ny) innovations there
    information: np.ndarray  # (parameters, parameters) priors included; covariance its inverse
    covariance: np.ndarray
    # -2 ln L up to a constant, priors included; `expected` what the linearised system promises at the optimum
    deviance: float
    expected: float


def evaluate_step(
    system: FilterSystem, theta: np.ndarray, linear: Linear, noise: NoiseModel, slope: np.ndarray, held: bool = False
) -> Step:
    """The step from theta; `slope` (parameters,) through the covariance, zero while far away. With `held` parameters
    the step is zero."""
    kalman = kalman_filter(linear, noise)
    residual = residual_column(linear)
    columns = system.columns(linear)
    Y, F = (np.concatenate(pair, axis=3) for pair in zip(residual, columns, strict=True))
    white = kalman.whiten(Y, F)
    J = white[..., 1:].reshape(-1, len(theta))
    v = white[..., 0].reshape(-1)
    weight = 1.0 / system.problem.prior_std**2
    off = theta - system.problem.nominal
    information = J.T @ J + np.diag(weight)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information * scale[:, None] * scale, rcond=1e-13, hermitian=True)
    covariance = inverse * scale[:, None] * scale
    change = np.zeros(len(theta)) if held else covariance @ (J.T @ v - weight * off - 0.5 * slope)
    left = (v - J @ change).reshape(white.shape[:3])
    determinant = float(kalman.log_determinant.sum())
    return Step(
        linear=linear,
        filter=kalman,
        left=left,
        change=change,
        information=information,
        covariance=covariance,
        deviance=float(v @ v) + float(weight @ off**2) + determinant,
        expected=float(np.sum(left**2) + weight @ (off + change) ** 2 + slope @ change) + determinant,
    )


def trajectory_step(system: FilterSystem, step: Step) -> tuple[np.ndarray, np.ndarray]:
    """(N, R, nx) each: change of the trajectory to the most likely one, and what the change of the parameters adds."""
    nx = step.linear.X.shape[2]
    Y, F = (columns @ -step.change[:, None] for columns in system.columns(step.linear))
    alone = step.filter.smooth(*residual_column(step.linear))[0][..., :nx]
    return alone, step.filter.smooth(Y, F)[0][..., :nx]
