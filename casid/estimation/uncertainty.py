"""Standard errors: Cramer-Rao bound, and its correction for coloured residuals.

Initial states, and every other unknown of a record, are eliminated, not fixed: a sample's row is its sensitivity to
the parameters with the states re-estimated (u_i below), obtained from the same banded system as the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from casid.estimation.objective import Linearised, Objective, Value
from casid.estimation.quadratic import jacobi_scale

_LAGS = 0.2  # of the record: lags of the residual autocorrelation that are used (Morelli and Klein)
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
    the covariance that white residuals of the observed variance give. Corrected: the residuals' autocorrelation in
    place of white noise (Maine and Iliff, NASA RP-1138; Morelli and Klein, J. Aircraft 34, 1997). Parameters held by
    an active limit have no variance along it.
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
    inverse = free @ (scale[:, None] * np.linalg.inv(inner * np.outer(scale, scale)) * scale) @ free.T
    white, coloured = _score_covariances(objective, value, linear)
    return Uncertainty(covariance=inverse @ white @ inverse, corrected=inverse @ coloured @ inverse, confused=confused)


def _free_directions(active: np.ndarray, count: int) -> np.ndarray:
    return null_space(active) if len(active) else np.eye(count)


def _score_covariances(objective: Objective, value: Value, linear: Linearised) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of the gradient for white and for coloured residuals, (parameters, parameters) each."""
    white, coloured = linear.hessian.copy(), linear.hessian.copy()
    for rows, residuals, share, columns in _channels(objective, value, linear):
        grid = np.ix_(columns, columns)
        used = rows.T @ rows
        white[grid] += (share - 1.0) * used
        coloured[grid] += _coloured(rows, residuals) - used
    return white, coloured


def _channels(objective: Objective, value: Value, linear: Linearised):
    """(rows (N, f), weighted residuals (N,), their variance, columns) of each record and channel."""
    problem = objective.problem
    for r in range(len(problem.records)):
        columns = problem.columns(r)
        for rows, residuals, share in _record_channels(objective, value, linear, r):
            for c in range(residuals.shape[1]):
                seen = np.abs(rows[:, c]).sum(axis=1) > 0
                variance = float((residuals[seen, c] ** 2).mean()) if seen.any() else 0.0
                found = variance if objective.levels.proportional else share
                yield rows[:, c], residuals[:, c], found, columns


def _record_channels(objective: Objective, value: Value, linear: Linearised, r: int):
    """(rows (N, c, f), weighted residuals (N, c), share in the cost) of the output and of the equation part."""
    if linear.blocks is not None and value.trajectory is not None:
        layout, n = objective.layout, len(objective.scale)
        own = layout.segments_of(r)
        outputs = layout.z.shape[2]
        jacobian = linear.blocks.jacobian[own]
        rows = jacobian[..., n:] - jacobian[..., :n] @ linear.reduced[r].ds_p
        residuals = (value.trajectory.y - layout.z) * layout.present * objective.output_weights
        residuals = residuals[own].reshape(-1, outputs)
        keep = layout.sample[r] - layout.sample[r][0]
        yield rows.reshape(-1, outputs, rows.shape[2])[keep], residuals[keep], objective.part
    if value.equations is not None:
        residuals = np.nan_to_num(value.equations.residuals[r]) * objective.equation_weights
        yield linear.equation_jacobian[r], residuals, objective.equation_share


def _coloured(rows: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """(f, f) sum over i, j of rows_i R(i - j) rows_j' with the autocovariance R of the residuals.

    The biased estimate under a triangular window is positive semidefinite, so that variances come out positive.
    By Parseval's theorem: the sum over frequencies of the rows' spectra times that of R.
    """
    count = len(residuals)
    present = max(int(np.count_nonzero(residuals)), 1)
    lags = min(max(int(_LAGS * count), 1), count - 1)
    size = 1 << (count + lags - 1).bit_length()  # long enough for products at `lags` not to wrap around
    covariance = np.fft.irfft(np.abs(np.fft.rfft(residuals, size)) ** 2, size)[: lags + 1] / present
    covariance *= 1.0 - np.arange(lags + 1) / (lags + 1)
    kernel = np.zeros(size)
    kernel[: lags + 1] = covariance
    kernel[size - lags :] = covariance[:0:-1]
    density = np.fft.rfft(kernel).real / size
    density[1 : (size + 1) // 2] *= 2.0  # of a real signal only half of the frequencies are computed
    spectra = np.fft.rfft(rows.T, size)  # along the last axis, which is contiguous
    return (spectra.real * density) @ spectra.real.T + (spectra.imag * density) @ spectra.imag.T
