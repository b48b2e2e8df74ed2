"""Records as a caller gives them: objects, or the files that they are in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from casid.arguments import given, is_path
from casid.errors import InputError
from casid.records.readers import read_record, read_records
from casid.records.record import Record


def given_record(value: Any, where: str, own: Sequence[str] = ()) -> Record:
    """A record, or that of a file; InputError for anything else. `own`: channels of no aircraft."""
    if isinstance(value, Record):
        return value
    if is_path(value):
        return read_record(value, own=own)
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
