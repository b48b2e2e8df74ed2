"""Operators on sampled time series that effects are made of: lag, delay, rate limit, dead zone, backlash, mode.

All take t (N,) [s] and a series (N,), run between samples linearly, start in steady state and accept non-uniform t;
`rate_limit` is an exception to the first, `mode` to the first and the last.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from casid.errors import InputError

_FINER = 4  # points a sample along which a limit on a rate is followed
_STRAIGHT = 0.03  # of a period: over that, a wave is a straight line to 0.3 %
CYCLES = 1.0  # of an oscillation between samples, beyond which these do not determine what drives it


def delay(t: np.ndarray, y: np.ndarray, tau: float) -> np.ndarray:
    """y(t - tau), linear between samples; the first (tau > 0) or last (tau < 0) sample is held."""
    return np.interp(t - tau, t, y)


def delay_transfer(s: np.ndarray, tau: float) -> np.ndarray:
    """Transfer function of `delay`."""
    return np.exp(-s * tau)


def earlier(t: np.ndarray, y: np.ndarray, tau: float) -> np.ndarray:
    """y(t + tau), linear between samples; missing (NaN) where a neighbour is, and beyond the series."""
    wanted = t + tau
    after = np.clip(np.searchsorted(t, wanted), 1, len(t) - 1)
    share = (wanted - t[after - 1]) / (t[after] - t[after - 1])
    moved = (1.0 - share) * y[after - 1] + share * y[after]
    return np.where((wanted >= t[0]) & (wanted <= t[-1]), moved, np.nan)


def lag(t: np.ndarray, y: np.ndarray, time_constant: float) -> np.ndarray:
    """First-order lag, exact for an input that is linear between samples; none for a time constant of 0."""
    T = abs(time_constant)
    if T < 1e-9:
        return y.copy()
    dt = np.diff(t)
    if np.ptp(dt) < 1e-6 * dt[0]:
        a, b0, b1 = _lag_coefficients(dt[0], T)
        return scipy.signal.lfilter([b1, b0], [1.0, -a], y - y[0]) + y[0]
    out = np.empty_like(y)
    out[0] = y[0]
    for k, (a, b0, b1) in enumerate(zip(*_lag_coefficients(dt, T), strict=True)):
        out[k + 1] = a * out[k] + b0 * y[k] + b1 * y[k + 1]
    return out


def lag_transfer(s: np.ndarray, time_constant: float) -> np.ndarray:
    """Transfer function of `lag`."""
    return 1.0 / (1.0 + abs(time_constant) * s)


def _lag_coefficients(dt, T):
    a = np.exp(-dt / T)
    b1 = 1.0 - T / dt * (1.0 - a)
    return a, (1.0 - a) - b1, b1


def rate_limit(t: np.ndarray, y: np.ndarray, rate: float) -> np.ndarray:
    """y followed with at most `rate` [unit of y per s]. Akima's curve between samples, because what is limited keeps to
    its end the time by which straight lines begin a movement early."""
    fine = np.interp(np.arange((len(t) - 1) * _FINER + 1) / _FINER, np.arange(len(t)), t)
    wanted = scipy.interpolate.Akima1DInterpolator(t, y)(fine)
    most = np.diff(fine) * abs(rate)
    followed = wanted.copy()
    wished = wanted.tolist()
    steps = most.tolist()
    k = 0
    for begins in np.flatnonzero(np.abs(np.diff(wanted)) > most).tolist():  # elsewhere it keeps up
        if begins < k:
            continue  # it is still behind
        at = wished[begins]
        k = begins + 1
        while k < len(wished) and abs(wished[k] - at) > steps[k - 1]:
            at += steps[k - 1] if wished[k] > at else -steps[k - 1]
            followed[k] = at
            k += 1
    behind = (followed != wanted)[::_FINER]
    return np.where(behind, followed[::_FINER], y)  # of the curve what is no sample's own value is rounding


def dead_zone(y: np.ndarray, width: float, centre: float) -> np.ndarray:
    """Half-width `width` around `centre` without response; beyond it the response is shifted by the half-width."""
    z = y - centre
    return centre + np.sign(z) * np.maximum(np.abs(z) - abs(width), 0.0)


def backlash(y: np.ndarray, width: float, rest: float = 0.0) -> np.ndarray:
    """Play of half-width `width`: the output moves only when pushed by an end stop. It begins at `rest` within the
    play, from -1, the lower stop, to 1 (`folded`)."""
    out = y.copy()
    half = abs(width)
    out[0] += folded(rest) * half
    for k in range(1, len(y)):
        out[k] = min(max(out[k - 1], y[k] - half), y[k] + half)
    return out


def folded(x: float) -> float:
    """x between -1 and 1, beyond which it runs back, so that a fit that steps too far still has a slope."""
    return 1.0 - abs((x + 1.0) % 4.0 - 2.0)


def one_minus_cosine(t: np.ndarray, onset: float, length: float) -> np.ndarray:
    """Discrete gust of unit height that starts at `onset` and lasts `length` [s]."""
    inside = (t >= onset) & (t <= onset + length)
    return np.where(inside, 0.5 * (1.0 - np.cos(2.0 * np.pi * (t - onset) / length)), 0.0)


def step(t: np.ndarray, onset: float) -> np.ndarray:
    """0 before `onset`, 1 from one sample after it, linear within the sample that contains it: smooth in the onset."""
    return transition(t, onset, 0.0)


def transition(t: np.ndarray, onset: float, duration: float) -> np.ndarray:
    """0 before `onset`, 1 from `onset + duration`, linear between them; not shorter than a sample."""
    return np.clip((t - onset) / max(abs(duration), float(np.median(np.diff(t)))), 0.0, 1.0)


def ramp(t: np.ndarray, onset: float, duration: float) -> np.ndarray:
    """0 before `onset`, then rising by 1 per second for a duration [s], none if it is negative."""
    return np.clip(t - onset, 0.0, max(duration, 0.0))


TURNING = ("phi", "theta", "q", "r")  # what `turned` is made of


def turned(t: np.ndarray, phi: np.ndarray, theta: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Heading [rad] less that at the first sample, from bank and pitch angle [rad] and rates [rad/s]; it rests while
    one of them is missing."""
    rate = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
    return scipy.integrate.cumulative_trapezoid(np.nan_to_num(rate), t, initial=0.0)


def mode(t: np.ndarray, y: np.ndarray, frequency_hz: float, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Rate of a lightly damped mode driven by y, from rest, w0^2 s / (s^2 + 2 d w0 s + w0^2), and its derivative, for
    uniform t. A cubic spline between samples, because straight lines weaken what is near the mode's frequency. Raises
    InputError for more than one cycle between samples, which y does not resolve, and for a mode that grows."""
    w0 = 2.0 * np.pi * frequency_hz
    dt = float(np.median(np.diff(t)))
    if not (0.0 < frequency_hz * dt <= CYCLES and damping >= 0.0):
        raise InputError(
            f"an oscillation of {frequency_hz:.3g} Hz with a damping of {damping:.3g} in samples every {dt:.3g} s: "
            f"expected up to {CYCLES / dt:.3g} Hz, one cycle between samples, and a damping of 0 or more"
        )
    parts = max(1, int(np.ceil(frequency_hz * dt / _STRAIGHT)))
    if parts > 1:
        y = _cubic(np.asarray(y, dtype=float).tobytes())(np.arange((len(y) - 1) * parts + 1) / parts)
    numerators, denominator = _mode_filter(w0, damping, dt / parts)
    rate, derivative = (np.asarray(scipy.signal.lfilter(n, denominator, y - y[0]))[::parts] for n in numerators)
    return rate, derivative


@lru_cache(maxsize=16)  # many modes are driven by the same channel of a few records
def _cubic(samples: bytes) -> scipy.interpolate.CubicSpline:
    """The cubic spline through samples, over their numbers."""
    y = np.frombuffer(samples)
    return scipy.interpolate.CubicSpline(np.arange(len(y)), y)


@lru_cache(maxsize=256)  # every channel that a surface may shake asks for the same frequencies
def _mode_filter(w0: float, damping: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(numerators of the rate and of its derivative, denominator) of the sampled mode."""
    a = np.array([[0.0, 1.0], [-(w0**2), -2.0 * damping * w0]])
    b = np.array([[0.0], [w0**2]])
    phi, gamma0, gamma1 = _first_order_hold(a, b, dt)
    rows = np.array([[0.0, 1.0], a[1]])
    through = np.array([[0.0], b[1]])
    numerators, denominator = scipy.signal.ss2tf(phi, phi @ gamma1 + gamma0, rows, rows @ gamma1 + through)
    return np.atleast_2d(numerators), np.asarray(denominator)


def _first_order_hold(a: np.ndarray, b: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x_{k+1} = phi x_k + gamma0 u_k + gamma1 u_{k+1} for an input linear between samples."""
    n, m = b.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n] = a * dt
    block[:n, n : n + m] = b * dt
    block[n : n + m, n + m :] = np.eye(m)
    e = scipy.linalg.expm(block)
    gamma1 = e[:n, n + m :]
    return e[:n, :n], e[:n, n : n + m] - gamma1, gamma1
