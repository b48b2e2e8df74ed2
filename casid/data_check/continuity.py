"""Continuity of a record: motion that jumps in several channels at once, and stretches of samples that occur twice."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage
from scipy.special import ndtri

from casid.data_check.reading import Finding
from casid.records.channel_faults import runs
from casid.records.record import Record

# attitude, which cannot jump, and channels of other instruments; what is over ground a filter corrects at once
_ATTITUDE = ("phi", "theta", "psi")
_OTHERS = ("V", "alpha", "beta", "p", "q", "r")
_CHANNELS = 3  # that jump at once, attitude and others among them: one may be corrected in steps
# of the changes around, where a surface that steps bends several rates at once; no sample of 519 clean records has it
_SIGMAS = 8.0
_AROUND = 25  # changes on either side
_REPEATED = 8  # samples of all channels that are equal to those of another time: noise is never


def discontinuities(records: Sequence[Record]) -> list[Finding]:
    """Faults of the course of time: where some of it is missing, and where a stretch of samples occurs twice."""
    found = []
    for record in records:
        repeated = _repeated(record)
        found += [_finding(record, at, _twice(record, at, until)) for at, until in repeated[:1]]
        if not repeated:
            found += [_finding(record, at, _missing(record, at, names)) for at, names in _jumps(record)]
    return found


def _finding(record: Record, at: int, sentence: str) -> Finding:
    moment = float(record.t[at])
    return Finding(
        kind="data_dropout",
        target="t",
        records=(record.name,),
        intervals_s={record.name: ((moment, moment),)},
        handled="reported",
        sentence=sentence,
    )


def _missing(record: Record, at: int, names: Sequence[str]) -> str:
    return (
        f"{record.name} jumps at {record.t[at]:.6g} s in {', '.join(names)} at once, as if time were missing there: "
        "split it at that time."
    )


def _twice(record: Record, at: int, until: int) -> str:
    return (
        f"{record.name} has the samples from {record.t[at]:.6g} s on twice, again from {record.t[until]:.6g} s: "
        "leave one of them out."
    )


def _jumps(record: Record) -> list[tuple[int, tuple[str, ...]]]:
    """(sample, channels) at which several channels jump, of attitude and of others; of jumps near each other the
    largest."""
    names = [name for name in (*_ATTITUDE, *_OTHERS) if name in record and np.isfinite(record[name]).all()]
    if len(names) < _CHANNELS or len(record) < 4 * _AROUND:
        return []
    sizes = np.stack([_unlike_around(record[name]) for name in names])
    jumps = sizes > _SIGMAS
    turns = np.array([name in _ATTITUDE for name in names])
    at = np.flatnonzero((jumps.sum(axis=0) >= _CHANNELS) & jumps[turns].any(axis=0) & jumps[~turns].any(axis=0))
    found = []
    for group in np.split(at, np.flatnonzero(np.diff(at) > _AROUND) + 1) if len(at) else ():
        most = int(group[np.argmax(jumps[:, group].sum(axis=0))])
        found.append((most + 1, tuple(n for n, one in zip(names, jumps[:, most], strict=True) if one)))
    return found


def _unlike_around(values: np.ndarray) -> np.ndarray:
    """(N-1,) each change of a channel, less those beside it, over the scatter of the same around it."""
    turned = np.unwrap(values) if np.abs(values).max() < 7.0 else values
    change = np.diff(turned)
    beside = np.convolve(change, [0.5, 0.0, 0.5], mode="same")
    unlike = np.abs(change - beside)
    # one sigma by half of the changes around, and by nine tenths of them, which a manoeuvre makes larger
    around = 2 * _AROUND + 1
    half, most = (ndimage.percentile_filter(unlike, share, around, mode="reflect") for share in (50.0, 90.0))
    sigma = np.maximum(half / ndtri(0.75), most / ndtri(0.95))
    rounding = 1e-12 * max(float(np.abs(turned).max()), 1.0)
    return unlike / np.maximum(sigma, rounding)


def _repeated(record: Record) -> list[tuple[int, int]]:
    """(first, second) begin of stretches whose samples are equal in all channels that vary."""
    finite = [np.nan_to_num(values, nan=np.inf) for values in record.channels.values() if np.isfinite(values).any()]
    varying = [values for values in finite if np.ptp(values[np.isfinite(values)]) > 0.0]
    if len(varying) < _CHANNELS or len(record) < 4 * _REPEATED:
        return []
    rows = np.ascontiguousarray(np.stack(varying, axis=1))
    _, first, same = np.unique(rows.view(f"V{rows.strides[0]}")[:, 0], return_index=True, return_inverse=True)
    earlier = np.arange(len(rows)) - first[same.ravel()]  # samples since the same row; it grows while all channels hold
    begins, lengths = runs(earlier)
    twice = begins[(lengths >= _REPEATED) & (earlier[begins] >= _REPEATED)]
    return [(int(at - earlier[at]), int(at)) for at in twice]
