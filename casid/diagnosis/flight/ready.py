"""Records made ready to be explained: which channels count as measured, and what of them is read anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from casid.diagnosis.flight.criteria import NoiseCriteria
from casid.errors import InputError
from casid.records.noise import pooled_sigma, real_updates
from casid.records.record import Record

_NOTHING: Mapping[str, str] = MappingProxyType({})


def as_updated(record: Record, outputs: Sequence[str]) -> Record:
    """The record without readings that only repeat the one before, in `outputs` that a slower recorder updates."""
    slow, notes = {}, []
    for name in (o for o in outputs if o in record):
        new = real_updates(record.t, record[name])
        if new.sum() < np.isfinite(record[name]).sum():
            slow[name] = np.where(new, record[name], np.nan)
            notes.append(f"{name}: {new.sum()} readings, each repeated until the next; repeats are left out")
    return replace(record.with_channels(**slow), notes=(*record.notes, *notes)) if slow else record


def has(record: Record, name: str, criteria: NoiseCriteria) -> bool:
    """Whether enough of the samples are there."""
    return name in record and np.isfinite(record[name]).sum() > int(criteria.present * len(record))


def that_have(records: Sequence[Record], name: str, criteria: NoiseCriteria) -> list[Record]:
    return [record for record in records if has(record, name, criteria)]


def moves(records: Sequence[Record], name: str, criteria: NoiseCriteria) -> bool:
    """Whether a channel is measured in some record, and is no constant."""
    values = [record[name][np.isfinite(record[name])] for record in that_have(records, name, criteria)]
    return bool(values) and float(np.ptp(np.concatenate(values))) > 0.0


def with_all(
    record: Record, outputs: Sequence[str], criteria: NoiseCriteria, left_out: Mapping[str, str] = _NOTHING
) -> Record:
    """The record with all of the `outputs`, as missing samples where it does not measure one, and notes of these and of
    channels that are `left_out`, with the reason. Raises InputError when it measures less than two."""
    shown = [name for name in outputs if has(record, name, criteria)]
    if len(shown) < 2:
        raise InputError(
            f"record '{record.name}': of the outputs {', '.join(outputs) or 'of the model'} it has only "
            f"{', '.join(shown) or 'none'}; at least two are needed: add the columns, or leave the record out"
        )
    absent = {name: np.full(len(record), np.nan) for name in outputs if name not in shown}
    notes = [f"{name}: not measured here, so the other records alone tell of it" for name in absent]
    notes += [f"{name}: {why}, so it is left out" for name, why in left_out.items() if name in record]
    return replace(record.with_channels(**absent), notes=(*record.notes, *notes)) if notes else record


def hides_noise(records: Sequence[Record], name: str, criteria: NoiseCriteria) -> bool:
    """Whether the high band of a channel shows less than the smallest noise that is believed."""
    series = [record[name] for record in records]
    return pooled_sigma(series) < criteria.smallest * float(np.nanstd(np.concatenate(series)))


def sigma_of(series: list[np.ndarray], criteria: NoiseCriteria) -> float:
    """1-sigma of the noise; the smallest there is where the samples are too few to tell."""
    noise, variation = pooled_sigma(series, continuous=True), float(np.nanstd(np.concatenate(series)))
    return max(noise if np.isfinite(noise) else 0.0, criteria.smallest * variation, 1e-12)
