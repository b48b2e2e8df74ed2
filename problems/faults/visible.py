"""Whether a hidden fault shows at all: in the readings, or by what a diagnosis says that it would have found."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.records.noise import high_band_sigma, resolution
from casid.records.record import Record
from problems.faults.fault import DataFault

_AXES = {
    "longitudinal motion": ("V", "alpha", "q", "theta", "ax", "az", "qdot", "delta_e", "thrust"),
    "lateral motion": ("beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot", "delta_a", "delta_r"),
}


def judged(channels: Collection[str], not_judged: Collection[str]) -> tuple[str, ...]:
    """Those of the channels that a diagnosis has judged which says what it has not."""
    left_out = {name for what in not_judged for name in _AXES.get(what, ())}
    return tuple(name for name in channels if name not in left_out)


def as_it_shows(
    fault: DataFault, healthy: Sequence[Record], faulty: Sequence[Record], detectable: Mapping[str, float]
) -> DataFault | None:
    """The fault with those of its records in which it shows; None when in none of them.

    A size does not show that is less than the smallest one that the diagnosis says it would have found (`detectable`,
    by name). Samples that are held, clipped or off do not show in a record where all that they change, against the
    noise of the channel, is less than that, in the same sigmas.
    """
    if fault.kind.startswith("data_"):
        pairs = {before.name: (before, after) for before, after in zip(healthy, faulty, strict=True)}
        shows = tuple(name for name in fault.records if _changes(*pairs[name], fault.channels))
        return replace(fault, records=shows) if shows else None
    name = f"{fault.kind}({fault.target}{':' + fault.term if fault.term else ''})"
    least = detectable.get(name, detectable.get(fault.kind, 0.0))
    return fault if fault.value is None or abs(fault.value) >= least else None


def _changes(before: Record, after: Record, channels: Collection[str]) -> bool:
    least = Criteria().significance.search
    return len(before) != len(after) or sum(_square(before, after, name) for name in channels if name in before) > least


def _square(before: Record, after: Record, channel: str) -> float:
    """Sum of squares of what has changed, in the noise of the channel."""
    if channel not in after or np.isnan(after[channel][np.isfinite(before[channel])]).any():
        return np.inf
    changed = float(np.nansum((after[channel] - before[channel]) ** 2))
    noise = max(high_band_sigma(before[channel]), resolution(before[channel]) / np.sqrt(12.0))
    if changed == 0.0:
        return 0.0
    return changed / noise**2 if noise > 0.0 else np.inf
