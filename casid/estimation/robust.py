"""Noise with more large errors than the normal distribution has: Student's t and Huber's, by reweighted least squares.

-ln(likelihood) is the sum of rho(r/s) + ln s with residuals r and a scale s of each output. It is minimised by least
squares with the weights w(u) = rho'(u)/u of the present residuals, again and again (Holland and Welsch, Commun. Stat.
A6, 1977). The scale of Student's noise is that of highest likelihood, s^2 = mean of w r^2; of Huber's it is his
"proposal 2", on which one reading has a bounded effect. The standard errors are those of the last least squares with
all variances times E[psi^2] E[w] / E[psi']^2, psi = w u, as M-estimators have them (Huber, Ann. Stat. 1, 1973).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln, ndtr

from casid.arguments import number
from casid.estimation.fit import Fit
from casid.estimation.noise import Huber, StudentT
from casid.estimation.problem import Problem
from casid.estimation.uncertainty import Rescaled

_ROUNDS = 100
_SETTLED = 1e-3  # standard deviations of an estimate, and relative change of a scale
_MEDIAN = 1.4826  # standard deviations of normal noise in a median of magnitudes
_LEAST = 1e-6  # of the largest residual: a scale below is that of readings without noise
_SCALE = "scale of the noise of {}"


@dataclass(frozen=True, eq=False, kw_only=True)
class _Law:
    """Functions of residuals over their scale u: the weight w, the derivative of psi = w u, ln of the density, and
    the function whose mean is the square by which the scale is too small."""

    growth: Callable[[np.ndarray], np.ndarray]
    weight: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    log_density: Callable[[np.ndarray], np.ndarray]


def _law(noise: StudentT | Huber) -> _Law:
    if isinstance(noise, StudentT):
        v = noise.degrees
        constant = float(gammaln(0.5 * (v + 1)) - gammaln(0.5 * v)) - 0.5 * math.log(v * math.pi)
        return _Law(
            growth=lambda u: (v + 1) * u**2 / (v + u**2),
            weight=lambda u: (v + 1) / (v + u**2),
            slope=lambda u: (v + 1) * (v - u**2) / (v + u**2) ** 2,
            log_density=lambda u: constant - 0.5 * (v + 1) * np.log1p(u**2 / v),
        )
    k = noise.threshold
    tail = float(ndtr(-noise.threshold))
    beside = math.exp(-0.5 * k**2)  # density of normal noise there over that at zero
    mass = math.sqrt(2 * math.pi) * (1 - 2 * tail) + 2 / k * beside
    expected = 1 - 2 * tail - 2 * k * beside / math.sqrt(2 * math.pi) + 2 * k**2 * tail  # of psi^2 under normal noise
    return _Law(
        growth=lambda u: np.minimum(np.abs(u), k) ** 2 / expected,
        weight=lambda u: k / np.maximum(np.abs(u), k),
        slope=lambda u: (np.abs(u) < k).astype(float),
        log_density=lambda u: np.where(np.abs(u) < k, -0.5 * u**2, 0.5 * k**2 - k * np.abs(u)) - math.log(mass),
    )


def solved_robustly(
    problem: Problem, noise: StudentT | Huber, solved: Callable[[Problem], Fit], again: Callable[[Problem], Fit]
) -> Fit:
    """The fit of a problem with robust noise: `solved` as least squares, and `again` from there with weights."""
    known = None if noise.sigma is None else {n: number(s, "noise") for n, s in noise.sigma.items()}
    fit = solved(replace(problem, noise=known))
    law = _law(noise)
    first = _residuals(problem, fit)
    scale = known or {n: max(_MEDIAN * float(np.median(np.abs(r))), _least(r)) for n, r in first.items()}
    iterations = fit.iterations
    seconds = fit.seconds
    for _ in range(_ROUNDS):
        if not fit.converged:
            break
        before = fit
        former = scale
        weights = _weights(law, fit, scale)
        if known is None:
            scale = _scale_of(problem, fit, law, scale)
        fit = again(_weighted(problem, weights, scale, fit))
        iterations = iterations + fit.iterations
        seconds = seconds + fit.seconds
        if _settled(before, fit, former, scale):
            break
    return _returned(problem, fit, law, scale, (iterations, seconds))


def _outputs(problem: Problem, fit: Fit) -> Mapping[str, int]:
    """Output -> its column, of those that are measured."""
    return {name: i for i, name in enumerate(problem.model.outputs) if name in fit.channels or name in fit.noise}


def _residuals(problem: Problem, fit: Fit) -> dict[str, np.ndarray]:
    """Output -> its residuals in all records, of those that are measured."""
    every = np.concatenate(list(fit.residuals.values()))
    return {name: every[np.isfinite(every[:, i]), i] for name, i in _outputs(problem, fit).items()}


def _least(r: np.ndarray) -> float:
    """Return the smallest scale of residuals."""
    return max(_LEAST * float(np.abs(r).max()), 1e-300)


def _weights(law: _Law, fit: Fit, scale: Mapping[str, float]) -> dict[str, dict[str, np.ndarray]]:
    """Record -> output -> (N,) weights, one where nothing is measured."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for record, residuals in fit.residuals.items():
        own = {name: residuals[:, i] / scale[name] for name, i in _outputs(fit.problem, fit).items()}
        found[record] = {n: np.where(np.isfinite(u), law.weight(np.nan_to_num(u)), 1.0) for n, u in own.items()}
    return found


def _scale_of(problem: Problem, fit: Fit, law: _Law, scale: Mapping[str, float]) -> dict[str, float]:
    """The next scale for the present residuals."""
    found = dict(scale)
    for name, r in _residuals(problem, fit).items():
        next_one = scale[name] * math.sqrt(float(law.growth(r / scale[name]).mean()))
        found[name] = max(next_one, _least(r))
    return found


def _weighted(
    problem: Problem, weights: Mapping[str, Mapping[str, np.ndarray]], scale: Mapping[str, float], fit: Fit
) -> Problem:
    """The least squares in which every reading has the noise of its weight, from where a fit ended."""
    records = [
        record.with_channels(**{_SCALE.format(n): scale[n] / np.sqrt(w) for n, w in weights[record.name].items()})
        for record in problem.records
    ]
    names = next(iter(weights.values()))
    sigma = {name: _SCALE.format(name) if name in names else 1.0 for name in problem.model.outputs}
    return replace(problem, records=records, noise=sigma, start=dict(fit.values))


def _settled(before: Fit, after: Fit, former: Mapping[str, float], scale: Mapping[str, float]) -> bool:
    std = np.sqrt(np.maximum(np.diagonal(after.covariance), 0.0))
    moved = np.abs(np.array(list(after.values.values())) - np.array(list(before.values.values())))
    change = max(abs(math.log(scale[name] / former[name])) for name in scale)
    return change < _SETTLED and bool((moved <= _SETTLED * np.nan_to_num(std)).all())


def _returned(problem: Problem, fit: Fit, law: _Law, scale: Mapping[str, float], spent: tuple[int, float]) -> Fit:
    u = []
    likelihood = 0.0
    for name, r in _residuals(problem, fit).items():
        own = r / scale[name]
        u.append(own)
        likelihood += float(law.log_density(own).sum()) - len(own) * math.log(scale[name])
    every = np.concatenate(u)
    count = len(fit.values)
    weight = law.weight(every)
    slope = float(law.slope(every).mean())
    inflation = float(((weight * every) ** 2).mean() * weight.mean()) / max(slope, 1e-3) ** 2
    return replace(
        fit,
        problem=problem,
        # a reading far away weighs little with Student's law, with Huber's its weighted residual still grows
        uncertainty=Rescaled(fit.uncertainty, np.ones(count), isinstance(problem.noise, StudentT), inflation),
        log_likelihood=likelihood,
        noise=dict(scale),
        noise_covariance=np.diag([scale.get(name, np.nan) ** 2 for name in problem.model.outputs]),
        iterations=spent[0],
        seconds=spent[1],
    )
