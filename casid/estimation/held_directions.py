"""Errors of parameters that an active limit holds.

Errors at an active limit have one side. A limit r'p <= b has a multiplier m > 0: along the direction V that leaves it,
all other parameters following, -ln(likelihood) rises by m d + K d^2/2 with the distance d, K = V'HV. It has risen by
z^2/2 at

    d = z^2 / (m + sqrt(m^2 + K z^2)).

This is z standard deviations of the free estimate where the limit is only just active, and z^2/(2 m) where the
multiplier is large. For noise other than the information H assumes, with the covariance S of the gradient, K becomes
V'SV under the root and d is V'SV/K times as large. Each of several active limits counts separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
    """Return the directions that limits `rows` (rows, parameters) hold; `equal` (rows,) marks equalities, which are
    never left. `inverse` is that of the information `hessian` in the directions that are free. None where nothing is
    held."""
    active = (multipliers != 0.0) & ~equal
    if not active.any():
        return None
    holding = active | equal
    leaving = np.linalg.pinv(rows[holding])[:, active[holding]]
    directions = leaving - inverse @ (hessian @ leaving)
    curvature = np.einsum("ik,ij,jk->k", directions, hessian, directions)
    return HeldDirections(directions=directions, multipliers=multipliers[active], curvature=curvature)
