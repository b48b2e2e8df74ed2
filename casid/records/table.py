"""A table of numbers as it is in a file: columns with or without names, before anything is known of channels."""

from __future__ import annotations

import csv
import re
import warnings
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.clock import clock_of
from casid.records.layout import DELIMITERS, NUMBER, Layout, is_comment, layout_of, number_of, of_commas
from casid.records.limits import read_bytes

_MARKS = {"utf-8": b"\xef\xbb\xbf", "utf-32": b"\xff\xfe\0\0", "utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}
_BLOCK = 1 << 23  # bytes
_PLAIN = b"0123456789+-.eE\n"


def plain_numbers(raw: bytes, start: int, width: int, delimiter: str) -> np.ndarray | None:
    """(rows, width) numbers of the text from byte `start` on; None unless every line has `width` plain numbers: whoever
    gets None reads the slow way, which finds what is wrong and where."""
    mark = delimiter.encode()
    end = len(raw)
    while end > start and raw[end - 1] in b"\r\n":
        end -= 1
    values = np.empty((raw.count(b"\n", start, end) + 1, width))
    filled = 0
    at = start
    while at < end:
        stop = end if at + _BLOCK >= end else raw.rfind(b"\n", at, at + _BLOCK)
        if stop <= at:
            return None
        block = raw[at:stop]
        numbers = _block_numbers(block, width, mark)
        if numbers is None:
            return None
        values[filled : filled + len(numbers)] = numbers
        filled = filled + len(numbers)
        at = stop + 1
    return values if filled == len(values) else None


def _block_numbers(block: bytes, width: int, mark: bytes) -> np.ndarray | None:
    block = block.replace(b"\r\n", b"\n").removesuffix(b"\r")
    if block.translate(None, _PLAIN + mark):  # a carriage return within a line too: it parts nothing
        return None
    text = np.frombuffer(block, np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    cells = np.searchsorted(np.flatnonzero(text == ord(mark)), ends)
    if (np.diff(cells, prepend=0) != width - 1).any():
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # how older versions of numpy say that text is no number
            numbers = np.fromstring(block.replace(b"\n", mark).decode(), sep=mark.decode())
    except (ValueError, DeprecationWarning):
        return None
    return numbers.reshape(-1, width) if numbers.size == width * len(ends) else None


@dataclass(frozen=True, eq=False, kw_only=True)
class RawTable:
    """N rows of numbers."""

    source: str  # file, for messages
    names: tuple[str, ...] | None  # header of each column, or None when the columns have no names
    values: np.ndarray  # (N, columns), NaN where a cell is empty or no number
    lines: np.ndarray | None = None  # (N,) line of each row in a text file, or None
    # column -> (row, cell) of the first cell that is no number
    text: Mapping[int, tuple[int, str]] = field(default_factory=dict)
    # what a comment `# hold: held` says, or `# hold: u = held, v = cubic` of single channels; "" without
    hold: str | Mapping[str, str] = ""
    notes: tuple[str, ...] = ()  # remarks of whoever read it
    first: int = 0  # number of the first row in the file, from 0
    grounded: bool = False  # whether the aircraft stays on the ground by its log
    paths: tuple[str, ...] = ()  # by which a map names the columns where names stand twice, like "/raw/q"
    units: Mapping[int, str] = field(default_factory=dict)  # column -> unit that is stated, but not in its name
    how: Mapping[int, str] = field(default_factory=dict)  # column -> what was made of the numbers of the file
    clocks: frozenset[int] = frozenset()  # columns of dates or times of day
    unread: Mapping[str, str] = field(default_factory=dict)  # what else the file holds -> why it is not read

    def place(self, row: int) -> str:
        """File and row, counted from 1 without the header, for a message."""
        line = f" (line {self.lines[row]})" if self.lines is not None else ""
        return f"{self.source}: row {self.first + row + 1}{line}"

    def column(self, index: int) -> str:
        """Name of a column for a message, or its number counted from 1."""
        return f"column '{self.path(index)}'" if self.names else f"column {index + 1}"

    def path(self, index: int) -> str:
        """Return the name by which a map finds a column, also one of several of one name."""
        return self.paths[index] if self.paths else self.names[index] if self.names else str(index + 1)


def rows_of(table: RawTable, rows: np.ndarray) -> RawTable:
    """The table with some rows alone, in their order."""
    lines = None if table.lines is None else table.lines[rows]
    return replace(table, values=table.values[rows], lines=lines, first=int(rows[0]))


def shown(cell: str) -> str:
    """A cell for a one-line message, cut when it is long."""
    return repr(cell if len(cell) <= 40 else cell[:37] + "...")


def read_text(path: Path) -> RawTable:
    """Table of a text file: columns parted by commas, semicolons, tabs, bars or blanks, decimal points or commas, in
    UTF-8, UTF-16 or an encoding of one byte, below any preamble; see `layout`. A last row that is cut short is left
    out, and said."""
    raw, cut = _whole(read_bytes(path))
    quick = _plain_table(path, raw)
    if quick is not None:
        return replace(quick, notes=cut)
    content, notes = _decoded(path, raw)
    return table_of_lines(path, content.split("\n"), notes + cut)


def table_of_lines(path: Path, lines: list[str], notes: tuple[str, ...] = (), delimiters: str = DELIMITERS) -> RawTable:
    """Table of the lines of a text or of a sheet."""
    layout = layout_of(lines, delimiters)
    if layout is None:
        raise InputError(f"{path}: {_without_rows(lines)}")
    if layout.above:
        notes += (f"{layout.above} lines above the numbers are no names and no units, and are left out",)
    return _numbers(path, lines, layout, notes)


_CUT = re.compile(rb".*\d(\.|[eEdD][+-]?\d?)")
_SHORT = re.compile(rb"\d(\.|[eEdD][+-]?\d)(?=[,;\t |\r\n])")  # as whole numbers of some programs end


def _whole(raw: bytes) -> tuple[bytes, tuple[str, ...]]:
    """The bytes without a last row that ends behind a point or within an exponent, and what is said of it."""
    at = raw.rfind(b"\n") + 1
    cell = re.split(rb"[,;\t |]", raw[at:])[-1]
    if not _CUT.fullmatch(cell) or _SHORT.search(raw):
        return raw, ()
    return raw[:at], (f"the last row is cut off within its last number, {cell.decode('ascii', 'replace')}; left out",)


def _plain_table(path: Path, raw: bytes) -> RawTable | None:
    """The table of a file that has names on top and plain numbers below; None for every other."""
    end = raw.find(b"\n")
    head = raw[: max(end, 0)].removeprefix(b"\xef\xbb\xbf")
    if end < 0 or not head.isascii() or head.startswith((b"#", b"%")) or b'"' in head:
        return None
    first = head.decode().rstrip("\r")
    delimiter = max(",;\t", key=first.count)
    names = tuple(cell.strip() for cell in first.split(delimiter))
    if len(names) < 2 or any(NUMBER.fullmatch(name) for name in names):
        return None
    values = plain_numbers(raw, end + 1, len(names), delimiter)
    if values is None:
        return None
    return RawTable(source=str(path), names=names, values=values, lines=np.arange(2, len(values) + 2))


def _decoded(path: Path, raw: bytes) -> tuple[str, tuple[str, ...]]:
    """Text of a file with lines that end in \\n, and a remark on its encoding."""
    mark = next((name for name, bom in _MARKS.items() if raw.startswith(bom)), None)
    encodings = (mark,) if mark else ("utf-8", *_without_mark(raw))
    for encoding in encodings:
        try:
            content = raw.decode(encoding)
            break
        except UnicodeDecodeError:
            continue
    else:
        raise InputError(f"{path}: not a text in UTF-8, UTF-16, cp1252 or Latin-1; save it as CSV in UTF-8")
    if "\0" in content:
        raise InputError(f"{path}: not a text: it has zeros between its letters; save it as CSV in UTF-8")
    content = content.removeprefix("\ufeff").replace("\r\n", "\n")
    content = content if "\n" in content else content.replace("\r", "\n")
    return content, () if encoding.startswith("utf") else (f"read as {encoding}, since it is not UTF-8",)


def _without_mark(raw: bytes) -> tuple[str, ...]:
    """Encodings to try besides UTF-8: of two bytes where every second one is zero, else of one byte."""
    head = np.frombuffer(raw[: 1 << 12], np.uint8)
    zeros = [float(np.mean(head[i::2] == 0)) if len(head) > 1 else 0.0 for i in (0, 1)]
    return ("utf-16-le",) if zeros[1] > 0.4 else ("utf-16-be",) if zeros[0] > 0.4 else ("cp1252", "latin-1")


def _without_rows(lines: list[str]) -> str:
    """Describe what is wrong with a text in which no row of numbers was found."""
    full = [line for line in lines if line.strip() and not line.startswith(("#", "%"))]
    if not full:
        return "the file is empty; expected a row of channel names and rows of numbers"
    return f"no rows of numbers below the header; the first line is {shown(full[0].strip())}"


_SIMPLE = re.compile(r"[\x00-^`-\x7f]*")  # float() takes more than numbers of a file, but of these letters nothing else


def _numbers(path: Path, lines: list[str], layout: Layout, notes: tuple[str, ...]) -> RawTable:
    """Numbers of all rows, dates and clocks as seconds from the first; per column the first cell that is neither."""
    numbers = array("d")
    at = []
    words = dict[int, list[tuple[int, str]]]()
    while lines and not lines[-1].strip():
        del lines[-1]
    between = sum(map(is_comment, lines[layout.first :]))
    if between:
        notes += (f"{between} comments between the rows are left out",)
    for line, cells in _rows(path, lines, layout):
        if len(cells) == layout.width + 1 and not cells[-1].strip():
            del cells[-1]
        if len(cells) != layout.width:
            if line == len(lines) and len(cells) < layout.width and at:
                notes += (f"the last row (line {line}) is cut off: {len(cells)} of {layout.width} cells; left out",)
                continue
            kind = "truncated or ragged" if len(cells) < layout.width else "ragged"
            raise InputError(
                f"{path}: row {len(at) + 1} (line {line}) has {len(cells)} cells, expected {layout.width} as in the "
                f"first row; the row is {kind}: repair or remove it"
            )
        at.append(line)
        start = len(numbers)
        try:
            numbers.extend(map(float, cells if _SIMPLE.fullmatch("".join(cells)) else [""]))
            continue
        except ValueError:
            del numbers[start:]
        for column, cell in enumerate(cells):
            text = cell.strip()
            number = number_of(text)
            numbers.append(np.nan if number is None else number)
            if number is None:
                words.setdefault(column, []).append((len(at) - 1, text))
    values = np.frombuffer(numbers, dtype=float).reshape(-1, layout.width).copy()
    names = layout.names
    text = {}
    clocks = list[int]()
    for column, some in words.items():
        seconds = clock_of([cell for _, cell in some])
        if seconds is None:
            text[column] = next((row, cell) for row, cell in some if clock_of([cell]) is None or len(some) == 1)
            continue
        clocks.append(column)
        values[[row for row, _ in some], column] = seconds - seconds[0]
        called = names[column] if names else column + 1
        notes += (f"column '{called}' is a clock; time is counted from its first sample, {some[0][1]}",)
    return RawTable(
        source=str(path), names=names, values=values, lines=np.array(at), text=text, hold=layout.hold, notes=notes
    )


def _rows(path: Path, lines: list[str], layout: Layout) -> Iterator[tuple[int, list[str]]]:
    """Number of the line and cells of each row, empty lines and comments left out."""
    body = ["" if is_comment(line) else line for line in lines[layout.first :]]
    if not layout.delimiter:
        rows = ((layout.first + k + 1, line.split()) for k, line in enumerate(body))
    else:
        reader = csv.reader(body, delimiter=layout.delimiter, skipinitialspace=True, strict=True)
        rows = _read(path, reader, layout.first)
    for line, cells in rows:
        if len(cells) > 1 or "".join(cells).strip():
            yield line, [of_commas(cell.strip()) for cell in cells] if layout.comma else cells


def _read(path: Path, reader: Any, skipped: int) -> Iterator[tuple[int, list[str]]]:
    try:
        for cells in reader:
            yield reader.line_num + skipped, cells
    except csv.Error as error:
        said = "a carriage return stands within the row; save the file with one kind of line ends"
        said = said if str(error).startswith("new-line") else f"not valid CSV: {error}; check its quotation marks"
        raise InputError(f"{path}: line {reader.line_num + skipped}: {said}") from None
