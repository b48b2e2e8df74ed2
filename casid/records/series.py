"""Series of samples of which some are missing (NaN)."""

from __future__ import annotations

import numpy as np


def across_gaps(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a series (N,) with straight lines between the samples that are there; the first and the last are held."""
    there = np.isfinite(values)
    return values if there.all() else np.interp(t, t[there], values[there])


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """Return an angle (N,) [rad] without jumps by a full turn from one sample that is there to the next."""
    there = np.isfinite(angle)
    smooth = angle.copy()
    smooth[there] = np.unwrap(angle[there])
    return smooth
