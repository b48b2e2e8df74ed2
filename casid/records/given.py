"""Records as a caller gives them: objects, or the files that they are in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from casid.arguments import given, is_path
from casid.errors import InputError
from casid.records.noise import is_noise
from casid.records.readers import read_record, read_records
from casid.records.record import Record


def given_record(value: Any, where: str) -> Record:
    """A record, or that of a file; InputError for anything else."""
    if isinstance(value, Record):
        return value
    if is_path(value):
        return read_record(value)
    hint = "; data in memory are cs.Record.from_frame(df)" if hasattr(value, "columns") else ""
    raise InputError(f"{where}: record is {given(value)}; expected a cs.Record or a file name{hint}")


def given_records(value: Any, where: str, own: Sequence[str] = ()) -> tuple[Record, ...]:
    """Records of a list in which files and patterns may stand too, or one of either alone; InputError otherwise. `own`:
    channels of no aircraft, for the files."""
    if isinstance(value, Record):
        return (value,)
    if is_path(value):
        return tuple(read_records(value, own=own))
    if not isinstance(value, Iterable) or hasattr(value, "columns") or not getattr(value, "ndim", 1):
        hint = "; data in memory are cs.Record.from_frame(df)" if hasattr(value, "columns") else ""
        raise InputError(f"{where}: records is {given(value)}; expected a list of cs.Record or of file names{hint}")
    found: list[Record] = []
    for one in value:
        found += read_records(one, own=own) if is_path(one) else [given_record(one, where)]
    return tuple(found)


_INERTIAL = ("p", "q", "r", "ax", "ay", "az")
_FURTHER = ("phi", "theta", "alpha", "beta", "V", "altitude")


def unflown(record: Record) -> str:
    """Say why nothing can be identified: the aircraft stays on the ground, or nothing moves; "" of other records."""
    if record.grounded:
        return "the aircraft stays on the ground"
    told = [name for name in _INERTIAL if name in record] or [name for name in _FURTHER if name in record]
    if told and all(is_noise(record[name]) for name in told):
        return f"nothing moves, {', '.join(told)} are noise alone"
    return ""


def require_flight(records: Iterable[Record], where: str) -> None:
    """Raise InputError for the first record on the ground or without any motion."""
    for record in records:
        if why := unflown(record):
            raise InputError(
                f"{where}: record '{record.name}': {why}; expected a manoeuvre in flight: leave the record out, or "
                "take a part of it by --from and --to"
            )
