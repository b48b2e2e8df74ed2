"""Profile-likelihood intervals: all values of a parameter that the data cannot reject, everything else re-estimated.

The deviance D(v) = 2 (ln L_max - max ln L with the parameter held at v) is chi-square with one degree of freedom at the
truth (Wilks), so the interval ends where D reaches its quantile. Unlike a standard error it may be lopsided, and
it notices when a direction has no end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from casid.arguments import names as argument_names
from casid.arguments import number, require
from casid.errors import EstimationError, InputError
from casid.estimation.constraints import LinearConstraint
from casid.estimation.constraints import limit_parameter as limits_of
from casid.estimation.cost import RangeWeights
from casid.estimation.estimate import solve
from casid.estimation.fit import Fit
from casid.estimation.noise import Huber, StudentT
from casid.estimation.solvers.newton import Automatic
from casid.estimation.solvers.solver import Solver
from casid.estimation.transcriptions.transcription import MultipleShooting, Transcription
from casid.native.singular import singular_is
from casid.native.threads import single_threaded

_TOLERANCE = 0.005  # of the root of the deviance: half a per cent of a standard error
_SOLVES = 10  # per side
_FARTHEST = 30.0  # standard errors: beyond, the side counts as open
_DEFAULT_METHOD = MultipleShooting()
_DEFAULT_SOLVER = Automatic()


@dataclass(frozen=True, kw_only=True)
class ProfileInterval:
    """All values that are not rejected at `level`.

    Attributes
    ----------
    lower, upper
        Ends; infinite where the deviance stays below its quantile, NaN where an estimation failed.
    points
        (value, deviance) of every estimation made, sorted by value.
    status
        "found", or in words what is wrong with an end.

    Examples
    --------
    After the example of `profile`:

    >>> interval.name, interval.value == fit.values["T"]
    ('T', True)
    """

    name: str
    value: float
    lower: float
    upper: float
    level: float
    points: tuple[tuple[float, float], ...]
    status: str


@single_threaded()
@singular_is("profile", "parameters or states cannot be told apart; fix one, or give a prior")
def profile(
    fit: Fit,
    names: Iterable[str],
    *,
    level: float = 0.95,
    method: Transcription = _DEFAULT_METHOD,
    solver: Solver = _DEFAULT_SOLVER,
) -> dict[str, ProfileInterval]:
    """Profile-likelihood intervals for parameters of a converged fit of OutputError with noise given or estimated.

    Each end is found by a secant on the signed root of the deviance, which is nearly a straight line. Each estimation
    starts from the last one moved along the line on which the others follow. A limit on the parameter alone cuts the
    interval off.

    Parameters
    ----------
    fit
        A converged fit of OutputError with noise given or estimated.
    names
        Parameters whose intervals are wanted.
    level
        Probability with which an interval holds the true value.
    method, solver
        As in `solve`.

    Returns
    -------
    dict of str to ProfileInterval
        By name, in the order of `names`.

    Raises
    ------
    InputError
        For an unknown name or a level outside (0, 1).
    EstimationError
        For a fit whose cost is no likelihood or that has not converged.

    Examples
    --------
    After the example of `solve`:

    >>> noisy = flown.with_channels(y=flown["y"] + 0.01 * np.random.default_rng(1).standard_normal(len(t)))
    >>> fit = cs.solve(cs.Problem(model=lag, records=[noisy], free=["T"], noise={"y": 0.01}))
    >>> interval = cs.profile(fit, ["T"])["T"]
    >>> interval.status, interval.lower < 0.4 < interval.upper
    ('found', True)
    """
    require(fit, Fit, "profile: fit", "cs.solve(problem)")
    _check(fit, level, method)
    wanted = argument_names(names, "profile: names")
    return {name: _ProfileSearch(fit, fit[name].name, method, solver).interval(level) for name in wanted}


def negative_log_posterior(fit: Fit) -> float:
    """-ln L of a fit plus what its priors cost, up to a constant of the problem."""
    return fit.prior_cost - fit.log_likelihood


def _check(fit: Fit, level: float, method: Transcription) -> None:
    if not 0.0 < number(level, "profile: level") < 1.0:
        raise InputError(f"profile: level is {level}; expected a probability inside (0, 1), like 0.95")
    if not fit.problem.is_output_error or isinstance(fit.problem.noise, RangeWeights | StudentT | Huber):
        raise EstimationError("profile: the cost is no likelihood; use OutputError with noise given or estimated")
    if getattr(method, "process_noise", None):
        raise EstimationError("profile: with soft defects the cost is no likelihood; use hard ones")
    if not fit.converged:
        raise EstimationError(f"profile: the fit has not converged ({fit.status}); an interval about it means nothing")


class _ProfileSearch:
    """The search for the ends of one parameter's interval; `along` (parameters,) is how the others follow it."""

    def __init__(self, fit: Fit, name: str, method: Transcription, solver: Solver) -> None:
        self.fit = fit
        self.name = name
        self.method = method
        self.solver = solver
        self.index = list(fit.parameters).index(name)
        variance = float(fit.covariance[self.index, self.index])
        if not variance > 0.0:
            raise EstimationError(f"profile: '{name}' has no variance; it is held by a limit, or nothing moves it")
        self.std = math.sqrt(variance)
        self.along = fit.covariance[:, self.index] / variance
        self.best = negative_log_posterior(fit)
        constraints = fit.problem.constraints
        own = [c for c in constraints if isinstance(c, LinearConstraint) and set(c.coefficients) == {name}]
        self.others = tuple(c for c in constraints if c not in own)
        ends = [sorted((c.lower / c.coefficients[name], c.upper / c.coefficients[name])) for c in own]
        self.limits = max((e[0] for e in ends), default=-math.inf), min((e[1] for e in ends), default=math.inf)
        self.points = [(fit[name].value, 0.0)]

    def interval(self, level: float) -> ProfileInterval:
        reach = math.sqrt(float(chdtri(1, 1.0 - level)))
        ends, words = zip(*(self._end(sign, reach) for sign in (-1.0, 1.0)), strict=True)
        return ProfileInterval(
            name=self.name,
            value=self.fit[self.name].value,
            lower=ends[0],
            upper=ends[1],
            level=level,
            points=tuple(sorted(self.points)),
            status="; ".join(dict.fromkeys(w for w in words if w)) or "found",
        )

    def _end(self, sign: float, reach: float) -> tuple[float, str]:
        """(end, what is wrong with it); distances are in standard errors from the estimate."""
        centre = self.fit[self.name].value
        limit = self.limits[1 if sign > 0 else 0]
        room = min(sign * (limit - centre) / self.std, _FARTHEST)
        theta = np.array(list(self.fit.values.values()))
        known = [(0.0, 0.0)]
        distance = reach
        for _ in range(_SOLVES):
            distance = min(distance, room)
            value = centre + sign * distance * self.std
            found = self._solve(value, theta + self.along * (value - theta[self.index]))
            if found is None:
                return math.nan, f"no estimation at {self.name} = {value:.6g} converged"
            theta, root = found
            self.points.append((value, root**2))
            if abs(root - reach) < _TOLERANCE:
                return value, ""
            if distance >= room and root < reach:
                if math.isfinite(limit) and room < _FARTHEST:
                    return limit, f"{self.name} ends at its limit {limit:g}"
                return sign * math.inf, f"{self.name} has no {'upper' if sign > 0 else 'lower'} end"
            known.append((distance, root))
            distance = _next_distance(known, reach)
        return math.nan, f"no end of {self.name} after {_SOLVES} estimations"

    def _solve(self, value: float, start: np.ndarray) -> tuple[np.ndarray, float] | None:
        """(parameters, root of the deviance) with the parameter held at `value`."""
        problem = self.fit.problem
        held = replace(
            problem,
            constraints=(*self.others, limits_of(self.name, lower=value, upper=value)),
            start=dict(zip(problem.parameters, start.tolist(), strict=True)) | {self.name: value},
        )
        fit = solve(held, self.method, self.solver, starts=1)
        if not fit.converged:
            return None
        deviance = 2.0 * (negative_log_posterior(fit) - self.best)
        return np.array(list(fit.values.values())), math.sqrt(max(deviance, 0.0))


def _next_distance(known: list[tuple[float, float]], reach: float) -> float:
    """Return where the root of the deviance is expected to reach `reach`: inside the bracket when there is one."""
    below = max((k for k in known if k[1] < reach), key=lambda k: k[0])
    above = min((k for k in known if k[1] > reach and k[0] > below[0]), key=lambda k: k[0], default=None)
    if above is not None:
        return below[0] + (reach - below[1]) * (above[0] - below[0]) / (above[1] - below[1])
    before = max((k for k in known if k[0] < below[0]), key=lambda k: k[0], default=(0.0, 0.0))
    slope = (below[1] - before[1]) / (below[0] - before[0])
    farthest = max(2.5 * below[0], below[0] + 1.0)
    wanted = below[0] + 1.05 * (reach - below[1]) / slope if slope > 0.0 else farthest
    return min(wanted, farthest, _FARTHEST)
