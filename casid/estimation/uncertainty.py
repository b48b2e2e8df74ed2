"""Standard errors: Cramer-Rao bound, and its correction for coloured residuals.

Initial states, and every other unknown of a record, are eliminated, not fixed. A sample's row is its sensitivity to
the parameters with the states re-estimated (u_i below), obtained from the same banded system as the step.

A limit on the path holds what the initial states do too, which are no parameters. Its rows, and the information, then
have further unknowns: independent ones of unit information that move the samples which are held (see `HeldPaths`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

from casid.estimation.held_directions import HeldDirections, held_directions
from casid.estimation.initial_errors import InitialErrors, initial_errors
from casid.estimation.residual_colour import (
    ORDER,
    ChannelSums,
    Colour,
    WhitePiece,
    coloured_score,
    estimated,
    gain,
    gathered,
    noise_autocovariance,
    spread,
    variance_scatter,
)
from casid.estimation.solvers.identified import Determined, determined, weakest
from casid.estimation.solvers.levels import NoiseLevels
from casid.estimation.solvers.own import AnyObjective
from casid.estimation.solvers.paths import HeldPaths, diagonal
from casid.estimation.solvers.point import Levels, Linearised, ObjectiveValue
from casid.estimation.solvers.quadratic import free_directions, inverse_along
from casid.frames import brief
from casid.native.threads import single_threaded

_CHANCE = 1e-3  # that white residuals are called coloured
# what a saved fit has
_KEPT = "covariance corrected confused is_coloured coloured_channels sides initial_std quantile pressed"
_Z95 = float(ndtri(0.975))


@dataclass(frozen=True, eq=False, kw_only=True)
class Uncertainty:
    """Standard errors at a solution, computed when they are asked for; covariances are (parameters, parameters).

    covariance   Cramer-Rao: inverse of the information; with weights that are not the inverse noise (range weights,
                 combined cost) the covariance that white residuals of the observed variance give. Where the noise was
                 estimated too, its variance counts with samples less unknowns, as in ordinary least squares (see
                 `freedom`), and not as at the maximum of likelihood, where it is too small.
    corrected    the residuals' autocorrelation in place of white noise (Maine and Iliff, NASA RP-1138; Morelli and
                 Klein, J. Aircraft 34, 1997), by an autoregression of each channel that counts the parameters (see
                 residual_colour); channels count as independent.
    confused     names of parameters that the data do not separate or determine

    Priors count as information: with them the covariances are those of the blended estimates. The regressors of an
    equation error count as exact and the two parts of a combined cost as independent: what noise in the regressors
    does, bias above all, is in neither covariance.
    A parameter that an active limit holds has an error to one side (see held_directions). Both covariances are not a
    number in the rows and columns of confused parameters, and where nothing could be linearised (`linear` None).

    Intervals take Student's quantile where the noise is estimated. The variance v of a parameter has the degrees of
    freedom v^2 / sum (a_c^2 / f_c) (Satterthwaite, Biometrics Bull. 2, 1946). a_c is the part of v that comes from the
    noise of channel c; f_c is the channel's samples less the share of the unknowns that it determines.
    """

    objective: AnyObjective
    value: ObjectiveValue
    linear: Linearised | None
    limit_multipliers: np.ndarray

    __repr__ = brief

    def __getstate__(self) -> dict[str, Any]:
        """Keep the numbers: how they came about is not pickled."""
        known = {name: getattr(self, name) for name in _KEPT.split()}
        return known | {"objective": None, "value": None, "linear": None, "limit_multipliers": self.limit_multipliers}

    @property
    def solved(self) -> Uncertainty:
        """Return itself, as `Rescaled` does the inner one."""
        return self

    @cached_property
    def covariance(self) -> np.ndarray:
        """Cramer-Rao."""
        return self._unknown if self._inverse is None else self._of_parameters(*self._cramer_rao)

    @cached_property
    def corrected(self) -> np.ndarray:
        """Return the covariance with the colour of the residuals."""
        return self._unknown if self._inverse is None else self._of_parameters(*self._coloured)

    @property
    def honest(self) -> np.ndarray:
        """The corrected one where the residuals of any channel are coloured, else Cramer-Rao; never below that, because
        noise that is given is kept where the residuals are smaller."""
        if not self.is_coloured:
            return self.covariance
        bound = np.diagonal(self.covariance)
        found = np.diagonal(self.corrected)
        with np.errstate(divide="ignore", invalid="ignore"):
            grown = np.where((found > 0.0) & (found < bound), np.sqrt(bound / found), 1.0)
        return self.corrected * grown[:, None] * grown

    @cached_property
    def is_coloured(self) -> bool:
        """Return True if an autoregression predicts the residuals of any channel better than white noise, by AIC."""
        return self._in_time and any(not c.white for c in self._scores.colours.values())

    @cached_property
    def coloured_channels(self) -> tuple[str, ...]:
        """Channels whose residuals are coloured beyond chance."""
        if not self._in_time:
            return ()
        names = self.objective.channel_names
        chance = _CHANCE / max(len(self._scores.colours), 1)
        return tuple(names[c] for c, gain in self._scores.gains.items() if gain > chdtri(ORDER, chance))

    @property
    def _in_time(self) -> bool:
        """Return True if there are residuals that follow each other in time."""
        return self._inverse is not None and self.objective.in_time

    @cached_property
    def sides(self) -> np.ndarray:
        """(2, parameters) how far the 95 % interval reaches below and above the estimates."""
        if self._inverse is None:
            return np.full((2, len(self.objective.problem.parameters)), np.nan)
        white = self._squares(*self._cramer_rao, self._freedom)
        if self.is_coloured:
            white = np.maximum(white, self._squares(*self._coloured, self._freedom_of_colour))  # as of `honest`
        return self._named(np.sqrt(white))

    @cached_property
    def _freedom(self) -> np.ndarray:
        """(unknowns,) degrees of freedom of the variances for white noise, infinite where that is given."""
        levels = self.value.noise.levels
        inverse = self._sure
        unknowns = len(self._information)
        if levels.fixed or not np.isfinite(self._more):
            return np.full(unknowns, np.inf)
        if not isinstance(levels, NoiseLevels) or levels.proportional:
            return np.full(unknowns, levels.count / (1.0 + self._more))  # one common factor
        free = np.diagonal(inverse) > 0.0
        total = np.zeros(unknowns)
        parts = np.zeros(unknowns)
        told = levels.count - levels.count / (1.0 + self._more)
        information = {c: spread(np.zeros_like(inverse), own.gram(1.0)) for c, own in self._scores.sums.items()}
        by_parameters = {c: float(np.trace(inverse @ h)) for c, h in information.items()}
        rest = told - sum(by_parameters.values())  # initial states and what equations have eliminated
        for c, h in information.items():
            own = np.diagonal(inverse @ h @ inverse)
            samples = float(levels.present[c])
            left = max(samples - by_parameters[c] - rest * samples / levels.count, 1e-9)
            total = total + own
            parts = parts + own**2 / left
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(free & (parts > 0.0), total**2 / parts, np.inf)

    @cached_property
    def _more(self) -> float:
        """Share by which the variance of estimated noise is larger than at the maximum of likelihood."""
        levels = self.value.noise.levels
        if levels.fixed:
            return 0.0
        data = self._data_information
        further = len(self._information) - self._count
        # initial states count in full; what path limits take from them is taken off again
        told = float(np.trace(self._sure @ data)) if self._is_plain else self._free.shape[1]
        return freedom(self.objective, levels, told - further + self._initial_told) - 1.0

    @cached_property
    def _initial_told(self) -> float:
        """Initial states that the data determine."""
        return 0.0 if self._initial is None else self._initial.told(self._sure[: self._count, : self._count])

    @cached_property
    def _initial(self) -> InitialErrors | None:
        if self.linear is None:
            return None
        try:
            return initial_errors(self.objective, self.linear)
        except np.linalg.LinAlgError:
            return None

    @cached_property
    def initial_std(self) -> np.ndarray | None:
        """(2, records, states) standard errors of the initial states by Cramer and Rao's bound, and with the colour of
        the residuals; None where nothing was simulated or linearised."""
        if self._inverse is None or self._initial is None:
            return None
        more = 1.0 + self._more
        known = [np.nan_to_num(c) for c in (self.covariance, self.honest)]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.nanmean(np.diagonal(known[1]) / np.diagonal(known[0])) if self.is_coloured else 1.0
        return np.sqrt([self._initial.variances(known[0], more), ratio * self._initial.variances(known[0], more)])

    @cached_property
    def quantile(self) -> float:
        """Standard errors that half a 95 % interval of an initial state is long."""
        if self._inverse is None or self.value.noise.levels.fixed or not np.isfinite(self._more):
            return _Z95
        return float(stdtrit(self.value.noise.levels.count / (1.0 + self._more), 0.975))

    @property
    def _is_plain(self) -> bool:
        """Return True if the weights are the inverse of the noise."""
        levels = self.value.noise.levels
        return not levels.proportional and bool((levels.share == 1.0).all())

    @property
    def _data_information(self) -> np.ndarray:
        """(unknowns, unknowns) of what weighs the parameters, without priors."""
        data = (self._information if self._is_plain else self._scores.white).copy()
        data[: self._count, : self._count] -= np.diag(1.0 / self.objective.problem.prior_std**2)
        return data

    @property
    def _freedom_of_colour(self) -> np.ndarray:
        """(unknowns,) degrees of freedom of the coloured variances, whose autoregressions are estimated: twice the
        square over the variance of a variance (Satterthwaite, Biometrics Bull. 2, 1946)."""
        scores = self._scores
        variance = np.diagonal(self._coloured[0])
        scatter = variance_scatter(scores.colours, scores.sums, self._pieces(), self._sure)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(scatter > 0.0, np.maximum(2.0 * variance**2 / scatter, 1.0), np.inf)

    def _squares(self, base: np.ndarray, score: np.ndarray, freedom: np.ndarray) -> np.ndarray:
        """(2, parameters) squares of the reach below and above, by a covariance, that of its gradient, and the degrees
        of freedom (unknowns,) of its variances."""
        quantile = np.where(np.isfinite(freedom), stdtrit(np.minimum(freedom, 1e9), 0.975), _Z95)
        squares = np.tile(quantile**2 * np.maximum(np.diagonal(base), 0.0), (2, 1))
        if self._held is not None:
            squares = squares + (quantile / _Z95) ** 2 * self._held.sides(score, _Z95)
        return squares[:, : self._count]

    def _named(self, values: np.ndarray) -> np.ndarray:
        """Values (..., parameters) without those of parameters that are confused."""
        lost = np.isin(self.objective.problem.parameters, self.confused)
        return np.where(lost, np.nan, values)

    @property
    def _count(self) -> int:
        return len(self.objective.problem.parameters)

    @cached_property
    def _cramer_rao(self) -> tuple[np.ndarray, np.ndarray]:
        """Covariance of all unknowns within the limits that hold, and the covariance of the gradient that it comes
        from."""
        levels = self.value.noise.levels
        inverse = self._sure
        information = self._information
        score = information if self._is_plain else self._scores.white
        covariance = inverse if self._is_plain else inverse @ score @ inverse
        if levels.fixed:
            return covariance, score
        if not np.isfinite(self._more):
            return np.full_like(score, np.nan), score
        data = self._more * self._data_information
        return covariance + inverse @ data @ inverse, score + data

    @cached_property
    def _coloured(self) -> tuple[np.ndarray, np.ndarray]:
        """Return `_cramer_rao` with the colour of the residuals."""
        score = self._scores.coloured
        return self._sure @ score @ self._sure, score

    def _of_parameters(self, covariance: np.ndarray, score: np.ndarray) -> np.ndarray:
        """The parameters' part, with what leaving the limits adds."""
        found = covariance if self._held is None else covariance + self._held.covariance(score)
        found = self._named(found[: self._count, : self._count])
        return self._named(found.T)

    @cached_property
    def _held(self) -> HeldDirections | None:
        return held_directions(*self._limits, self._information, self._sure)

    @cached_property
    def _limits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (limits, unknowns), multipliers and which are equations, of the limits of parameters and of the path."""
        limits = self.objective.limits
        paths = self._paths
        rows = limits.at(self._there.point.theta)[1]
        equal = limits.lower == limits.upper
        if paths is None:
            return rows, self.limit_multipliers, equal
        wide = np.pad(rows, ((0, 0), (0, paths.rows.shape[1] - self._count)))
        multipliers = np.concatenate([self.limit_multipliers, paths.multipliers])
        return np.concatenate([wide, paths.rows]), multipliers, np.concatenate([equal, paths.equal])

    @cached_property
    def _paths(self) -> HeldPaths | None:
        return self.objective.held_paths(self._there)

    @cached_property
    def pressed(self) -> tuple[np.ndarray, ...] | None:
        """Record -> (path limits, N) multipliers of samples that hard path limits hold; None where there are none."""
        return None if self.linear is None or self._paths is None else self._paths.pressed

    @cached_property
    def _information(self) -> np.ndarray:
        """(unknowns, unknowns) of the parameters and of what else path limits hold."""
        further = 0 if self._paths is None else self._paths.rows.shape[1] - self._count
        return diagonal(self._there.hessian, np.eye(further))

    @property
    def confused(self) -> tuple[str, ...]:
        """Parameters that the data cannot tell apart, or of which they say nothing."""
        return self._determined.lost

    @property
    def exchanged(self) -> tuple[str, ...]:
        """States whose initial values, of which nothing is known, the confused parameters are exchanged with."""
        return self._determined.states

    @cached_property
    def _determined(self) -> Determined:
        if self.linear is None:
            return Determined(lost=(), directions=np.zeros((self._count, 0)))
        return determined(self.objective, self.linear, self.limit_multipliers)

    @property
    def weakest(self) -> tuple[str, ...]:
        """Parameters of the direction that the data determine least."""
        return () if self.linear is None else weakest(self.objective, self.linear, self.limit_multipliers)

    @cached_property
    def _free(self) -> np.ndarray:
        rows, multipliers, equal = self._limits
        if self.confused:
            return self._determined.directions
        return free_directions(rows, np.where(equal, 1.0, multipliers))

    @cached_property
    def _inverse(self) -> np.ndarray | None:
        if self.linear is None or (self.confused and (not self._determined.directions.size or self._paths is not None)):
            return None
        try:
            return inverse_along(self._free, self._information)
        except np.linalg.LinAlgError:  # the parameters are not determined: their errors are no numbers
            return None

    @property
    def _sure(self) -> np.ndarray:
        """The inverse where there is one."""
        assert self._inverse is not None
        return self._inverse

    @property
    def _there(self) -> Linearised:
        """The linearisation where there is one."""
        assert self.linear is not None
        return self.linear

    @property
    def _unknown(self) -> np.ndarray:
        count = len(self.objective.problem.parameters)
        return np.full((count, count), np.nan)

    @cached_property
    def _scores(self) -> _Scores:
        levels = self.value.noise.levels
        squares = self.value.squares
        return _score_covariances(levels, squares, self._pieces, self._information, self._free)

    def _pieces(self) -> Iterator[WhitePiece]:
        return score_pieces(self.objective, self.value, self._there, self._paths)


@dataclass(frozen=True, eq=False)
class Rescaled:
    """The standard errors of another scale of the parameters: `factor` (parameters,) is the change of each per change
    of what was estimated, `inflation` multiplies all variances, and `added` (parameters, parameters) is a covariance of
    other origin. Not `coloured`: residuals without a colour, as of noise by formula."""

    of: Uncertainty | Rescaled
    factor: np.ndarray
    coloured: bool = True
    inflation: float = 1.0
    added: np.ndarray | None = None

    __repr__ = brief

    @property
    def covariance(self) -> np.ndarray:
        """Cramer-Rao."""
        return self._scaled(self.of.covariance)

    @property
    def corrected(self) -> np.ndarray:
        """Return the covariance with the colour of the residuals."""
        return self._scaled(self.of.corrected if self.coloured else self.of.covariance)

    @property
    def honest(self) -> np.ndarray:
        """The corrected one where the residuals of any channel are coloured, else Cramer-Rao."""
        return self._scaled(self.of.honest if self.coloured else self.of.covariance)

    @property
    def coloured_channels(self) -> tuple[str, ...]:
        """Channels whose residuals are coloured beyond chance."""
        return self.of.coloured_channels if self.coloured else ()

    @property
    def sides(self) -> np.ndarray:
        """(2, parameters) how far the 95 % interval reaches below and above the estimates; of a parameter that is
        estimated by its logarithm the interval is that of the logarithm."""
        plain = _Z95 * np.sqrt(np.maximum(np.diagonal(self.of.covariance), 0.0))
        sides = self.of.sides if self.coloured else np.stack([plain, plain])
        below, above = math.sqrt(self.inflation) * sides
        if self.added is not None:
            below, above = (np.sqrt(side**2 + _Z95**2 * np.diagonal(self.added)) for side in (below, above))
        log = self.factor != 1.0
        factor = self.factor
        with np.errstate(over="ignore"):
            low = np.where(log, -np.expm1(-below) * factor, below)
            return np.stack([low, np.where(log, np.expm1(above) * factor, above)])

    def _scaled(self, covariance: np.ndarray) -> np.ndarray:
        scaled = self.inflation * covariance
        scaled = scaled if self.added is None else scaled + self.added
        return scaled * np.outer(self.factor, self.factor)

    @property
    def initial_std(self) -> np.ndarray | None:
        """(2, records, states) standard errors of the initial states."""
        found = self.of.initial_std
        return None if found is None else math.sqrt(self.inflation) * found

    @property
    def quantile(self) -> float:
        """Standard errors that half a 95 % interval of an initial state is long."""
        return self.of.quantile

    @property
    def solved(self) -> Uncertainty:
        """Return the uncertainty of what was estimated."""
        return self.of.solved


@dataclass(frozen=True, eq=False, kw_only=True)
class _Scores:
    """Covariance (parameters, parameters) of the gradient for white and for coloured residuals; channel -> colour, and
    twice the gain in ln(likelihood) that it is over white noise, and the sums that they come from."""

    white: np.ndarray
    coloured: np.ndarray
    colours: Mapping[int, Colour]
    gains: Mapping[int, float]
    sums: Mapping[int, ChannelSums]


@single_threaded()
def _score_covariances(
    levels: Levels,
    squares: np.ndarray,
    pieces: Callable[[], Iterator[WhitePiece]],
    information: np.ndarray,
    free: np.ndarray,
) -> _Scores:
    expected = levels.share * (levels.rms(squares) / levels.sigma) ** 2 if levels.proportional else levels.share
    sums = gathered(pieces())
    white = information.copy()
    prior = prior_information(information, sums)
    for channel, own in sums.items():
        spread(white, own.gram(expected[channel] - 1.0))
    noise = noise_autocovariance(sums, prior, free)
    colours = {channel: estimated(noise[channel], own.count) for channel, own in sums.items()}
    coloured = prior + coloured_score(colours, sums, pieces(), len(prior))
    gains = {channel: gain(noise[channel], own.count) for channel, own in sums.items()}
    return _Scores(white=white, coloured=coloured, colours=colours, gains=gains, sums=sums)


def prior_information(information: np.ndarray, sums: Mapping[int, ChannelSums]) -> np.ndarray:
    """Return what the information has besides the data's, of which `sums` are gathered."""
    prior = information.copy()
    for own in sums.values():
        spread(prior, own.gram(-1.0))
    return prior


def score_pieces(
    objective: AnyObjective, value: ObjectiveValue, linear: Linearised, paths: HeldPaths | None = None
) -> Iterator[WhitePiece]:
    """Sensitivities and residuals of all records and channels, outputs before equations; with `paths` the sensitivities
    also to the unknowns of theirs."""
    for r in range(len(objective.problem.records)):
        columns = objective.problem.columns(r)
        columns = columns if paths is None else np.concatenate([columns, paths.columns(r)])
        for first, rows, residuals, present in objective.parts(value, linear, paths, r):
            wide = np.pad(rows, ((0, 0), (0, 0), (0, len(columns) - rows.shape[2])))
            for c in np.flatnonzero(present.any(axis=0)).tolist():
                seen = present[:, c]
                yield WhitePiece(
                    channel=first + c, record=r, columns=columns, rows=wide[seen, c], residuals=residuals[seen, c]
                )


def freedom(objective: AnyObjective, levels: Levels, told: float) -> float:
    """Factor N / (N - f) of the variance of noise that was estimated from N samples along with f unknowns; 1 where the
    noise was given, infinity where nothing is left of the samples.

    The unknowns `told` are parameters and initial states as far as the data and not a prior determine them; what the
    equations have eliminated is counted here. It is exact for one channel (Draper and Smith, Applied Regression
    Analysis, ch. 1); several channels share the unknowns evenly.
    """
    if levels.fixed:
        return 1.0
    unknown = told + objective.eliminated
    samples = levels.count
    return samples / (samples - unknown) if samples > unknown + 1e-9 else math.inf
