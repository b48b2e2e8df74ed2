"""Find where the numbers of a text file begin, what separates its columns, and which lines have their names and units.

Loggers write a preamble of any length, titles, names, units and descriptions above the numbers; the numbers are what
repeats. The first two neighbouring rows with the same number of cells, most of them numbers or times, are the first two
samples, by the separator that makes the most cells numbers.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from casid.records.clock import seconds_of
from casid.signals import is_known, is_unit

# also with an exponent as Fortran writes it, and with marks between thousands where another mark shows the decimals
NUMBER = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)([ed][+-]?\d+)?|[+-]?\d{1,3}((,\d{3})+|(\.\d{3})+)\.\d+|[+-]?nan|[+-]?inf(inity)?",
    re.ASCII | re.IGNORECASE,
)
_MISSING = re.compile(r"n/?a|null|none|-*|\**|#n/a|nodata|no data", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d+)?", re.ASCII)  # where decimals have a comma
_SEPARATOR = re.compile(r"sep=(.)\s*", re.IGNORECASE)
_HOLD = re.compile(r"[#%]\s*hold\s*:\s*(\w+|[^=]+=.*)\s*")
DELIMITERS = ",;\t| "  # a blank: any blanks
_HEAD = 500  # lines: the longest preamble that is looked at
_NAMING = 3  # lines above the numbers that may name columns, units and more
_MOSTLY = 0.5


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Layout of a text file."""

    delimiter: str  # between columns; "" for blanks
    first: int  # index of the line of the first row of numbers
    width: int  # cells of a row
    names: tuple[str, ...] | None  # of the columns, with units where a row has them; None when no line has them
    comma: bool  # decimals are written with a comma
    hold: str | dict[str, str]  # hold of a comment `# hold: held`
    above: int  # lines above the numbers that are neither names nor units nor comments


def number_of(cell: str) -> float | None:
    """The number in a cell of text, NaN of a missing sample; None where it is neither."""
    if _MISSING.fullmatch(cell):
        return math.nan
    if not NUMBER.fullmatch(cell):
        return None
    whole, point, part = cell.replace(",", "").lower().rpartition(".")
    return float(f"{whole.replace('.', '')}{point}{part.replace('d', 'e')}")


def layout_of(lines: Sequence[str], delimiters: str = DELIMITERS) -> Layout | None:
    """The layout of a text; None where it has no row of numbers."""
    head = list(islice(lines, _HEAD))
    told = _SEPARATOR.fullmatch(head[0]) if head else None
    found = [_rows_by(head, one) for one in (told[1] if told else delimiters)]
    found = [one for one in found if one is not None]
    if not found:
        return None
    _, width, _, delimiter, first, comma = max(found, key=lambda one: one[:3])
    open_end = not cells_of(head[first], delimiter)[-1]  # a separator behind the last column, or an empty cell
    names, used = _names_above(head, delimiter, first, width, open_end)
    above = [i for i in range(first) if i not in used and head[i].strip() and not is_comment(head[i])]
    above = [i for i in above if not _SEPARATOR.fullmatch(head[i])]
    return Layout(
        delimiter="" if delimiter == " " else delimiter,
        first=first,
        width=width,
        names=names,
        comma=comma,
        hold=_hold(head[:first]),
        above=len(above),
    )


def cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line, without blanks around them; one that cannot be parted is one cell."""
    if delimiter in (" ", ""):
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [line]


def of_commas(cell: str) -> str:
    """Return a cell of a text whose decimals have a comma as one with a point; a number with a point that does not part
    thousands is none then."""
    if "." not in cell:
        return cell.replace(",", ".")
    if _THOUSANDS.fullmatch(cell):
        return cell.replace(".", "").replace(",", ".")
    return f"{cell} (a point, beside commas)" if NUMBER.fullmatch(cell) else cell.replace(",", ".")


def is_comment(line: str) -> bool:
    return line.startswith(("#", "%"))


def _rows_by(lines: Sequence[str], delimiter: str) -> tuple[float, int, int, str, int, bool] | None:
    """Find the first rows of numbers by one delimiter: share of numbers in the first two, their width, rank, and
    where they begin. A row begins with a number or a time; where none does, any row of which most cells are numbers
    counts."""
    for strict in (True, False):
        for (i, here), (_, after) in _pairs(lines):
            one = cells_of(here, delimiter)
            two = cells_of(after, delimiter)
            if len(one) != len(two) or len(one) < 2:
                continue
            comma = delimiter not in (",", "") and _commas(one + two)
            data = [_is_data(a, comma) for a in one], [_is_data(b, comma) for b in two]
            shares = [sum(row) / len(row) for row in data]
            named = any(not a and b and c for a, b, c in zip(*data, one, strict=True))
            if min(shares) <= _MOSTLY or (named and i == 0) or (strict and not (data[0][0] and data[1][0] and one[0])):
                continue
            if any(NUMBER.fullmatch(of_commas(cell) if comma else cell) for cell in one):
                return sum(shares) / 2.0, len(one), -DELIMITERS.find(delimiter), delimiter, i, comma
    return None


def _pairs(lines: Sequence[str]) -> Iterator[tuple[tuple[int, str], tuple[int, str]]]:
    """Neighbouring lines that are neither empty nor comments; the last one stands beside itself where it is alone."""
    full = [(i, line) for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    for k, one in enumerate(full):
        yield one, full[k + 1] if k + 1 < len(full) else one


def _commas(cells: Sequence[str]) -> bool:
    """Tell whether decimals have a comma: a cell has one, and none has a point, but for thousands."""
    comma = any(_DECIMAL_COMMA.fullmatch(cell) for cell in cells)
    points = (cell for cell in cells if "." in cell and NUMBER.fullmatch(cell))
    return comma and all(_THOUSANDS.fullmatch(cell) for cell in points)


def _is_data(cell: str, comma: bool) -> bool:
    cell = of_commas(cell) if comma else cell
    return number_of(cell) is not None or seconds_of(cell) is not None


def _names_above(
    lines: Sequence[str], delimiter: str, first: int, width: int, open_end: bool
) -> tuple[tuple[str, ...] | None, set[int]]:
    """Names of the columns with their units, of the nearest lines above the numbers with as many cells; and which lines
    these are."""
    candidates: list[tuple[int, list[str]]] = []
    for i in range(first - 1, -1, -1):
        line = lines[i]
        if not line.strip():
            continue
        if _SEPARATOR.fullmatch(line) or _HOLD.fullmatch(line.strip()):
            break
        cells = cells_of(line.lstrip("#% ") if is_comment(line) else line, delimiter)
        cells = cells[:-1] if len(cells) == width + 1 and cells[-1].lower() in ("", "comment") else cells
        cells = [*cells, ""] if len(cells) == width - 1 and open_end else cells
        if is_comment(line) and len(cells) != width:
            continue
        if len(cells) != width or len(candidates) == _NAMING:
            break
        candidates.append((i, cells))
    units = next((one for one in candidates if _are_units(one[1])), None)
    named = [one for one in candidates if one is not units]
    if not named:
        return (None, set()) if units is None else (tuple(units[1]), {units[0]})
    beyond = [one for one in named if units is not None and one[0] < units[0]]
    line, names = (beyond or named)[0]
    if units is not None:
        names = [_with_unit(name, unit) for name, unit in zip(names, units[1], strict=True)]
    return tuple(names), {i for i, _ in candidates}


def _are_units(cells: Sequence[str]) -> bool:
    """Tell whether a row has units: more cells are units than are names of channels, and at least half are."""
    full = [cell.strip("[](){} ") for cell in cells if cell.strip("[](){} ")]
    units = sum(map(is_unit, full))
    names = sum(map(is_known, full))
    return bool(full) and units >= _MOSTLY * len(full) and units > names


def _with_unit(name: str, unit: str) -> str:
    unit = unit.strip("[](){} ")
    clock = ":" in unit or unit.lower().startswith("yyy")
    return name if not unit or unit == "-" or clock or name.endswith(("]", ")")) else f"{name} [{unit}]"


def _hold(lines: Sequence[str]) -> str | dict[str, str]:
    """One word of all channels, or "u = held, v = cubic"; the last comment counts."""
    said = [found[1].strip() for line in lines if (found := _HOLD.fullmatch(line.strip()))]
    if not said:
        return ""
    if "=" not in said[-1]:
        return said[-1]
    parts = (part.partition("=") for part in said[-1].split(","))
    return {name.strip(): how.strip() for name, _, how in parts}
