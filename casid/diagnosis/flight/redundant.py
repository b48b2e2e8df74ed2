"""Angular accelerations that were computed from the rates tell nothing new.

They hold the noise of the rate a second time, and taken for measurements of their own they are evidence twice over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from casid.diagnosis.flight.criteria import NoiseCriteria
from casid.records.noise import pooled_sigma
from casid.records.record import Record

RATE_OF: Mapping[str, str] = MappingProxyType({"pdot": "p", "qdot": "q", "rdot": "r"})


def is_derived(
    records: Sequence[Record], acceleration: str, sigma: Mapping[str, float], criteria: NoiseCriteria
) -> bool:
    """Whether a filter makes an angular acceleration of the rate of the same axis; `sigma` their noise.

    The filter is fitted by least squares. Behind one that only predicts the acceleration, the rate's noise is left over
    beside that of the acceleration, sigma |h| at least; where it is what the acceleration was made with, nothing is.
    A filter that is longer, as of a smoother of the whole record, shows by its effect: an acceleration that is
    quieter than any instrument, and quieter by far than the differences of its rate.
    """
    rate = RATE_OF[acceleration]
    if _is_smoothed(records, acceleration, criteria):
        return True
    reach = criteria.differentiator
    pairs = [_pair(record, rate, acceleration, reach) for record in records]
    around, values = (np.concatenate(part) for part in zip(*pairs, strict=True))
    if len(values) < criteria.differentiator_samples * around.shape[1]:
        return False
    columns = np.column_stack([around, np.ones(len(values))])
    h = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = float(np.std(values - columns @ h))
    return left < criteria.differentiated * sigma[rate] * float(np.linalg.norm(h[:-1]))


def _is_smoothed(records: Sequence[Record], acceleration: str, criteria: NoiseCriteria) -> bool:
    """Whether the high band of an acceleration has next to nothing of what its variation, and differences of its rate,
    would leave there."""
    both = [r for r in records if acceleration in r and RATE_OF[acceleration] in r]
    if not both:
        return False
    own, of_rate = (pooled_sigma([r[name] for r in both]) for name in (acceleration, RATE_OF[acceleration]))
    varies = float(np.nanstd(np.concatenate([r[acceleration] for r in both])))
    differences = of_rate / (math.sqrt(2.0) * float(np.median([r.dt for r in both])))
    return own < criteria.smallest * varies and own < criteria.smoothed * differences


def _pair(record: Record, rate: str, acceleration: str, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2 reach + 1) samples of a rate around each of the (n,) of its acceleration, where all are there."""
    width = 2 * reach + 1
    if rate not in record or acceleration not in record or len(record) < width:
        return np.empty((0, width)), np.empty(0)
    around = np.lib.stride_tricks.sliding_window_view(record[rate], width)
    values = record[acceleration][reach:-reach]
    there = np.isfinite(around).all(axis=1) & np.isfinite(values)
    return around[there], values[there]
