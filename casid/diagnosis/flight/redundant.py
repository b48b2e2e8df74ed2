"""Angular accelerations that were computed from the rates tell nothing new.

They hold the noise of the rate a second time, and taken for measurements of their own they are evidence twice over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from casid.diagnosis.criteria import NoiseCriteria
from casid.records.record import Record

RATE_OF: Mapping[str, str] = MappingProxyType({"pdot": "p", "qdot": "q", "rdot": "r"})


def is_derived(records: Sequence[Record], acceleration: str, sigma: float, criteria: NoiseCriteria) -> bool:
    """Whether a filter makes an angular acceleration of the rate of the same axis, the noise of which is `sigma`.

    The filter is fitted by least squares. Behind one that only predicts the acceleration, the rate's noise is left over
    beside that of the acceleration, sigma |h| at least; where it is what the acceleration was made with, nothing is.
    """
    reach = criteria.differentiator
    pairs = [_pair(record, RATE_OF[acceleration], acceleration, reach) for record in records]
    around, values = (np.concatenate(part) for part in zip(*pairs, strict=True))
    if len(values) < criteria.differentiator_samples * around.shape[1]:
        return False
    columns = np.column_stack([around, np.ones(len(values))])
    h = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = float(np.std(values - columns @ h))
    return left < criteria.differentiated * sigma * float(np.linalg.norm(h[:-1]))


def _pair(record: Record, rate: str, acceleration: str, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2 reach + 1) samples of a rate around each of the (n,) of its acceleration, where all are there."""
    width = 2 * reach + 1
    if rate not in record or acceleration not in record or len(record) < width:
        return np.empty((0, width)), np.empty(0)
    around = np.lib.stride_tricks.sliding_window_view(record[rate], width)
    values = record[acceleration][reach:-reach]
    there = np.isfinite(around).all(axis=1) & np.isfinite(values)
    return around[there], values[there]
