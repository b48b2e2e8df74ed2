"""Parts of a fit: a parameter, a channel, the states of a record, the minima that starts found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

_SHOWN = 4  # minima in a line
_EQUAL = 0.01  # of ln(likelihood), as good as the integration is: mirror images of one another, as a rule


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A parameter.

    Attributes
    ----------
    name, value
        Its estimate.
    std
        1-sigma: the larger of `std_corrected` and `std_cramer_rao` where residuals are coloured, else `std_cramer_rao`.
    std_cramer_rao
        By Cramer and Rao's bound, as if the residuals were white.
    std_corrected
        With the autocorrelation of the residuals.
    interval
        Of 95 %; it ends at a limit, and is one-sided where one holds the parameter. Of a parameter that is estimated
        by its logarithm it is that of the logarithm.
    prior, prior_std
        A-priori value and its 1-sigma, infinite where there is none.

    Examples
    --------
    After the example of `profile`:

    >>> T = fit["T"]
    >>> T.interval[0] < 0.4 < T.interval[1], round(T.std, 4)
    (True, 0.0018)
    """

    in_json: ClassVar[str] = "value std std_cramer_rao prior prior_std"

    name: str
    value: float
    std: float
    std_cramer_rao: float
    std_corrected: float
    interval: tuple[float, float]
    prior: float
    prior_std: float


@dataclass(frozen=True, kw_only=True)
class ChannelFit:
    """Quality of the fit of one channel, over the samples present.

    Attributes
    ----------
    rms
        Of measured minus predicted.
    R2
        1 - rms^2 / variance.
    theil
        Theil's inequality coefficient rms / (rms measured + rms predicted).
    samples
        How many are present.

    Examples
    --------
    After the example of `solve`:

    >>> y = fit.channels["y"]
    >>> y.samples, round(y.R2, 3)
    (200, 1.0)
    """

    rms: float
    R2: float
    theil: float
    samples: int


@dataclass(frozen=True, kw_only=True)
class Population:
    """The normal distribution over records that a per-record parameter is drawn from.

    Attributes
    ----------
    name
        Of the parameter.
    mean, mean_std
        Mean over records and its 1-sigma, at the spread that was found.
    spread
        Standard deviation over records, the mode of its posterior density; 0 where the data show none.
    interval
        Of 95 % for the spread.
    logarithmic
        Whether all of these are of the natural logarithm of the parameter.

    Examples
    --------
    >>> import casid as cs
    >>> fit = cs.solve(cs.Problem(model=lag, records=flown, per_record=["T"], spread={"T": 0.1}))  # doctest: +SKIP
    >>> fit.population["T"].mean, fit.population["T"].spread  # doctest: +SKIP
    """

    name: str
    mean: float
    mean_std: float
    spread: float
    interval: tuple[float, float]
    logarithmic: bool = False


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StateHistory:
    """States of a record at the solution.

    Attributes
    ----------
    trajectory
        (N, states) at the record's samples.
    nodes, node_times
        (M, states) at the starts of the segments, and their times (M,) [s].

    Examples
    --------
    After the example of `solve`:

    >>> fit.states["flown"].trajectory.shape
    (200, 1)
    """

    trajectory: np.ndarray
    nodes: np.ndarray
    node_times: np.ndarray

    def __repr__(self) -> str:
        return f"<StateHistory: {self.trajectory.shape[0]} samples of {self.trajectory.shape[1]} states>"


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
    After the example of `solve`:

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
    """Number of starts by where they ended.

    Attributes
    ----------
    minima
        Distinct ends that converged, the best first.
    lost
        Status -> how many starts ended with it instead.

    Examples
    --------
    After the example of `solve`:

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


def channel_fits(
    names: Sequence[str], measured: Mapping[str, np.ndarray], predicted: Mapping[str, np.ndarray]
) -> dict[str, ChannelFit]:
    """Return the fit of all channels with a sample, by record -> (N, channels) in the order of the names."""
    z = np.concatenate([measured[record] for record in predicted])
    y = np.concatenate(list(predicted.values()))
    return {n: channel_fit(z[:, i], y[:, i]) for i, n in enumerate(names) if np.isfinite(z[:, i]).any()}


def channel_fit(measured: np.ndarray, predicted: np.ndarray) -> ChannelFit:
    """Statistics of one channel over all its samples; NaN are missing, and of a channel that never changes R2 is."""
    good = np.isfinite(measured)
    z = measured[good]
    y = predicted[good]
    count = len(z)
    error = z - y
    centred = z - z.mean()
    with np.errstate(over="ignore"):  # of a simulation that diverges: infinite
        rms = math.sqrt(error @ error / count)
        size = math.sqrt(z @ z / count) + math.sqrt(y @ y / count)
    return ChannelFit(
        rms=rms,
        R2=1.0 - rms**2 * count / float(centred @ centred) if np.ptp(z) > 0 else math.nan,
        theil=rms / size if size > 0 else 0.0,
        samples=count,
    )
