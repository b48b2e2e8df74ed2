"""Spectrum of the noise in a measured channel, judged without any model: from the band above the motion.

Evidence for or against a model comes from the band of the motion, so what counts is the noise's spectral density there.
It is that of the high band when the noise is white. A channel that was low-pass filtered before it was sampled, or is
held, or is quantised coarsely against its noise, shows less than that at the top of its spectrum. `high_band_holds`
tells, and `density_sigma` reads the density from another band, as the 1-sigma of white noise of equal density.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from casid.records.noise import FEWEST, isolated, pooled_sigma, resolution
from casid.records.record import Record

_COARSE = 2.0  # high band over quantisation noise below which the latter may be all that it shows
_SCATTER = 1.5  # relative variance of the mean of Hann-windowed bins, times their number
_ROLL_OFF = 1.2  # ratio of densities in power above which a spectrum is not flat, beside 3 sigmas of its scatter
_CLIFF = 16.0  # amplitude ratio of neighbouring octaves above that of any motion: fourth order
_OUTLYING = 5.0  # scatters from which a reading is none of the noise whose spectrum is read
_MOTION_SHARE = 0.9  # of the power of angular acceleration
_STRETCH = 32  # samples of a short stretch
_QUIET = 0.25  # part of the stretches in which noise is judged
_OF_QUANTILE = 1.36  # scatter of that quantile over that of the mean, Gaussian


def high_band_holds(records: Sequence[Record], channel: str, edge_hz: float) -> bool:
    """Return True if the high-band noise of a channel represents its noise at all frequencies.

    Not when the upper half of its spectrum falls where the motion is quiet (a gentle filter), when it falls more
    steeply beyond twice `edge_hz`, the end of the motion, than motion does (a sharp filter), or when the high band
    shows little more than the quantisation. Short records and few levels are taken as good.
    """
    series = [record[channel] for record in records]
    sigma = pooled_sigma(series)
    if not np.isfinite(sigma) or min(np.isfinite(values).sum() for values in series) < FEWEST:
        return True
    step = float(np.median([resolution(values) for values in series]))
    if sigma < _COARSE * step / math.sqrt(12.0):
        return False
    nyquist = 0.5 * min(1.0 / _own_step(record, channel) for record in records)
    middle, top, count = _quiet_levels(records, channel, 0.5 / nyquist)
    scatter = _OF_QUANTILE * math.sqrt(2.0 * _SCATTER / max(count, 1))
    if middle > _ROLL_OFF * math.exp(3.0 * scatter) * top:
        return False
    share, power = _spectrum(records, channel, 0.5 / nyquist)
    return edge_hz == 0.0 or not _falls_off(share, power, 2.0 * edge_hz / nyquist)


def _quiet_levels(records: Sequence[Record], channel: str, step: float) -> tuple[float, float, int]:
    """Power from a half to three quarters of half the sampling rate, `step` [s] over half of that rate, and above; in
    the quiet quarter of all short stretches of the records; and how many bins of each there are."""
    middle = []
    top = []
    count = 0
    for record in records:
        values = _readings(record, channel)
        frequency, _, power = scipy.signal.spectrogram(values, 2.0, "hann", _STRETCH, _STRETCH // 2, detrend="linear")
        share = frequency * step / _own_step(record, channel)
        bands = (share >= 0.5) & (share < 0.75), (share >= 0.75) & (share < 1.0)
        if all(band.any() for band in bands):
            middle.append(power[bands[0]].mean(axis=0))
            top.append(power[bands[1]].mean(axis=0))
            count += len(values) // 8
    if not middle:
        return 0.0, 0.0, 0
    low, high = (float(np.quantile(np.concatenate(one), _QUIET)) for one in (middle, top))
    return low, high, count


@np.errstate(over="ignore", invalid="ignore")  # residuals of a simulation that departs
def density_sigma(records: Sequence[Record], channel: str, band_hz: tuple[float, float]) -> float:
    """1-sigma of the white noise, at the channel's own rate, that has its density in a band, or in as many octaves
    below half the sampling rate. The median over frequencies, so that a line or a structural mode does not count."""
    nyquist = 0.5 * min(1.0 / _own_step(record, channel) for record in records)
    highest = min(band_hz[1], nyquist)
    low, high = (edge * highest / (band_hz[1] * nyquist) for edge in band_hz)
    share, power = _spectrum(records, channel, 0.5 / nyquist)
    return math.sqrt(_median_level(power[(share >= low) & (share <= high)]))


def motion_edge(records: Sequence[Record]) -> float:
    """Frequency [Hz] below which 90 % of the power of angular acceleration, the quickest part of the motion, lies; 0
    when no rate is measured or moves. It is the slope of p, q and r with their noise taken off."""
    frequency = []
    power = []
    for name in ("p", "q", "r"):
        there = [record[name][np.isfinite(record[name])] for record in records if name in record]
        if len(there) < len(records) or min(map(len, there)) < FEWEST or not any(np.ptp(one) > 0.0 for one in there):
            continue
        noise = np.nan_to_num(pooled_sigma([record[name] for record in records]))
        for record in records:
            share, spectrum = _periodogram(record, name)
            step = _own_step(record, name)
            frequency.append(share / (2.0 * step))
            power.append((spectrum - noise**2) * (np.sin(0.5 * np.pi * share) / step) ** 2)
    if not power:
        return 0.0
    order = np.argsort(np.concatenate(frequency), kind="stable")
    below = np.cumsum(np.concatenate(power)[order])
    if below[-1] <= 0.0:
        return 0.0
    return float(np.concatenate(frequency)[order][np.argmax(below >= _MOTION_SHARE * below[-1])])


def _own_step(record: Record, channel: str) -> float:
    """Mean time [s] between the samples that a channel has."""
    t = record.t[np.isfinite(record[channel])]
    return float((t[-1] - t[0]) / (len(t) - 1)) if len(t) > 1 else record.dt


def _periodogram(record: Record, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """(frequency over half the channel's own sampling rate, power); white noise of 1-sigma s has power s^2 throughout.
    Missing samples and outliers are left out."""
    frequency, power = scipy.signal.periodogram(_readings(record, channel), 2.0, "hann", detrend="linear")
    return frequency[1:], power[1:]


def _readings(record: Record, channel: str) -> np.ndarray:
    """Samples of a channel that are there and are no outliers."""
    values = record[channel][np.isfinite(record[channel])]
    return values[~isolated(values, _OUTLYING)]


def _spectrum(records: Sequence[Record], channel: str, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Periodograms of all records as one, over half the sampling rate of `step` [s]: power as of samples at that
    rate."""
    shares = []
    powers = []
    for record in records:
        share, power = _periodogram(record, channel)
        ratio = step / _own_step(record, channel)
        shares.append(share * ratio)
        powers.append(power / ratio)
    return np.concatenate(shares), np.concatenate(powers)


def _falls_off(share: np.ndarray, power: np.ndarray, edge: float) -> bool:
    """Return True if above `edge`, a share of half the sampling rate, an octave is that much denser than the next
    one."""
    while 2.0 * edge < 1.0:
        octave, next_one = (power[(share >= low) & (share < 2.0 * low)] for low in (edge, 2.0 * edge))
        if len(next_one) >= FEWEST // 8 and _median_level(octave) > _CLIFF**2 * _median_level(next_one):
            return True
        edge *= math.sqrt(2.0)
    return False


def _median_level(power: np.ndarray) -> float:
    """Mean power of noise from the median of its periodogram, whose bins are chi-square with two degrees of freedom."""
    return float(np.median(power)) / math.log(2.0) if len(power) else 0.0
