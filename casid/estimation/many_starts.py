"""The best of the fits from many starts, and which of them are one minimum."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from casid.estimation.fit import Fit
from casid.estimation.problem import Problem
from casid.estimation.starts import Minimum, Starts, drawn

_SAME, _LIKELY = 0.5, 0.1  # standard deviations and ln(likelihood) between two ends that are one
_ROUNDED = 1e-6  # of an estimate, likewise
_DRAWS = 5  # times as many starts, where some are lost


def best_of(
    problem: Problem, starts: int, seed: int, solved: Callable[[Problem], Fit], tried: Callable[[Problem], Fit] | None
) -> Fit:
    """The best of the fits from the problem's own start and from others drawn over its ranges, with an account of all.

    `solved` does what it can from a start; `tried`, if there is one, only what is quick. Then starts that it loses give
    way to further ones, and are solved only where all that are drawn leave too few.
    Raises InputError for a parameter without a range.
    """
    fits, lost = [solved(problem)], list[tuple[Problem, Fit]]()
    for start in drawn(problem, (starts - 1) * (_DRAWS if tried else 1), seed):
        if len(fits) == starts:
            break
        one = replace(problem, start=start)
        fit = (tried or solved)(one)
        if fit.converged or tried is None:
            fits.append(fit)
        else:
            lost.append((one, fit))
    lost.sort(key=lambda pair: _badness(pair[1]))
    again = starts - len(fits)
    fits += [solved(one) for one, _ in lost[:again]]
    good = [fit for fit in fits if fit.converged]
    best = min(good or fits[:1], key=_badness)
    every = fits + [fit for _, fit in lost[again:]]
    seconds = sum(fit.seconds for fit in every)
    account = Starts(minima=_minima(good), lost=Counter(fit.status for fit in every if not fit.converged))
    return replace(best, problem=problem, seconds=seconds, starts=account)


def _badness(fit: Fit) -> float:
    """-ln(likelihood x prior), up to a constant of the problem."""
    return fit.uncertainty.objective.misfit(fit.uncertainty.value)


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
