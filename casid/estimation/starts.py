"""Many starts for one problem: where they are drawn, and how many ended where."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm, qmc

from casid.errors import InputError
from casid.estimation.problem import Problem

if TYPE_CHECKING:
    from casid.estimation.fit import Fit

_DECADES = 1.0  # either way of a start of which nothing else is known
_TAIL = 0.0014  # of a normal distribution beyond three deviations, which is not drawn
_SAME, _LIKELY = 0.5, 0.1  # standard deviations and ln(likelihood) between two ends that are one
_SHOWN = 4  # minima in a line
_ROUNDED = 1e-6  # of an estimate, likewise


@dataclass(frozen=True, eq=False, kw_only=True)
class Minimum:
    """A place where starts ended.

    Attributes
    ----------
    count
        How many starts ended here.
    cost
        Of the fit here, at its own weights.
    behind
        By how much -ln(likelihood x prior) is larger than at the best.
    values
        Name -> estimate.
    """

    count: int
    cost: float
    behind: float
    values: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Starts:
    """How many starts ended where.

    Attributes
    ----------
    minima
        Distinct ends that converged, the best first.
    lost
        Status -> how many starts ended with it instead.
    """

    minima: tuple[Minimum, ...]
    lost: Mapping[str, int]

    @property
    def count(self) -> int:
        """All starts."""
        return sum(m.count for m in self.minima) + sum(self.lost.values())

    def __repr__(self) -> str:
        ends = [
            f"{m.count} at {'the best minimum' if i == 0 else f'one {m.behind:.3g} behind'} (cost {m.cost:.6g})"
            for i, m in enumerate(self.minima[:_SHOWN])
        ]
        if len(self.minima) > _SHOWN:
            rest = self.minima[_SHOWN:]
            ends.append(f"{sum(m.count for m in rest)} at {len(rest)} others further behind")
        if self.lost:
            ends.append(f"{sum(self.lost.values())} not converged")
        return f"<Starts: of {self.count} ended {', '.join(ends)}>"


def best_of(problem: Problem, starts: int, seed: int, solved: Callable[[Problem], Fit]) -> Fit:
    """The best of the fits that `solved` gives from the problem's own start and from others drawn over its ranges, with
    an account of all. Raises InputError for a parameter without a range."""
    fits = [solved(problem)]
    fits += [solved(replace(problem, start=start)) for start in drawn(problem, starts - 1, seed)]
    good = [fit for fit in fits if fit.converged]
    best = min(good or fits[:1], key=_badness)
    seconds = sum(fit.seconds for fit in fits)
    account = Starts(minima=_minima(good), lost=Counter(fit.status for fit in fits if not fit.converged))
    return replace(best, problem=problem, seconds=seconds, starts=account)


def drawn(problem: Problem, count: int, seed: int) -> list[dict[str, float]]:
    """Starts at the points of a scrambled Sobol sequence: where a parameter has two limits, between them, on a
    logarithmic scale if it is estimated on one; where it has a prior, as that is distributed; else within a decade
    either way, on a logarithmic scale. Raises InputError for a parameter that begins at zero and has neither."""
    limits = _limits(problem)
    rules = [_rule(problem, i, *limits.get(name, (-math.inf, math.inf))) for i, name in enumerate(problem.parameters)]
    if count < 1:
        return []
    sobol = qmc.Sobol(len(rules), rng=np.random.default_rng(seed))
    shares = sobol.random(2 ** math.ceil(math.log2(count)))[:count]
    return [
        {name: rule(float(u)) for name, rule, u in zip(problem.parameters, rules, row, strict=True)} for row in shares
    ]


def _limits(problem: Problem) -> dict[str, tuple[float, float]]:
    """Name -> limits, of the parameters that have some of their own."""
    found: dict[str, tuple[float, float]] = {}
    for row, lower, upper in zip(*problem.linear_rows, strict=True):
        which = np.flatnonzero(row)
        if len(which) == 1:
            name, factor = problem.parameters[which[0]], row[which[0]]
            low, high = sorted((lower / factor, upper / factor))
            before = found.get(name, (-math.inf, math.inf))
            found[name] = max(low, before[0]), min(high, before[1])
    return found


def _rule(problem: Problem, i: int, low: float, high: float) -> Callable[[float], float]:
    """A start from a share in (0, 1) of parameter i between its limits."""
    name, start = problem.parameters[i], float(problem.start_vector[i])
    bare = name.split("[")[0]
    centre, std = float(problem.nominal[i]), float(problem.model.prior_std.get(bare, math.inf))
    if math.isfinite(low) and math.isfinite(high):
        if bare in problem.logarithmic and low > 0.0:
            return lambda u: float(low * (high / low) ** u)
        return lambda u: low + (high - low) * u
    if math.isfinite(std):
        return lambda u: float(np.clip(centre + std * norm.ppf(_TAIL + (1 - 2 * _TAIL) * u), low, high))
    if start == 0.0:
        raise InputError(
            f"solve: starts has no range for '{name}', which begins at 0 and has no prior; give both limits, like "
            f"cs.parameter('{name}', lower=-1.0, upper=1.0), or another start"
        )
    return lambda u: float(np.clip(start * 10.0 ** (_DECADES * (2.0 * u - 1.0)), low, high))


def _badness(fit: Fit) -> float:
    """-ln(likelihood x prior), up to a constant of the problem."""
    value, objective = fit.uncertainty.value, fit.uncertainty.objective
    found = value.cost if value.noise.levels.fixed else objective.likelihood_cost(value)
    return found if math.isfinite(found) else math.inf


def _minima(fits: Sequence[Fit]) -> tuple[Minimum, ...]:
    """Distinct ends, the best first."""
    groups: list[list[Fit]] = []
    for fit in sorted(fits, key=_badness):
        own = next((group for group in groups if _same(group[0], fit)), None)
        if own is None:
            groups.append([fit])
        else:
            own.append(fit)
    ends = [group[0] for group in groups]
    return tuple(
        Minimum(count=len(group), cost=end.cost, behind=_badness(end) - _badness(ends[0]), values=dict(end.values))
        for group, end in zip(groups, ends, strict=True)
    )


def _same(one: Fit, other: Fit) -> bool:
    """Whether two ends are one minimum: no data could tell them apart."""
    if abs(_badness(one) - _badness(other)) > _LIKELY:
        return False
    value = np.array(list(one.values.values()))
    std = np.sqrt(np.maximum(np.diagonal(one.covariance), 0.0))
    apart = np.abs(value - np.array(list(other.values.values())))
    return bool((apart <= _SAME * np.where(np.isfinite(std), std, 0.0) + _ROUNDED * np.abs(value)).all())
