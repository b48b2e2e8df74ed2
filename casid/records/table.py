"""A table of numbers as it stands in a file: columns with or without names, before anything is known of channels."""

from __future__ import annotations

import csv
import gzip
import io
import re
import warnings
import zlib
from array import array
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from casid.errors import InputError
from casid.records.clock import seconds_of

_BLOCK = 1 << 23  # bytes
_PLAIN = b"0123456789+-.eE\r\n"


def plain_numbers(raw: bytes, start: int, width: int, delimiter: str) -> np.ndarray | None:
    """(rows, width) numbers of the text from byte `start` on; None where anything but plain numbers stands there.

    Every line must have `width` cells and none may be empty: whoever gets None reads the slow way, which says what is
    wrong and where.
    """
    mark = delimiter.encode()
    end = len(raw)
    while end > start and raw[end - 1] in b"\r\n":
        end -= 1
    values, filled, at = np.empty((raw.count(b"\n", start, end) + 1, width)), 0, start
    while at < end:
        stop = end if at + _BLOCK >= end else raw.rfind(b"\n", at, at + _BLOCK)
        if stop <= at:
            return None
        block = raw[at:stop]
        numbers = _block_numbers(block, width, mark)
        if numbers is None:
            return None
        values[filled : filled + len(numbers)] = numbers
        filled, at = filled + len(numbers), stop + 1
    return values if filled == len(values) else None


def _block_numbers(block: bytes, width: int, mark: bytes) -> np.ndarray | None:
    if block.translate(None, _PLAIN + mark):
        return None
    text = np.frombuffer(block, np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    cells = np.searchsorted(np.flatnonzero(text == ord(mark)), ends)
    if (np.diff(cells, prepend=0) != width - 1).any():
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # how older versions of numpy say that text is no number
            numbers = np.fromstring(block.replace(b"\r", b"").replace(b"\n", mark).decode(), sep=mark.decode())
    except (ValueError, DeprecationWarning):
        return None
    return numbers.reshape(-1, width) if numbers.size == width * len(ends) else None


_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?nan|[+-]?inf(inity)?", re.ASCII | re.IGNORECASE)
_DECIMAL_COMMA, _DECIMAL_POINT = re.compile(r"\d,\d"), re.compile(r"\d\.\d")
_SEPARATOR = re.compile(r"sep=.\s*", re.IGNORECASE)
_HOLD = re.compile(r"#\s*hold\s*:\s*(\w+|[^=]+=.*)\s*")


@dataclass(frozen=True, eq=False, kw_only=True)
class RawTable:
    """N rows of numbers.

    source    file, for messages
    names     header of each column, or None when the columns have no names
    values    (N, columns), NaN where a cell is empty or no number
    lines     (N,) line of each row in a text file, or None
    text      column -> (row, cell) of the first cell that is no number
    hold      what a comment `# hold: held` says, or `# hold: u = held, v = cubic` of single channels; "" without
    notes     remarks of whoever read it
    first     number of the first row in the file, from 0
    """

    source: str
    names: tuple[str, ...] | None
    values: np.ndarray
    lines: np.ndarray | None = None
    text: Mapping[int, tuple[int, str]] = field(default_factory=dict)
    hold: str | Mapping[str, str] = ""
    notes: tuple[str, ...] = ()
    first: int = 0

    def place(self, row: int) -> str:
        """File and row, counted from 1 without the header, for a message."""
        line = f" (line {self.lines[row]})" if self.lines is not None else ""
        return f"{self.source}: row {self.first + row + 1}{line}"

    def column(self, index: int) -> str:
        """Name of a column for a message, or its number counted from 1."""
        return f"column '{self.names[index]}'" if self.names else f"column {index + 1}"


def rows_of(table: RawTable, rows: np.ndarray) -> RawTable:
    """The table with neighbouring rows alone."""
    lines = None if table.lines is None else table.lines[rows]
    return replace(table, values=table.values[rows], lines=lines, first=int(rows[0]))


def shown(cell: str) -> str:
    """A cell for a one-line message, cut when it is long."""
    return repr(cell if len(cell) <= 40 else cell[:37] + "...")


def read_csv(path: Path) -> RawTable:
    """Table of a CSV file: comma, semicolon or tab, by what stands most often in its first row; UTF-8.

    A line ``sep=;`` on top is skipped. Decimal commas are read where semicolons or tabs part the columns and no number
    has a decimal point.
    """
    raw = _raw(path)
    quick = _plain_table(path, raw)
    if quick is not None:
        return quick
    content, skipped, hold = _content(path, raw)
    first, _, rest = content.partition("\n")
    delimiter = _delimiter(first)
    if delimiter != "," and _DECIMAL_COMMA.search(rest) and not _DECIMAL_POINT.search(rest):
        content = f"{first}\n{rest.replace(',', '.')}"
    reader = csv.reader(io.StringIO(content, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True)

    def rows() -> Iterator[tuple[int, list[str]]]:
        try:
            for cells in reader:
                yield reader.line_num + skipped, cells
        except csv.Error as error:
            raise InputError(f"{path}: line {reader.line_num + skipped}: not valid CSV: {error}") from None

    return _table(path, rows(), hold, exact="_" not in content[len(first) :] and content.isascii())


def read_columns(path: Path) -> RawTable:
    """Table of a text file with columns between blanks, with or without a row of names."""
    content, skipped, hold = _content(path, _raw(path))
    rows = ((number, line.split()) for number, line in enumerate(content.splitlines(), start=1 + skipped))
    return _table(path, rows, hold, exact="_" not in content and content.isascii())


def _delimiter(first: str) -> str:
    return max(",;\t", key=first.count)


def _plain_table(path: Path, raw: bytes) -> RawTable | None:
    """The table of a file that has names on top and plain numbers below; None for every other."""
    end = raw.find(b"\n")
    head = raw[: max(end, 0)].removeprefix(b"\xef\xbb\xbf")
    if end < 0 or not head.isascii() or head.startswith((b"#", b"%")) or b'"' in head:
        return None
    first = head.decode().rstrip("\r")
    delimiter = _delimiter(first)
    names = tuple(cell.strip() for cell in first.split(delimiter))
    if _SEPARATOR.fullmatch(first) or len(names) < 2 or all(_NUMBER.fullmatch(name) for name in names):
        return None
    values = plain_numbers(raw, end + 1, len(names), delimiter)
    if values is None:
        return None
    return RawTable(source=str(path), names=names, values=values, lines=np.arange(2, len(values) + 2))


def _raw(path: Path) -> bytes:
    try:
        raw = path.read_bytes()
        return gzip.decompress(raw) if path.suffix.lower() == ".gz" else raw
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise InputError(f"{path}: not a whole .gz file; pack it again") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _content(path: Path, raw: bytes) -> tuple[str, int, str | dict[str, str]]:
    """Text of a file without the comment lines on top, their number, and what they say about `hold`."""
    try:
        content = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text (byte {error.start}); save it as CSV in UTF-8") from None
    skipped, start = 0, 0
    hold: str | dict[str, str] = ""
    if _SEPARATOR.fullmatch(content.partition("\n")[0]):
        skipped, start = 1, content.find("\n") + 1
    while content.startswith("#", start) or content.startswith("%", start):
        end = content.find("\n", start)
        end = len(content) if end < 0 else end + 1
        said = _HOLD.fullmatch(content[start:end].strip())
        hold = _hold(said[1].strip()) if said else hold
        skipped, start = skipped + 1, end
    return content[start:], skipped, hold


def _hold(said: str) -> str | dict[str, str]:
    """One word of all channels, or "u = held, v = cubic"."""
    if "=" not in said:
        return said
    parts = (part.partition("=") for part in said.split(","))
    return {name.strip(): how.strip() for name, _, how in parts}


def _table(
    path: Path, rows: Iterator[tuple[int, list[str]]], hold: str | Mapping[str, str], *, exact: bool
) -> RawTable:
    full = ((line, cells) for line, cells in rows if len(cells) > 1 or "".join(cells).strip())
    line, head = next(full, (0, []))
    if not head:
        raise InputError(f"{path}: the file is empty; expected a row of channel names and rows of numbers")
    names: tuple[str, ...] | None = tuple(cell.strip() for cell in head)
    if all(_NUMBER.fullmatch(name) for name in names):
        names, full = None, _chain((line, head), full)
    numbers, lines, text = _numbers(path, full, len(head), exact)
    if not lines:
        raise InputError(f"{path}: no rows of numbers below the header")
    values = np.frombuffer(numbers, dtype=float).reshape(-1, len(head))
    return RawTable(source=str(path), names=names, values=values, lines=np.array(lines), text=text, hold=hold)


def _chain(first: tuple[int, list[str]], rest: Iterable[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
    yield first
    yield from rest


def _numbers(
    path: Path, rows: Iterable[tuple[int, list[str]]], width: int, exact: bool
) -> tuple[array, list[int], dict[int, tuple[int, str]]]:
    """Numbers of all rows, one after the other, their lines, and per column the first cell that is no number.

    `exact`: float() accepts what a number in a file may be and no more. Only then it may read whole rows.
    """
    numbers, lines, text = array("d"), [], {}
    for line, cells in rows:
        if len(cells) != width:
            kind = "truncated or ragged" if len(cells) < width else "ragged"
            raise InputError(
                f"{path}: row {len(lines) + 1} (line {line}) has {len(cells)} cells, expected {width} as in the first "
                f"row; the row is {kind}: repair or remove it"
            )
        start = len(numbers)
        lines.append(line)
        if exact:
            try:
                numbers.extend(map(float, cells))
                continue
            except ValueError:
                del numbers[start:]
        for column, cell in enumerate(cells):
            stripped = cell.strip()
            if _NUMBER.fullmatch(stripped):
                numbers.append(float(stripped))
                continue
            seconds = seconds_of(stripped)
            numbers.append(np.nan if seconds is None else seconds)
            if stripped and seconds is None:
                text.setdefault(column, (len(lines) - 1, stripped))
    return numbers, lines, text
