"""Standard errors: Cramer-Rao bound, and its correction for coloured residuals.

Initial states, and every other unknown of a record, are eliminated, not fixed. A sample's row is its sensitivity to
the parameters with the states re-estimated (u_i below), obtained from the same banded system as the step.

Errors at an active limit have one side. A limit r'p <= b has a multiplier m > 0: along the direction V that leaves it,
all other parameters following, -ln(likelihood) rises by m d + K d^2/2 with the distance d, K = V'HV. It has risen by
z^2/2 at

    d = z^2 / (m + sqrt(m^2 + K z^2)).

This is z standard deviations of the free estimate where the limit is only just active, and z^2/(2 m) where the
multiplier is large. For noise other than the information H assumes, with the covariance S of the gradient, K becomes
V'SV under the root and d is V'SV/K times as large. Each of several active limits counts separately.

A limit on the path holds what the initial states do too, which are no parameters. Its rows, and the information, then
have further unknowns: independent ones of unit information that move the samples which are held (see `HeldPaths`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

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
from casid.estimation.solvers.identified import lost, weakest
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.paths import HeldPaths, diagonal
from casid.estimation.solvers.point import Levels, Linearised, ObjectiveValue
from casid.estimation.solvers.quadratic import free_directions, inverse_along
from casid.estimation.transcriptions.equation import EquationPart
from casid.estimation.transcriptions.kernel import whitened
from casid.model.system import Model
from casid.native.threads import single_threaded
from casid.views import brief

_CHANCE = 1e-3  # that white residuals are called coloured
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
    confused     names of parameters that the data cannot tell apart, or of which they say nothing

    Priors count as information: with them the covariances are those of the blended estimates. The regressors of an
    equation error count as exact and the two parts of a combined cost as independent: what noise in the regressors
    does, bias above all, is in neither covariance.
    A parameter that an active limit holds has an error to one side (see above). Both covariances are not a number
    where parameters are confused and where nothing could be linearised (`linear` None).
    """

    objective: Objective
    value: ObjectiveValue
    linear: Linearised | None
    limit_multipliers: np.ndarray

    __repr__ = brief

    def __getstate__(self) -> dict[str, Any]:
        """What is kept of it are the numbers: how they came about is not pickled."""
        names = ("covariance", "corrected", "confused", "is_coloured", "coloured_channels", "sides")
        known = {name: getattr(self, name) for name in names}
        return known | {"objective": None, "value": None, "linear": None, "limit_multipliers": self.limit_multipliers}

    @cached_property
    def covariance(self) -> np.ndarray:
        """Cramer-Rao."""
        return self._unknown if self._inverse is None else self._of_parameters(*self._cramer_rao)

    @cached_property
    def corrected(self) -> np.ndarray:
        """With the colour of the residuals."""
        return self._unknown if self._inverse is None else self._of_parameters(*self._coloured)

    @property
    def honest(self) -> np.ndarray:
        """The corrected one where the residuals of any channel are coloured, else Cramer-Rao; never below that, because
        noise that is given stands where the residuals are smaller."""
        if not self.is_coloured:
            return self.covariance
        bound, found = np.diagonal(self.covariance), np.diagonal(self.corrected)
        with np.errstate(divide="ignore", invalid="ignore"):
            grown = np.where((found > 0.0) & (found < bound), np.sqrt(bound / found), 1.0)
        return self.corrected * grown[:, None] * grown

    @cached_property
    def is_coloured(self) -> bool:
        """Whether an autoregression predicts the residuals of any channel better than white noise, by AIC."""
        return self._in_time and any(not c.white for c in self._scores.colours.values())

    @cached_property
    def coloured_channels(self) -> tuple[str, ...]:
        """Channels whose residuals are coloured beyond chance."""
        if not self._in_time:
            return ()
        names, chance = self.objective.channel_names, _CHANCE / max(len(self._scores.colours), 1)
        return tuple(names[c] for c, gain in self._scores.gains.items() if gain > chdtri(ORDER, chance))

    @property
    def _in_time(self) -> bool:
        """Whether there are residuals that follow each other in time: those of a regression have no order."""
        objective = self.objective
        equations = isinstance(objective.equations, EquationPart) and bool(objective.problem.model.states)
        return self._inverse is not None and (objective.dynamics is not None or equations)

    @cached_property
    def sides(self) -> np.ndarray:
        """(2, parameters) how far the 95 % interval reaches below and above the estimates."""
        if self._inverse is None:
            return np.full((2, len(self.objective.problem.parameters)), np.nan)
        if not self.is_coloured:
            return np.sqrt(self._squares(*self._cramer_rao))
        wider = (stdtrit(self._freedom_of_colour, 0.975) / _Z95) ** 2
        coloured = wider[: self._count] * self._squares(*self._coloured)
        return np.sqrt(np.maximum(coloured, self._squares(*self._cramer_rao)))  # as of `honest`

    @property
    def _freedom_of_colour(self) -> np.ndarray:
        """(unknowns,) degrees of freedom of the coloured variances, whose autoregressions are estimated: twice the
        square over the variance of a variance (Satterthwaite, Biometrics Bull. 2, 1946)."""
        assert self._inverse is not None
        scores, variance = self._scores, np.diagonal(self._coloured[0])
        scatter = variance_scatter(scores.colours, scores.sums, self._pieces(), self._inverse)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(scatter > 0.0, np.maximum(2.0 * variance**2 / scatter, 1.0), np.inf)

    def _squares(self, base: np.ndarray, score: np.ndarray) -> np.ndarray:
        """(2, parameters) squares of the reach below and above, by a covariance and that of its gradient."""
        squares = np.tile(_Z95**2 * np.maximum(np.diagonal(base), 0.0), (2, 1))
        squares = squares if self._held is None else squares + self._held.sides(score, _Z95)
        return squares[:, : self._count]

    @property
    def _count(self) -> int:
        return len(self.objective.problem.parameters)

    @cached_property
    def _cramer_rao(self) -> tuple[np.ndarray, np.ndarray]:
        """Covariance of all unknowns within the limits that hold, and the covariance of the gradient that it comes
        from."""
        assert self._inverse is not None
        levels, inverse, information = self.value.noise.levels, self._inverse, self._information
        plain = not levels.proportional and (levels.share == 1.0).all()
        score = information if plain else self._scores.white
        covariance = inverse if plain else inverse @ score @ inverse
        if levels.fixed:
            return covariance, score
        data, further = score.copy(), len(score) - self._count
        data[: self._count, : self._count] -= np.diag(1.0 / self.objective.problem.prior_std**2)
        # initial states count in full; what path limits take from them is taken off again
        told = float(np.trace(inverse @ data)) if plain else self._free.shape[1]
        more = freedom(self.objective, levels, told - further) - 1.0
        if not np.isfinite(more):
            return np.full_like(score, np.nan), score
        return covariance + more * inverse @ data @ inverse, score + more * data

    @cached_property
    def _coloured(self) -> tuple[np.ndarray, np.ndarray]:
        """As `_cramer_rao`, with the colour of the residuals."""
        score = self._scores.coloured
        return self._inverse @ score @ self._inverse, score  # pyright: ignore[reportOptionalOperand]

    def _of_parameters(self, covariance: np.ndarray, score: np.ndarray) -> np.ndarray:
        """The parameters' part, with what leaving the limits adds."""
        found = covariance if self._held is None else covariance + self._held.covariance(score)
        return found[: self._count, : self._count]

    @cached_property
    def _held(self) -> HeldDirections | None:
        assert self._inverse is not None
        return held_directions(*self._limits, self._information, self._inverse)

    @cached_property
    def _limits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (limits, unknowns), multipliers and which are equations, of the limits of parameters and of the path."""
        assert self.linear is not None
        limits, paths = self.objective.limits, self._paths
        rows, equal = limits.at(self.linear.point.theta)[1], limits.lower == limits.upper
        if paths is None:
            return rows, self.limit_multipliers, equal
        wide = np.pad(rows, ((0, 0), (0, paths.rows.shape[1] - self._count)))
        multipliers = np.concatenate([self.limit_multipliers, paths.multipliers])
        return np.concatenate([wide, paths.rows]), multipliers, np.concatenate([equal, paths.equal])

    @cached_property
    def _paths(self) -> HeldPaths | None:
        assert self.linear is not None
        return self.objective.held_paths(self.linear)

    @cached_property
    def _information(self) -> np.ndarray:
        """(unknowns, unknowns) of the parameters and of what else path limits hold."""
        assert self.linear is not None
        further = 0 if self._paths is None else self._paths.rows.shape[1] - self._count
        return diagonal(self.linear.hessian, np.eye(further))

    @cached_property
    def confused(self) -> tuple[str, ...]:
        """Parameters that the data cannot tell apart, or of which they say nothing."""
        if self.linear is None:
            return ()
        return lost(self.objective, self.linear, self.limit_multipliers)

    @property
    def weakest(self) -> tuple[str, ...]:
        """Parameters of the direction that the data say least of."""
        return () if self.linear is None else weakest(self.objective, self.linear, self.limit_multipliers)

    @cached_property
    def _free(self) -> np.ndarray:
        rows, multipliers, equal = self._limits
        return free_directions(rows, np.where(equal, 1.0, multipliers))

    @cached_property
    def _inverse(self) -> np.ndarray | None:
        if self.linear is None or self.confused:
            return None
        try:
            return inverse_along(self._free, self._information)
        except np.linalg.LinAlgError:  # the parameters are not determined: their errors are no numbers
            return None

    @property
    def _unknown(self) -> np.ndarray:
        count = len(self.objective.problem.parameters)
        return np.full((count, count), np.nan)

    @cached_property
    def _scores(self) -> _Scores:
        levels, squares = self.value.noise.levels, self.value.squares
        return _score_covariances(levels, squares, self._pieces, self._information, self._free)

    def _pieces(self) -> Iterator[WhitePiece]:
        assert self.linear is not None
        return score_pieces(self.objective, self.value, self.linear, self._paths)


@dataclass(frozen=True, eq=False)
class Rescaled:
    """The standard errors of another scale of the parameters: `factor` (parameters,) is the change of each per change
    of what was estimated, `inflation` multiplies all variances, and `added` (parameters, parameters) is a covariance of
    other origin. Not `coloured`: residuals that say nothing of a colour, as of noise by formula."""

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
        """With the colour of the residuals."""
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
        log, factor = self.factor != 1.0, self.factor
        with np.errstate(over="ignore"):
            low = np.where(log, -np.expm1(-below) * factor, below)
            return np.stack([low, np.where(log, np.expm1(above) * factor, above)])

    def _scaled(self, covariance: np.ndarray) -> np.ndarray:
        scaled = self.inflation * covariance
        scaled = scaled if self.added is None else scaled + self.added
        return scaled * np.outer(self.factor, self.factor)

    @property
    def confused(self) -> tuple[str, ...]:
        """Parameters that the data cannot tell apart, or of which they say nothing."""
        return self.of.confused

    @property
    def objective(self) -> Objective:
        """As it was solved."""
        return self.of.objective

    @property
    def value(self) -> ObjectiveValue:
        """As it was solved."""
        return self.of.value

    @property
    def linear(self) -> Linearised | None:
        """As it was solved."""
        return self.of.linear


def uncertainty(
    objective: Objective, value: ObjectiveValue, linear: Linearised | None, limit_multipliers: np.ndarray
) -> Uncertainty:
    """The standard errors at a solution."""
    return Uncertainty(objective=objective, value=value, linear=linear, limit_multipliers=limit_multipliers)


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
    white, prior = information.copy(), prior_information(information, sums)
    for channel, own in sums.items():
        spread(white, own.gram(expected[channel] - 1.0))
    noise = noise_autocovariance(sums, prior, free)
    colours = {channel: estimated(noise[channel], own.count) for channel, own in sums.items()}
    coloured = prior + coloured_score(colours, sums, pieces(), len(prior))
    gains = {channel: gain(noise[channel], own.count) for channel, own in sums.items()}
    return _Scores(white=white, coloured=coloured, colours=colours, gains=gains, sums=sums)


def prior_information(information: np.ndarray, sums: Mapping[int, ChannelSums]) -> np.ndarray:
    """What the information has besides the data's, of which `sums` are gathered."""
    prior = information.copy()
    for own in sums.values():
        spread(prior, own.gram(-1.0))
    return prior


def score_pieces(
    objective: Objective, value: ObjectiveValue, linear: Linearised, paths: HeldPaths | None = None
) -> Iterator[WhitePiece]:
    """Sensitivities and residuals of all records and channels, outputs before equations; with `paths` the sensitivities
    also to the unknowns of theirs."""
    for record in range(len(objective.problem.records)):
        yield from _pieces(objective, value, linear, paths, record)


def _pieces(
    objective: Objective, value: ObjectiveValue, linear: Linearised, paths: HeldPaths | None, r: int
) -> Iterator[WhitePiece]:
    """Every channel of a record, of the output and of the equation part."""
    columns = objective.problem.columns(r)
    columns = columns if paths is None else np.concatenate([columns, paths.columns(r)])
    for first, rows, residuals, present in _parts(objective, value, linear, paths, r):
        wide = np.pad(rows, ((0, 0), (0, 0), (0, len(columns) - rows.shape[2])))
        for c in range(residuals.shape[1]):
            seen = present[:, c]
            if seen.any():
                yield WhitePiece(
                    channel=first + c, record=r, columns=columns, rows=wide[seen, c], residuals=residuals[seen, c]
                )


def _parts(
    objective: Objective, value: ObjectiveValue, linear: Linearised, paths: HeldPaths | None, r: int
) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
    """(first channel, rows (m, c, f), weighted residuals (m, c), present (m, c)) of the output and of the equation
    part, piece by piece: the rows of all samples would take most of the memory."""
    outputs = 0
    if value.trajectory is not None and objective.dynamics is not None:
        layout, n, weights = objective.layout, len(objective.scale), objective.whitening(value.noise.levels)
        own, outputs = layout.segments_of(r), layout.z.shape[2]
        motion = -linear.reduced[r].ds_p
        motion = motion if paths is None else np.concatenate([motion, paths.motion[r]], axis=2)
        for slab in objective.dynamics.slabs(value.trajectory, value.parameters[layout.record], weights, own):
            at = slab.segments, slab.samples
            by_state = motion[slab.segments.start - own.start : slab.segments.stop - own.start, None]
            rows = slab.rows[..., :n] @ by_state
            rows[..., : slab.rows.shape[3] - n] += slab.rows[..., n:]
            residuals = whitened(value.trajectory.y[at] - layout.z[at], weights, layout.pattern[at])
            present, width = layout.present[at] > 0, rows.shape[3]
            yield 0, rows.reshape(-1, outputs, width), residuals.reshape(-1, outputs), present.reshape(-1, outputs)
    if value.equations is not None:
        residuals = value.equations.residuals[r]
        weighted = np.nan_to_num(residuals) * objective.equation_weights(value.noise.levels)
        for samples, rows in objective.equation_slabs(value, r):
            yield outputs, rows, weighted[samples], np.isfinite(residuals[samples])


def freedom(objective: Objective, levels: Levels, parameters: float) -> float:
    """Factor N / (N - f) of the variance of noise that was estimated from N samples along with f unknowns; 1 where the
    noise was given, infinity where nothing is left of the samples.

    The unknowns are the `parameters` as far as the data and not a prior determine them. So are the initial states of
    all records that some output shows and of which the caller knew no more than the scale, and what the equations have
    eliminated. It is exact for one channel (Draper and Smith, Applied Regression Analysis, ch. 1); several channels
    share the unknowns evenly.
    """
    if levels.fixed:
        return 1.0
    unknown, samples = parameters + _initial_states(objective), levels.count
    unknown += objective.equations.eliminated if objective.equations is not None else 0
    return samples / (samples - unknown) if samples > unknown + 1e-9 else math.inf


def _initial_states(objective: Objective) -> int:
    if objective.dynamics is None:
        return 0
    model = objective.problem.model
    weak = objective.initial_precision * model.scale_vector() <= 1.0 + 1e-9
    return int((weak & ~objective.exact & shown_states(model)).sum())


def shown_states(model: Model) -> np.ndarray:
    """(states,) whether any output depends on the state, at once or by way of other states."""
    shown = np.array([ca.depends_on(model.h, model.x[i]) for i in range(len(model.states))], dtype=bool)
    moved_by = np.zeros((len(model.states),) * 2, dtype=bool)
    for motion in (model.f, *model.events.values()):
        moved_by |= np.array(ca.DM(ca.jacobian_sparsity(motion, model.x), 1.0).full(), dtype=bool)
    for _ in model.states:
        shown = shown | (shown @ moved_by)
    return shown


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldDirections:
    """Directions (parameters, k) that leave the active limits, along which they are left by one; multipliers (k,);
    curvature (k,) of -ln(likelihood) along them."""

    directions: np.ndarray
    multipliers: np.ndarray
    curvature: np.ndarray

    def distances(self, score: np.ndarray, z: float) -> np.ndarray:
        """(k,) of the limits at which -ln(likelihood) has risen by z^2/2; score (parameters, parameters)."""
        variance = np.maximum(np.einsum("ik,ij,jk->k", self.directions, score, self.directions), 0.0)
        known = self.curvature > 0.0
        excess = np.where(known, variance / np.where(known, self.curvature, 1.0), 1.0)
        pull = np.abs(self.multipliers)
        return excess * z**2 / (pull + np.sqrt(pull**2 + variance * z**2))

    def covariance(self, score: np.ndarray) -> np.ndarray:
        """(parameters, parameters) what leaving the limits by one deviation adds."""
        moved = self.directions * self.distances(score, 1.0)
        return moved @ moved.T

    def sides(self, score: np.ndarray, z: float) -> np.ndarray:
        """(2, parameters) squared changes of the parameters, down and up, at z deviations."""
        moved = -self.directions * np.sign(self.multipliers) * self.distances(score, z)
        return np.stack([(np.minimum(moved, 0.0) ** 2).sum(axis=1), (np.maximum(moved, 0.0) ** 2).sum(axis=1)])


def held_directions(
    rows: np.ndarray, multipliers: np.ndarray, equal: np.ndarray, hessian: np.ndarray, inverse: np.ndarray
) -> HeldDirections | None:
    """Of limits `rows` (rows, parameters); `equal` (rows,) those that are no inequality, which are never left.
    `inverse` is that of the information `hessian` in the directions that are free. None where nothing is held."""
    active = (multipliers != 0.0) & ~equal
    if not active.any():
        return None
    holding = active | equal
    leaving = np.linalg.pinv(rows[holding])[:, active[holding]]
    directions = leaving - inverse @ (hessian @ leaving)
    curvature = np.einsum("ik,ij,jk->k", directions, hessian, directions)
    return HeldDirections(directions=directions, multipliers=multipliers[active], curvature=curvature)
