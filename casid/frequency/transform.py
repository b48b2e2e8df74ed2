"""Fourier transforms of samples at any frequencies: the chirp-z transform, and the finite Fourier integral.

Frequencies are in rad/s throughout. Values are (N,) or (N, channels), one row per sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import CZT

from casid.arguments import number, whole
from casid.errors import InputError, unknown
from casid.records.record import Record

_EVEN = 1e-3  # of an interval: time stamps this close to an even grid are even
_JITTER = 0.05  # of an interval: a reading that is as late as that is less wrong than one between two others
_GAP = 1.5  # intervals: a longer step between two samples is a gap
_SERIES = 0.1  # rad per sample: below it the weights come from their power series, good to 1e-11 there
_AT_ONCE = 4_000_000  # terms of sums that are held in memory
_POINTS_PER_PERIOD = 10  # a straight line over a tenth of a period is at most 5 % lower than the sine, 1 - cos(pi/10)

# Weights of the cubic order in ascending powers of theta**2, real parts and imaginary parts over theta: Press et al.,
# Numerical Recipes, 3rd ed., eq. 13.9.14 (`dftcor`). First row: of all samples; then of the four at either end.
_REAL_SERIES = (
    (1.0, 0.0, -11 / 720, 23 / 15120),
    (-2 / 3, 1 / 45, 103 / 15120, -169 / 226800),
    (7 / 24, -7 / 180, 5 / 3456, -7 / 259200),
    (-1 / 6, 1 / 45, -5 / 6048, 1 / 64800),
    (1 / 24, -1 / 180, 5 / 24192, -1 / 259200),
)
_IMAGINARY_SERIES = (
    (0.0, 0.0, 0.0, 0.0),
    (2 / 45, 2 / 105, -8 / 2835, 86 / 467775),
    (7 / 72, -1 / 168, 11 / 72576, -13 / 5987520),
    (-7 / 90, 1 / 210, -11 / 90720, 13 / 7484400),
    (7 / 360, -1 / 840, 11 / 362880, -13 / 29937600),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Stretch:
    """Consecutive samples of several channels on an even time grid, without a gap."""

    record: str  # name of the record
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


def band(low: float, high: float, count: int) -> np.ndarray:
    """(count,) evenly spaced frequencies from low to high [rad/s], for which the chirp-z transform is fast."""
    low, high = number(low, "band: low", least=0.0), number(high, "band: high", positive=True)
    if whole(count, "band: count", least=2) and high <= low:
        raise InputError(f"band: high is {high:g} rad/s, low is {low:g} rad/s; expected high above low")
    return np.linspace(low, high, count)


def chirp_z(values: np.ndarray, dt: float, omega: np.ndarray) -> np.ndarray:
    """The sums over k of values[k] exp(-j omega k dt).

    Evenly spaced frequencies take the chirp-z algorithm of `scipy.signal.CZT`, others the sums as they are written.

    Parameters
    ----------
    values
        (N,) or (N, channels), real or complex.
    dt
        Sampling interval [s].
    omega
        (frequencies,) [rad/s].

    Returns
    -------
    np.ndarray
        (frequencies,) or (frequencies, channels), complex.

    Raises
    ------
    InputError
        For a missing sample, and for a frequency above that of Nyquist, pi/dt.

    References
    ----------
    Rabiner, Schafer and Rader, The chirp z-transform algorithm, IEEE Trans. Audio Electroacoustics 17 (1969).
    """
    values, omega = _samples(values), _frequencies(omega, dt)
    step = np.diff(omega)
    if len(omega) > 2 and np.allclose(step, step[0], rtol=1e-9, atol=0.0):
        return _czt(len(values), len(omega), float(omega[0]), float(step.mean()), dt)(values, axis=0)
    t = dt * np.arange(len(values))
    parts = np.array_split(omega, -(-len(omega) * len(t) // _AT_ONCE))
    return np.concatenate([np.exp(-1j * np.outer(part, t)) @ values for part in parts])


def finite_fourier(t: np.ndarray, values: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The integral of values(t) exp(-j omega t) dt over the record, t counted from its first sample.

    The samples are joined by cubics, so that the result is good up to frequencies at which a plain sum is not. Uneven
    time stamps are first brought onto an even grid by a cubic spline.

    Parameters
    ----------
    t
        (N,) time stamps [s], increasing.
    values
        (N,) or (N, channels).
    omega
        (frequencies,) [rad/s].

    Returns
    -------
    np.ndarray
        (frequencies,) or (frequencies, channels), complex, in the unit of the values times s.

    Raises
    ------
    InputError
        For a missing sample, a gap in time, and a frequency above that of Nyquist. `stretches` divides a record with
        gaps into parts that have none.

    References
    ----------
    Press et al., Numerical Recipes, 3rd ed., sec. 13.9; Morelli, High accuracy evaluation of the finite Fourier
    transform using sampled data, NASA TM 110340 (1997).
    """
    t, values = np.asarray(t, dtype=float), _samples(values)
    if t.shape != values.shape[:1]:
        raise InputError(f"finite_fourier: t has the shape {t.shape}, values {values.shape}; expected one row per time")
    if len(t) < 8:
        raise InputError(f"finite_fourier: {len(t)} samples; expected at least 8")
    dt, values = _on_even_grid(t, values)
    omega = _frequencies(omega, dt)
    weights = _weights(omega * dt)
    last = np.exp(-1j * omega * dt * (len(values) - 1))
    shape = (-1,) + (1,) * (values.ndim - 1)
    total = weights[0].reshape(shape) * chirp_z(values, dt, omega)
    for k, weight in enumerate(weights[1:]):
        total = total + np.multiply.outer(np.conj(weight), values[k])
        total = total + np.multiply.outer(weight * last, values[-1 - k])
    return dt * total


def derivative_fourier(t: np.ndarray, values: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The finite Fourier integral of the time derivative of the values: by parts, from that of the values themselves.

    Integral of x' exp(-j omega t) = j omega X + x(T) exp(-j omega T) - x(0), so that no sample is differentiated.
    Arguments, result and errors as in `finite_fourier`.
    """
    transform, values = finite_fourier(t, values, omega), _samples(values)
    omega = np.asarray(omega, dtype=float)
    last = np.exp(-1j * omega * (t[-1] - t[0]))
    inside = 1j * omega.reshape((-1,) + (1,) * (values.ndim - 1)) * transform
    return inside + np.multiply.outer(last, values[-1]) - values[0]


def detrended(t: np.ndarray, values: np.ndarray, degree: int = 1) -> np.ndarray:
    """The values without their mean (degree 0), or without their straight line of least squares (degree 1).

    `t` is (N,) [s], even or not; the values are (N,) or (N, channels).
    """
    values = _samples(values)
    if degree not in (0, 1):
        raise InputError(f"detrended: degree is {degree}; expected 0 (mean) or 1 (straight line)")
    if degree == 0 or len(values) < 2:
        return values - values.mean(axis=0)
    line = np.stack([np.ones(len(values)), np.asarray(t, dtype=float) - np.mean(t)], axis=1)
    return values - line @ np.linalg.lstsq(line, values, rcond=None)[0]


def stretches(record: Record, channels: Sequence[str], omega_max: float) -> list[Stretch]:
    """The parts of a record in which all these channels have samples, on an even time grid.

    Samples where any of the channels is missing are left out of all of them, so that what follows acts on all alike.
    A gap of at most a tenth of the shortest period, 2 pi / omega_max, is bridged by straight lines (at most 5 % low in
    amplitude, the same in every channel); a longer one ends a stretch.

    Parameters
    ----------
    record
        A flight record.
    channels
        Names of its channels.
    omega_max
        The highest frequency that matters [rad/s].

    Returns
    -------
    list of Stretch
        In the order of time; empty where the channels have no two samples together.

    Raises
    ------
    InputError
        For a channel that the record does not have, and a frequency above that of Nyquist.
    """
    for name in channels:
        if name not in record:
            raise unknown("channel", name, record.channels, f"record '{record.name}'")
    matrix = record.matrix(channels)
    there = np.isfinite(matrix).all(axis=1)
    if len(record) < 2 or there.sum() < 2:
        return []
    t, values = record.t[there], matrix[there]
    dt = float(np.median(np.diff(t)))  # of a channel that has one sample in several rows, that of its samples
    _frequencies(np.array([omega_max]), dt)
    longest = max(_GAP * dt, 2.0 * np.pi / omega_max / _POINTS_PER_PERIOD * (1.0 + 1e-9))
    ends = np.flatnonzero(np.diff(t) > longest) + 1
    parts = zip(np.split(t, ends), np.split(values, ends), strict=True)
    return [_stretch(record.name, time, rows, dt) for time, rows in parts if len(time) > 1]


def _stretch(name: str, t: np.ndarray, values: np.ndarray, dt: float) -> Stretch:
    """These samples on a grid of about the interval dt, by straight lines where they are not there already."""
    count = int(np.round(np.diff(t) / dt).sum()) + 1  # whole intervals each, as the median may be off by a rounding
    grid = np.linspace(t[0], t[-1], count)
    if count != len(t) or np.abs(t - grid).max() > _JITTER * dt:
        values = np.stack([np.interp(grid, t, column) for column in values.T], axis=1)
    return Stretch(record=name, start=float(t[0]), dt=float((t[-1] - t[0]) / (count - 1)), values=values)


def _on_even_grid(t: np.ndarray, values: np.ndarray) -> tuple[float, np.ndarray]:
    """(interval, values) on an even grid from the first time to the last, by a cubic spline where needed."""
    step = np.diff(t)
    if not (step > 0.0).all():
        raise InputError("finite_fourier: t does not increase; expected increasing time stamps in s")
    dt = (t[-1] - t[0]) / (len(t) - 1)
    gap = int(np.argmax(step))
    if step[gap] > _GAP * np.median(step):
        raise InputError(
            f"finite_fourier: no sample from t = {t[gap]:g} to {t[gap + 1]:g} s; expected no gap: transform the parts "
            "apart, casid.frequency.transform.stretches finds them"
        )
    grid = t[0] + dt * np.arange(len(t))
    even = np.abs(t - grid).max() <= _EVEN * dt
    return float(dt), values if even else CubicSpline(t, values, axis=0)(grid)


def _weights(theta: np.ndarray) -> np.ndarray:
    """(5, frequencies) weight of all samples, and corrections of the last four, the last one first."""
    power = np.vander(theta**2, 4, increasing=True).T
    small = np.array(_REAL_SERIES) @ power + 1j * theta * (np.array(_IMAGINARY_SERIES) @ power)
    x = np.where(np.abs(theta) < _SERIES, 1.0, theta)  # the closed form loses its digits there
    c, s, c2, s2, square = np.cos(x), np.sin(x), np.cos(2.0 * x), np.sin(2.0 * x), x**2
    exact = np.stack(
        [
            (6.0 + square) * (3.0 - 4.0 * c + c2) / 3.0 + 0.0j,
            (-42.0 + 5.0 * square + (6.0 + square) * (8.0 * c - c2)) / 6.0
            + 1j * (-12.0 * x + 6.0 * x**3 + (6.0 + square) * s2) / 6.0,
            (14.0 * (3.0 - square) - 7.0 * (6.0 + square) * c) / 6.0 + 1j * (30.0 * x - 5.0 * (6.0 + square) * s) / 6.0,
            (-4.0 * (3.0 - square) + 2.0 * (6.0 + square) * c) / 3.0
            + 1j * (-12.0 * x + 2.0 * (6.0 + square) * s) / 3.0,
            (2.0 * (3.0 - square) - (6.0 + square) * c) / 6.0 + 1j * (6.0 * x - (6.0 + square) * s) / 6.0,
        ]
    )
    return np.where(np.abs(theta) < _SERIES, small, exact / x**4)


@lru_cache(maxsize=64)
def _czt(count: int, frequencies: int, first: float, step: float, dt: float) -> CZT:
    return CZT(count, frequencies, w=np.exp(-1j * step * dt), a=np.exp(1j * first * dt))


def _samples(values: np.ndarray) -> np.ndarray:
    array = np.asarray(values)
    if array.ndim not in (1, 2) or array.dtype.kind not in "fiuc":
        raise InputError(
            f"Fourier transform: values have the shape {array.shape}; expected numbers, (N,) or (N, channels)"
        )
    missing = np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))
    if len(missing):
        raise InputError(
            f"Fourier transform: sample {missing[0]} is missing, {len(missing)} of {len(array)} in all; expected none: "
            "casid.frequency.transform.stretches finds the parts without gaps"
        )
    return array


def _frequencies(omega: np.ndarray, dt: float) -> np.ndarray:
    omega = np.atleast_1d(np.asarray(omega, dtype=float))
    highest, nyquist = float(np.abs(omega).max(initial=0.0)), np.pi / dt
    if omega.ndim != 1 or not np.isfinite(omega).all():
        raise InputError("Fourier transform: omega has to be finite frequencies in rad/s, (frequencies,)")
    if highest > nyquist * (1.0 + 1e-9):
        raise InputError(
            f"Fourier transform: {highest:g} rad/s is above the Nyquist frequency of samples every {dt:g} s, "
            f"{nyquist:.4g} rad/s; lower the band"
        )
    return omega
