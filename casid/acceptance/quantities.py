"""Derived quantities of a response, with their 1-sigma: period, damping, time to half, time constant, rise, overshoot.

All are measured from flight and from simulation in the same way, from samples alone. An oscillation is a damped
sinusoid on a straight line, least squares; a time constant an exponential. Their deviations are those of least squares,
with the autocovariance of the residuals in place of white noise. Rise time and overshoot are read from cubics through
the samples near the crossing or the peak; their deviations are those over draws of the noise. time_to_half is negative
for an oscillation that grows: minus the time to double amplitude. time_between_peaks is by how much peaks of the first
response come after those of the second, within half a period.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy

from casid.acceptance.smoothing import smooth

_FEWEST = 12  # samples of a fit
_FREQUENCIES = 60  # starts of the fit of an oscillation
_DAMPINGS = (-0.1, 0.02, 0.2, 0.6)
_LEAST_CYCLES = 0.5  # in the window, of an oscillation that can be fitted at all
_SAMPLES_PER_CYCLE = 6.0
_MOST_SAMPLES = 600  # of a fit; a longer response is thinned for the start alone
_LAGS = 0.1  # part of the samples over which residuals may be correlated
_DRAWS = 200
_ROUNDING = 1e-12  # of a response: what varies less is constant
_LOCAL = 6  # fewest samples of a cubic
_LOCAL_SHARE = 0.25  # of the rise, on either side, to which a cubic is fitted
_SETTLED = 0.1  # last part of a response, whose mean is its final value
# of a rise
_LOW = 0.1
_HIGH = 0.9


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A derived quantity: value and 1-sigma, SI; `cycles` of the oscillation that were seen, where it is of one."""

    value: float
    std: float
    cycles: float = math.nan


UNKNOWN = Quantity(value=math.nan, std=math.inf)  # what the samples do not determine


@dataclass(frozen=True, kw_only=True)
class QuantityKind:
    """Name of a derived quantity, its SI unit, and its measurement: a fitted oscillation, of two channels or one, or
    the samples t, y (N,) of a response."""

    words: str
    unit: str
    of_oscillation: Callable[[Oscillation], Quantity] | None = None
    of_response: Callable[[np.ndarray, np.ndarray], Quantity] | None = None
    of_two: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Oscillation:
    """y = c + d t + exp(-decay t) (a cos(frequency t) + b sin(frequency t)) of one or more channels."""

    decay: float  # decay, frequency: [1/s] and damped frequency [rad/s], of all channels
    frequency: float
    phases: np.ndarray  # (channels,) of each, y ~ cos(frequency t - phase) [rad]
    covariance: np.ndarray  # (2 + channels) square, of decay, frequency and phases
    duration: float  # of the window [s]

    @property
    def cycles(self) -> float:
        """Number of cycles that were seen."""
        return self.frequency * self.duration / (2.0 * math.pi)

    def quantity(self, value: float, gradient: Mapping[int, float]) -> Quantity:
        """A function of decay (0), frequency (1) and phases (2...) with its first-order deviation."""
        g = np.zeros(len(self.covariance))
        g[list(gradient)] = list(gradient.values())
        return Quantity(value=value, std=math.sqrt(max(g @ self.covariance @ g, 0.0)), cycles=self.cycles)


def oscillation(t: np.ndarray, responses: Sequence[np.ndarray]) -> Oscillation | None:
    """The damped sinusoid that fits responses (N,) best, with one decay and frequency; None when none can be fitted."""
    there = np.all([np.isfinite(y) for y in responses], axis=0)
    t = t[there] - t[0]
    Y = np.stack([y[there] for y in responses], axis=1)
    if len(t) < _FEWEST or not (Y.std(axis=0) > _ROUNDING * np.abs(Y).max(axis=0)).all():
        return None
    Y = Y / Y.std(axis=0)
    duration = t[-1] - t[0]
    thin = slice(None, None, -(-len(t) // _MOST_SAMPLES))
    start = _best_start(t[thin], Y[thin], duration)
    if start is None:
        return None

    def residuals(z: np.ndarray) -> np.ndarray:
        return _left(t, Y, z).ravel()

    found = scipy.optimize.least_squares(
        residuals, start, x_scale=np.maximum(np.abs(start), 0.1 / duration), xtol=1e-12, ftol=1e-12
    )
    decay, frequency = found.x
    if not found.success or not frequency > 0.0 or frequency * duration < 2.0 * math.pi * _LEAST_CYCLES:
        return None
    return _with_covariance(t, Y, float(decay), float(frequency), float(duration))


def _best_start(t: np.ndarray, Y: np.ndarray, duration: float) -> np.ndarray | None:
    """(decay, frequency) of a grid that leaves least."""
    lowest = 2.0 * math.pi * _LEAST_CYCLES / duration
    highest = 2.0 * math.pi * len(t) / (_SAMPLES_PER_CYCLE * duration)
    if highest <= lowest:
        return None
    grid = np.array(
        [(zeta * omega, omega) for omega in np.geomspace(lowest, highest, _FREQUENCIES) for zeta in _DAMPINGS]
    )
    return grid[np.argmin((_left(t, Y, grid) ** 2).sum(axis=(1, 2)))]


def _basis(t: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(..., N, 4) what an oscillation of decay and frequency z (..., 2) is made of."""
    decay = z[..., :1]
    phase = z[..., 1:] * t
    envelope = np.exp(np.clip(-decay * t, -50.0, 50.0))
    columns = np.broadcast_arrays(np.ones_like(t), t, envelope * np.cos(phase), envelope * np.sin(phase))
    return np.stack(columns, axis=-1)


def _left(t: np.ndarray, Y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(..., N, channels) residuals with the linear coefficients at their best."""
    B = _basis(t, z)
    Q = np.linalg.qr(B / np.maximum(np.linalg.norm(B, axis=-2, keepdims=True), 1e-300))[0]
    return Y - Q @ (Q.swapaxes(-1, -2) @ Y)


def _with_covariance(t: np.ndarray, Y: np.ndarray, decay: float, frequency: float, duration: float) -> Oscillation:
    """The oscillation with the covariance of decay, frequency and phases under coloured residuals."""
    B = _basis(t, np.array([decay, frequency]))
    coefficients = np.linalg.lstsq(B, Y, rcond=None)[0]
    channels = Y.shape[1]
    cos = B[:, 2]
    sin = B[:, 3]
    information = np.zeros((2 + 4 * channels, 2 + 4 * channels))
    score = np.zeros_like(information)
    for i in range(channels):
        a, b = coefficients[2:, i]
        J = np.zeros((len(t), len(information)))
        J[:, 0] = -t * (a * cos + b * sin)
        J[:, 1] = t * (b * cos - a * sin)
        J[:, 2 + 4 * i : 6 + 4 * i] = B
        left = Y[:, i] - B @ coefficients[:, i]
        variance = float(left @ left) / max(len(t) - 4 - 2 / channels, 1.0)
        weight = 1.0 / max(variance, 1e-30)
        information += weight * J.T @ J
        score += weight**2 * _score(J, left, variance)
    inverse = np.linalg.pinv(information, hermitian=True)
    every = inverse @ score @ inverse
    wanted = np.zeros((2 + channels, len(information)))
    wanted[0, 0] = wanted[1, 1] = 1.0
    for i in range(channels):
        a, b = coefficients[2:, i]
        wanted[2 + i, 4 + 4 * i : 6 + 4 * i] = np.array([-b, a]) / max(a * a + b * b, 1e-300)
    phases = np.arctan2(coefficients[3], coefficients[2])
    covariance = wanted @ every @ wanted.T
    return Oscillation(decay=decay, frequency=frequency, phases=phases, covariance=covariance, duration=duration)


def _score(J: np.ndarray, left: np.ndarray, variance: float) -> np.ndarray:
    """J' R J with the autocovariance R of the residuals, Bartlett's window (Morelli and Klein, J. Aircraft 34, 1997),
    not below that of white noise. What the fit takes of noise that is white near the frequencies of J is added in
    proportion."""
    lags = max(int(_LAGS * len(left)), 1)
    U, S, _ = np.linalg.svd(J, full_matrices=False)
    Q = U[:, 1e-10 * S[0] < S]
    window = 1.0 - np.arange(lags) / lags

    def form(autocovariance: np.ndarray) -> np.ndarray:
        return J.T @ scipy.linalg.matmul_toeplitz(np.pad(autocovariance, (0, len(J) - lags)), J)

    total = form(window * _lagged(left[:, None], lags))
    taken = form(window * _lagged(Q, lags))
    share = float(np.trace(np.linalg.pinv(J.T @ J, hermitian=True) @ taken)) / Q.shape[1]
    total /= max(1.0 - share, 0.1)
    least = variance * J.T @ J
    eigenvalues, vectors = np.linalg.eigh(total - least)
    return least + (vectors * eigenvalues.clip(min=0.0)) @ vectors.T


def _lagged(columns: np.ndarray, lags: int) -> np.ndarray:
    """(lags,) sum over the columns of their products with themselves so many samples later, per sample."""
    n = len(columns)
    return np.array([float((columns[k:] * columns[: n - k]).sum()) for k in range(lags)]) / n


def _period(o: Oscillation) -> Quantity:
    return o.quantity(2.0 * math.pi / o.frequency, {1: -2.0 * math.pi / o.frequency**2})


def _damping(o: Oscillation) -> Quantity:
    size = math.hypot(o.decay, o.frequency)
    return o.quantity(o.decay / size, {0: o.frequency**2 / size**3, 1: -o.decay * o.frequency / size**3})


def _time_to_half(o: Oscillation) -> Quantity:
    decay = o.decay if o.decay != 0.0 else 1e-300
    return o.quantity(math.log(2.0) / decay, {0: -math.log(2.0) / decay**2})


def _time_between_peaks(o: Oscillation) -> Quantity:
    phase = math.remainder(float(o.phases[0] - o.phases[1]), 2.0 * math.pi)
    gradient = {1: -phase / o.frequency**2, 2: 1.0 / o.frequency, 3: -1.0 / o.frequency}
    return o.quantity(phase / o.frequency, gradient)


def time_constant(t: np.ndarray, response: np.ndarray) -> Quantity:
    """Return the time constant of an exponential approach to a constant [s]."""
    there = np.isfinite(response)
    t = t[there] - t[0]
    y = response[there]
    if len(t) < _FEWEST or np.ptp(y) == 0.0:
        return UNKNOWN
    y = y / y.std()
    duration = float(t[-1])

    def basis(rate: float) -> np.ndarray:
        return np.stack([np.ones_like(t), np.exp(np.clip(-rate * t, -50.0, 50.0))], axis=1)

    def residuals(z: np.ndarray) -> np.ndarray:
        B = basis(z[0])
        return y - B @ np.linalg.lstsq(B, y, rcond=None)[0]

    rates = np.geomspace(0.2 / duration, 0.2 * len(t) / duration, _FREQUENCIES)
    start = min(rates, key=lambda rate: float((residuals(np.array([rate])) ** 2).sum()))
    found = scipy.optimize.least_squares(residuals, [start], x_scale=[start], xtol=1e-12, ftol=1e-12)
    rate = float(found.x[0])
    if not found.success or not rate > 0.0:
        return UNKNOWN
    B = basis(rate)
    coefficients = np.linalg.lstsq(B, y, rcond=None)[0]
    J = np.column_stack([-t * coefficients[1] * B[:, 1], B])
    left = y - B @ coefficients
    inverse = np.linalg.pinv(J.T @ J, hermitian=True)
    variance = float(left @ left) / max(len(t) - 3, 1)
    std = math.sqrt(max((inverse @ _score(J, left, variance) @ inverse)[0, 0], 0.0))
    return Quantity(value=1.0 / rate, std=std / rate**2)


def rise_time(t: np.ndarray, response: np.ndarray) -> Quantity:
    """Return the time from 10 % to 90 % of the way from the first to the final value [s], the mean of the last
    tenth."""
    return _of_step(t, response, _rise)


def overshoot(t: np.ndarray, response: np.ndarray) -> Quantity:
    """Return the excess of the peak over the final value, as a part of the way to it."""
    return _of_step(t, response, _beyond)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Step:
    """Responses (N, draws) to a step: the samples at t (N,), and where their smoothed curve rises."""

    t: np.ndarray
    curve: np.ndarray
    samples: np.ndarray

    @property
    def settled(self) -> slice:
        return slice(-max(int(_SETTLED * len(self.t)), 1), None)

    @property
    def rough(self) -> np.ndarray:
        """(N,) the smoothed curve, from 0 at its first sample to 1 at its final value."""
        final = self.curve[self.settled].mean()
        with np.errstate(divide="ignore", invalid="ignore"):
            return (self.curve - self.curve[0]) / (final - self.curve[0])

    def crossing(self, level: float) -> float:
        """When the smoothed curve first reaches a level; NaN where it does not."""
        way = self.rough
        k = int(np.argmax(way >= level))
        if not way[k] >= level or k == 0:
            return math.nan
        return float(self.t[k - 1] + (level - way[k - 1]) / (way[k] - way[k - 1]) * (self.t[k] - self.t[k - 1]))

    def local(self, at: float, half: float) -> tuple[np.ndarray, float]:
        """(4, draws) coefficients, lowest first, of the cubic through the samples within `half` of a time, in
        (t - at) over the scale that comes with it."""
        near = np.abs(self.t - at) <= half
        if near.sum() < _LOCAL:
            near = np.zeros(len(self.t), dtype=bool)
            near[np.argsort(np.abs(self.t - at), kind="stable")[:_LOCAL]] = True
        scale = float(np.abs(self.t[near] - at).max())
        return np.polynomial.polynomial.polyfit((self.t[near] - at) / scale, self.samples[near], 3), scale

    def first_and_final(self, half: float) -> tuple[np.ndarray, np.ndarray]:
        """(draws,) each."""
        return self.local(float(self.t[0]), half)[0][0], self.samples[self.settled].mean(axis=0)


def _rise(step: _Step, low: float, high: float) -> np.ndarray:
    half = _LOCAL_SHARE * (high - low)
    first, final = step.first_and_final(half)
    times = []
    for level, at in ((_LOW, low), (_HIGH, high)):
        c, scale = step.local(at, half)
        aim = first + level * (final - first)
        z = np.zeros(step.samples.shape[1])
        for _ in range(4):  # Newton's method
            z = z - (c[0] + z * (c[1] + z * (c[2] + z * c[3])) - aim) / (c[1] + z * (2.0 * c[2] + 3.0 * z * c[3]))
        times.append(at + scale * z)
    return times[1] - times[0]


def _beyond(step: _Step, low: float, high: float) -> np.ndarray:
    half = _LOCAL_SHARE * (high - low)
    first, final = step.first_and_final(half)
    c, _ = step.local(float(step.t[np.argmax(step.rough)]), 2.0 * half)
    z = np.linspace(-1.0, 1.0, 201)[:, None]
    peak = np.sign(final - first) * (c[0] + z * (c[1] + z * (c[2] + z * c[3])))
    return peak.max(axis=0) / np.abs(final - first) - np.sign(final - first) * first / np.abs(final - first) - 1.0


def _of_step(t: np.ndarray, response: np.ndarray, function: Callable[[_Step, float, float], np.ndarray]) -> Quantity:
    """A function of the response to a step and of the times when it has gone 10 and 90 % of its way, with its deviation
    over draws of the noise."""
    smoothed = smooth(t, response)
    samples = np.where(np.isfinite(response), response, smoothed.curve)[:, None]
    step = _Step(t=t, curve=smoothed.curve, samples=samples)
    low = step.crossing(_LOW)
    high = step.crossing(_HIGH)
    value = float(function(step, low, high)[0]) if math.isfinite(high - low) else math.nan
    if not math.isfinite(value):
        return UNKNOWN
    noise = np.random.default_rng(0).normal(0.0, smoothed.sigma, (len(t), _DRAWS))
    drawn = function(replace(step, samples=samples + noise), low, high)
    good = drawn[np.isfinite(drawn)]
    return Quantity(value=value, std=float(good.std()) if 2 * len(good) > _DRAWS else math.inf)


QUANTITIES: Mapping[str, QuantityKind] = MappingProxyType(
    {
        "period": QuantityKind(words="period", unit="s", of_oscillation=_period),
        "damping": QuantityKind(words="damping ratio", unit="1", of_oscillation=_damping),
        "time_to_half": QuantityKind(words="time to half amplitude", unit="s", of_oscillation=_time_to_half),
        "time_between_peaks": QuantityKind(
            words="time between peaks", unit="s", of_oscillation=_time_between_peaks, of_two=True
        ),
        "time_constant": QuantityKind(words="time constant", unit="s", of_response=time_constant),
        "rise_time": QuantityKind(words="rise time", unit="s", of_response=rise_time),
        "overshoot": QuantityKind(words="overshoot", unit="1", of_response=overshoot),
    }
)


def quantity(name: str, t: np.ndarray, responses: Sequence[np.ndarray]) -> Quantity:
    """A quantity of `QUANTITIES` from the samples of one response (N,), or of two; NaN when they do not tell it."""
    kind = QUANTITIES[name]
    if kind.of_response is not None:
        return kind.of_response(t, responses[0])
    found = oscillation(t, responses)
    return UNKNOWN if found is None or kind.of_oscillation is None else kind.of_oscillation(found)
