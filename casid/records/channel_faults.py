"""Find faults that one channel shows alone: frozen stretches, held values, rails, isolated outliers, codes for "no
value".

Every judgement is one of exact repeats or of single samples; what moves slowly is nobody's fault here.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from casid.records.checks import GAP, INPUTS
from casid.records.noise import CUBIC, ROUNDING
from casid.records.record import Record
from casid.records.series import across_gaps, unwrapped
from casid.signals import CHANNELS, SURFACES, unit_of

_FEWEST = 60  # finite samples from which a channel is judged
_LEVELS = 20  # distinct values below which a channel is of steps
# own sampling interval over the record's; part of a record in runs: a slower recorder
_SLOWER = 1.5
_STAIRCASE = 0.4
_REPEATS = 0.1  # chance of a repeat that is allowed for at least: recorders differ
_NEVER = 0.02  # chance of a repeat below which a channel has no levels, and a run of them needs no jump behind it
_BESIDE = 5  # samples on either side of a plateau that show how fast the channel moves there
_EDGE = 8  # samples at either end of a part in which filters leave artefacts
_MOVES_WITH = {"phi": ("p", "ay", "beta"), "beta": ("ay", "r", "phi"), "theta": ("q", "az"), "alpha": ("q", "az")}
_INTEGRATED = frozenset(("phi", "theta", "psi", "altitude", "north", "east"))  # by a filter, from rates
_EVERY = (4, 25)  # samples from one correction of a filter to the next
_QUICK = frozenset(("pdot", "qdot", "rdot"))  # what answers a surface at once, and may in a single sample
_ANSWER = 3.0  # of the range of nine tenths of the samples: no answer to a surface is a peak as high
_OF_ANSWER = (0.4, 2.5)  # of the answer by a file, whose derivatives are not exact, that a jump may be
# What instruments read. A command rests, jumps and has stops as it likes, and so may a column that nobody knows.
_READ = frozenset(CHANNELS) - {"t", "rho", "throttle"}
_SOON = 0.25  # s from a step of a surface within which an angular acceleration may peak; recorders are late by 0.2 s
_OF_RANGE = 0.5  # of the range of an input: a smaller outlier may be a command
_MATTERS = 0.03  # of the range of an output: one sample nearer to the others changes nothing
_COMPANIONS: tuple[frozenset[str], ...] = (
    frozenset(("beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot")),
    frozenset(("V", "alpha", "q", "theta", "ax", "az", "qdot", "altitude")),
)
# limits of the decisions, each with its reason
# expected number of runs as long, or longer, in a healthy channel of this length; derived: one false alarm in 10 000
# channels, were repeats independent
_CHANCE = 1e-4
# s: a run as long, or one to the end of the record, is frozen, a shorter one a held value; chosen: a recorder that
# loses messages holds the last one for shorter
_FROZEN = 3.0
_HELD = 0.15  # s: shorter runs are left alone; chosen: what is shorter passes for quantisation
# fewest samples at exactly the largest (or smallest) value of a clipped channel; chosen: the crest of a quantised
# motion has a few, see also `_CROWDED`
_RAIL = 6
# samples at a rail over samples at a level near it; derived: the crest of a sine in 16 levels has 3.3 times the mean of
# the next seven
_CROWDED = 10.0
# distance of an isolated outlier from the cubic through its neighbours, in scatters of that; measured: none in 13 clean
# real records
_SPIKE = 10.0
# kinks of an attitude or a position at every n-th sample, over those at the others; derived: medians of 32 samples of
# white noise scatter by a fifth
_STEPS = 3.0
# distance of a code from the median, over the range of nine tenths of the samples; chosen: a quick manoeuvre in a long
# rest has no edges on both sides
_CODE = 10.0


@dataclass(frozen=True, eq=False, kw_only=True)
class ChannelFault:
    """A fault of one channel in one record: samples that are not to be believed."""

    kind: str  # data_stuck, data_dropout, data_clipped, data_spikes or data_steps
    target: str
    record: str
    at: np.ndarray  # (N,) True at the samples concerned
    # level at which it rests (the rail, the frozen value); None of outliers and of several holds
    value: float | None = None

    def intervals(self, t: np.ndarray) -> list[tuple[float, float]]:
        """Begin and end [s] of every stretch of samples concerned."""
        return [(float(t[first]), float(t[last])) for first, last in stretches(self.at)]


def stretches(at: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def channel_faults(
    record: Record,
    answers: Mapping[str, np.ndarray] | None = None,
    names: Collection[str] = _READ,
) -> list[ChannelFault]:
    """The faults that channels of these names show by themselves, in the order in which they are to be taken out. A
    sample that `answers`, channel -> (N,) what surfaces make of it at once, explain is no outlier."""
    found: list[ChannelFault] = []
    parts = _unbroken(record)
    commanded = _commanded(record)
    for name, values in record.channels.items():
        if name not in names or np.isfinite(values).sum() < _FEWEST or _rests(values):
            continue
        faults, clean = _of_levels(record, name, values)
        if not update_interval(record, name) > _SLOWER * record.dt:
            wild = _spikes(clean, parts, least=_OF_RANGE if name in INPUTS else _MATTERS)
            if name in _QUICK and (wild & commanded).any():
                wild &= ~commanded | _spikes(clean, parts, least=_ANSWER)
            if wild.any() and answers is not None and name in answers:
                wild &= ~_answered(clean, answers[name])
            faults["data_spikes"] = faults["data_spikes"] | wild
            faults["data_steps"] = _stepped(record, name, np.where(wild, np.nan, clean))
        for kind, at in faults.items():
            if at.any():
                level = float(values[at][0]) if kind in ("data_stuck", "data_clipped") else None
                found.append(ChannelFault(kind=kind, target=name, record=record.name, at=at, value=level))
    return found


def _of_levels(record: Record, name: str, values: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Kind -> samples of what an output repeats, and codes of any channel; and the values without these."""
    codes = _codes(values)
    clean = np.where(codes, np.nan, values)
    found = {"data_spikes": codes}
    if name in INPUTS:
        return found, clean  # a surface rests, and has stops
    rail = _rails(clean)
    frozen, held = _held(record, name, np.where(rail, np.nan, clean))
    if rail.any():
        edges = np.isin(clean, (np.nanmin(clean), np.nanmax(clean))) & (frozen | held)
        rail = rail | edges
        frozen = frozen & ~edges
        held = held & ~edges
        if len(stretches(rail)) == 1 and len(stretches(held)) > 1:
            rail, held = np.zeros_like(rail), held | rail  # one of the holds was at the crest
    found |= {"data_clipped": rail, "data_stuck": frozen, "data_dropout": held}
    beside = np.convolve(rail | frozen | held, np.ones(5), mode="same") > 0.5
    return found, np.where(beside, np.nan, clean)


def _commanded(record: Record) -> np.ndarray:
    """(N,) whether a surface has just been moved at once: what responds to that may show in a single sample."""
    at = np.zeros(len(record), dtype=bool)
    for name in SURFACES:
        if name in record:
            steps = np.abs(np.diff(record[name], prepend=record[name][0]))
            at |= (steps > 9.0 * float(np.median(steps))) & (steps > 0.25 * float(steps.max()))
    reach = round(_SOON / record.dt)
    return np.convolve(at, np.ones(2 * reach + 1), mode="same")[: len(at)] > 0.5


def _unbroken(record: Record) -> list[slice]:
    """Parts of the record between gaps in its time."""
    gaps = np.flatnonzero(np.diff(record.t) > GAP * record.dt) + 1
    edges = [0, *gaps.tolist(), len(record)]
    return [slice(a, b) for a, b in pairwise(edges)]


def without_faults(record: Record, faults: Iterable[ChannelFault]) -> Record:
    """The record with samples of outputs that are not plausible set missing, and those of inputs interpolated. What is
    corrected in steps is wrong between them, too, and stays."""
    changed: dict[str, np.ndarray] = {}
    for fault in faults:
        if fault.record != record.name or fault.kind == "data_steps":
            continue
        values = np.where(fault.at, np.nan, changed.get(fault.target, record[fault.target]))
        if fault.target in INPUTS:
            values = across_gaps(record.t, values)
        changed[fault.target] = values
    return record.with_channels(**changed) if changed else record


def not_moving(records: Sequence[Record]) -> list[ChannelFault]:
    """Outputs that do not move throughout a record while what belongs to them moves in it: they do in others, or are an
    angle of zero, which was not measured."""
    found = []
    for record in records:
        for name, values in record.channels.items():
            if name in INPUTS or not _rests(values):
                continue
            others = [other for other in records if other is not record and name in other]
            beside = next((group for group in _COMPANIONS if name in group), frozenset()) - {name}
            zero = name in _MOVES_WITH and not np.nanmax(np.abs(values))
            beside = frozenset(_MOVES_WITH[name]) if zero else beside
            moving = any(n in record and not _rests(record[n]) for n in beside)
            if moving and (zero or any(not _rests(other[name]) for other in others)):
                at = np.isfinite(values)
                level = float(values[at][0]) + 0.0
                found.append(ChannelFault(kind="data_stuck", target=name, record=record.name, at=at, value=level))
    return found


def _rests(values: np.ndarray) -> bool:
    good = values[np.isfinite(values)]
    return len(good) > 0 and float(np.ptp(good)) == 0.0


def runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(first sample, number of samples) of every stretch of equal values; missing samples are stretches of one."""
    new = np.concatenate([[True], values[1:] != values[:-1]])
    first = np.flatnonzero(new)
    return first, np.diff(np.concatenate([first, [len(values)]]))


def update_interval(record: Record, name: str) -> float:
    """Median time [s] between the new samples of a channel, whose own rate may be slower than the record."""
    values = record[name]
    first, _ = runs(values)
    fresh = first[np.isfinite(values[first])]
    return float(np.median(np.diff(record.t[fresh]))) if len(fresh) > 10 else math.nan


def _held(record: Record, name: str, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples of runs of equal values that are too long to be chance: frozen, long or to the end; held, with a jump
    behind them."""
    first, length = runs(values)
    frozen = np.zeros(len(values), dtype=bool)
    held = np.zeros(len(values), dtype=bool)
    if len(first) < 10:
        return frozen, held
    shortest = max(5.0, 3.0 * float(np.median(length)), _HELD / record.dt)
    long_ones = length > shortest
    rest = length[~long_ones]
    repeats = (float(np.sum(rest - 1)) + 1.0) / (float(np.sum(rest)) + 2.0)
    many = length[long_ones] if repeats < _NEVER else length[long_ones][:0]
    needed = max(shortest, _improbable(many, len(values), max(repeats, _REPEATS)))
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    for begin, count in zip(first[long_ones].tolist(), length[long_ones].tolist(), strict=True):
        end = begin + count
        seconds = (count - 1) * record.dt
        ends = end >= len(values)
        jumps = ends or repeats < _NEVER or not np.isfinite(values[end])
        jumps = jumps or abs(values[end] - values[begin]) > 3.0 * step
        if count < needed or not jumps or (begin == 0 and _all_rest(record, name, end)):
            continue
        if seconds >= _FROZEN or (ends and seconds >= 1.0):
            frozen[begin + 1 : end] = True
        elif not ends:
            held[begin + 1 : end] = True
    if held.mean() > _STAIRCASE:  # a channel of a slower recorder
        held[:] = False
    return frozen, held


def _improbable(many: np.ndarray, samples: int, repeats: float) -> float:
    """Length from which a run is less probable than `_CHANCE` when samples repeat by themselves with a probability of
    `repeats`; of `many` runs together each may be shorter. Long runs by chance are a Poisson process: n of them, of
    which m are expected, have a probability of m^n / n! at most."""

    def least(count: int) -> float:
        each = (math.log(_CHANCE) + math.lgamma(count + 1)) / count  # the logarithm of m
        return 1.0 + (math.log(samples) - each) / -math.log(repeats)

    needed = least(1)
    for count, one in enumerate(sorted(many.tolist(), reverse=True), start=1):
        needed = min(needed, one) if one >= least(count) else needed
    return needed


def _all_rest(record: Record, name: str, end: int) -> bool:
    """Return True if most other outputs rest, too, up to a sample: a simulation that begins in trim."""
    others = [v[:end] for n, v in record.channels.items() if n not in INPUTS and n != name]
    resting = [_rests(v) for v in others]
    return bool(resting) and float(np.mean(resting)) > 0.5


def _rails(values: np.ndarray) -> np.ndarray:
    """Samples at which a channel sticks to its largest, its smallest or both values."""
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    at = np.zeros(len(values), dtype=bool)
    if len(levels) < _LEVELS:
        return at
    gaps = np.diff(levels)
    quantum = float(gaps[gaps > ROUNDING * (levels[-1] - levels[0])].min())
    for edge, near in ((0, slice(1, 8)), (-1, slice(-8, -1))):
        here = values == levels[edge]
        inside = [(a, b) for a, b in stretches(here) if a > 0 and b < len(values) - 1]  # at an end it may be frozen
        samples = sum(b - a + 1 for a, b in inside)
        crowded = samples >= max(_RAIL, _CROWDED * counts[near].mean())
        if crowded and _has_corners(values, inside, quantum):
            at |= here
    return at


def _has_corners(values: np.ndarray, plateaus: list[tuple[int, int]], quantum: float) -> bool:
    """Return True if a channel leaves its longest plateau faster than a parabola with such a crest in its
    resolution."""
    first, last = max(plateaus, key=lambda plateau: plateau[1] - plateau[0])
    if last - first < 1 and len(plateaus) < 3 * _RAIL:
        return False
    exits = [ratio for ratio in (_exit(values, *plateau) for plateau in plateaus) if np.isfinite(ratio)]
    if exits and float(np.median(exits)) > 2.0:
        return False  # it was held there, and has moved on
    half = 0.5 * (last - first + 1)
    outside = [k for k in (first - 3, last + 3) if 0 <= k < len(values)]
    drops = [abs(values[k] - values[first]) for k in outside if np.isfinite(values[k])]
    return bool(drops) and float(np.mean(drops)) > 4.0 * quantum * ((half + 3.0) / half) ** 2


def _exit(values: np.ndarray, first: int, last: int) -> float:
    """Step by which a channel leaves a plateau, over the largest step of the samples near it: what was held there moved
    on meanwhile, what is clipped leaves as fast as it came. NaN where that is not known."""
    steps = np.abs(np.diff(values[max(0, first - _BESIDE) : last + 2 + _BESIDE]))
    at = last - max(0, first - _BESIDE)
    near = np.concatenate([steps[: min(first, _BESIDE)], steps[at + 1 :]])
    near = near[np.isfinite(near)]
    if at >= len(steps) or not len(near) or near.max() == 0.0:
        return math.nan
    return float(steps[at] / near.max())


def _answered(values: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """(N,) whether a sample is off the cubic through its neighbours as the answer to a surface is there."""
    off, expected = (x - np.convolve(x, CUBIC, mode="same") for x in (values, answer))
    least, most = _OF_ANSWER
    return (off * expected > 0.0) & (np.abs(off) > least * np.abs(expected)) & (np.abs(off) < most * np.abs(expected))


def _stepped(record: Record, name: str, values: np.ndarray) -> np.ndarray:
    """Samples at which an attitude or a position jumps at every n-th sample and goes on from there: a filter that is
    corrected in steps. A channel of a slower recorder rests between, and is none."""
    at = np.zeros(len(values), dtype=bool)
    good = np.isfinite(values)
    if name not in _INTEGRATED or np.mean(np.diff(values[good]) == 0.0) > _STAIRCASE:
        return at
    series = across_gaps(record.t, unwrapped(values) if unit_of(name) == "rad" else values)
    change = np.diff(series)
    kink = np.abs(change[1:-1] - 0.5 * (change[:-2] + change[2:]))
    kink[kink < ROUNDING * np.ptp(series)] = 0.0
    most = _STEPS
    for every in range(_EVERY[0], min(_EVERY[1], len(kink) // _EVERY[1]) + 1):
        usual = np.array([np.median(kink[phase::every]) for phase in range(every)])
        phase = int(np.argmax(usual))
        others = float(np.median(np.delete(usual, [(phase + k) % every for k in (-1, 0, 1)])))
        if usual[phase] > most * others > 0.0:
            most = usual[phase] / others
            at = np.arange(len(values)) % every == (phase + 2) % every
    return at & good


# samples on either side that show what is usual
_WINDOW = 25
_NEAR = 12


def _spikes(values: np.ndarray, parts: Sequence[slice], least: float) -> np.ndarray:
    """Single samples far from the cubic through their neighbours, which agree among each other, and farther than what
    is usual near them; `least` as a part of the range of nine tenths of the samples."""
    low, high = np.nanquantile(values, (0.05, 0.95))
    at = np.zeros(len(values), dtype=bool)
    for part in parts:
        good = np.arange(len(values))[part]
        good = good[np.isfinite(values[good])]
        if len(good) >= _FEWEST:
            at[good] = _isolated(good, values[good], least * (high - low))
    return at


def _isolated(sample: np.ndarray, series: np.ndarray, least: float) -> np.ndarray:
    """(N,) outliers of a series of which `sample` numbers the samples: neighbours must be in it."""
    at = np.zeros(len(series), dtype=bool)
    series = series.copy()
    steps = np.abs(np.diff(series))
    resolution = float(steps[steps > 0.0].min()) if (steps > 0.0).any() else 0.0
    together = sample[4:] - sample[:-4] == 4
    for _ in range(len(series) // 10):
        off = series[2:-2] - np.convolve(series, CUBIC, mode="valid")
        size = np.abs(off)
        floor = max(0.5 * 1.4826 * float(np.median(size)), 0.3 * resolution)
        far = size > max(_SPIKE * floor, least)
        if not far.any():
            break
        far &= size > _SPIKE * 1.4826 * _local_median(size)
        before = series[2:-2] - series[1:-3]
        after = series[2:-2] - series[3:-1]
        far &= together & (before * after > 0.0) & (np.minimum(np.abs(before), np.abs(after)) > 0.6 * size)
        far[: _EDGE - 2] = False
        far[2 - _EDGE :] = False
        reached = np.convolve(far, np.ones(5), mode="same") > 0.5  # the cubic spreads an outlier over five samples
        for k in np.flatnonzero(far)[np.argsort(-size[far])]:
            beside = slice(max(0, k - _NEAR), max(0, k - 2)), slice(k + 3, k + 1 + _NEAR)
            usual = [size[side][~reached[side]] for side in beside if 2 * reached[side].sum() <= len(size[side]) > 0]
            if len(usual) == 2 and size[k] > 3.0 * max(float(np.quantile(one, 0.9)) for one in usual):
                at[k + 2] = True
                series[k + 2] -= off[k]
                break
        else:
            break
    return at


def _local_median(size: np.ndarray) -> np.ndarray:
    """(N,) median over a window, stepwise: one for every half window."""
    blocks = max(1, len(size) // _WINDOW)
    edges = np.linspace(0, len(size), blocks + 1).astype(int)
    middle = 0.5 * (edges[1:] + edges[:-1])
    medians = [
        float(np.median(size[max(0, a - _WINDOW) : b + _WINDOW])) for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    return np.interp(np.arange(len(size)), middle, medians)


def _codes(values: np.ndarray) -> np.ndarray:
    """Values far from all others with an edge on both sides: -999, 9999 and the like."""
    once = values[runs(values)[0]]  # a rest counts once, however long
    low, middle, high = np.quantile(once[np.isfinite(once)], (0.05, 0.5, 0.95))
    far = np.abs(values - middle) > _CODE * max(high - low, 1e-300)
    at = np.zeros(len(values), dtype=bool)
    if high == low or not far.any():
        return at
    for first, last in stretches(far):
        inside = values[first : last + 1]
        sides = [values[k] for k in (first - 1, last + 1) if 0 <= k < len(values) and np.isfinite(values[k])]
        edges = all(abs(inside[0] - side) > 0.5 * _CODE * (high - low) for side in sides)
        at[first : last + 1] = edges and np.ptp(inside) <= 1e-9 * abs(inside[0])
    return at


def by_kind(faults: Iterable[ChannelFault]) -> Mapping[tuple[str, str], list[ChannelFault]]:
    """Faults of one kind and channel, of all records, together."""
    table: dict[tuple[str, str], list[ChannelFault]] = {}
    for fault in faults:
        table.setdefault((fault.kind, fault.target), []).append(fault)
    return table
