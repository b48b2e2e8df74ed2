"""Many starts for one problem: where they are drawn, and how many ended where."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, qmc

from casid.errors import InputError
from casid.estimation.problem import Problem

_DECADES = 1.0  # either way of a start of which nothing else is known
_TAIL = 0.0014  # of a normal distribution beyond three deviations, which is not drawn
_SHOWN = 4  # minima in a line
_EQUAL = 0.01  # of ln(likelihood), as good as the integration is: mirror images of one another, as a rule


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

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> lag = cs.define_model(
    ...     "lag", states=["x"], inputs=["u"], parameters={"T": 0.5}, outputs=["y"],
    ...     dynamics=lambda s: {"x": (s.u - s.x) / s.T}, output=lambda s: {"y": s.x},
    ... )
    >>> t = 0.02 * np.arange(200)
    >>> step = cs.Record(name="step", t=t, channels={"u": np.where(t > 0.5, 1.0, 0.0)})
    >>> flown = cs.simulate(lag, step, [0.0], {"T": 0.4}).as_record("flown")
    >>> problem = cs.Problem(model=lag, records=[flown], free=["T"], noise={"y": 0.01})
    >>> best = cs.solve(problem, starts=3).starts.minima[0]
    >>> best.behind, round(best.values["T"], 2)
    (0.0, 0.4)
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

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> lag = cs.define_model(
    ...     "lag", states=["x"], inputs=["u"], parameters={"T": 0.5}, outputs=["y"],
    ...     dynamics=lambda s: {"x": (s.u - s.x) / s.T}, output=lambda s: {"y": s.x},
    ... )
    >>> t = 0.02 * np.arange(200)
    >>> step = cs.Record(name="step", t=t, channels={"u": np.where(t > 0.5, 1.0, 0.0)})
    >>> flown = cs.simulate(lag, step, [0.0], {"T": 0.4}).as_record("flown")
    >>> problem = cs.Problem(model=lag, records=[flown], free=["T"], noise={"y": 0.01})
    >>> starts = cs.solve(problem, starts=3).starts
    >>> len(starts.minima), starts.lost
    (1, Counter())
    """

    minima: tuple[Minimum, ...]
    lost: Mapping[str, int]

    @property
    def count(self) -> int:
        """All starts."""
        return sum(m.count for m in self.minima) + sum(self.lost.values())

    def __repr__(self) -> str:
        ends = [f"{m.count} at {_place(i, m)} (cost {m.cost:.6g})" for i, m in enumerate(self.minima[:_SHOWN])]
        if len(self.minima) > _SHOWN:
            rest = self.minima[_SHOWN:]
            ends.append(f"{sum(m.count for m in rest)} at {len(rest)} others further behind")
        if self.lost:
            ends.append(f"{sum(self.lost.values())} not converged")
        return f"<Starts: of {self.count} ended {', '.join(ends)}>"


def _place(i: int, minimum: Minimum) -> str:
    if i == 0:
        return "the best minimum"
    return "another as good" if minimum.behind < _EQUAL else f"one {minimum.behind:.3g} behind"


def drawn(problem: Problem, count: int, seed: int) -> list[dict[str, float]]:
    """Starts at the points of a scrambled Sobol sequence: where a parameter has two limits, between them, on a
    logarithmic scale if it is estimated on one. Where it has a prior, as that is distributed; else within a decade
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
            f"cs.limit_parameter('{name}', lower=-1.0, upper=1.0), or another start"
        )
    return lambda u: float(np.clip(start * 10.0 ** (_DECADES * (2.0 * u - 1.0)), low, high))
