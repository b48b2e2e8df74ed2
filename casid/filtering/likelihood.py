"""Likelihood of the innovations of a Kalman filter, for any `Model` with process noise, and noise levels that follow.

The innovations of `innovations.kalman_filter` are white with unit variance at the truth, so that -2 ln L is their sum
of squares plus the log determinant of their covariance. Parameters and motion move by Gauss-Newton on the innovations.
The logarithms of all noise levels move by a quasi-Newton method on the likelihood of the linearised system, with the
parameters at their optimum for every level, and with its exact gradient (see `noise_score`). Without process noise it
is output error with measurement noise by maximum likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from casid.errors import EstimationError
from casid.estimation.fitted import StateHistory
from casid.estimation.problem import Problem
from casid.estimation.solvers.levels import NoiseLevels, noise_levels
from casid.estimation.solvers.own import LimitedStep, Told, Whitened
from casid.estimation.solvers.point import NoiseState
from casid.estimation.transcriptions.steps import sample_derivatives
from casid.filtering.innovations import Batch, Linear, NoiseModel, PointFunctions, linearise, make_batch, padded
from casid.filtering.kalman import Filter, kalman_filter, residual_column
from casid.filtering.noise_score import unit_variances, variance_score
from casid.model.built import cached
from casid.native.compiler import Compilable
from casid.records.noise import pooled_sigma

_PARTS = 8  # parameters whose perturbed filters run side by side
_PERTURBATION = 1e-3  # of the standard error of a parameter when the others are known
# factors a noise may be from its first guess, and from the last linearisation
_NOISE_RANGE = 1e4
_NOISE_REACH = 8.0
_TIMES = 4  # a trajectory is linearised anew before the parameters move
_KICK = 0.02  # first guess of process noise: its kick per sample, in units of the state's scale
_NOISE_STEPS = 12  # quasi-Newton steps on the noise per relinearisation
_HOPELESS = 1e12


@dataclass(frozen=True, eq=False, kw_only=True)
class Linearisation:
    """A model linearised about a motion with parameters theta, and the filter of it under a noise model."""

    theta: np.ndarray
    linear: Linear
    filter: Filter


class FilterLikelihood:
    """Innovations of a problem, with white (correlation time 0) or Gauss-Markov noise of disturbances.

    correlation_time   disturbance -> correlation time [s] of its process noise, 0: white from sample to sample
    sigma              disturbance -> 1-sigma of process noise that is given; that of all others is estimated
    """

    follows = True

    def __init__(self, problem: Problem, correlation_time: Mapping[str, float], sigma: Mapping[str, float]) -> None:
        self.problem = problem
        self.names = problem.model.outputs
        self.eliminated = len(problem.model.states) * len(problem.records)
        self.weight = 1.0 / problem.prior_std**2
        self.correlation_time = dict(sorted(correlation_time.items(), key=lambda pair: pair[1] > 0.0))
        self.batch = make_batch(problem.model, problem.records)
        self.functions = PointFunctions(problem.model, problem.shared + problem.local)
        unseen = [o for i, o in enumerate(self.names) if not np.isfinite(self.batch.Z[..., i]).any()]
        if unseen:
            raise EstimationError(
                f"FilterError: no record has a sample of {', '.join(unseen)}; leave it out of the model"
            )
        theta = problem.start_vector
        linear = self.linearise(theta, padded([problem.model.guess(record) for record in problem.records]))
        self.given = np.array([name in sigma for name in self.correlation_time], dtype=bool)
        self.levels = self._first_levels()
        kicks = [sigma[name] if name in sigma else self._kick(linear, name) for name in self.correlation_time]
        self.process = np.log(np.array(kicks, dtype=float))
        first = self._unknown(NoiseState(levels=self.levels, process=self.process))
        self.limits = first - math.log(_NOISE_RANGE), first + math.log(_NOISE_RANGE)
        self._begun = self._along_the_readings(theta, linear)

    # ---- noise

    def _first_levels(self) -> NoiseLevels:
        """Those that are given, or the high band of the outputs."""
        problem = self.problem
        given = problem.noise if isinstance(problem.noise, Mapping) else None
        known = None if given is None else {name: float(s) for name, s in given.items() if isinstance(s, int | float)}
        Z = self.batch.Z.reshape(-1, len(self.names))
        levels = noise_levels(known, self.names, Z, np.ones(len(self.names)))
        if known is not None:
            return levels
        high = [pooled_sigma([self.batch.Z[:, r, i] for r in range(self.batch.Z.shape[1])]) for i in range(Z.shape[1])]
        spread = np.nanstd(Z, axis=0)
        return replace(levels, sigma=np.maximum.reduce([np.nan_to_num(high), 1e-2 * spread, np.full(len(high), 1e-12)]))

    def _kick(self, linear: Linear, name: str) -> float:
        """First guess of process noise: a small kick per sample."""
        model = self.problem.model
        w = model.disturbances.index(name)
        kick = np.abs(linear.Bw0[..., w] + linear.Bw1[..., w]) / model.scale_vector()
        size = float(np.median(kick[self.batch.live[1:]].max(axis=1)))
        return _KICK / size if size > 0.0 else 1.0

    def _unknown(self, noise: NoiseState) -> np.ndarray:
        """Logarithms of the levels that are estimated, of channels before process noise."""
        channels = np.zeros(0) if noise.levels.fixed else np.log(noise.levels.sigma)
        return np.concatenate([channels, noise.process[~self.given]])

    def _with(self, noise: NoiseState, unknown: np.ndarray) -> NoiseState:
        """The noise with other levels of what is estimated."""
        count = 0 if noise.levels.fixed else len(self.names)
        process = noise.process.copy()
        process[~self.given] = unknown[count:]
        levels = replace(noise.levels, sigma=np.exp(unknown[:count])) if count else noise.levels
        return replace(noise, levels=levels, process=process)

    def noise_model(self, noise: NoiseState) -> NoiseModel:
        """Return what is random, as the filter takes it."""
        tau = self.correlation_time
        process = dict(zip(tau, np.exp(noise.process).tolist(), strict=True))
        sizes = zip(self.problem.model.states, self.problem.guessed_size.tolist(), strict=True)
        return NoiseModel(
            measurement=dict(zip(self.names, noise.levels.sigma.tolist(), strict=True)),
            white={name: sigma for name, sigma in process.items() if not tau[name]},
            coloured={name: (sigma, tau[name]) for name, sigma in process.items() if tau[name]},
            initial=dict(sizes),
        )

    def relaxed(self, at: Whitened, noise: NoiseState, step: LimitedStep | None) -> NoiseState:
        """Relax as `Following` does, for the linearised system."""
        here: Linearisation = at.kept
        begin = self._unknown(noise)
        if not len(begin):
            return noise
        units = unit_variances(here.linear, self.noise_model(noise), not noise.levels.fixed)
        estimated = np.concatenate([np.ones(len(units) - len(self.given), dtype=bool), ~self.given])
        units = [unit for unit, free in zip(units, estimated, strict=True) if free]
        columns = zip(residual_column(here.linear), self.columns(here.linear), strict=True)
        Y, F = (np.concatenate(pair, axis=3) for pair in columns)
        off = here.theta - self.problem.nominal

        def cost(trial: np.ndarray) -> tuple[float, np.ndarray]:
            try:
                kalman = kalman_filter(here.linear, self.noise_model(self._with(noise, trial)))
                white = kalman.whiten(Y, F)
                residual = -white[..., 0].reshape(-1)
                J = white[..., 1:].reshape(-1, len(off))
                change = np.zeros(len(off))
                if step is not None:
                    gradient = J.T @ residual + self.weight * off + 0.5 * at.slope
                    change = step(J.T @ J + np.diag(self.weight), gradient)
            except (
                np.linalg.LinAlgError
            ):  # so far from the data that the covariance is not positive definite in numbers
                return _HOPELESS, np.zeros(len(trial))
            left = residual + J @ change
            deviance = left @ left + self.weight @ (off + change) ** 2 + at.slope @ change
            score = variance_score(kalman, -left.reshape(white.shape[:3]), units)
            return 0.5 * float(deviance + kalman.log_determinant.sum()), score * np.exp(2.0 * trial)

        reach = math.log(_NOISE_REACH)
        low = np.maximum(self.limits[0], begin - reach)
        high = np.minimum(self.limits[1], begin + reach)
        found = scipy.optimize.minimize(
            cost,
            begin,
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": _NOISE_STEPS, "ftol": 1e-10},
            bounds=list(zip(low, high, strict=True)),
        )
        return self._with(noise, np.asarray(found.x))

    # ---- motion

    def motion(self, theta: np.ndarray) -> np.ndarray:
        """See `Following`."""
        return self._begun.reshape(-1, self._begun.shape[2])

    def _along_the_readings(self, theta: np.ndarray, linear: Linear) -> np.ndarray:
        """(N, R, nx) the most likely motion for the parameters theta. States that are not measured are guessed as zero;
        sensitivities along such a guess can make parameters collinear that are not. A motion that diverges is not
        taken."""
        noise = self.noise_model(NoiseState(levels=self.levels, process=self.process))
        for _ in range(_TIMES):
            X = linear.X + kalman_filter(linear, noise).smooth(*residual_column(linear))[0][..., : linear.X.shape[2]]
            found = self.linearise(theta, X)
            if not (np.isfinite(found.residual).all() and np.isfinite(found.defect).all()):
                break
            linear = found
        return linear.X

    def followed(self, at: Whitened, change: np.ndarray) -> np.ndarray:
        """Change of the motion to the most likely one, and what the change of the parameters adds."""
        here: Linearisation = at.kept
        nx = here.linear.X.shape[2]
        moved = here.filter.smooth(*residual_column(here.linear))[0][..., :nx]
        if len(change):
            Y, F = (columns @ -change[:, None] for columns in self.columns(here.linear))
            moved = moved + here.filter.smooth(Y, F)[0][..., :nx]
        return moved.reshape(-1, nx)

    # ---- likelihood

    def at(self, theta: np.ndarray, motion: np.ndarray, noise: NoiseState) -> Whitened:
        """See `Following`."""
        N, R = self.batch.live.shape
        return self._whitened(theta, self.linearise(theta, motion.reshape(N, R, -1)), noise, np.zeros(len(theta)))

    def again(self, at: Whitened, noise: NoiseState) -> Whitened:
        """See `Following`."""
        return self._whitened(at.kept.theta, at.kept.linear, noise, at.slope)

    def _whitened(self, theta: np.ndarray, linear: Linear, noise: NoiseState, slope: np.ndarray) -> Whitened:
        if not (np.isfinite(linear.residual).all() and np.isfinite(linear.defect).all()):
            raise np.linalg.LinAlgError("the motion departs")
        kalman = kalman_filter(linear, self.noise_model(noise))
        white = kalman.whiten(*residual_column(linear))
        error = np.where(linear.seen, np.linalg.solve(kalman.inverse_root, white)[..., 0], 0.0)
        return Whitened(
            residual=-white.reshape(-1),
            log_determinant=float(kalman.log_determinant.sum()),
            squares=(error**2).sum(axis=(0, 1)),
            slope=slope,
            kept=Linearisation(theta=theta, linear=linear, filter=kalman),
        )

    def jacobian(self, at: Whitened) -> np.ndarray:
        """See `Following`."""
        return self._rows(at).reshape(len(at.residual), -1)

    def _rows(self, at: Whitened) -> np.ndarray:
        """(N, R, ny, parameters) of the residual."""
        here: Linearisation = at.kept
        if not self.problem.parameters:
            return np.zeros((*here.linear.residual.shape, 0))
        return here.filter.whiten(*self.columns(here.linear))

    def linearise(self, theta: np.ndarray, X: np.ndarray) -> Linear:
        """Linearised about X (N, R, nx), with the exact derivatives of the Runge-Kutta step: at low sampling rates
        those of second order in dt shift an optimum by a standard error."""
        return self._exact(self.batch, self.problem.model_parameters(theta), X)

    def _exact(self, batch: Batch, P: np.ndarray, X: np.ndarray) -> Linear:
        linear = linearise(self.functions, batch, P, X)
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

    def bent(self, at: Whitened) -> Whitened:
        """Return the likelihood with the slope of -2 ln L through the covariance of the innovations, by differences
        along each parameter. Without it the estimate is that of highest joint density with the noise history, off by
        over a standard error in turbulence."""
        here: Linearisation = at.kept
        theta = here.theta
        noise = here.filter.noise
        J = self.jacobian(at)
        curvature = np.einsum("ij,ij->j", J, J)
        steps = _PERTURBATION / np.sqrt(np.maximum(curvature, 1e-300))
        slope = -2.0 * (J.T @ at.residual) - steps * curvature
        for first in range(0, len(theta), _PARTS):
            chosen = np.arange(first, min(first + _PARTS, len(theta)))
            shifted = [theta, *(theta + steps[i] * np.eye(len(theta))[i] for i in chosen)]
            P = np.concatenate([self.problem.model_parameters(one) for one in shifted])
            many = _tiled(self.batch, len(shifted))
            moved = self._exact(many, P, np.tile(here.linear.X, (1, len(shifted), 1)))
            kalman = kalman_filter(moved, noise)
            squares = (kalman.whiten(*residual_column(moved)) ** 2).sum(axis=(0, 2, 3))
            deviance = (kalman.log_determinant.sum(axis=0) + squares).reshape(len(shifted), -1).sum(axis=1)
            slope[chosen] += (deviance[1:] - deviance[0]) / steps[chosen]
        return replace(at, slope=slope)

    # ---- what it tells

    def parts(self, at: Whitened, record: int) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """See `Following`."""
        seen = at.kept.linear.seen
        rows = self._rows(at)[:, record][..., self.problem.columns(record)]
        yield 0, rows, at.residual.reshape(seen.shape)[:, record], seen[:, record]

    def told(self, at: Whitened, noise: NoiseState) -> Told:
        """See `Following`."""
        here: Linearisation = at.kept
        linear = here.linear
        residual = residual_column(linear)
        white = here.filter.whiten(*residual)
        error = np.linalg.solve(here.filter.inverse_root, white)[..., 0]
        X = linear.X + here.filter.smooth(*residual)[0][..., : linear.X.shape[2]]
        predicted = np.where(linear.seen, self.batch.Z - error, linear.output)
        parts = {record.name: (slice(len(record)), j) for j, record in enumerate(self.problem.records)}
        sigmas = np.exp(noise.process).tolist()
        return Told(
            measured={record.name: self.problem.outputs_of(record) for record in self.problem.records},
            predicted={name: predicted[own] for name, own in parts.items()},
            innovations={name: white[own][..., 0] for name, own in parts.items()},
            states={
                record.name: StateHistory(
                    trajectory=X[parts[record.name]], nodes=X[parts[record.name]], node_times=record.t
                )
                for record in self.problem.records
            },
            process_noise={n: (s, tau) for (n, tau), s in zip(self.correlation_time.items(), sigmas, strict=True)},
        )


def _tiled(batch: Batch, count: int) -> Batch:
    """The records of a batch several times over, side by side."""
    arrays = {name: np.concatenate([getattr(batch, name)] * count, axis=1) for name in ("t", "dt", "U", "Z", "live")}
    return replace(batch, names=batch.names * count, held=np.tile(batch.held, (count, 1)), **arrays)
