"""The Gauss-Newton step of one record: a banded system in (states, multipliers) with the parameters as its border.

    min  sum_j 1/2 [ds_j; dp]' H_j [ds_j; dp] + g_j' [ds_j; dp]
    s.t. ds_{j+1} - A_j ds_j - B_j dp - Q_j lambda_{j+1} = d_j
Q = 0 is the hard defect; Q > 0 pays 1/2 e' Q^-1 e for a defect e without ever inverting Q.
Ordered s_0, lambda_1, s_1, lambda_2, ... the matrix has the half bandwidth 2 n - 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import get_lapack_funcs

from casid.estimation.transcriptions.dynamics import Reducing

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
    """The system of a record with `segments` segments and n states; `solve` fills and factorises."""

    def __init__(self, segments: int, n: int) -> None:
        self.segments = segments
        self.n = n
        self.size = n * (2 * segments - 1)
        self.band = 2 * n - 1

    @cached_property
    def _places(self) -> tuple[np.ndarray, ...]:
        """Indices of the n x n blocks in LAPACK's band storage."""
        n = self.n
        rows = 3 * self.band + 1
        i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        step = 2 * n * np.arange(self.segments)

        def place(first_row: np.ndarray, first_column: np.ndarray) -> np.ndarray:
            r = first_row[:, None, None] + i
            c = first_column[:, None, None] + j
            return (2 * self.band + r - c + rows * c).ravel()

        tied = step[:-1]
        return (
            place(step, step),
            place(tied + n, tied),
            place(tied, tied + n),
            place(tied + n, tied + 2 * n),
            place(tied + 2 * n, tied + n),
            place(tied + n, tied + n),
        )

    @cached_property
    def _band_storage(self) -> np.ndarray:
        return np.zeros((3 * self.band + 1) * self.size)

    def solve(
        self,
        hessian: np.ndarray,
        gradient: np.ndarray,
        transition: np.ndarray,
        defect: np.ndarray,
        covariance: np.ndarray | None,
        scale: np.ndarray,
        kernel: Reducing | None = None,
    ) -> Reduced:
        """hessian (M, n+f, n+f), gradient (M, n+f), transition (M, n, n+f) [A, B]. Defects (M-1, n) and the covariance
        (M-1, n, n) or None of the segments that have a successor; scale (n,) typical size of the states. By the
        kernel when one is given, else by LAPACK.

        Raises numpy.linalg.LinAlgError when the system is singular.
        """
        reduce = self._by_lapack if kernel is None else kernel.reduce
        states, multipliers, information = reduce(hessian, gradient, transition, defect, covariance, scale)
        if not np.isfinite(information).all():  # every unknown is in it
            raise np.linalg.LinAlgError("singular states and multipliers")
        reduced = information[:, 1:]
        return Reduced(
            ds0=states[..., 0],
            ds_p=states[..., 1:],
            l0=multipliers[..., 0],
            l_p=multipliers[..., 1:],
            hessian=0.5 * (reduced + reduced.T),
            gradient=-information[:, 0],
        )

    def _by_lapack(
        self,
        hessian: np.ndarray,
        gradient: np.ndarray,
        transition: np.ndarray,
        defect: np.ndarray,
        covariance: np.ndarray | None,
        scale: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What `Reduction` gives."""
        n = self.n
        m = self.segments
        a = transition[:-1, :, :n]
        b = transition[:-1, :, n:]
        f = hessian.shape[1] - n
        diagonal = np.diagonal(hessian[:, :n, :n], axis1=1, axis2=2) * scale**2
        so = 1.0 / max(float(diagonal.max(axis=1).mean()), 1e-300)
        outer = scale[:, None] * scale
        flat = self._band_storage
        flat[:] = 0.0
        at_h, at_a, at_at, at_up, at_low, at_q = self._places
        flat[at_h] = (hessian[:, :n, :n] * (so * outer)).ravel()
        a_scaled = -a * (scale / scale[:, None])
        flat[at_a], flat[at_at] = a_scaled.ravel(), a_scaled.transpose(0, 2, 1).ravel()
        flat[at_up] = flat[at_low] = np.broadcast_to(np.eye(n), (m - 1, n, n)).ravel()
        if covariance is not None:
            flat[at_q] = (-covariance / (so * outer)).ravel()
        right = np.zeros((2 * m - 1, n, f + 1))
        right[0::2, :, 0] = -gradient[:, :n] * (so * scale)
        right[0::2, :, 1:] = hessian[:, :n, n:] * (so * scale[:, None])
        right[1::2, :, 0] = defect / scale
        right[1::2, :, 1:] = -b / scale[:, None]
        right = right.reshape(self.size, f + 1)
        matrix = flat.reshape(self.size, -1).T
        _, _, solution, info = _gbsv(self.band, self.band, matrix, right, overwrite_ab=1)
        if info != 0 or not np.isfinite(solution).all():
            raise np.linalg.LinAlgError("singular states and multipliers")
        eliminated = right[:, 1:].T @ solution / so
        slope = gradient[:, n:].sum(axis=0) + eliminated[:, 0]
        reduced = hessian[:, n:, n:].sum(axis=0) - eliminated[:, 1:]
        solution = solution.reshape(2 * m - 1, n, f + 1)
        states = solution[0::2] * scale[:, None]
        multipliers = solution[1::2] / (so * scale[:, None])
        return states, multipliers, np.column_stack([-slope, reduced])


def without_starts(hessian: np.ndarray, gradient: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start states (n) of segments that nothing ties, eliminated from hessian (..., n+f, n+f) and gradient (..., n+f):
    (..., n, f+1) by how much they follow the parameters and, last, by themselves; information (..., f, f) and gradient
    (..., f) of the parameters."""
    by_state = hessian[..., :n, n:]
    by_parameter = hessian[..., n:, :n]
    follow = np.linalg.solve(hessian[..., :n, :n], np.concatenate([by_state, gradient[..., :n, None]], axis=-1))
    inner = hessian[..., n:, n:] - by_parameter @ follow[..., :-1]
    return follow, inner, gradient[..., n:] - (by_parameter @ follow[..., -1:])[..., 0]
