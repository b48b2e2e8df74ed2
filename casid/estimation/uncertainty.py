"""Standard errors: Cramer-Rao bound, and its correction for coloured residuals.

Initial states, and every other unknown of a record, are eliminated, not fixed: a sample's row is its sensitivity to
the parameters with the states re-estimated (u_i below), obtained from the same banded system as the step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from casid.estimation.objective import Linearised, Objective, Value
from casid.estimation.quadratic import inverse_along, jacobi_scale
from casid.estimation.residual_colour import Piece, coloured_score, gathered

_RANK = 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class Uncertainty:
    """Covariance (parameters, parameters) by Cramer-Rao and with coloured residuals; `confused` names of parameters
    that the data cannot tell apart (their variances are infinite)."""

    covariance: np.ndarray
    corrected: np.ndarray
    confused: tuple[str, ...]


def uncertainty(objective: Objective, value: Value, linear: Linearised, limit_multipliers: np.ndarray) -> Uncertainty:
    """Both covariances at a solution.

    Cramer-Rao: inverse of the information; with weights that are not the inverse noise (range weights, combined cost)
    the covariance that white residuals of the observed variance give. Noise that was estimated is at its maximum of
    likelihood, which does not count the parameters: with N samples of a channel and f parameters the variance is about
    f/N too small. Corrected: the residuals' autocorrelation in place of white noise (Maine and Iliff, NASA RP-1138;
    Morelli and Klein, J. Aircraft 34, 1997), by an autoregression of each channel that counts the parameters (see
    residual_colour); channels count as independent. Parameters held by an active limit have no variance along it.
    """
    information = linear.hessian
    names = objective.problem.parameters
    free = _free_directions(objective.rows[np.abs(limit_multipliers) > 0], len(names))
    inner = free.T @ information @ free
    scale = jacobi_scale(inner) if len(inner) else np.zeros(0)
    eigenvalues, vectors = np.linalg.eigh(inner * np.outer(scale, scale))
    lost = vectors[:, eigenvalues < _RANK]
    confused: tuple[str, ...] = ()
    if lost.size:
        weight = np.abs(free @ (scale[:, None] * lost)).max(axis=1) / (np.abs(free) @ scale + 1e-300)
        confused = tuple(name for name, w in zip(names, weight, strict=True) if w > 0.1)
        infinite = np.full((len(names), len(names)), np.nan)
        return Uncertainty(covariance=infinite, corrected=infinite, confused=confused)
    inverse = inverse_along(free, information)
    white, coloured = _score_covariances(objective, value, linear, free)
    return Uncertainty(covariance=inverse @ white @ inverse, corrected=inverse @ coloured @ inverse, confused=confused)


def _free_directions(active: np.ndarray, count: int) -> np.ndarray:
    return null_space(active) if len(active) else np.eye(count)


def _score_covariances(
    objective: Objective, value: Value, linear: Linearised, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of the gradient for white and for coloured residuals, (parameters, parameters) each."""
    levels = objective.levels
    expected = levels.share * (levels.rms(value.squares) / levels.sigma) ** 2 if levels.proportional else levels.share

    def pieces() -> Iterator[Piece]:
        for record in range(len(objective.problem.records)):
            yield from _pieces(objective, value, linear, record)

    sums = gathered(pieces())
    white, prior = linear.hessian.copy(), linear.hessian.copy()
    for channel, own in sums.items():
        own.spread(white, own.inner(np.array([expected[channel] - 1.0])))
        own.spread(prior, own.inner(np.array([-1.0])))
    return white, prior + coloured_score(sums, pieces, prior, free)


def _pieces(objective: Objective, value: Value, linear: Linearised, r: int) -> Iterator[Piece]:
    """Every channel of a record, of the output and of the equation part."""
    columns, channel = objective.problem.columns(r), 0
    for rows, residuals, present in _parts(objective, value, linear, r):
        for c in range(residuals.shape[1]):
            if present[:, c].any():
                seen = present[:, c]
                yield Piece(
                    channel=channel, record=r, columns=columns, rows=rows[seen, c], residuals=residuals[seen, c]
                )
            channel += 1


def _parts(
    objective: Objective, value: Value, linear: Linearised, r: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(rows (N, c, f), weighted residuals (N, c), present (N, c)) of the output and of the equation part."""
    if linear.blocks is not None and value.trajectory is not None:
        layout, n = objective.layout, len(objective.scale)
        own = layout.segments_of(r)
        outputs = layout.z.shape[2]
        jacobian = linear.blocks.jacobian[own]
        rows = jacobian[..., n:] - jacobian[..., :n] @ linear.reduced[r].ds_p
        residuals = (value.trajectory.y - layout.z) * layout.present * objective.output_weights
        keep = layout.sample[r] - layout.sample[r][0]
        yield (
            rows.reshape(-1, outputs, rows.shape[2])[keep], residuals[own].reshape(-1, outputs)[keep],
            layout.present[own].reshape(-1, outputs)[keep] > 0,
        )  # fmt: skip
    if value.equations is not None:
        residuals = value.equations.residuals[r]
        weighted = np.nan_to_num(residuals) * objective.equation_weights
        yield linear.equation_jacobian[r], weighted, np.isfinite(residuals)
