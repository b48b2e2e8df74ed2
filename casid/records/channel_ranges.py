"""Describe every channel of some records, in units that a person reads: the table that a check prints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casid.keeping import by_fields
from casid.records.channel_faults import update_interval
from casid.records.checks import GAP, INPUTS
from casid.records.noise import LEVELS, converter_step, pooled_sigma
from casid.records.record import Record
from casid.signals import CHANNELS, for_a_person, unit_of

_FEW = 5  # levels of a reading from which its steps are judged; those of an input may be its own


@dataclass(frozen=True, kw_only=True)
class ChannelRow:
    """One channel of all records."""

    name: str
    unit: str  # of the numbers: degrees for radians, else SI
    least: float  # least, median, most: over all records; NaN of a channel without a sample
    median: float
    most: float
    noise: float  # 1-sigma of the white noise that its high band shows; NaN when that band does not show it
    step: float  # of which the differences of all its samples are multiples; NaN of a channel without one
    rate_hz: float  # at which new samples come
    missing: float  # part of the samples that are missing
    records: int  # how many have it

    to_dict = by_fields


def channel_table(records: Sequence[Record]) -> tuple[ChannelRow, ...]:
    """A row for every channel that a record has, in the order of the vocabulary."""
    named = {name for record in records for name in record.channels}
    order = [name for name in CHANNELS if name in named] + sorted(named - CHANNELS.keys())
    return tuple(_row(name, [record for record in records if name in record]) for name in order)


def _row(name: str, records: Sequence[Record]) -> ChannelRow:
    series = [record[name] for record in records]
    values = np.concatenate(series)
    good = values[np.isfinite(values)]
    factor, shown = for_a_person(unit_of(name))
    least, median, most = factor * np.quantile(good, (0.0, 0.5, 1.0)) if len(good) else (math.nan,) * 3
    intervals = [update_interval(record, name) for record in records]
    known = [interval for interval in intervals if math.isfinite(interval)]
    return ChannelRow(
        name=name,
        unit=shown,
        least=float(least),
        median=float(median),
        most=float(most),
        noise=factor * pooled_sigma(series),
        step=factor * converter_step(values, LEVELS if name in INPUTS else _FEW),
        rate_hz=1.0 / float(np.median(known)) if known else math.nan,
        missing=1.0 - len(good) / len(values),
        records=len(records),
    )


def gaps(record: Record) -> list[tuple[float, float]]:
    """Stretches [s] in which rows are missing."""
    steps = np.diff(record.t)
    return [(float(record.t[k]), float(record.t[k + 1])) for k in np.flatnonzero(steps > GAP * record.dt)]
