"""Solution from many starts: where they are drawn, the best of their fits, and which of them are one minimum."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy
from scipy.special import ndtri

from casid.errors import InputError
from casid.estimation.cost import OwnLikelihood
from casid.estimation.fit import Fit
from casid.estimation.fitted import Minimum, Starts
from casid.estimation.integration import MET, misfit_of
from casid.estimation.problem import Problem
from casid.estimation.solvers.effort import Effort
from casid.estimation.solvers.gauss_newton import FilterSearch
from casid.estimation.solvers.iteration import Iteration
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Point
from casid.estimation.solvers.solver import Outcome
from casid.estimation.solvers.timed import Clock, Timed
from casid.estimation.uncertainty import Uncertainty
from casid.estimation.working import natural
from casid.model.system import bare_name

_DECADES = 1.0  # either way of a start of which nothing else is known
_TAIL = 0.0014  # of a normal distribution beyond three deviations, which is not drawn


def drawn(problem: Problem, count: int, seed: int) -> list[dict[str, float]]:
    """Starts at the points of a scrambled Sobol sequence: where a parameter has two limits, between them, on a
    logarithmic scale if it is estimated on one. Where it has a prior, as that is distributed; else within a decade
    either way, on a logarithmic scale. Raises InputError for a parameter that begins at zero and has neither."""
    rules = [_rule(problem, i, *bounds.tolist()) for i, bounds in enumerate(problem.bounds.T)]
    if count < 1:
        return []
    sobol = scipy.stats.qmc.Sobol(len(rules), rng=np.random.default_rng(seed))
    shares = sobol.random(2 ** math.ceil(math.log2(count)))[:count]
    return [
        {name: rule(float(u)) for name, rule, u in zip(problem.parameters, rules, row, strict=True)} for row in shares
    ]


def _rule(problem: Problem, i: int, low: float, high: float) -> Callable[[float], float]:
    """A start from a share in (0, 1) of parameter i between its limits."""
    name = problem.parameters[i]
    start = float(problem.start_vector[i])
    bare = bare_name(problem.model, name)
    centre = float(problem.nominal[i])
    std = float(problem.model.prior_std.get(bare, math.inf))
    if math.isfinite(low) and math.isfinite(high):
        if problem.by_logarithm[i] and low > 0.0:
            return lambda u: float(low * (high / low) ** u)
        return lambda u: low + (high - low) * u
    if math.isfinite(std):
        return lambda u: float(np.clip(centre + std * ndtri(_TAIL + (1 - 2 * _TAIL) * u), low, high))
    if start == 0.0:
        raise InputError(
            f"solve: starts has no range for '{name}', which begins at 0 and has no prior; give both limits, like "
            f"cs.limit_parameter('{name}', lower=-1.0, upper=1.0), or another start"
        )
    return lambda u: float(np.clip(start * 10.0 ** (_DECADES * (2.0 * u - 1.0)), low, high))


# standard deviations and ln(likelihood) between two ends that are one
_SAME = 0.5
_LIKELY = 0.1
_ROUNDED = 1e-6  # of an estimate, likewise
_DRAWS = 5  # times as many starts, where some are lost
# readings per unknown: of 37 problems (`bench_ends.py`) those with a lower minimum within a decade have 2 and 20
_FEW = 30
# standard deviations: intervals end at two or three, and the farther a search begins the more it may find
_TIMES = (16.0, -16.0, 8.0, -8.0, 4.0, -4.0)
_BACK = 2.0  # standard deviations from the end: the search has come back
_LEAST = 64  # evaluations of all searches, which cost less than twice what else a small solution takes
_EACH = 0.5  # of them for one search
_QUICK = 1e-3  # standard deviations: nearer to its end no search goes
_STEPS = 40  # of a search
_LINEAR = 2  # steps, of which the second finds nothing left


def best_of(
    problem: Problem, starts: int, seed: int, solved: Callable[[Problem], Fit], tried: Callable[[Problem], Fit] | None
) -> Fit:
    """The best of the fits from the problem's own start and from others drawn over its ranges, with an account of all.

    `solved` does what it can from a start; `tried`, if there is one, only what is quick. Then starts that it loses give
    way to further ones, and are solved only where all that are drawn leave too few, or where one is more likely than
    every end that was solved. An end that is more likely than all that converged is the best, whatever its status:
    a minimum between bounds does not contradict it.
    Raises InputError for a parameter without a range.
    """
    fits = [solved(problem)]
    lost = list[tuple[Problem, Fit]]()
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
    if again == 0 and lost and _badness(lost[0][1]) < min(map(_badness, fits)) - _LIKELY:
        again = 1
    fits += [solved(one) for one, _ in lost[:again]]
    return _best(problem, fits, [fit for _, fit in lost[again:]])


def confirmed(problem: Problem, first: Fit, solved: Callable[[Problem], Fit], clock: Timed) -> Fit:
    """Return a solution on few readings, or a more likely one that quick searches from beyond its interval find.

    A minimum that is not the lowest leaves no trace in few residuals, and the intervals do not reach another. So
    searches begin on both sides of it, along what the data determine least, and end where they come back to it; all
    together they cost no more than twice what the solution has. What is lower is `solved` anew. Nothing else is tried
    where the problem is linear or has more readings.
    """
    readings = sum(channel.samples for channel in first.channels.values())
    unknowns = len(problem.parameters) + int((problem.initial_knowledge[1] > 0.0).sum())
    if (
        isinstance(problem.cost, OwnLikelihood)
        or not first.converged
        or first.iterations <= _LINEAR
        or readings > _FEW * unknowns
    ):
        return first
    told = first.uncertainty.solved
    end = min(_lower(told, clock), key=lambda end: told.objective.misfit(end.value), default=None)
    if end is None:
        return first
    second = solved(replace(problem, start=natural(problem, problem.named(end.point.theta))))
    found = _best(problem, [first, second] if second.converged else [first], [])
    return found if found.starts is not None and len(found.starts.minima) > 1 else first


def _beyond(told: Uncertainty) -> Iterator[np.ndarray]:
    """Parameters at some standard deviations from an end, along the main axis of their correlation."""
    covariance = told.covariance
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    if told.linear is None or not np.isfinite(covariance).all() or not (std > 0.0).all():
        return
    sizes, axes = np.linalg.eigh(covariance / np.outer(std, std))
    axis = np.sqrt(max(float(sizes[-1]), 0.0)) * std * axes[:, -1]
    for times in _TIMES:
        yield np.clip(told.linear.point.theta + times * axis, *told.objective.problem.bounds)


def _lower(told: Uncertainty, clock: Timed) -> Iterator[Outcome]:
    """Ends of searches from beyond an end that are more likely; one that comes back to it is given up."""
    linear = told.linear
    given = told.objective
    if linear is None or not isinstance(given, Objective):
        return
    pool = max(2.0 * given.effort.spent, _LEAST)
    objective = Objective(given.problem, given.dynamics, effort=Effort())

    def is_back(point: Point) -> bool:
        apart = point.theta - linear.point.theta
        return bool(apart @ linear.hessian @ apart < _BACK**2)

    for theta in _beyond(told):
        if clock.left <= 0.0 or objective.effort.spent >= pool:
            break
        objective.effort.allowed = min(objective.effort.spent + _EACH * pool, pool)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            begin = replace(linear.point, theta=theta)
            iteration = Iteration(objective, Clock(clock.left, objective), _QUICK, begin)
            end = iteration.run(FilterSearch(iteration), _STEPS, until=is_back)
            is_lower = objective.misfit(end.value) < given.misfit(told.value) - _LIKELY
        if is_lower and end.value.worst() < MET:
            yield end


def _best(problem: Problem, fits: Sequence[Fit], lost: Sequence[Fit]) -> Fit:
    """The most likely of fits, with an account of them and of those that were `lost`."""
    good = [fit for fit in fits if fit.converged]
    best = min(fits, key=_badness)
    if good and _badness(best) > min(map(_badness, good)) - _LIKELY:
        best = min(good, key=_badness)
    every = [*fits, *lost]
    account = Starts(
        minima=_minima(good, _badness(best)), lost=Counter(fit.status for fit in every if not fit.converged)
    )
    return replace(best, problem=problem, seconds=sum(fit.seconds for fit in every), starts=account)


def _badness(fit: Fit) -> float:
    """Return `misfit_of` where the solver ended."""
    solved = fit.uncertainty.solved
    return misfit_of(solved.objective, solved.value)


def _minima(fits: Sequence[Fit], best: float) -> tuple[Minimum, ...]:
    """Distinct ends, the most likely first; `best` is the badness of the fit that is returned."""
    groups: list[list[Fit]] = []
    for fit in sorted(fits, key=_badness):
        own = next((group for group in groups if _same(group[0], fit)), None)
        if own is None:
            groups.append([fit])
        else:
            own.append(fit)
    ends = [group[0] for group in groups]
    return tuple(
        Minimum(count=len(group), cost=end.cost, behind=_badness(end) - best, values=dict(end.values))
        for group, end in zip(groups, ends, strict=True)
    )


def _same(one: Fit, other: Fit) -> bool:
    """Return True if two ends are one minimum: no data could separate them."""
    if abs(_badness(one) - _badness(other)) > _LIKELY:
        return False
    value = np.array(list(one.values.values()))
    std = np.sqrt(np.maximum(np.diagonal(one.covariance), 0.0))
    apart = np.abs(value - np.array(list(other.values.values())))
    return bool((apart <= _SAME * np.where(np.isfinite(std), std, 0.0) + _ROUNDED * np.abs(value)).all())
