"""The Gauss-Newton step of one record: a banded system in (states, multipliers) with the parameters as its border.

    min  sum_j 1/2 [ds_j; dp]' H_j [ds_j; dp] + g_j' [ds_j; dp]
    s.t. ds_{j+1} - A_j ds_j - B_j dp - Q_j lambda_{j+1} = d_j
Q = 0 is the hard defect; Q > 0 pays 1/2 e' Q^-1 e for a defect e without ever inverting Q.
Ordered s_0, lambda_1, s_1, lambda_2, ... the matrix has the half bandwidth 2 n - 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import get_lapack_funcs

(_gbsv,) = get_lapack_funcs(("gbsv",), dtype=np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class Reduced:
    """The step of one record as a function of the parameter step: ds = ds0 - ds_p dp, lambda = l0 - l_p dp, and the
    reduced Hessian and gradient in the free parameters of this record."""

    ds0: np.ndarray
    ds_p: np.ndarray
    l0: np.ndarray
    l_p: np.ndarray
    hessian: np.ndarray
    gradient: np.ndarray


class BandedKKT:
    """Index maps of a record with `segments` segments and n states; `solve` fills and factorises."""

    def __init__(self, segments: int, n: int) -> None:
        self.segments, self.n = segments, n
        self.size, self.band = n * (2 * segments - 1), 2 * n - 1
        rows = 3 * self.band + 1
        i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        step = 2 * n * np.arange(segments)

        def place(first_row: np.ndarray, first_column: np.ndarray) -> np.ndarray:
            """Flat position in LAPACK's band storage (column-major) of n x n blocks."""
            r, c = first_row[:, None, None] + i, first_column[:, None, None] + j
            return (2 * self.band + r - c + rows * c).ravel()

        tied = step[:-1]
        self._h = place(step, step)
        self._at, self._a = place(tied, tied + n), place(tied + n, tied)
        self._q = place(tied + n, tied + n)
        self._up, self._low = place(tied + n, tied + 2 * n), place(tied + 2 * n, tied + n)
        self._matrix = np.zeros((rows, self.size), order="F")

    def solve(
        self, hessian: np.ndarray, gradient: np.ndarray, a: np.ndarray, b: np.ndarray, defect: np.ndarray,
        covariance: np.ndarray | None, scale: np.ndarray,
    ) -> Reduced:  # fmt: skip
        """hessian (M, n+f, n+f), gradient (M, n+f); a (M-1, n, n), b (M-1, n, f), defect (M-1, n) and the covariance
        (M-1, n, n) or None of the segments that have a successor; scale (n,) typical size of the states.

        Raises numpy.linalg.LinAlgError when the system is singular.
        """
        n, m = self.n, self.segments
        f = hessian.shape[1] - n
        diagonal = np.diagonal(hessian[:, :n, :n], axis1=1, axis2=2) * scale**2
        so = 1.0 / max(float(np.median(diagonal.max(axis=1))), 1e-300)
        outer = scale[:, None] * scale
        flat = self._matrix.ravel(order="K")
        flat[:] = 0.0
        flat[self._h] = (hessian[:, :n, :n] * (so * outer)).ravel()
        a_scaled = -a * (scale / scale[:, None])
        flat[self._a], flat[self._at] = a_scaled.ravel(), a_scaled.transpose(0, 2, 1).ravel()
        flat[self._up] = flat[self._low] = np.broadcast_to(np.eye(n), (m - 1, n, n)).ravel()
        if covariance is not None:
            flat[self._q] = (-covariance / (so * outer)).ravel()
        right = np.zeros((2 * m - 1, n, f + 1))
        right[0::2, :, 0] = -gradient[:, :n] * (so * scale)
        right[0::2, :, 1:] = hessian[:, :n, n:] * (so * scale[:, None])
        right[1::2, :, 0] = defect / scale
        right[1::2, :, 1:] = -b / scale[:, None]
        right = right.reshape(self.size, f + 1)
        _, _, solution, info = _gbsv(self.band, self.band, self._matrix, right, overwrite_ab=1)
        if info != 0 or not np.isfinite(solution).all():
            raise np.linalg.LinAlgError("singular states and multipliers")
        border = right[:, 1:]
        reduced = hessian[:, n:, n:].sum(axis=0) - border.T @ solution[:, 1:] / so
        slope = gradient[:, n:].sum(axis=0) + border.T @ solution[:, 0] / so
        solution = solution.reshape(2 * m - 1, n, f + 1)
        states, multipliers = solution[0::2] * scale[:, None], solution[1::2] / (so * scale[:, None])
        return Reduced(
            ds0=states[..., 0], ds_p=states[..., 1:], l0=multipliers[..., 0], l_p=multipliers[..., 1:],
            hessian=0.5 * (reduced + reduced.T), gradient=slope,
        )  # fmt: skip
