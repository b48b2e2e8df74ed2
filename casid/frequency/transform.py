"""Fourier transforms of samples at any frequencies [rad/s], and spectra averaged over overlapping windows.

Values are (N,) or (N, channels), one row per sample. Spectra are one-sided densities over the frequency in rad/s:
integrated over omega they give the variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from casid.errors import InputError, check_known
from casid.records.record import Record

_JITTER = 0.05  # of an interval: a reading that is as late as that is less wrong than one between two others
_GAP = 1.5  # intervals: a longer step between two samples is a gap
_AT_ONCE = 4_000_000  # terms of sums that are held in memory
_POINTS_PER_PERIOD = 10  # a straight line over a tenth of a period is at most 5 % lower than the sine, 1 - cos(pi/10)


@dataclass(frozen=True, eq=False, kw_only=True)
class Stretch:
    """Consecutive samples of several channels on an even time grid, without a gap."""

    start: float  # time of the first sample [s]
    dt: float  # sampling interval [s]
    values: np.ndarray  # (N, channels)

    @property
    def t(self) -> np.ndarray:
        """(N,) time stamps [s]."""
        return self.start + self.dt * np.arange(len(self.values))

    @property
    def duration(self) -> float:
        """Time from first to last sample [s]."""
        return self.dt * (len(self.values) - 1)


def check_band(band: tuple[float, float], where: str) -> tuple[float, float]:
    """(low, high) [rad/s], or an InputError with what to write."""
    try:
        low, high = (float(edge) for edge in band)
    except (TypeError, ValueError):
        raise InputError(f"{where}: band is {band!r}; expected (low, high) in rad/s, like band=(0.6, 12.0)") from None
    if not 0.0 <= low < high < np.inf:
        raise InputError(
            f"{where}: band is ({low:g}, {high:g}); expected 0 <= low < high in rad/s, the lower one first"
        )
    return low, high


def chirp_z(values: np.ndarray, dt: float, omega: np.ndarray) -> np.ndarray:
    """Sum values[k] exp(-j omega k dt) over k, at omega (frequencies,) [rad/s]: (frequencies, ...), complex.

    Evenly spaced frequencies take the chirp-z algorithm (Rabiner, Schafer and Rader, IEEE Trans. Audio Electroacoustics
    17, 1969), others the sums as written. Samples and frequencies are those of `stretches`: none missing, and not above
    Nyquist's.
    """
    step = np.diff(omega)
    if len(omega) > 2 and np.allclose(step, step[0], rtol=1e-9, atol=0.0):
        return _czt(len(values), len(omega), float(omega[0]), float(step.mean()), dt)(values, axis=0)
    t = dt * np.arange(len(values))
    parts = np.array_split(omega, -(-len(omega) * len(t) // _AT_ONCE))
    return np.concatenate([np.exp(-1j * np.outer(part, t)) @ values for part in parts])


def stretches(record: Record, channels: Sequence[str], omega_max: float) -> list[Stretch]:
    """Find the parts of a record in which all these channels have samples, each on an even time grid, in order of time.

    Samples where any of the channels is missing are left out of all of them, so that what follows acts on all alike.
    A gap of at most a tenth of the shortest period, 2 pi / omega_max, is bridged by straight lines (at most 5 % low in
    amplitude, the same in every channel); a longer one ends a stretch. Raises InputError for a channel that the record
    does not have, and an omega_max [rad/s] above Nyquist's frequency.
    """
    check_known("channel", channels, record.channels, f"record '{record.name}'")
    matrix = record.matrix(channels)
    there = np.isfinite(matrix).all(axis=1)
    if len(record) < 2 or there.sum() < 2:
        return []
    t = record.t[there]
    values = matrix[there]
    dt = float(np.median(np.diff(t)))  # of a channel that has one sample in several rows, that of its samples
    if not omega_max <= np.pi / dt * (1.0 + 1e-9):
        raise InputError(
            f"Fourier transform: {omega_max:g} rad/s is above the Nyquist frequency of samples every {dt:g} s, "
            f"{np.pi / dt:.4g} rad/s; lower the band"
        )
    longest = max(_GAP * dt, 2.0 * np.pi / omega_max / _POINTS_PER_PERIOD * (1.0 + 1e-9))
    ends = np.flatnonzero(np.diff(t) > longest) + 1
    parts = zip(np.split(t, ends), np.split(values, ends), strict=True)
    return [_stretch(time, rows, dt) for time, rows in parts if len(time) > 1]


def _stretch(t: np.ndarray, values: np.ndarray, dt: float) -> Stretch:
    """These samples on a grid of about the interval dt, by straight lines where they are not there already."""
    count = int(np.round(np.diff(t) / dt).sum()) + 1  # whole intervals each, as the median may be off by a rounding
    grid = np.linspace(t[0], t[-1], count)
    if count != len(t) or np.abs(t - grid).max() > _JITTER * dt:
        values = np.stack([np.interp(grid, t, column) for column in values.T], axis=1)
    return Stretch(start=float(t[0]), dt=float((t[-1] - t[0]) / (count - 1)), values=values)


@lru_cache(maxsize=64)
def _czt(count: int, frequencies: int, first: float, step: float, dt: float) -> scipy.signal.CZT:
    return scipy.signal.CZT(count, frequencies, w=np.exp(-1j * step * dt), a=np.exp(1j * first * dt))


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
