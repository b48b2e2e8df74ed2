"""Fixed points of a slowly contracting map, by extrapolation."""

from __future__ import annotations

import numpy as np

_DEPTH = 5  # earlier values that are combined
_INDEPENDENT = 1e-8  # of the largest difference of residuals: what is less is no information


class FixedPoint:
    """Anderson's mixing for x = g(x) (J. ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011): of the affine
    combinations of the last values the one whose residual g(x) - x would be least, were g linear."""

    def __init__(self) -> None:
        self._x: list[np.ndarray] = []
        self._residual: list[np.ndarray] = []

    def following(self, x: np.ndarray, image: np.ndarray) -> np.ndarray:
        """(n,) where the fixed point is expected, after g(x) = image was found, both (n,). Values are forgotten when
        the residual has grown: the map is not yet linear."""
        residual = image - x
        if self._residual and np.abs(residual).max(initial=0.0) > np.abs(self._residual[-1]).max(initial=0.0):
            self._x = []
            self._residual = []
        self._x = [*self._x, x][-_DEPTH - 1 :]
        self._residual = [*self._residual, residual][-_DEPTH - 1 :]
        if len(self._x) == 1:
            return image
        by_x = np.diff(self._x, axis=0).T
        by_residual = np.diff(self._residual, axis=0).T
        weights = np.linalg.lstsq(by_residual, residual, rcond=_INDEPENDENT)[0]
        return image - (by_x + by_residual) @ weights
