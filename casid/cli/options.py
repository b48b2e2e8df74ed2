"""Options that several commands share, and reading what they name."""

from __future__ import annotations

import math
import re
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, Token

from casid.arguments import a_path
from casid.diagnosis.document import Called
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.flown_records import FlownRecords, default_free
from casid.model.plausible import impossibilities
from casid.records.column_map import ColumnMap
from casid.records.readers import read_records
from casid.records.record import Record
from casid.report.folder import out_folder


def _whole(type_: type, tokens: Sequence[Token]) -> int:
    """A whole number, and nothing rounded to one."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].keyword} {tokens[0].value}: expected a whole number") from None


def _folder(type_: type, tokens: Sequence[Token]) -> Path:
    return out_folder(tokens[0].value)


DEMO = Path(__file__).resolve().parent / "demo"

MAP_HELP = (
    "Column map: CHANNEL=COLUMN:UNIT, several of them, or a TOML file; with alpha=ALCG:deg the column ALCG is alpha, "
    "in degrees."
)
Files = Annotated[list[str], Parameter(consume_multiple=True, negative="")]
Records = Annotated[str, Parameter(name="RECORD", help="Files, or patterns like 'flight/m*.csv'.")]
Folder = Annotated[Path, Parameter(name="--out", converter=_folder, help="Folder for the results.")]
Maps = Annotated[list[str], Parameter(name="--map", negative="", help=MAP_HELP)]
Begin = Annotated[float | None, Parameter(name="--from", help="Time [s] from which records are read.")]
End = Annotated[float | None, Parameter(name="--to", help="Time [s] up to which records are read.")]
Whole = Annotated[int, Parameter(converter=_whole)]
Flag = Annotated[bool, Parameter(negative="")]
AsJson = Annotated[bool, Parameter(name="--json", negative="", help="Print the result as JSON and nothing else.")]
Axes = Literal["full", "longitudinal", "lateral"]


def require_words(words: Sequence[str] | Sequence[Path], name: str, usage: str) -> None:
    """Raise InputError for a command without the words that it is about."""
    if not words:
        raise InputError(f"{name} is missing; expected: {usage}")


def require_positive(numbers: Mapping[str, float]) -> None:
    """Raise InputError for an option, by its name, that is no positive number."""
    for name, value in numbers.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"--{name} {value:g}: expected a positive number")


def records_of(
    patterns: Sequence[str],
    maps: Sequence[str] | None,
    own: Sequence[str] = (),
    span: tuple[float | None, float | None] = (None, None),
    flown_by: Iterable[Aircraft] = (),
) -> list[Record]:
    """The records of files or glob patterns, their columns named by ``--map``; what their reader remarks is said, and
    which effects of the aircraft that fly them do nothing here.

    `own`: channels of no aircraft; `span`: values of ``--from`` and ``--to``.
    """
    # `--map a=.. b=..` hands the second to the records
    maps = [*(maps or []), *(one for one in patterns if _is_map(one))]
    patterns = [one for one in patterns if not _is_map(one)]
    records = read_records(patterns, ColumnMap.from_options(maps), own=own, between=between(*span))
    say_notes(records)
    _say_idle_effects(flown_by, records)
    return records


def _is_map(word: str) -> bool:
    """Say whether a word is a column map, CHANNEL=COLUMN, and no file."""
    return re.match(r"[A-Za-z_]\w*=", word) is not None and not a_path(word, "--map").exists()


def say_notes(records: Sequence[Record]) -> None:
    """Say what the reader of records remarks."""
    for record in records:
        for note in record.notes:
            print(f"note: {record.name}: {note}", file=sys.stderr)


def between(begin: float | None, end: float | None) -> tuple[float, float] | None:
    """The part of records [s] that ``--from`` and ``--to`` name; None where neither is given."""
    if begin is None and end is None:
        return None
    low = -math.inf if begin is None else begin
    high = math.inf if end is None else end
    if not low < high:
        raise InputError(f"--from {low:g} --to {high:g}: no time lies between them; --from must be the earlier one")
    return low, high


def aircraft_of(file: str | Path) -> Aircraft:
    """The aircraft of a file; what is to be said of it, and what in it is impossible, is said."""
    aircraft = Aircraft.read(file)
    said = (*aircraft.notes, *(one.sentence for one in impossibilities(aircraft) if one.parameter != "inertia"))
    for note in said:
        print(f"note: {Path(file).name}: {note}", file=sys.stderr)
    return aircraft


def fleet(files: Sequence[str | Path]) -> dict[str, Aircraft]:
    """Label -> aircraft; the label is the file's name without ending, with its folder where that is not enough."""
    paths = [Path(file) for file in files]
    stems = [path.stem for path in paths]
    labels = [p.stem if stems.count(p.stem) == 1 else f"{p.resolve().parent.name}-{p.stem}" for p in paths]
    if len(set(labels)) < len(labels):
        raise InputError(f"--aircraft: two files are called '{labels[0]}'; give them different names")
    return {label: aircraft_of(path) for label, path in zip(labels, paths, strict=True)}


def _say_idle_effects(aircraft: Iterable[Aircraft], records: Sequence[Record]) -> None:
    """Say which effects of files are of records alone that are not among these, and do nothing here."""
    here = {record.name for record in records}
    for effect in (effect for one in aircraft for effect in one.effects):
        if effect.records and not here & set(effect.records):
            own = ", ".join(effect.records)
            print(f"note: {effect.kind} of the aircraft file is of {own} alone: it does nothing here", file=sys.stderr)


def shared_and_biases(applied: FlownRecords, free: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Globs of the parameters of all records, and of those that each record has: biases, whatever their instruments."""
    globs = free or default_free(applied)
    biases = [glob for glob in globs if glob.startswith("bias_")]
    return [glob for glob in globs if glob not in biases], biases


def called_by(files: Sequence[str], maps: Sequence[str] | None, aircraft: Path, out: Path) -> Called:
    """Return the words by which further commands find the same records and the same aircraft file."""
    words = [*map(shlex.quote, _as_pattern(files)), *(f"--map {shlex.quote(one)}" for one in maps or [])]
    return Called(records=" ".join(words), aircraft=shlex.quote(str(aircraft)), out=str(out))


def _as_pattern(files: Sequence[str]) -> list[str]:
    """Return one pattern for files that are all of their kind in their folder, which a shell had spelled out."""
    first = Path(files[0])
    pattern = first.parent / f"*{first.suffix}"
    named = {Path(file) for file in files}
    return [str(pattern)] if len(named) > 1 and named == set(first.parent.glob(pattern.name)) else list(files)
