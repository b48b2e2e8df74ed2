"""Filter error: maximum likelihood with process noise, for any `Model`, noise variances estimated too.

The innovations of `innovations.kalman_filter` are white with unit variance at the truth, so that -2 ln L is their sum
of squares plus the log determinant of their covariance. Parameters and trajectory move by Gauss-Newton on the
innovations. The logarithms of all noise variances move by a quasi-Newton method on the likelihood of the linearised
system, with the parameters at their optimum for every variance, and with its exact gradient (see `noise_score`).
Without process noise it is output error with measurement noise by maximum likelihood.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from casid.arguments import require
from casid.errors import EstimationError, check_known, unknown
from casid.estimation.guess import with_guess
from casid.estimation.problem import Problem, check_plain
from casid.estimation.solvers.identified import lost_along
from casid.estimation.solvers.search import longest
from casid.estimation.solvers.status import CONVERGED, NO_DESCENT, Results, Status, out_of_steps
from casid.estimation.working import along_splines
from casid.filtering.innovations import Linear, NoiseModel, PointFunctions, make_batch
from casid.filtering.kalman import Filter, kalman_filter, residual_column
from casid.filtering.noise_score import unit_variances, variance_score
from casid.filtering.system import FilterSystem, Step, evaluate_step, trajectory_step
from casid.frames import brief
from casid.model.system import check_continuous
from casid.native.singular import singular_is
from casid.native.threads import single_threaded
from casid.records.noise import pooled_sigma

_SMALL_STEP = 0.01  # of a standard error, and of a logarithm of a noise: converged
_NEAR = 1.0  # standard errors: from here on the slope through the covariance is worth its cost
# factors a noise may be from its first guess, and from the last linearisation
_NOISE_RANGE = 1e4
_NOISE_REACH = 8.0
_TIMES = 4  # a trajectory is linearised anew before the parameters move
_KICK = 0.02  # first guess of process noise: its kick per sample, in units of the state's scale
_NOISE_STEPS = 12  # quasi-Newton steps on the noise per relinearisation
_HOPELESS = 1e12
# parts of a step that are tried
_SHRINK = 0.4
_SHORTEST = 1e-3
_FLAT = 0.1  # of the deviance: less is no loss


@dataclass(frozen=True, eq=False, kw_only=True)
class Innovations:
    """One-step predictions of a model under a noise model, on records that it may never have seen."""

    # record -> (N, outputs) innovations over their standard deviation, 0 where not measured
    white: Mapping[str, np.ndarray]
    # record -> (N, outputs) measured minus predicted from all samples before, NaN where not measured
    error: Mapping[str, np.ndarray]
    states: Mapping[str, np.ndarray]  # record -> (N, states) smoothed trajectory
    # of all measured samples, the initial state of every record free with a wide prior; `samples` their number
    log_likelihood: float
    samples: int

    __repr__ = brief


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterFit:
    """Result of `filter_error`.

    Attributes
    ----------
    problem
        What was estimated.
    values, std
        Parameter -> estimate and its 1-sigma.
    covariance
        (parameters, parameters) Cramer-Rao bound at the estimated noise.
    noise
        Measurement and process noise.
    innovations
        Of all records, with their log-likelihood.
    ended
        How the iteration ended: result, reason and remedy; `status` is it in words.
    iterations, seconds
        How many, and how long.

    Examples
    --------
    After the example of `filter_error`:

    >>> fit.covariance.shape
    (1, 1)
    """

    problem: Problem
    values: Mapping[str, float]
    std: Mapping[str, float]
    covariance: np.ndarray
    noise: NoiseModel
    innovations: Innovations
    ended: Status
    iterations: int
    seconds: float

    __repr__ = brief

    @property
    def result(self) -> Results:
        """Return how the iteration ended, of an enumeration whose values state what to do about it."""
        return self.ended.result

    @property
    def status(self) -> str:
        """ "converged", or result, reason and remedy in words."""
        return self.ended.text

    @property
    def converged(self) -> bool:
        """Return True if neither parameters nor noise would move any more."""
        return self.ended.converged

    @property
    def intensities(self) -> dict[str, float]:
        """White process noise as `MultipleShooting(process_noise=...)` takes it: sigma times sqrt(dt)."""
        root = math.sqrt(float(np.median([record.dt for record in self.problem.records])))
        return {name: sigma * root for name, sigma in self.noise.white.items()}

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts for a JSON file."""
        noise = {name: sigma for name, sigma in self.noise.measurement.items()}
        process = {name: {"sigma": sigma, "correlation_time_s": 0.0} for name, sigma in self.noise.white.items()}
        process |= {n: {"sigma": s, "correlation_time_s": tau} for n, (s, tau) in self.noise.coloured.items()}
        return {
            "status": self.status,
            "iterations": self.iterations,
            "seconds": self.seconds,
            "log_likelihood": self.innovations.log_likelihood,
            "samples": self.innovations.samples,
            "parameters": {n: {"value": v, "std": self.std[n]} for n, v in self.values.items()},
            "measurement_noise": noise,
            "process_noise": process,
        }


@single_threaded()
@singular_is("filter_error", "parameters or states cannot be told apart; fix one, or give a prior")
def filter_error(problem: Problem, process_noise: Mapping[str, float], *, iterations: int = 40) -> FilterFit:
    """Estimate parameters, measurement noise and process noise together.

    A course of iteration that goes wrong is not an error: `FilterFit.status` states it. The time constant of a lag
    runs off to infinity from a start of the wrong sign, where the data do not determine it. The iteration then starts
    again with the other sign. If nothing is found there either, the status is "not identifiable", and the standard
    errors are nan.

    Parameters
    ----------
    problem
        Its `noise` is the measurement noise; None: estimated. Initial states are free with a wide prior.
    process_noise
        Disturbance of the model -> correlation time [s] of the Gauss-Markov process that drives it; 0: white from
        sample to sample. The standard deviations are estimated.
    iterations
        After how many iterations to give up.

    Returns
    -------
    FilterFit
        Estimates with their Cramer-Rao bounds, the noise found and the innovations.

    Raises
    ------
    InputError
        For a name that is no disturbance.
    EstimationError
        For what this method does not do: costs other than OutputError, range weights, constraints, a prior of the
        initial state.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> lag = cs.define_model(
    ...     "lag", states=["x"], inputs=["u"], parameters={"T": 0.5}, outputs=["y"], disturbances=["w_x"],
    ...     dynamics=lambda s: {"x": (s.u - s.x) / s.T + s.w_x}, output=lambda s: {"y": s.x},
    ... )
    >>> t, rng = 0.05 * np.arange(200), np.random.default_rng(1)
    >>> square = cs.Record(name="square", t=t, channels={"u": np.sign(np.sin(t))})
    >>> gust = {"w_x": 0.5 * rng.standard_normal(len(t))}
    >>> flown = cs.simulate(lag, square, [0.0], {"T": 0.4}, gust).as_record("flown")
    >>> noisy = flown.with_channels(y=flown["y"] + 0.02 * rng.standard_normal(len(t)))
    >>> fit = cs.filter_error(cs.Problem(model=lag, records=[noisy], free=["T"]), {"w_x": 0.0})
    >>> fit.status, round(fit.values["T"], 1)
    ('converged', 0.4)
    """
    require(problem, Problem, "filter_error: problem", "cs.Problem(model, records, free=[...])")
    begin = time.perf_counter()
    system = _prepare(problem, process_noise)
    end = _iterated(system, problem.start_vector, iterations)
    beyond = np.isin(problem.parameters, end.lost) & (np.abs(end.theta) > np.abs(problem.start_vector))
    if beyond.any():  # a time constant of infinity is one of minus infinity: the way goes on from the other side
        other = _iterated(system, np.where(beyond, -1.0, 1.0) * problem.start_vector, iterations)
        if other.ended.converged and other.step.deviance < end.step.deviance + _FLAT:
            end = replace(other, iterations=end.iterations + other.iterations)
    covariance = np.full_like(end.step.covariance, np.nan) if end.lost else end.step.covariance
    return FilterFit(
        problem=problem,
        values=dict(zip(problem.parameters, end.theta.tolist(), strict=True)),
        std=dict(zip(problem.parameters, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        covariance=covariance,
        noise=end.noise,
        innovations=_innovations(system, end.step.linear, end.step.filter),
        ended=end.ended,
        iterations=end.iterations,
        seconds=time.perf_counter() - begin,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _End:
    """End of an iteration; `lost` are parameters that the data do not determine there."""

    theta: np.ndarray
    noise: NoiseModel
    step: Step
    ended: Status
    iterations: int
    lost: tuple[str, ...]


def _iterated(system: FilterSystem, theta: np.ndarray, iterations: int) -> _End:
    """Iterate from the parameters theta, with a first guess of noise and trajectory."""
    linear = system.linearise(theta, system.measured)
    log_sigma = _first_noise(system, linear)
    slope = np.zeros(len(theta))
    linear = _along_the_readings(system, theta, linear, system.noise(log_sigma))
    limits = log_sigma - math.log(_NOISE_RANGE), log_sigma + math.log(_NOISE_RANGE)
    ended = out_of_steps(iterations)
    near = False
    done = 0
    while done < iterations:
        done += 1
        before = log_sigma
        for held in (False, True):  # the noise that goes with a step that is too long forbids shorter steps, too
            log_sigma = _best_noise(system, theta, linear, before, limits, slope, held)
            noise = system.noise(log_sigma)
            step = evaluate_step(system, theta, linear, noise, slope)
            taken = _search(system, theta, step, noise)
            if taken is not None:
                break
        if taken is None:
            ended = NO_DESCENT
            break
        if _lost(system, step, theta):
            break
        theta, linear, length = taken
        std = np.sqrt(np.diag(step.covariance))
        moved = max(np.abs(step.change / std).max(initial=0.0), np.abs(log_sigma - before).max(initial=0.0))
        if near and length == 1.0 and moved < _SMALL_STEP:
            ended = CONVERGED
            break
        near = near or moved < _NEAR or length < 1.0
        if near:
            slope = system.covariance_slope(theta, linear, noise)
    noise = system.noise(log_sigma)
    final = evaluate_step(system, theta, linear, noise, slope)
    lost = _lost(system, final, theta)
    if lost:
        values = zip(system.problem.parameters, theta, strict=True)
        where = ", ".join(f"{name} = {value:.3g}" for name, value in values if name in lost)
        reason = f"the data say nothing of {where}"
        remedy = "start nearer, fix one, or give a prior"
        ended = Status(result=Results.NOT_IDENTIFIABLE, reason=reason, remedy=remedy)
    return _End(theta=theta, noise=noise, step=final, ended=ended, iterations=done, lost=lost)


def _lost(system: FilterSystem, step: Step, theta: np.ndarray) -> tuple[str, ...]:
    return lost_along(system.problem, step.information, np.eye(len(theta)), theta)


def predict(
    problem: Problem, values: Mapping[str, float], noise: NoiseModel, relinearisations: int = _TIMES
) -> Innovations:
    """One-step predictions of the problem's records with its parameters at `values`; only states are estimated. A
    per-record parameter has its own name, "bias_q[m1]", or the bare one. Raises InputError when a value is missing."""
    chosen = []
    for name in problem.parameters:
        bare = name.split("[")[0]
        if name not in values and bare not in values:
            raise unknown("value", name, values, "predict")
        chosen.append(values[name] if name in values else values[bare])
    theta = np.array(chosen, dtype=float)
    driven = {name: 0.0 for name in noise.white} | {name: tau for name, (_, tau) in noise.coloured.items()}
    system = _prepare(problem, driven)
    linear = _along_the_readings(system, theta, system.linearise(theta, system.measured), noise, relinearisations)
    return _innovations(system, linear, kalman_filter(linear, noise))


def _prepare(problem: Problem, process_noise: Mapping[str, float]) -> FilterSystem:
    model = problem.model
    independent = problem.noise is None or isinstance(problem.noise, Mapping)
    if not problem.is_output_error or not independent or problem.constraints:
        raise EstimationError(
            "filter_error: takes OutputError, independent noise by maximum likelihood or given, no constraints"
        )
    check_plain(problem, "filter_error")
    check_continuous(model, "filter_error")
    if problem.initial_state.value or problem.initial_state.std:
        raise EstimationError("filter_error: initial states are free with a wide prior; leave initial_state out")
    if not model.disturbances:
        raise EstimationError(f"filter_error: model '{model.name}' has no disturbance that process noise could drive")
    for name, tau in process_noise.items():
        check_known("disturbance", (name,), model.disturbances, "filter_error: process_noise")
        if not (tau >= 0.0 and math.isfinite(tau)):
            raise EstimationError(f"filter_error: correlation time of '{name}' is {tau} s; expected 0 (white) or more")
    problem = with_guess(problem, along_splines(problem))
    model = problem.model
    batch = make_batch(model, problem.records)
    unseen = [o for i, o in enumerate(model.outputs) if not np.isfinite(batch.Z[..., i]).any()]
    if unseen:
        raise EstimationError(f"filter_error: no record has a sample of {', '.join(unseen)}; leave it out of the model")
    return FilterSystem(
        problem=problem,
        batch=batch,
        functions=PointFunctions(model, problem.shared + problem.local),
        correlation_time=dict(process_noise),
        measurement=_given_noise(problem),
    )


def _along_the_readings(
    system: FilterSystem, theta: np.ndarray, linear: Linear, noise: NoiseModel, times: int = _TIMES
) -> Linear:
    """Linearised along the most likely trajectory for the parameters theta. States that are not measured are guessed as
    zero; sensitivities along such a guess can make parameters collinear that are not. A trajectory that diverges is not
    taken."""
    for _ in range(times):
        X = linear.X + kalman_filter(linear, noise).smooth(*residual_column(linear))[0][..., : linear.X.shape[2]]
        found = system.linearise(theta, X)
        if not (np.isfinite(found.residual).all() and np.isfinite(found.defect).all()):
            break
        linear = found
    return linear


def _first_noise(system: FilterSystem, linear: Linear) -> np.ndarray:
    """Logarithms of a first guess: high band of the outputs, a small kick per sample for process noise."""
    model = system.problem.model
    batch = system.batch
    tau = system.correlation_time
    guess = []
    if system.measurement is None:
        for i in range(len(model.outputs)):
            high = pooled_sigma([batch.Z[:, r, i] for r in range(batch.Z.shape[1])])
            spread = float(np.nanstd(batch.Z[..., i]))
            guess.append(max(high if math.isfinite(high) else 0.0, 1e-2 * spread, 1e-12))
    for name in sorted(tau, key=lambda n: tau[n] > 0.0):
        w = model.disturbances.index(name)
        kick = np.abs(linear.Bw0[..., w] + linear.Bw1[..., w]) / model.scale_vector()
        size = float(np.median(kick[batch.live[1:]].max(axis=1)))
        guess.append(_KICK / size if size > 0.0 else 1.0)
    return np.log(guess)


def _best_noise(
    system: FilterSystem,
    theta: np.ndarray,
    linear: Linear,
    log_sigma: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    slope: np.ndarray,
    held: bool,
) -> np.ndarray:
    """Noise of highest likelihood for the linearised system, parameters at their optimum for every trial, or `held`."""
    if not len(log_sigma):
        return log_sigma
    units = unit_variances(linear, system.noise(log_sigma), system.measurement is None)

    def cost(trial: np.ndarray) -> tuple[float, np.ndarray]:
        try:
            now = evaluate_step(system, theta, linear, system.noise(trial), slope, held)
        except np.linalg.LinAlgError:  # so far from the data that the covariance is not positive definite in numbers
            return _HOPELESS, np.zeros(len(trial))
        return 0.5 * now.expected, variance_score(now.filter, now.left, units) * np.exp(2.0 * trial)

    reach = math.log(_NOISE_REACH)
    low = np.maximum(limits[0], log_sigma - reach)
    high = np.minimum(limits[1], log_sigma + reach)
    found = scipy.optimize.minimize(
        cost,
        log_sigma,
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": _NOISE_STEPS, "ftol": 1e-10},
        bounds=list(zip(low, high, strict=True)),
    )
    return np.asarray(found.x)


def _search(
    system: FilterSystem, theta: np.ndarray, step: Step, noise: NoiseModel
) -> tuple[np.ndarray, Linear, float] | None:
    """The longest step along the Gauss-Newton direction that lowers the deviance, along the most likely trajectory of
    the parameters tried, where alone slopes are right; None when there is none."""
    alone, direction = trajectory_step(system, step)
    X = step.linear.X + alone
    none = np.zeros(len(theta))

    def tried(length: float) -> tuple[np.ndarray, Linear, float] | None:
        trial = theta + length * step.change
        linear = system.linearise(trial, X + length * direction)
        after = _HOPELESS
        if np.isfinite(linear.residual).all() and np.isfinite(linear.defect).all():
            with suppress(np.linalg.LinAlgError):
                after = evaluate_step(system, trial, linear, noise, none).deviance
        return (trial, linear, length) if after < step.deviance + _FLAT else None

    return longest(tried, _SHRINK, _SHORTEST)


def _innovations(system: FilterSystem, linear: Linear, kalman: Filter) -> Innovations:
    residual = residual_column(linear)
    white = kalman.whiten(*residual)
    error = np.linalg.solve(kalman.inverse_root, white)[..., 0]
    X = linear.X + kalman.smooth(*residual)[0][..., : linear.X.shape[2]]
    samples = int(linear.seen.sum())
    deviance = float(np.sum(white**2) + kalman.log_determinant.sum())
    parts = {record.name: (j, len(record)) for j, record in enumerate(system.problem.records)}
    return Innovations(
        white={name: white[:n, j, :, 0] for name, (j, n) in parts.items()},
        error={name: np.where(linear.seen, error, np.nan)[:n, j] for name, (j, n) in parts.items()},
        states={name: X[:n, j] for name, (j, n) in parts.items()},
        log_likelihood=-0.5 * (deviance + samples * math.log(2.0 * math.pi)),
        samples=samples,
    )


def _given_noise(problem: Problem) -> dict[str, float] | None:
    """Output -> 1-sigma of its noise as the problem gives it; None where it is estimated. Raises EstimationError for
    noise that is a channel or a formula."""
    if not isinstance(problem.noise, Mapping):
        return None
    numbers = {name: float(sigma) for name, sigma in problem.noise.items() if isinstance(sigma, int | float)}
    others = [name for name in problem.noise if name not in numbers]
    if others:
        raise EstimationError(
            f"filter_error: noise of {', '.join(others)} is a channel or a formula; give each a number, or none at all"
        )
    return numbers
