"""Noise of a measured channel, judged without any model: from the band above the motion."""

from __future__ import annotations

import math

import numpy as np

_ORDER = 4
_LEVELS = 30


def high_band_sigma(values: np.ndarray) -> float:
    """Standard deviation of the white noise in a uniformly sampled series (N,); NaN when fewer than 20 differences.

    Robust (median absolute deviation) scale of the fourth differences, which pass white noise with gain sqrt(70) and
    suppress a motion of frequency f by (2 sin(pi f dt))^4: below 2 % of its amplitude at a tenth of the sampling rate.
    Assumes noise that is white at the sampling rate. A series without noise gives a value near 0.
    """
    good = values[np.isfinite(values)]
    if len(good) < 20 + _ORDER:
        return float("nan")
    differences = np.diff(good, _ORDER)
    gain = math.sqrt(sum(math.comb(_ORDER, k) ** 2 for k in range(_ORDER + 1)))
    scale = np.median(np.abs(differences - np.median(differences)))
    return float(1.482602218505602 * scale / gain)


def resolution(values: np.ndarray) -> float:
    """Smallest step between distinct values: the quantisation of a channel; 0 for a series of so few levels that they
    may be the signal's own, as of an input of steps."""
    levels = np.unique(values[np.isfinite(values)])
    return float(np.diff(levels).min()) if len(levels) >= _LEVELS else 0.0


def pooled_sigma(series: list[np.ndarray]) -> float:
    """High-band noise of one channel over several records: the median, and never below the quantisation noise."""
    sigmas = [s for s in map(high_band_sigma, series) if np.isfinite(s)]
    if not sigmas:
        return float("nan")
    return max(float(np.median(sigmas)), float(np.median([resolution(s) for s in series])) / np.sqrt(12.0))


_HALF_WIDTHS = (0, 1, 2, 4, 8, 16, 32)
_CONFIDENCE = 2.5


def denoise(values: np.ndarray, sigma: float) -> np.ndarray:
    """Adaptive moving mean of a series (N,) with white noise `sigma` that respects edges.

    At every sample the widest centred window whose mean is still compatible with those of all narrower ones
    (intersection of confidence intervals; Goldenshluger and Nemirovski 1997): long while a surface rests, one sample
    while it moves. The noise left is as strong at low frequency as before; only its rough part is gone.
    """
    if not sigma > 0.0:
        return values.copy()
    total = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    best, open_ = values.copy(), np.ones(len(values), dtype=bool)
    low, high = np.full(len(values), -np.inf), np.full(len(values), np.inf)
    for half in _HALF_WIDTHS:
        reach = np.minimum(np.minimum(at, len(values) - 1 - at), half)
        count = 2 * reach + 1
        mean = (total[at + reach + 1] - total[at - reach]) / count
        margin = _CONFIDENCE * sigma / np.sqrt(count)
        low, high = np.maximum(low, mean - margin), np.minimum(high, mean + margin)
        open_ &= low <= high
        best = np.where(open_, mean, best)
    return best
