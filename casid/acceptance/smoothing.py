"""The curve under a noisy channel: Whittaker's smoother with the weight of generalised cross-validation.

Penalised least squares with the second derivative as penalty (E. T. Whittaker, 1923; P. H. C. Eilers, "A perfect
smoother", Analytical Chemistry 75, 2003). The trace that cross-validation needs is that of equidistant samples, whose
eigenvalues are known (D. Garcia, Computational Statistics and Data Analysis 54, 2010). A curve is no further from a
sample than noise may be, so that steps stay: those that a surface puts into an acceleration are no noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from scipy.linalg import solveh_banded

from casid.records.noise import pooled_sigma

_WEIGHTS = (-10.0, 10.0)  # decimal logarithms between which the weight of the penalty lies
_FEWEST = 8  # samples
_SIGMAS = 4.0  # of the noise in the high band, by which a curve may miss a sample
_TINY = 1e-300


@dataclass(frozen=True, eq=False, kw_only=True)
class Smooth:
    """A smoothed channel."""

    curve: np.ndarray  # (N,) values at all samples, also where a sample is missing
    sigma: float  # 1-sigma of what was taken off


def smooth(t: np.ndarray, values: np.ndarray) -> Smooth:
    """The curve under a channel (N,) whose noise is white; NaN are missing samples. Samples without noise stay."""
    there = np.isfinite(values)
    if there.sum() < _FEWEST:
        curve = np.interp(t, t[there], values[there]) if there.any() else np.full(len(t), np.nan)
        return Smooth(curve=curve, sigma=0.0)
    level = values[there].mean()  # taken off for the accuracy of the solution
    data = np.where(there, values - level, 0.0)
    weight = there.astype(float)
    penalty = _penalty(t)
    eigenvalues = (2.0 - 2.0 * np.cos(np.pi * np.arange(len(t)) / len(t))) ** 2

    def curve_of(log_weight: float) -> np.ndarray:
        system = 10.0**log_weight * penalty
        system[2] += weight
        return solveh_banded(system, data)

    def score(log_weight: float) -> float:
        left = weight * (data - curve_of(log_weight))
        trace = (1.0 / (1.0 + 10.0**log_weight * eigenvalues)).mean()
        return float(np.log(left @ left + _TINY) - 2.0 * np.log(1.0 - trace + _TINY))

    best = scipy.optimize.minimize_scalar(score, bounds=_WEIGHTS, method="bounded", options={"xatol": 0.05})
    curve = curve_of(float(best.x))  # pyright: ignore[reportAttributeAccessIssue]
    reach = np.nan_to_num(_SIGMAS * pooled_sigma([values]), nan=np.inf)
    curve = np.where(there, np.clip(curve, data - reach, data + reach), curve)
    left = weight * (data - curve)
    return Smooth(curve=curve + level, sigma=float(np.sqrt(left @ left / weight.sum())))


def _penalty(t: np.ndarray) -> np.ndarray:
    """(3, N) upper bands of the sum of squared second differences, divided ones where sampling is not uniform."""
    step = np.diff(t) / np.median(np.diff(t))
    before = step[:-1]
    after = step[1:]
    total = before + after
    rows = np.stack([2.0 / (before * total), -2.0 / (before * after), 2.0 / (after * total)])
    bands = np.zeros((3, len(t)))
    for i in range(3):
        for j in range(i, 3):
            bands[2 - (j - i), j : j + len(t) - 2] += rows[i] * rows[j]
    return bands
