"""Parameters of single records that are drawn from one normal distribution, whose mean and spread are estimated.

Every record r has a value theta_r ~ N(mean, spread^2); the logarithm of a parameter that is estimated by it. The joint
density of values and spread has no maximum: it is infinite where all values are equal and the spread is zero. So the
values, the means and all other parameters are integrated out, and the spread is the mode of its own posterior density
(empirical Bayes; with a flat prior that is restricted maximum likelihood, Patterson and Thompson, Biometrika 58, 1971).
The integral is exact for models that are linear in their parameters; for others it is Laplace's, linearised at the
estimates, again and again. The prior of a spread is the positive half of a normal density.

Given the spreads, the values are those of highest density with the prior N(mean, spread^2), drawn towards the mean by
what their record leaves open. Their standard errors count the error of the mean, not that of the spread.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from casid.errors import EstimationError
from casid.estimation.fit import Fit
from casid.estimation.fitted import Population
from casid.estimation.initial_errors import initial_errors
from casid.estimation.problem import Problem
from casid.estimation.uncertainty import Rescaled, freedom

_ROUNDS = 30
_SETTLED = 1e-3  # of a spread, and of the standard errors of values and means
_LEAST = 1e-3  # of the largest spread that is thought of: a spread below is none
_RISE = 1.92  # of -ln(density) at the ends of a 95 % interval, half the quantile of chi2 with one degree of freedom


def solved_with_population(problem: Problem, first: Callable[[Problem], Fit], again: Callable[[Problem], Fit]) -> Fit:
    """The fit of a problem with spreads: `first` solves a problem from its own start, `again` from where it ended."""
    names = tuple(problem.spread)
    scale = np.array([problem.spread[name] for name in names])
    mean = np.array([_start(problem, name) for name in names])
    spread = scale
    fit = first(_given(problem, names, mean, scale))
    settled = False
    for _ in range(_ROUNDS):
        seen = _Seen.of(names, fit, (mean, spread))
        found = seen.most_likely_spreads(scale)
        _, means, errors = seen.estimates(found)
        least = _LEAST * seen.size
        moved = np.abs(found - spread) > np.maximum(_SETTLED * found, least)
        settled = not moved.any() and bool((np.abs(means - mean) <= np.maximum(_SETTLED * errors, least)).all())
        mean = means
        spread = found
        if settled:
            break
        fit = again(replace(_given(problem, names, mean, np.maximum(spread, least)), start=dict(fit.values)))
        if fit.uncertainty.solved.linear is None:
            break
    if fit.uncertainty.solved.linear is None:
        return replace(fit, problem=problem)
    return _returned(problem, names, fit, _Seen.of(names, fit, (mean, spread)), (spread, scale), settled)


def _start(problem: Problem, name: str) -> float:
    """Mean of the start values over the records, as the solvers count."""
    start = [v for n, v in zip(problem.bare, problem.start_vector, strict=True) if n == name]
    return float(np.mean(np.log(start) if name in problem.logarithmic else start))


def _given(problem: Problem, names: tuple[str, ...], mean: np.ndarray, spread: np.ndarray) -> Problem:
    """The problem with known means and spreads, as a prior of the values; none where a spread is infinite."""
    model = problem.model
    nominal = dict(model.nominal)
    prior = dict(model.prior_std) if problem.prior else {}
    for name, m, s in zip(names, mean.tolist(), spread.tolist(), strict=True):
        by_log = name in problem.logarithmic
        prior.pop(name, None)
        if np.isfinite(s):
            nominal[name] = float(np.exp(m)) if by_log else m
            prior[name] = s * nominal[name] if by_log else s
    start = problem.named(problem.start_vector)
    known = replace(model, nominal=nominal, prior_std=prior)
    return replace(problem, model=known, spread={}, start=start, prior=bool(prior))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Seen:
    """Information that the data, and priors of other parameters, give about all parameters: -ln(likelihood) is, up
    to a constant, 1/2 theta' hessian theta - slope' theta. `member` (parameters,) is the number of the distribution
    that a parameter is drawn from, -1 of none; `size` (distributions,) the largest spread that is considered."""

    hessian: np.ndarray
    slope: np.ndarray
    member: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, names: tuple[str, ...], fit: Fit, given: tuple[np.ndarray, np.ndarray]) -> _Seen:
        """Linearise a fit with given means and spreads, in the coordinates of the solvers."""
        base = fit.uncertainty.solved
        assert base.linear is not None
        inner = base.objective.problem
        levels = base.value.noise.levels
        prior = np.diag(1.0 / inner.prior_std**2)
        data = base.linear.hessian - prior
        theta = base.linear.point.theta
        pull = prior @ (theta - inner.nominal)  # of the prior, which the data balance at the estimates
        inverse = np.linalg.pinv(base.linear.hessian, hermitian=True)
        initial = initial_errors(base.objective, base.linear)
        told = float(np.trace(inverse @ data)) + (0.0 if initial is None else initial.told(inverse))
        factor = freedom(base.objective, levels, told)
        if not np.isfinite(factor):
            raise EstimationError("solve: as many unknowns as samples; a spread cannot be told with estimated noise")
        member = np.array([names.index(n) if n in names else -1 for n in inner.bare])
        other = member < 0
        hessian = data / factor
        slope = (data @ theta + pull) / factor
        hessian[np.ix_(other, other)] += prior[np.ix_(other, other)]
        slope[other] += (prior @ inner.nominal)[other]
        informed = np.diagonal(data)
        size = [_largest_spread(theta[member == j], informed[member == j], s) for j, s in enumerate(given[1])]
        return cls(hessian=hessian, slope=slope, member=member, size=np.array(size))

    def _system(self, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(matrix, right, map) of the joint density of v: deviations from the mean in spreads, other parameters, means;
        theta = map v. It is well conditioned at a spread of zero, too."""
        count = len(self.member)
        drawn = self.member >= 0
        into = np.zeros((count, count + len(spread)))
        into[np.arange(count), np.arange(count)] = np.where(drawn, spread[self.member], 1.0)
        into[drawn, count + self.member[drawn]] = 1.0
        matrix = into.T @ self.hessian @ into
        matrix[np.arange(count), np.arange(count)] += drawn
        return matrix, into.T @ self.slope, into

    def misfit(self, spread: np.ndarray, scale: np.ndarray) -> float:
        """-ln of the posterior density of the spreads, up to a constant; infinite where something is not determined."""
        matrix, right, _ = self._system(spread)
        size = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
        try:
            factor = np.linalg.cholesky(matrix * size[:, None] * size)
        except np.linalg.LinAlgError:
            return np.inf
        whitened = np.linalg.solve(factor, size * right)
        determinant = np.log(np.diagonal(factor)).sum() - np.log(size).sum()
        return float(determinant - 0.5 * whitened @ whitened + 0.5 * ((spread / scale) ** 2).sum())

    def most_likely_spreads(self, scale: np.ndarray) -> np.ndarray:
        """(distributions,) the mode; zero where the data show no spread."""
        found = scipy.optimize.minimize(
            lambda x: self.misfit(self.size * np.sqrt(np.maximum(x, 0.0)), scale),
            np.full(len(scale), 0.25),
            method="L-BFGS-B",
            bounds=[(0.0, None)] * len(scale),
            options={"ftol": 1e-15, "gtol": 1e-9},
        )
        if not np.isfinite(found.fun):
            raise EstimationError("solve: the data do not determine the parameters that all records share, or a mean")
        spread = self.size * np.sqrt(np.maximum(found.x, 0.0))
        return np.where(spread < _LEAST * self.size, 0.0, spread)

    def estimates(self, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Covariance (parameters, parameters) of all values, means (distributions,) and their standard errors."""
        matrix, right, into = self._system(spread)
        size = 1.0 / np.sqrt(np.diagonal(matrix))
        covariance = np.linalg.inv(matrix * size[:, None] * size) * size[:, None] * size
        v = covariance @ right
        count = len(self.member)
        return into @ covariance @ into.T, v[count:], np.sqrt(np.diagonal(covariance)[count:])

    def interval(self, spread: np.ndarray, scale: np.ndarray, which: int) -> tuple[float, float]:
        """Return the interval of 95 %, by the rise of the misfit with the other spreads as they are."""

        def above(value: float) -> float:
            moved = spread.copy()
            moved[which] = value
            return self.misfit(moved, scale) - self.misfit(spread, scale) - _RISE

        best = float(spread[which])
        high = float(max(spread[which], self.size[which]))
        low = scipy.optimize.brentq(above, 0.0, best) if best > 0.0 and above(0.0) > 0.0 else 0.0
        for _ in range(60):
            if above(high) > 0.0:
                return float(low), float(scipy.optimize.brentq(above, best, high))  # pyright: ignore[reportArgumentType]
            high *= 2.0
        return float(low), np.inf  # pyright: ignore[reportArgumentType]


def _largest_spread(theta: np.ndarray, informed: np.ndarray, spread: float) -> float:
    """Return a limit of the spread of values (records,) with their information (records,): several times what they
    differ by and by what they are off."""
    errors = 1.0 / np.sqrt(informed[informed > 0.0]) if (informed > 0.0).any() else np.zeros(1)
    found = 2.0 * float(np.std(theta)) + float(np.median(errors))
    return max(found, spread) if np.isfinite(spread) else found


def _returned(
    problem: Problem,
    names: tuple[str, ...],
    fit: Fit,
    seen: _Seen,
    spreads: tuple[np.ndarray, np.ndarray],
    settled: bool,
) -> Fit:
    """The fit of `problem`, with the distributions and with standard errors that count those of the means."""
    spread, scale = spreads
    covariance, mean, errors = seen.estimates(spread)
    plain = fit.uncertainty.covariance
    factor = np.where(problem.by_logarithm, list(fit.values.values()), 1.0)
    more = np.diagonal(covariance) * factor**2 - np.diagonal(plain)
    found: Mapping[str, Population] = {
        name: Population(
            name=name,
            mean=float(mean[j]),
            mean_std=float(errors[j]),
            spread=float(spread[j]),
            interval=seen.interval(spread, scale, j),
            logarithmic=name in problem.logarithmic,
        )
        for j, name in enumerate(names)
    }
    added = covariance * np.outer(factor, factor) - plain
    added = np.where(np.outer(more > 0.0, more > 0.0), added, 0.0)
    return replace(
        fit,
        problem=problem,
        uncertainty=Rescaled(fit.uncertainty, np.ones(len(factor)), added=added),
        population=found,
        way=fit.way if settled else f"the spreads had not settled after {_ROUNDS} rounds",
    )
