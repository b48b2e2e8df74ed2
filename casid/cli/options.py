"""Options that several commands share, and reading what they name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from casid.records.column_map import ColumnMap
from casid.records.readers import read_records
from casid.records.record import Record

DEMO = Path(__file__).resolve().parent / "demo"

Files = Annotated[list[str], Parameter(consume_multiple=True, negative="")]
Folder = Annotated[Path, Parameter(name="--out")]
Maps = Annotated[list[str], Parameter(name="--map", negative="")]
Flag = Annotated[bool, Parameter(negative="")]
AsJson = Annotated[bool, Parameter(name="--json", negative="")]
Axes = Literal["full", "longitudinal", "lateral"]


def records_of(patterns: Sequence[str], maps: Sequence[str]) -> list[Record]:
    """The records of files or glob patterns, their columns named by ``--map``."""
    return read_records(list(patterns), ColumnMap.from_options(list(maps)))
