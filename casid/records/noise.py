"""Noise of a series of readings, judged without any model: its level, outliers, quiet windows, the update rate.

The level is that of the highest frequencies, above the motion. `casid.records.noise_spectrum` decides whether it holds
at all frequencies.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

_ORDER = 4
LEVELS = 30
ROUNDING = 1e-6  # of a channel's range: nearer levels are one, converted with rounding
_OFF_STEP = 0.05  # of a step, that the distance of two levels may miss a multiple by, as after a conversion of units
_UPDATES = 8  # updates from which a beat is judged
_HELD = 3.0  # readings per update from which a channel is held
_BEAT = 1.0  # samples by which an update may miss the beat
_IN_STEP = 0.9  # part of the updates that keep to it
_ONE_STEP = 1.5  # smallest changes below which a change is one step of the converter
FEWEST = 64  # samples from which a spectrum is judged
CUBIC = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0  # through two neighbours on either side
_BESIDE = 12  # readings on either side that show what scatter is usual
_ALONE = 0.6  # part of its distance from the cubic by which an outlier is off each neighbour
_MEDIAN_OF_NORMAL = 0.6745  # of the size, over 1-sigma
_WHITE = 4.0  # deviations of the correlation of neighbours, up to which noise is white
_FOLLOWED = 0.5  # correlation of neighbours that a motion has of which few readings are known


def high_band_sigma(values: np.ndarray) -> float:
    """Standard deviation of the white noise in a uniformly sampled series (N,); NaN when fewer than 20 differences.

    Robust scale of the fourth differences, which pass white noise with gain sqrt(70) and a motion of frequency f with
    (2 sin(pi f dt))^4: below 2 % at a tenth of the sampling rate.
    """
    good = values[np.isfinite(values)]
    if len(good) < 20 + _ORDER:
        return float("nan")
    differences = np.diff(good, _ORDER)
    gain = math.sqrt(sum(math.comb(_ORDER, k) ** 2 for k in range(_ORDER + 1)))
    scale = np.median(np.abs(differences - np.median(differences)))
    return float(1.482602218505602 * scale / gain)


def resolution(values: np.ndarray, fewest: int = LEVELS) -> float:
    """Smallest step between distinct values: the quantisation of a channel; 0 for a series of `fewest` levels or less,
    which may be the signal's own, as of an input of steps. Levels that differ by rounding, as after a conversion of
    units, are one."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < fewest:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > ROUNDING * (levels[-1] - levels[0])]
    return float(steps.min()) if len(steps) + 1 >= fewest else 0.0


def converter_step(values: np.ndarray, fewest: int = LEVELS) -> float:
    """Step of the converter of a channel, of which its levels, `fewest` or more, are multiples apart; NaN where they
    are not."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < fewest:
        return math.nan
    apart = np.diff(levels)
    apart = apart[apart > ROUNDING * (levels[-1] - levels[0])]
    count = np.rint(apart / apart.min())
    step = float(apart.sum() / count.sum())
    return step if np.max(np.abs(apart / step - count)) < _OFF_STEP else math.nan


def real_updates(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(N,) True at the readings of a channel (N,) that are new, the first after each update of a slower recorder; of
    any other channel all that are there. A slower recorder shows by its beat: the value changes after multiples of one
    time, while a channel of coarse steps changes at any time, by one step."""
    there = np.isfinite(values)
    at = np.flatnonzero(there)
    if len(at) < FEWEST:
        return there
    new = np.flatnonzero(np.diff(values[at]) != 0.0) + 1
    if len(new) < _UPDATES or not len(new) < len(at) / _HELD:
        return there
    changes = np.abs(np.diff(values[at])[new - 1])
    if np.mean(changes < _ONE_STEP * changes.min()) > _IN_STEP:
        return there
    runs = np.diff(new)
    beat = float(np.median(runs))
    multiples = np.maximum(np.rint(runs / beat), 1.0)
    if beat < _HELD or np.mean(np.abs(runs - multiples * beat) <= _BEAT) < _IN_STEP:
        return there
    first = np.zeros(len(t), dtype=bool)
    first[at[new]] = True
    return first


def pooled_sigma(series: list[np.ndarray], continuous: bool = False) -> float:
    """High-band noise of one channel over several records: the median, and never below the quantisation noise. Of what
    is `continuous`, as motion is, levels are steps of a converter however few there are."""
    sigmas = [s for s in map(high_band_sigma, series) if np.isfinite(s)]
    if not sigmas:
        return float("nan")
    quantum = float(np.median([resolution(values, 2 if continuous else LEVELS) for values in series]))
    return max(float(np.median(sigmas)), quantum / np.sqrt(12.0))


_HALF_WIDTHS = (0, 1, 2, 4, 8, 16, 32)
_CONFIDENCE = 2.0
# change of the mean from one sample to the next that is a movement, in sigmas; samples near it
_MOVED = 1.5
_NEAR = 2
# sigmas by which a sample is ahead of the rest and so on its way, short of it and not there yet, or cannot be noise
_ON_THE_WAY = 1.0
_NOT_THERE = 2.0
_NOISE = 3.0


def mean_over(values: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(N,) mean of a series from sample `first` to sample `last`: over `quiet_windows`, denoised and with its edges."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return (total[last + 1] - total[first]) / (last - first + 1)


def quiet_windows(values: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """(first, last) samples of a window at every sample of a series (N,) with white noise `sigma`: the widest, centred
    or to one side, whose mean agrees with those of all narrower ones (intersection of confidence intervals;
    Goldenshluger and Nemirovski 1997). It is long while a surface rests and one sample while it moves."""
    at = np.arange(len(values))
    begin = at.copy()
    end = at.copy()
    if not sigma > 0.0:
        return begin, end
    total = np.concatenate([[0.0], np.cumsum(values)])
    for before, after in ((1, 1), (2, 0), (0, 2)):
        open_ = np.ones(len(values), dtype=bool)
        low = np.full(len(values), -np.inf)
        high = np.full(len(values), np.inf)
        for half in _HALF_WIDTHS:
            first = np.maximum(at - before * half, 0)
            last = np.minimum(at + after * half, len(values) - 1)
            if before == after:
                reach = np.minimum(at - first, last - at)
                first = at - reach
                last = at + reach
            count = last - first + 1
            mean = (total[last + 1] - total[first]) / count
            margin = _CONFIDENCE * sigma / np.sqrt(count)
            low = np.maximum(low, mean - margin)
            high = np.minimum(high, mean + margin)
            open_ &= low <= high
            wider = open_ & (last - first > end - begin)
            begin = np.where(wider, first, begin)
            end = np.where(wider, last, end)
    return _off_movement(values, sigma, begin, end)


def _off_movement(
    values: np.ndarray, sigma: float, begin: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The windows, but of samples near a movement that of the rest before or after it, where they agree with its mean,
    and else the sample alone. A mean over the beginning of a movement is compatible with the rest, and late."""
    at = np.arange(len(values))
    mean = mean_over(values, begin, end)
    moves = np.abs(np.diff(mean, prepend=mean[0])) > _MOVED * sigma
    near = np.convolve(moves, np.ones(2 * _NEAR + 1))[_NEAR:-_NEAR] > 0.0
    first = np.where(near, at, begin)
    last = np.where(near, at, end)
    before = np.maximum.accumulate(np.where(near, -1, at))
    after = np.minimum.accumulate(np.where(near, len(values), at)[::-1])[::-1]
    way = np.sign(mean[np.minimum(at + _NEAR, len(values) - 1)] - mean[np.maximum(at - _NEAR, 0)])
    for rest, back, ahead in ((before, _NOISE, _ON_THE_WAY), (after, _NOT_THERE, _NOISE)):
        known = near & (rest >= 0) & (rest < len(values)) & (np.abs(rest - at) <= 2 * _NEAR + 1)
        rest = np.where(known, rest, at)
        moved = way * (values - mean[rest]) / sigma
        rests = known & (moved > -back) & (moved < ahead)
        first = np.where(rests, begin[rest], first)
        last = np.where(rests, end[rest], last)
    return first, last


def isolated(values: np.ndarray, sigmas: float) -> np.ndarray:
    """(N,) True at single readings of a series (N,) that are `sigmas` scatters or more from the cubic through their
    neighbours, and on the same side of both."""
    at = np.zeros(len(values), dtype=bool)
    if len(values) < FEWEST:
        return at
    off = values[2:-2] - np.convolve(values, CUBIC, mode="valid")
    size = np.abs(off)
    usual = scipy.ndimage.median_filter(size, 2 * _BESIDE + 1, mode="nearest")
    scatter = max(float(np.median(size)), 0.3 * resolution(values)) / _MEDIAN_OF_NORMAL
    sides = np.stack([values[2:-2] - values[1:-3], values[2:-2] - values[3:-1]]) * np.sign(off)
    far = size > sigmas * np.maximum(usual / _MEDIAN_OF_NORMAL, scatter)
    at[2:-2] = far & (sides.min(axis=0) > _ALONE * size)
    return at


def time_scale(t: np.ndarray, values: np.ndarray) -> float:
    """Time scale [s] of a motion (N,): 1-sigma of the signal over that of its rate, 1/omega of a sine. White noise is
    taken off both; NaN where nothing but noise is left."""
    there = np.isfinite(values)
    if there.sum() < FEWEST // 2:
        return math.nan
    t = t[there]
    series = scipy.signal.detrend(values[there])
    step = float(np.median(np.diff(t)))
    sigma = float(np.nan_to_num(high_band_sigma(series)))
    moves = float(np.var(series)) - sigma**2
    quick = float(np.mean(((series[2:] - series[:-2]) / (2.0 * step)) ** 2)) - 0.5 * (sigma / step) ** 2
    return math.sqrt(moves / quick) if moves > sigma**2 and quick > 0.0 else math.nan


def is_noise(values: np.ndarray) -> bool:
    """Tell whether no reading of a series (N,) depends on the one before it, as of white noise on a constant or a slow
    drift; every motion that is sampled often enough to be followed does."""
    seen = values[np.isfinite(values)]
    if len(seen) < 2 or np.ptp(seen) == 0.0:
        return True
    left = scipy.signal.detrend(seen)
    most = min(_WHITE / math.sqrt(len(left)), _FOLLOWED)
    return float(np.mean(left[1:] * left[:-1])) < most * float(np.mean(left**2))
