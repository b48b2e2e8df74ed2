"""Noise levels of the measured channels: given, estimated from the residuals, or weights by range."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casid.errors import InputError, unknown
from casid.estimation.cost import RangeWeights

_START = 0.05  # of a channel's range, before any residual is known
_FLOOR = 1e-7  # of a channel's range: data without noise


class NoiseLevels:
    """sigma (channels,) that residuals are divided by; `fixed` when it was given.

    Estimated: the root mean square of each channel's residuals, which is the likelihood's maximum for given
    parameters. Range weights: their proportions stay (paper eq. 13), and one common factor makes the mean square of
    all weighted residuals one, so that priors weigh against the data as they should.
    share (channels,) is the weight of each channel's part in the cost.
    Raises InputError for a noise that names other channels than `names` or is not positive.
    """

    full = False

    def __init__(
        self,
        noise: Mapping[str, float] | RangeWeights | None,
        names: tuple[str, ...],
        measured: np.ndarray,
        share: np.ndarray,
    ) -> None:
        self.share = share
        self.present = np.isfinite(measured).sum(axis=0)
        self.count = max(int(self.present.sum()), 1)
        filled = np.where(self.present > 0, measured, 0.0)
        spread = np.nanmax(filled, axis=0) - np.nanmin(filled, axis=0)
        self.floor = _FLOOR * np.maximum(spread, 1e-3 * np.nanmax(np.abs(filled), axis=0) + 1e-12)
        self.proportional = isinstance(noise, RangeWeights)
        self.fixed = noise is not None and not self.proportional
        if noise is None:
            sigma = np.maximum(_START * spread, self.floor)
        elif isinstance(noise, RangeWeights):
            sigma = _START / noise.weights(filled)
        else:
            sigma = _given(noise, names)
        self.sigma = np.where(self.present > 0, sigma, 1.0)
        self._start = self.sigma
        self._magnitude = np.nansum(filled**2, axis=0)

    @property
    def size(self) -> float:
        """Norm of all measurements in units of sigma: rounding of the residuals is relative to it."""
        return float(np.sqrt((self._magnitude / self.sigma**2).sum()))

    def whitening(self, seen: np.ndarray) -> np.ndarray:
        """(patterns, o, o) lower triangle that makes the residuals of the first o channels white where `seen`
        (patterns, o), zero in the rows and columns of what is missing."""
        return seen[:, :, None] * np.diag(1.0 / self.sigma[: seen.shape[1]])

    def rms(self, squares: np.ndarray) -> np.ndarray:
        """(channels,) root mean square, from sums of squared residuals; floored where there is no noise."""
        found = np.sqrt(squares / np.maximum(self.present, 1))
        return np.where(self.present > 0, np.maximum(found, self.floor), 1.0)

    def relax(self, squares: np.ndarray) -> float:
        """Put sigma to what the sums of squared residuals say; the largest relative change."""
        if self.fixed:
            return 0.0
        rms = self.rms(squares)
        sigma = self._start * self._common_factor(rms) if self.proportional else rms
        change = float(np.abs(np.log(sigma / self.sigma)).max(initial=0.0))
        self.sigma = sigma
        return change

    @property
    def coordinates(self) -> np.ndarray:
        """(channels,) ln sigma in units of the standard deviation with which the residuals tell it."""
        return np.log(self.sigma) * self._precision

    @coordinates.setter
    def coordinates(self, found: np.ndarray) -> None:
        self.sigma = np.exp(found / self._precision)

    @property
    def _precision(self) -> np.ndarray:
        return np.sqrt(2.0 * np.maximum(self.present, 1))

    def cost(self, squares: np.ndarray) -> float:
        """Half the sum of squared weighted residuals, from sums of squared residuals."""
        return 0.5 * float((self.share * squares / self.sigma**2).sum())

    @property
    def matrix(self) -> np.ndarray:
        """(channels, channels) covariance."""
        return np.diag(self.sigma**2)

    def log_likelihood(self, squares: np.ndarray) -> float:
        """Of residuals with these sums of squares; with range weights, under the noise that the residuals show."""
        sigma = self.rms(squares) if self.proportional else self.sigma
        return -float((0.5 * squares / sigma**2 + self.present * np.log(sigma * np.sqrt(2 * np.pi))).sum())

    def concentrated(self, squares: np.ndarray) -> float:
        """The cost with sigma at its optimum for these residuals, up to a constant (same slope as `cost` there)."""
        rms, counts = self.rms(squares), self.share * self.present
        if self.proportional:
            return float(counts.sum() * np.log(self._common_factor(rms)))
        return float((counts * np.log(rms / self._start)).sum())

    def _common_factor(self, rms: np.ndarray) -> float:
        counts = self.share * self.present
        return float(np.sqrt((counts * (rms / self._start) ** 2).sum() / counts.sum()))


def _given(noise: Mapping[str, float], names: tuple[str, ...]) -> np.ndarray:
    for name in noise:
        if name not in names:
            raise unknown("channel", name, names, "Problem: noise")
    for name in names:
        if name not in noise:
            raise InputError(f"Problem: noise has no 1-sigma of '{name}'; expected one for each of {', '.join(names)}")
        if not noise[name] > 0:
            raise InputError(f"Problem: noise of '{name}' is {noise[name]}; expected a positive 1-sigma")
    return np.array([noise[name] for name in names], dtype=float)
