"""Noise of the measured channels with correlations between them: one covariance, given or estimated.

Of a sample that lacks channels, the marginal distribution of the others is used. Sufficient for everything here are the
moments: for each pattern p of present channels the sum of r r' of its residuals, (patterns, o, o), zero where missing.

For given residuals the covariance of highest likelihood is their mean square, where every sample is complete. Otherwise
it is reached by expectation and maximisation (Dempster, Laird and Rubin, J. R. Stat. Soc. B 39, 1977): what is missing
is replaced by what the present channels let expect of it, and no such step lowers the likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from casid.estimation.solvers.levels import NoiseLevels

_ROUNDS = 2000  # of expectation and maximisation
_SETTLED = 1e-12  # change of a covariance in units of its standard deviations


@dataclass(frozen=True, eq=False, kw_only=True)
class FullNoise:
    """Covariance `matrix` (o, o) of the noise of the outputs, `fixed` when it was given; the same interface as
    NoiseLevels.
    """

    matrix: np.ndarray
    fixed: bool
    share: np.ndarray  # share, present: (o,) as in NoiseLevels; the share is one everywhere
    present: np.ndarray
    measured: np.ndarray  # moments of the measurements: rounding of the residuals is relative to them
    floor: np.ndarray  # moments that are always added: data without noise
    # number, present channels and samples of each pattern that occurs
    patterns: tuple[tuple[int, np.ndarray, int], ...]

    full: ClassVar[bool] = True
    proportional: ClassVar[bool] = False

    @property
    def count(self) -> int:
        """Samples of all channels together."""
        return max(int(self.present.sum()), 1)

    @property
    def sigma(self) -> np.ndarray:
        """(o,) 1-sigma of each channel."""
        return np.sqrt(np.diagonal(self.matrix))

    @property
    def size(self) -> float:
        """Norm of all measurements in units of the noise."""
        return float(np.sqrt(2.0 * self.cost(self.measured)))

    def whitening(self, seen: np.ndarray) -> np.ndarray:
        """(patterns, o, o): the inverse of the Cholesky factor of the covariance of what is present."""
        found = np.zeros((*seen.shape, seen.shape[1]))
        for p, present in enumerate(seen):
            s = np.flatnonzero(present)
            found[p][np.ix_(s, s)] = np.linalg.inv(np.linalg.cholesky(self.matrix[np.ix_(s, s)]))
        return found

    def rms(self, moments: np.ndarray) -> np.ndarray:
        """(o,) root mean square of the residuals of each channel."""
        return np.sqrt(np.diagonal(moments.sum(axis=0)) / np.maximum(self.present, 1))

    def relaxed(self, moments: np.ndarray) -> tuple[FullNoise, float]:
        """Return a copy with the covariance that the moments of the residuals give, and the largest relative change
        of a 1-sigma in any direction."""
        if self.fixed:
            return self, 0.0
        matrix = self._likeliest(moments)
        whiten = np.linalg.inv(np.linalg.cholesky(self.matrix))
        change = 0.5 * float(np.abs(np.log(np.linalg.eigvalsh(whiten @ matrix @ whiten.T))).max())
        return replace(self, matrix=matrix), change

    @property
    def coordinates(self) -> np.ndarray:
        """(o (o + 1)/2,) the logarithms of the diagonal of the Cholesky factor, what stands left of it over it, in
        units of the standard deviations with which residuals of independent channels determine them."""
        factor = np.linalg.cholesky(self.matrix)
        diagonal = np.diagonal(factor)
        return (np.tril(factor / diagonal[:, None], -1) + np.diag(np.log(diagonal)))[self._triangle] * self._precision

    def at(self, coordinates: np.ndarray) -> FullNoise:
        """Return a copy with the covariance at these `coordinates`."""
        factor = np.zeros_like(self.matrix)
        factor[self._triangle] = coordinates / self._precision
        diagonal = np.exp(np.diagonal(factor))
        factor = (np.tril(factor, -1) + np.eye(len(factor))) * diagonal[:, None]
        return replace(self, matrix=factor @ factor.T)

    @property
    def _triangle(self) -> tuple[np.ndarray, np.ndarray]:
        return np.tril_indices(len(self.matrix))

    @property
    def _precision(self) -> np.ndarray:
        row, column = self._triangle
        return np.sqrt(np.where(row == column, 2.0, 1.0) * np.maximum(self.present[row], 1))

    def cost(self, moments: np.ndarray) -> float:
        """Half the sum of squared whitened residuals."""
        return 0.5 * self._squares(moments, self.matrix)

    def concentrated(self, moments: np.ndarray) -> float:
        """The cost with the covariance at its optimum for these residuals, up to a constant."""
        if not np.isfinite(moments).all():
            return np.inf
        matrix = self._likeliest(moments)
        return 0.5 * (self._log_determinants(matrix) + self._squares(moments + self.floor, matrix))

    def log_likelihood(self, moments: np.ndarray) -> float:
        """Return the log-likelihood of residuals with these moments under the present covariance."""
        constant = self.count * np.log(2.0 * np.pi)
        return -0.5 * float(self._log_determinants(self.matrix) + constant) - self.cost(moments)

    def _squares(self, moments: np.ndarray, matrix: np.ndarray) -> float:
        total = 0.0
        for p, s, _ in self.patterns:
            own = np.ix_(s, s)
            total += float(np.trace(np.linalg.solve(matrix[own], moments[p][own])))
        return total

    def _log_determinants(self, matrix: np.ndarray) -> float:
        return sum(count * float(np.linalg.slogdet(matrix[np.ix_(s, s)])[1]) for _, s, count in self.patterns)

    def _likeliest(self, moments: np.ndarray) -> np.ndarray:
        """The covariance of highest likelihood for residuals with these moments."""
        matrix = self.matrix
        moments = moments + self.floor
        for _ in range(_ROUNDS):
            former = matrix
            matrix = self._expected(moments, matrix)
            sigma = np.sqrt(np.diagonal(matrix))
            if (np.abs(matrix - former) < _SETTLED * np.outer(sigma, sigma)).all():
                break
        return matrix

    def _expected(self, moments: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Mean over the samples of the expected r r', where a channel is missing under `matrix`."""
        total = np.zeros_like(matrix)
        samples = 0
        for p, s, count in self.patterns:
            own = np.ix_(s, s)
            gain = np.linalg.solve(matrix[own], matrix[s]).T
            gain[s] = np.eye(len(s))
            total += gain @ moments[p][own] @ gain.T
            if len(s) < len(matrix):
                rest = matrix - gain @ matrix[s]
                rest[s] = 0.0
                rest[:, s] = 0.0
                total += count * rest
            samples += count
        return 0.5 * (total + total.T) / samples


def full_noise(
    levels: NoiseLevels,
    given: np.ndarray | None,
    names: tuple[str, ...],
    seen: np.ndarray,
    pattern: np.ndarray,
    z: np.ndarray,
) -> FullNoise:
    """The covariance to begin with: the independent `levels`, or `given` when it is known.

    seen (patterns, o) 1 where present, pattern (...) of each sample, z (..., o) measurements, zero where missing.
    """
    counts = np.bincount(pattern.ravel(), minlength=len(seen))
    patterns = tuple(
        (p, np.flatnonzero(present), int(count))
        for p, (present, count) in enumerate(zip(seen, counts, strict=True))
        if count and present.any()
    )
    floor = np.zeros((len(seen), len(names), len(names)))
    for p, s, count in patterns:
        floor[p, s, s] = 0.0 if given is not None else count * levels.floor[s] ** 2
    return FullNoise(
        matrix=np.diag(levels.sigma**2) if given is None else 0.5 * (given + given.T),
        fixed=given is not None,
        share=np.ones(len(names)),
        present=counts @ seen,
        measured=moments_of(z, pattern, seen),
        floor=floor,
        patterns=patterns,
    )


def moments_of(residuals: np.ndarray, pattern: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(patterns, o, o) sum of r r' of the residuals (..., o) with each pattern (...)."""
    found = np.empty((len(seen), seen.shape[1], seen.shape[1]))
    for p, present in enumerate(seen):
        own = residuals[pattern == p] * present
        found[p] = own.T @ own
    return found
