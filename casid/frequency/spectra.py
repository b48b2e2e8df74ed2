"""Auto- and cross-spectra of flight records, averaged over overlapping windows of one length.

Spectra are one-sided densities over the frequency in rad/s: integrated over omega they give the variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from casid.errors import InputError
from casid.frequency.transform import Stretch, chirp_z


@dataclass(frozen=True, eq=False, kw_only=True)
class Spectra:
    """Spectra of several channels at the same frequencies."""

    channels: tuple[str, ...]  # names, in the order of the matrix
    omega: np.ndarray  # (frequencies,) [rad/s]
    # (frequencies, channels, channels) one-sided spectral densities, complex: row i, column j is the average of
    # conj(X_i) X_j, in unit_i unit_j s/rad
    matrix: np.ndarray
    window: float  # length of a window [s]
    segments: int  # how many windows were averaged
    averages: float  # how many independent windows have the same scatter: windows that overlap are correlated


def spectra(
    parts: Sequence[Stretch], channels: Sequence[str], omega: np.ndarray, window: float, overlap: float
) -> Spectra:
    """Average over all windows that fit into stretches of the channels, which may come from several records.

    Every window of so many seconds is tapered by Hann's function, after the mean of its samples was taken off, and
    shares the part `overlap`, below 1, with the next (Welch, IEEE Trans. Audio Electroacoustics 15, 1967, also for the
    number of independent averages). Raises InputError when no stretch is as long as the window.
    """
    total = np.zeros((len(omega), len(channels), len(channels)), dtype=complex)
    segments = 0
    scatter = 0.0
    for dt, alike in _by_interval(parts).items():
        count = round(window / dt)
        long = [part.values for part in alike if len(part.values) >= count >= 4]
        if not long:
            continue
        step = max(1, round(count * (1.0 - overlap)))
        taper = np.asarray(scipy.signal.get_window("hann", count))
        views = [np.lib.stride_tricks.sliding_window_view(values, count, axis=0)[::step] for values in long]
        windows = np.concatenate(views)  # (windows, channels, count)
        tapered = (windows - windows.mean(axis=2, keepdims=True)) * taper
        transform = chirp_z(tapered.reshape(-1, count).T, dt, omega).reshape(len(omega), *windows.shape[:2])
        scale = dt / np.pi / (taper @ taper)  # one-sided, over rad/s
        total += scale * (transform.conj().transpose(0, 2, 1) @ transform)
        segments += len(windows)
        scatter += sum(len(view) * _inflation(taper, step, len(view)) for view in views)
    if not segments:
        longest = max((part.duration + part.dt for part in parts), default=0.0)
        raise InputError(
            f"frequency response: no stretch without a gap is as long as a window of {window:g} s, the longest has "
            f"{longest:.3g} s; give shorter windows"
        )
    return Spectra(
        channels=tuple(channels),
        omega=omega,
        matrix=total / segments,
        window=window,
        segments=segments,
        averages=segments**2 / scatter,
    )


def _by_interval(parts: Sequence[Stretch]) -> dict[float, list[Stretch]]:
    """Stretches by their sampling interval, to the precision of time stamps."""
    found: dict[float, list[Stretch]] = {}
    for part in parts:
        found.setdefault(round(part.dt, 9), []).append(part)
    return found


def _inflation(taper: np.ndarray, step: int, count: int) -> float:
    """Variance of a mean over `count` windows, `step` samples apart, over that of as many independent ones."""
    shifts = np.arange(step, min(len(taper), step * count), step)
    shared = np.array([taper[s:] @ taper[: len(taper) - s] for s in shifts]) / (taper @ taper)
    return 1.0 + 2.0 * float(np.sum((1.0 - shifts / step / count) * shared**2))
