"""Operators on sampled time series that effects are made of: lag, delay, rate limit, dead zone, hysteresis, mode.

All take t (N,) [s] and a series (N,), run between samples linearly, start in steady state and accept non-uniform t;
`rate_limit` is an exception to the first, `mode` to the first and the last.

Sizes may be complex: the imaginary part of the result is then the derivative times that of the size (`with_slopes`).
Whatever compares does so by real parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import scipy

from casid.errors import InputError

_FINER = 4  # points a sample along which a limit on a rate is followed
_STRAIGHT = 0.03  # of a period: over that, a wave is a straight line to 0.3 %
CYCLES = 1.0  # of an oscillation between samples, beyond which these tell nothing of what drives it
IMAGINARY = 1e-20  # part of a size that carries its derivative: its square vanishes beside 1

Size = float | complex


def with_slopes(
    make: Callable[[Mapping[str, Size]], Mapping[str, np.ndarray]], sizes: Mapping[str, float]
) -> tuple[dict[str, np.ndarray], dict[str, dict[str, np.ndarray]]]:
    """Evaluate series that are `make` of sizes, by name, and their exact derivatives by each size, size -> name ->
    (N,)."""
    slopes: dict[str, dict[str, np.ndarray]] = {}
    for name, size in sizes.items():
        moved = make({**sizes, name: complex(size, IMAGINARY)})
        slopes[name] = {station: np.imag(series) / IMAGINARY for station, series in moved.items()}
    return {station: np.real(series) for station, series in make(sizes).items()}, slopes


def larger(x: Any, least: float) -> Any:
    """Return the larger one of x, real or complex, and a number."""
    return np.where(np.real(x) > least, x, least)[()]


def magnitude(x: Size) -> Size:
    """x without its sign."""
    return -x if np.real(x) < 0.0 else x


def sampled(t: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Evaluate a series at other times, linear between samples; the first or last sample is held. Where a time is a
    sample's own, the slope is the mean of those at both sides."""
    found = np.interp(np.real(at), t, y)
    if not np.iscomplexobj(at):
        return found
    rates = np.concatenate([np.zeros(1), np.diff(y) / np.diff(t), np.zeros(1)])
    before, behind = (rates[np.searchsorted(t, np.real(at), side=side)] for side in ("left", "right"))
    return found + 0.5j * np.imag(at) * (before + behind)


def delay(t: np.ndarray, y: np.ndarray, tau: Size) -> np.ndarray:
    """y(t - tau), linear between samples; the first (tau > 0) or last (tau < 0) sample is held."""
    return sampled(t, y, t - tau)


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


def lag(t: np.ndarray, y: np.ndarray, time_constant: Size) -> np.ndarray:
    """First-order lag, exact for an input that is linear between samples; none for a time constant of 0."""
    T = magnitude(time_constant)
    if np.real(T) < 1e-9:
        if not np.iscomplexobj(T):
            return y.copy()
        T = T + 1e-9
    dt = np.diff(t)
    if np.ptp(dt) < 1e-6 * dt[0]:
        a, b0, b1 = _lag_coefficients(dt[0], T)
        return scipy.signal.lfilter([b1, b0], [1.0, -a], y - y[0]) + y[0]
    out = np.empty(len(y), dtype=np.result_type(y, T))
    out[0] = y[0]
    for k, (a, b0, b1) in enumerate(zip(*_lag_coefficients(dt, T), strict=True)):
        out[k + 1] = a * out[k] + b0 * y[k] + b1 * y[k + 1]
    return out


def uneven_lag(t: np.ndarray, y: np.ndarray, rise: Size, fall: Size) -> np.ndarray:
    """First-order lag with one time constant while it rises and another while it falls, each exact for an input that is
    linear between samples. It begins in steady state."""
    dt = np.diff(t)
    up, down = (np.transpose(_lag_coefficients(dt, magnitude(T) + 1e-9)).tolist() for T in (rise, fall))
    out = [y[0] + 0.0 * rise * fall]
    for k, after in enumerate(y[1:].tolist()):
        a, b0, b1 = (up if after > np.real(out[k]) else down)[k]
        out.append(a * out[k] + b0 * y[k] + b1 * after)
    return np.array(out)


def lag_transfer(s: np.ndarray, time_constant: float) -> np.ndarray:
    """Transfer function of `lag`."""
    return 1.0 / (1.0 + abs(time_constant) * s)


def _lag_coefficients(dt, T):
    a = np.exp(-dt / T)
    b1 = 1.0 - T / dt * (1.0 - a)
    return a, (1.0 - a) - b1, b1


def second_order(t: np.ndarray, y: np.ndarray, radian: Size, damping: Size) -> np.ndarray:
    """Follow y as an oscillator 1/(radian^2 s^2 + 2 damping radian s + 1), exactly for an input that is linear between
    samples; y itself for a time of 0. It begins in steady state."""
    T = magnitude(radian)
    if np.real(T) < 1e-9:
        return y.astype(np.result_type(y, T, damping))
    a = np.array([[0.0, 1.0], [-1.0 / T**2, -2.0 * damping / T]])
    b = np.array([[0.0], [1.0 / T**2]])
    kind = np.result_type(a, b)
    state = np.array([y[0], 0.0], dtype=kind)
    out = np.empty(len(y), dtype=kind)
    out[0] = y[0]
    dt = np.diff(t)
    uniform = np.ptp(dt) < 1e-6 * dt[0]
    steps = _first_order_hold(a, b, float(dt[0]))
    for k in range(len(dt)):
        phi, gamma0, gamma1 = steps if uniform else _first_order_hold(a, b, float(dt[k]))
        state = phi @ state + gamma0[:, 0] * y[k] + gamma1[:, 0] * y[k + 1]
        out[k + 1] = state[0]
    return out


def second_order_transfer(s: np.ndarray, radian: Size, damping: Size) -> np.ndarray:
    """Transfer function of `second_order`."""
    return 1.0 / (radian**2 * s**2 + 2.0 * damping * magnitude(radian) * s + 1.0)


def sample_hold(t: np.ndarray, y: np.ndarray, interval: Size) -> np.ndarray:
    """Hold y from one multiple of an interval since the first sample to the next; y itself for an interval of 0."""
    held = magnitude(interval)
    if np.real(held) < 1e-9:
        return y.astype(np.result_type(y, held))
    count = np.floor((t - t[0]) / np.real(held) + 1e-9)
    return sampled(t, y, t[0] + count * held)


def rounded(y: np.ndarray, step: float) -> np.ndarray:
    """y rounded to multiples of a step; y itself for a step of 0."""
    return abs(step) * np.rint(y / abs(step)) if step else y


def rate_limit(t: np.ndarray, y: np.ndarray, rate: Size) -> np.ndarray:
    """y followed with at most `rate` [unit of y per s]. Akima's curve between samples, because what is limited keeps to
    its end the time by which straight lines begin a movement early."""
    fine = np.interp(np.arange((len(t) - 1) * _FINER + 1) / _FINER, np.arange(len(t)), t)
    wanted = scipy.interpolate.Akima1DInterpolator(t, y)(fine)
    most = np.diff(fine) * magnitude(rate)
    followed = wanted.astype(most.dtype)
    wished = wanted.tolist()
    steps = most.tolist()
    k = 0
    for begins in np.flatnonzero(np.abs(np.diff(wanted)) > most.real).tolist():  # elsewhere it keeps up
        if begins < k:
            continue  # it is still behind
        at = wished[begins]
        k = begins + 1
        while k < len(wished) and abs(wished[k] - at.real) > steps[k - 1].real:
            at += steps[k - 1] if wished[k] > at.real else -steps[k - 1]
            followed[k] = at
            k += 1
    behind = (followed != wanted)[::_FINER]
    return np.where(behind, followed[::_FINER], y)  # of the curve what is no sample's own value is rounding


def dead_zone(y: np.ndarray, width: Size, centre: Size) -> np.ndarray:
    """Half-width `width` around `centre` without response; beyond it the response is shifted by the half-width."""
    z = y - centre
    side = np.sign(np.real(z))
    return centre + side * larger(side * z - magnitude(width), 0.0)


def backlash(y: np.ndarray, width: Size, rest: Size = 0.0) -> np.ndarray:
    """Play of half-width `width`: the output moves only when pushed by an end stop. It begins at `rest` within the
    play, from -1, the lower stop, to 1 (`folded`)."""
    half = magnitude(width)
    begins = y[0] + folded(rest) * half
    out = np.empty(len(y), dtype=type(begins))
    out[0] = begins
    low = (y - half).tolist()
    high = (y + half).tolist()
    at = begins
    for k in range(1, len(y)):
        if at.real < low[k].real:
            at = low[k]
        elif at.real > high[k].real:
            at = high[k]
        out[k] = at
    return out


def hysteresis(y: np.ndarray, stroke: Size, rest: Size = 0.0) -> np.ndarray:
    """Memory z of the way that y came, from -1 to 1: z' = (y' - |y'| z) / stroke, exactly for straight lines between
    samples; of a stroke of 0 the sign of the last movement. It begins at `rest` (`folded`)."""
    along = np.diff(y)
    kept = np.exp(-np.abs(along) / larger(magnitude(stroke), 1e-300)).tolist()
    z = [folded(rest)]
    for side, share in zip(np.sign(along).tolist(), kept, strict=True):
        z.append(side + (z[-1] - side) * share)
    return np.array(z)


def folded(x: Size) -> Size:
    """x between -1 and 1, beyond which it runs back, so that a fit that steps too far still has a slope."""
    beyond = 4.0 * np.floor((np.real(x) + 1.0) / 4.0)
    return 1.0 - magnitude(x + 1.0 - beyond - 2.0)


def one_minus_cosine(t: np.ndarray, onset: Size, length: Size) -> np.ndarray:
    """Discrete gust of unit height that starts at `onset` and lasts `length` [s]."""
    inside = (t >= np.real(onset)) & (t <= np.real(onset + length))
    return np.where(inside, 0.5 * (1.0 - np.cos(2.0 * np.pi * (t - onset) / length)), 0.0)


def step(t: np.ndarray, onset: Size) -> np.ndarray:
    """0 before `onset`, 1 from one sample after it, linear within the sample that contains it: smooth in the onset."""
    return transition(t, onset, 0.0)


def transition(t: np.ndarray, onset: Size, duration: Size) -> np.ndarray:
    """0 before `onset`, 1 from `onset + duration`, linear between them; not shorter than a sample."""
    moved = (t - onset) / larger(magnitude(duration), float(np.median(np.diff(t))))
    return np.where(np.real(moved) < 1.0, larger(moved, 0.0), 1.0)


def ramp(t: np.ndarray, onset: Size, duration: Size) -> np.ndarray:
    """0 before `onset`, then rising by 1 per second for a duration [s], none if it is negative."""
    most = larger(duration, 0.0)
    since = larger(t - onset, 0.0)
    return np.where(np.real(since) < np.real(most), since, most)


TURNING = ("phi", "theta", "q", "r")  # what `turned` is made of


def turned(t: np.ndarray, phi: np.ndarray, theta: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Heading [rad] less that at the first sample, from bank and pitch angle [rad] and rates [rad/s]; it rests while
    one of them is missing."""
    rate = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
    return scipy.integrate.cumulative_trapezoid(np.nan_to_num(rate), t, initial=0.0)


def mode(t: np.ndarray, y: np.ndarray, frequency_hz: Size, damping: Size) -> tuple[np.ndarray, np.ndarray]:
    """Rate of a lightly damped mode driven by y, from rest, w0^2 s / (s^2 + 2 d w0 s + w0^2), and its derivative, for
    uniform t. A cubic spline between samples, because straight lines weaken what is near the mode's frequency. Raises
    InputError for more than one cycle between samples, which y does not resolve, and for a mode that grows."""
    w0 = 2.0 * np.pi * frequency_hz
    dt = float(np.median(np.diff(t)))
    if not (0.0 < np.real(frequency_hz) * dt <= CYCLES and np.real(damping) >= 0.0):
        raise InputError(
            f"an oscillation of {np.real(frequency_hz):.3g} Hz with a damping of {np.real(damping):.3g} in samples "
            f"every {dt:.3g} s: expected up to {CYCLES / dt:.3g} Hz, one cycle between samples, and a damping of 0 or "
            "more"
        )
    parts = max(1, int(np.ceil(np.real(frequency_hz) * dt / _STRAIGHT)))
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
def _mode_filter(w0: Size, damping: Size, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(numerators of the rate and of its derivative, denominator) of the sampled mode."""
    a = np.array([[0.0, 1.0], [-(w0**2), -2.0 * damping * w0]])
    b = np.array([[0.0], [w0**2]])
    phi, gamma0, gamma1 = _first_order_hold(a, b, dt)
    rows = np.array([[0.0, 1.0], a[1]])
    through = np.array([[0.0], b[1]])
    into = phi @ gamma1 + gamma0
    at_once = rows @ gamma1 + through
    denominator = np.array([1.0, -np.trace(phi), phi[0, 0] * phi[1, 1] - phi[0, 1] * phi[1, 0]])
    # C adj(z - phi) B + D det(z - phi): of two rows, the adjoint is z + phi - trace
    first = rows @ into
    second = rows @ (phi - np.trace(phi) * np.eye(2)) @ into
    numerators = np.hstack([np.zeros((2, 1)), first, second]) + at_once * denominator
    return numerators, denominator


def _first_order_hold(a: np.ndarray, b: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x_{k+1} = phi x_k + gamma0 u_k + gamma1 u_{k+1} for an input linear between samples."""
    n, m = b.shape
    block = np.zeros((n + 2 * m, n + 2 * m), dtype=a.dtype)
    block[:n, :n] = a * dt
    block[:n, n : n + m] = b * dt
    block[n : n + m, n + m :] = np.eye(m)
    e = scipy.linalg.expm(block)
    gamma1 = e[:n, n + m :]
    return e[:n, :n], e[:n, n : n + m] - gamma1, gamma1
