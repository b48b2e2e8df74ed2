"""Noise levels of the measured channels: given, estimated from the residuals, or weights by range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from casid.errors import InputError, unknown
from casid.estimation.cost import RangeWeights

_START = 0.05  # of a channel's range, before any residual is known
_FLOOR = 1e-7  # of a channel's range: data without noise
_DEAD = 1e-12  # range of a channel that is zero throughout


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseLevels:
    """sigma (channels,) that residuals are divided by; `fixed` when it was given.

    Estimated: the root mean square of each channel's residuals, which is the likelihood's maximum for given
    parameters. Range weights (`proportional`): their proportions stay (paper eq. 13), and one common factor makes the
    mean square of all weighted residuals one, so that priors weigh against the data as they should.
    """

    sigma: np.ndarray
    fixed: bool
    proportional: bool
    share: np.ndarray  # (channels,) weight of each channel's part in the cost
    present: np.ndarray  # (channels,) samples that are there
    floor: np.ndarray  # (channels,) least 1-sigma: data without noise
    start: np.ndarray  # (channels,) sigma before any residual is known
    magnitude: np.ndarray  # (channels,) sum of squares of the measurements

    full: ClassVar[bool] = False

    @property
    def count(self) -> int:
        """Samples of all channels together."""
        return max(int(self.present.sum()), 1)

    @property
    def size(self) -> float:
        """Norm of all measurements in units of sigma: rounding of the residuals is relative to it."""
        return float(np.sqrt((self.magnitude / self.sigma**2).sum()))

    def whitening(self, seen: np.ndarray) -> np.ndarray:
        """(patterns, o, o) lower triangle that makes the residuals of the first o channels white where `seen`
        (patterns, o), zero in the rows and columns of what is missing."""
        return seen[:, :, None] * np.diag(1.0 / self.sigma[: seen.shape[1]])

    def rms(self, squares: np.ndarray) -> np.ndarray:
        """(channels,) root mean square, from sums of squared residuals; floored where there is no noise."""
        found = np.sqrt(squares / np.maximum(self.present, 1))
        return np.where(self.present > 0, np.maximum(found, self.floor), 1.0)

    def relaxed(self, squares: np.ndarray) -> tuple[NoiseLevels, float]:
        """Return a copy with the sigma that the sums of squared residuals give, and the largest relative change of
        it."""
        if self.fixed:
            return self, 0.0
        rms = self.rms(squares)
        sigma = self.start * self._common_factor(rms) if self.proportional else rms
        return replace(self, sigma=sigma), float(np.abs(np.log(sigma / self.sigma)).max(initial=0.0))

    @property
    def coordinates(self) -> np.ndarray:
        """(channels,) ln sigma in units of the standard deviation with which the residuals determine it."""
        return np.log(self.sigma) * self._precision

    def at(self, coordinates: np.ndarray) -> NoiseLevels:
        """Return a copy with sigma at these `coordinates`."""
        return replace(self, sigma=np.exp(coordinates / self._precision))

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
        """Return the log-likelihood of residuals with these sums of squares; with range weights, under the noise
        that the residuals show."""
        sigma = self.rms(squares) if self.proportional else self.sigma
        return -float((0.5 * squares / sigma**2 + self.present * np.log(sigma * np.sqrt(2 * np.pi))).sum())

    def concentrated(self, squares: np.ndarray) -> float:
        """The cost with sigma at its optimum for these residuals, up to a constant (same slope as `cost` there)."""
        rms = self.rms(squares)
        counts = self.share * self.present
        if self.proportional:
            return float(counts.sum() * np.log(self._common_factor(rms)))
        return float((counts * np.log(rms / self.start)).sum())

    def _common_factor(self, rms: np.ndarray) -> float:
        counts = self.share * self.present
        return float(np.sqrt((counts * (rms / self.start) ** 2).sum() / counts.sum()))


def noise_levels(
    noise: Mapping[str, float] | RangeWeights | None, names: tuple[str, ...], measured: np.ndarray, share: np.ndarray
) -> NoiseLevels:
    """The levels to begin with, of channels `names` with the measurements (samples, channels), NaN where missing.

    Raises InputError for a noise that names other channels or is not positive.
    """
    present = np.isfinite(measured).sum(axis=0)
    filled = np.where(present > 0, measured, 0.0)
    spread = np.nanmax(filled, axis=0) - np.nanmin(filled, axis=0)
    size = np.maximum(spread, 1e-3 * np.nanmax(np.abs(filled), axis=0))
    floor = _FLOOR * np.where(size > 0.0, size, _DEAD)
    if noise is None:
        sigma = np.maximum(_START * spread, floor)
    elif isinstance(noise, RangeWeights):
        sigma = _START / noise.weights(filled)
    else:
        sigma = _given(noise, names)
    sigma = np.where(present > 0, sigma, 1.0)
    with np.errstate(over="ignore"):  # absurd measurements: no fit follows them, and its status states it
        magnitude = np.nansum(filled**2, axis=0)
    return NoiseLevels(
        sigma=sigma,
        fixed=noise is not None and not isinstance(noise, RangeWeights),
        proportional=isinstance(noise, RangeWeights),
        share=share,
        present=present,
        floor=floor,
        start=sigma,
        magnitude=magnitude,
    )


def _given(noise: Mapping[str, float], names: tuple[str, ...]) -> np.ndarray:
    for name in noise:
        if name not in names:
            raise unknown("channel", name, names, "Problem: noise")
    for name in names:
        if name not in noise:
            raise InputError(f"Problem: noise has no 1-sigma of '{name}'; expected one for each of {', '.join(names)}")
    return np.array([noise[name] for name in names], dtype=float)
