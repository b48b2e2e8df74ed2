"""Filter error: maximum likelihood with process noise, for any `Model`, noise variances estimated too.

The innovations of `innovations.kalman_filter` are white with unit variance at the truth, so that -2 ln L is their sum of
squares plus the log determinant of their covariance. Parameters and trajectory move by Gauss-Newton on the innovations;
the logarithms of all noise variances move by a quasi-Newton method on the likelihood of the linearised system, with the
parameters at their optimum for every variance, and with its exact gradient from one backward pass (Koopman and
Shephard, Biometrika 79, 1992). Without process noise it is output error with measurement noise by maximum likelihood.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from casid.errors import EstimationError, unknown
from casid.estimation.cost import OutputError, RangeWeights
from casid.estimation.innovations import (
    Batch,
    Filter,
    Linear,
    NoiseModel,
    PointFunctions,
    kalman_filter,
    linearise,
    make_batch,
    residual_column,
)
from casid.estimation.noise import pooled_sigma
from casid.estimation.noise_score import unit_variances, variance_score
from casid.estimation.problem import Problem

_SMALL_STEP = 1e-3  # of a standard error, and of a logarithm of a noise: converged
_NOISE_RANGE = 1e4  # a noise is sought within this factor of its first guess
_KICK = 0.02  # first guess of process noise: its kick per sample, in units of the state's scale
_FLAT = 0.05  # of the deviance
_NOISE_STEPS = 12  # quasi-Newton steps on the noise per relinearisation


@dataclass(frozen=True, eq=False, kw_only=True)
class Innovations:
    """One-step predictions of a model under a noise model, on records that it may never have seen.

    white           record -> (N, outputs) innovations over their standard deviation, 0 where not measured
    error           record -> (N, outputs) measured minus predicted from all samples before, NaN where not measured
    states          record -> (N, states) smoothed trajectory
    log_likelihood  of all measured samples, the initial state of every record free with a wide prior; `samples` their
                    number
    """

    white: Mapping[str, np.ndarray]
    error: Mapping[str, np.ndarray]
    states: Mapping[str, np.ndarray]
    log_likelihood: float
    samples: int

    @property
    def per_sample(self) -> float:
        """Log likelihood per measured sample."""
        return self.log_likelihood / self.samples


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterFit:
    """Result of `filter_error`; `covariance` (parameters, parameters) by Cramer-Rao at the noise found."""

    problem: Problem
    values: Mapping[str, float]
    std: Mapping[str, float]
    covariance: np.ndarray
    noise: NoiseModel
    innovations: Innovations
    status: str
    iterations: int
    seconds: float

    @property
    def converged(self) -> bool:
        """Whether neither parameters nor noise would move any more."""
        return self.status == "converged"

    @property
    def intensities(self) -> dict[str, float]:
        """White process noise as `MultipleShooting(process_noise=...)` takes it: sigma times sqrt(dt)."""
        root = math.sqrt(float(np.median([record.dt for record in self.problem.records])))
        return {name: sigma * root for name, sigma in self.noise.white.items()}


@dataclass(eq=False)
class _Work:
    """What stays the same over the iterations."""

    problem: Problem
    batch: Batch
    functions: PointFunctions
    correlation_time: Mapping[str, float]
    measurement: Mapping[str, float] | None

    def noise(self, log_sigma: np.ndarray) -> NoiseModel:
        """The noise model of a vector of unknowns: measurement (when not given), then process noise."""
        sigma = np.exp(log_sigma)
        outputs = self.problem.model.outputs
        count = 0 if self.measurement is not None else len(outputs)
        measurement = self.measurement or dict(zip(outputs, sigma[:count].tolist(), strict=True))
        process = dict(zip(self.correlation_time, sigma[count:].tolist(), strict=True))
        return NoiseModel(
            measurement=measurement,
            white={n: s for n, s in process.items() if not self.correlation_time[n]},
            coloured={n: (s, self.correlation_time[n]) for n, s in process.items() if self.correlation_time[n]},
        )

    def columns(self, linear: Linear) -> tuple[np.ndarray, np.ndarray]:
        """(Y, F) of the unknown parameters: shared ones act in all records, a per-record one in its own."""
        N, R, ny, _ = linear.Dp.shape
        count = len(self.problem.parameters)
        Y, F = np.zeros((N, R, ny, count)), np.zeros((N - 1, R, linear.Bp.shape[2], count))
        for r in range(R):
            Y[:, r][..., self.problem.columns(r)] = linear.Dp[:, r]
            F[:, r][..., self.problem.columns(r)] = linear.Bp[:, r]
        return Y, F


@dataclass(frozen=True, eq=False, kw_only=True)
class _Point:
    """A linearised system under a noise model, with the parameters at their optimum of the linearised system."""

    linear: Linear
    filter: Filter
    left: np.ndarray
    change: np.ndarray
    covariance: np.ndarray
    deviance: float
    profiled: float


def filter_error(problem: Problem, process_noise: Mapping[str, float], *, iterations: int = 40) -> FilterFit:
    """Estimate parameters, measurement noise and process noise together.

    problem        its `noise` is the measurement noise; None: estimated. Initial states are free with a wide prior
    process_noise  disturbance of the model -> correlation time [s] of the Gauss-Markov process that drives it; 0: white
                   from sample to sample. The standard deviations are estimated

    Raises InputError for a name that is no disturbance; EstimationError for what this method does not do: costs other
    than OutputError, range weights, constraints, a prior of the initial state. A course of iteration that goes wrong is
    not an error: `FilterFit.status` says it.
    """
    begin = time.perf_counter()
    work = _prepare(problem, process_noise)
    theta, X = problem.start_vector, _guess(problem, work.batch)
    linear = _linearise(work, theta, X)
    log_sigma = _first_noise(work, linear)
    status, count = f"gave up after {iterations} iterations", 0
    for count in range(1, iterations + 1):
        before = log_sigma
        log_sigma = _best_noise(work, theta, linear, log_sigma)
        noise = work.noise(log_sigma)
        now = _point(work, theta, linear, noise)
        taken = _search(work, theta, X, now, noise)
        if taken is None:
            status = "gave up: no step along the Gauss-Newton direction lowers the deviance"
            break
        theta, X, linear, length = taken
        std = np.sqrt(np.diag(now.covariance))
        moved = max(np.abs(now.change / std).max(initial=0.0), np.abs(log_sigma - before).max(initial=0.0))
        if length == 1.0 and moved < _SMALL_STEP:
            status = "converged"
            break
    now = _point(work, theta, linear, work.noise(log_sigma))
    std = np.sqrt(np.diag(now.covariance))
    return FilterFit(
        problem=problem, values=dict(zip(problem.parameters, theta.tolist(), strict=True)),
        std=dict(zip(problem.parameters, std.tolist(), strict=True)), covariance=now.covariance,
        noise=work.noise(log_sigma), innovations=_innovations(work, now.linear, now.filter),
        status=status, iterations=count, seconds=time.perf_counter() - begin,
    )  # fmt: skip


def predict(problem: Problem, values: Mapping[str, float], noise: NoiseModel, relinearisations: int = 4) -> Innovations:
    """One-step predictions of the problem's records with its parameters at `values` and nothing estimated but states.

    Raises InputError when a value is missing or unknown.
    """
    for name in problem.parameters:
        if name not in values and name.split("[")[0] not in values:
            raise unknown("value", name, values, "predict")
    theta = np.array([values.get(name, values.get(name.split("[")[0], 0.0)) for name in problem.parameters])
    work = _Work(problem, make_batch(problem.model, problem.records), PointFunctions(problem.model, ()), {}, None)
    X = _guess(problem, work.batch)
    for _ in range(relinearisations):
        linear = _linearise(work, theta, X)
        X = X + kalman_filter(linear, noise).smooth(*residual_column(linear))[..., : X.shape[2]]
    linear = _linearise(work, theta, X)
    return _innovations(work, linear, kalman_filter(linear, noise))


def _prepare(problem: Problem, process_noise: Mapping[str, float]) -> _Work:
    model = problem.model
    if not isinstance(problem.cost, OutputError) or isinstance(problem.noise, RangeWeights) or problem.constraints:
        raise EstimationError("filter_error: takes OutputError, noise by maximum likelihood or given, no constraints")
    if problem.initial_state.value or problem.initial_state.std:
        raise EstimationError("filter_error: initial states are free with a wide prior; leave initial_state out")
    if not model.disturbances:
        raise EstimationError(f"filter_error: model '{model.name}' has no disturbance that process noise could drive")
    for name, tau in process_noise.items():
        if name not in model.disturbances:
            raise unknown("disturbance", name, model.disturbances, "filter_error: process_noise")
        if not (tau >= 0.0 and math.isfinite(tau)):
            raise EstimationError(f"filter_error: correlation time of '{name}' is {tau} s; expected 0 (white) or more")
    measurement = dict(problem.noise) if isinstance(problem.noise, Mapping) else None
    batch = make_batch(model, problem.records)
    unseen = [o for i, o in enumerate(model.outputs) if not np.isfinite(batch.Z[..., i]).any()]
    if unseen:
        raise EstimationError(f"filter_error: no record has a sample of {', '.join(unseen)}; leave it out of the model")
    functions = PointFunctions(model, problem.shared + problem.local)
    return _Work(problem, batch, functions, dict(process_noise), measurement)


def _guess(problem: Problem, batch: Batch) -> np.ndarray:
    X = np.zeros((*batch.live.shape, len(problem.model.states)))
    for j, record in enumerate(problem.records):
        guess = problem.model.guess(record)
        X[: len(record), j], X[len(record) :, j] = guess, guess[-1]
    return X


def _linearise(work: _Work, theta: np.ndarray, X: np.ndarray) -> Linear:
    return linearise(work.functions, work.batch, work.problem.model_parameters(theta), X)


def _first_noise(work: _Work, linear: Linear) -> np.ndarray:
    """Logarithms of a first guess: high band of the outputs, a small kick per sample for process noise."""
    model, batch = work.problem.model, work.batch
    guess = []
    if work.measurement is None:
        for i in range(len(model.outputs)):
            series = [batch.Z[:, r, i] for r in range(batch.Z.shape[1])]
            spread = float(np.nanstd(batch.Z[..., i]))
            high = pooled_sigma(series)
            guess.append(max(high if math.isfinite(high) else 0.0, 1e-2 * spread, 1e-12))
    scale = model.scale_vector()
    for name in work.correlation_time:
        w = model.disturbances.index(name)
        kick = np.abs(linear.Bw0[..., w] + linear.Bw1[..., w]) / scale
        size = float(np.median(kick[batch.live[1:]].max(axis=1)))
        guess.append(_KICK / size if size > 0.0 else 1.0)
    return np.log(guess)


def _best_noise(work: _Work, theta: np.ndarray, linear: Linear, log_sigma: np.ndarray) -> np.ndarray:
    """Noise of highest likelihood for the linearised system, parameters re-estimated for every trial."""
    if not len(log_sigma):
        return log_sigma
    units = unit_variances(linear, work.noise(log_sigma), work.measurement is None)

    def cost(trial: np.ndarray) -> tuple[float, np.ndarray]:
        now = _point(work, theta, linear, work.noise(trial))
        slope = variance_score(now.filter, now.left, units)
        return 0.5 * now.profiled, slope * np.exp(2.0 * trial)

    reach = math.log(_NOISE_RANGE)
    found = minimize(
        cost, log_sigma, jac=True, method="L-BFGS-B", options={"maxiter": _NOISE_STEPS, "ftol": 1e-10},
        bounds=[(value - reach, value + reach) for value in log_sigma],
    )  # fmt: skip
    return np.asarray(found.x)


def _point(work: _Work, theta: np.ndarray, linear: Linear, noise: NoiseModel) -> _Point:
    kalman = kalman_filter(linear, noise)
    residual, columns = residual_column(linear), work.columns(linear)
    Y, F = (np.concatenate(pair, axis=3) for pair in zip(residual, columns, strict=True))
    white = kalman.whiten(Y, F)
    J, v = white[..., 1:].reshape(-1, len(theta)), white[..., 0].reshape(-1)
    weight = 1.0 / work.problem.prior_std**2
    off = theta - work.problem.nominal
    information = J.T @ J + np.diag(weight)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information * scale[:, None] * scale, rcond=1e-13, hermitian=True)
    covariance = inverse * scale[:, None] * scale
    change = covariance @ (J.T @ v - weight * off)
    left = (v - J @ change).reshape(white.shape[:3])
    determinant = float(kalman.log_determinant.sum())
    return _Point(
        linear=linear, filter=kalman, left=left, change=change, covariance=covariance,
        deviance=float(v @ v) + float(weight @ off**2) + determinant,
        profiled=float(np.sum(left**2)) + float(weight @ (off + change) ** 2) + determinant,
    )  # fmt: skip


def _search(
    work: _Work, theta: np.ndarray, X: np.ndarray, now: _Point, noise: NoiseModel
) -> tuple[np.ndarray, np.ndarray, Linear, float] | None:
    """The longest step along the Gauss-Newton direction that lowers the deviance; None when there is none."""
    Y, F = residual_column(now.linear)
    by_parameter = work.columns(now.linear)
    Y, F = Y - by_parameter[0] @ now.change[:, None], F - by_parameter[1] @ now.change[:, None]
    direction = now.filter.smooth(Y, F)[..., : X.shape[2]]
    length = 1.0
    while length > 1e-3:
        trial = theta + length * now.change, X + length * direction
        linear = _linearise(work, *trial)
        if np.isfinite(linear.residual).all() and np.isfinite(linear.defect).all():
            # the trajectory alone may move the linearised likelihood by rounding and curvature: a part of a nat is no loss
            if _point(work, trial[0], linear, noise).deviance < now.deviance + _FLAT:
                return *trial, linear, length
        length *= 0.4
    return None


def _innovations(work: _Work, linear: Linear, kalman: Filter) -> Innovations:
    batch = work.batch
    white = kalman.whiten(*residual_column(linear))
    error = np.linalg.solve(kalman.inverse_root, white)[..., 0]
    X = linear.X + kalman.smooth(*residual_column(linear))[..., : linear.X.shape[2]]
    samples = int(linear.seen.sum())
    deviance = float(np.sum(white**2) + kalman.log_determinant.sum())
    parts = {record.name: (j, len(record)) for j, record in enumerate(work.problem.records)}
    return Innovations(
        white={name: white[:n, j, :, 0] for name, (j, n) in parts.items()},
        error={name: np.where(linear.seen, error, np.nan)[:n, j] for name, (j, n) in parts.items()},
        states={name: X[:n, j] for name, (j, n) in parts.items()},
        log_likelihood=-0.5 * (deviance + samples * math.log(2.0 * math.pi)), samples=samples,
    )  # fmt: skip
