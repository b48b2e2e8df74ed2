"""Sections of a page as data: texts, tables and pictures in the order in which they are read."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from matplotlib.figure import Figure

from casid.arguments import given, listed, one_line, require, sequence
from casid.errors import InputError
from casid.frames import Rows
from casid.report.figure import Picture


@dataclass(frozen=True, kw_only=True)
class ReportTable:
    """Rows of cells, the first of which heads them, under a `head`; those of the numbers `marked` stand out.

    `claims`: number of a row -> anchor of the statement that it tells of, whose figure it links to. `numeric`: short
    cells, none of which may break. A table without rows is not shown.
    """

    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    caption: str
    numeric: bool = False
    marked: Collection[int] = ()
    claims: Mapping[int, str] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, str]], caption: str, **others: Any) -> ReportTable:
        """Return the table of rows that are head -> cell, with the same heads in each."""
        head = tuple(rows[0]) if rows else ()
        return cls(head=head, rows=[tuple(row.values()) for row in rows], caption=caption, **others)

    def text(self) -> str:
        """Return its rows for a terminal."""
        first, *rest = self.head
        return Rows(heads={first: "", **dict.fromkeys(rest, "s" if self.numeric else "")}, rows=self.rows).text()

    @property
    def kind(self) -> str:
        """Classes of the style sheet."""
        kinds = (("numeric", self.numeric), ("many", len(self.head) > 3), ("wide", len(self.head) > 5))
        return " ".join(word for word, true in kinds if true)


def of_rows(rows: Rows, caption: str) -> ReportTable:
    """Return the table of a result with a caption."""
    return ReportTable(head=tuple(rows.heads), rows=list(map(tuple, rows.cells())), caption=caption, numeric=True)


def where(flags: Iterable[object]) -> set[int]:
    """Return the numbers of what is true, for rows that are `marked`."""
    return {k for k, one in enumerate(flags) if one}


@dataclass(frozen=True, kw_only=True)
class Bars:
    """Rows of bars, one for each of `names`, on a common scale.

    A row has its name and the bars: each its number in words, and its width in per cent of the row.
    """

    caption: str
    names: Sequence[str]
    rows: Sequence[tuple[str, Sequence[tuple[str, float]]]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Fragment:
    """What a template of its own shows, and the pictures in it."""

    template: str
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """A section of a page: texts, tables and figures under a title.

    Parameters
    ----------
    title
        Its heading.
    parts
        In the order of reading, each of them a text; a list of texts; a table as column -> values, or a result that has
        `rows()`, such as a `Fit`; a figure of matplotlib, such as the `plot` of a result; or a section in this one.
    name
        Its anchor on the page: "values" is report.html#values.
    open
        It is seen without being asked for. Otherwise its title is seen, which opens it.

    Raises
    ------
    InputError
        For a part that is none of these.

    Examples
    --------
    >>> import casid as cs
    >>> masses = {"what": ["empty", "fuel"], "kg": [12500.0, 2100.0]}
    >>> cs.Section(title="Loading", parts=["Weighed on the day of the flight.", masses]).title
    'Loading'
    """

    title: str
    parts: Sequence[Any]
    name: str = ""
    open: bool = False

    def __post_init__(self) -> None:
        one_line(self.title, "Section: title")
        one_line(self.name, "Section: name")
        require(self.open, bool, "Section: open", "True or False")
        for part in sequence(self.parts, "Section: parts", 'a list like ["A text.", {"what": ["fuel"], "kg": [2100]}]'):
            kind(part)


Part = str | Sequence[str] | Mapping[str, Sequence[Any]] | ReportTable | Rows | Picture | Section | Bars | Fragment
_KINDS = {
    str: "text",
    tuple: "list",
    list: "list",
    Mapping: "rows",
    Rows: "rows",
    ReportTable: "table",
    Picture: "figure",
    Figure: "figure",
    Bars: "bars",
    Fragment: "fragment",
    Section: "section",
}


def kind(part: object) -> str:
    """Name what a part of a page is. Raises InputError for what is none."""
    found = next((name for of, name in _KINDS.items() if isinstance(part, of)), "rows")
    if found == "list":
        for one in sequence(part, "a list on a page", "texts"):
            one_line(one, "a line of a list on a page", 10_000)
    elif found == "rows":
        rows_of(part)
    return found


def rows_of(part: Any) -> Rows:
    """Return the table of a part: its own, the `rows()` of a result, or the columns of a mapping."""
    if isinstance(part, Rows):
        return part
    if not isinstance(part, Mapping):
        if callable(getattr(part, "rows", None)) and not isinstance(part, type):
            return part.rows()
        raise InputError(
            f"a part of a page is {given(part)}; expected a text, a list of texts, a table as column -> values, a "
            "result with rows(), a figure of matplotlib or a cs.Section"
        )
    columns = {one_line(key, "a column"): sequence(part[key], f"column {key!r}", "values") for key in part}
    counts = [len(values) for values in columns.values()]
    if len(set(counts)) != 1:
        raise InputError(
            f"a table on a page has columns of {listed(map(str, counts))} values; expected as many in each"
        )
    forms = [".6g" if all(isinstance(v, float | int) for v in values) else "" for values in columns.values()]
    return Rows(heads=dict(zip(columns, forms, strict=True)), rows=list(zip(*columns.values(), strict=True)))


def shown_parts(parts: Iterable[Any], title: str = "", numbers: Iterator[int] | None = None) -> list[Any]:
    """Return what there is to show, with a name and a title for each figure that has none."""
    numbers = count(1) if numbers is None else numbers
    found = []
    for part in parts:
        if isinstance(part, Figure):
            found.append(Picture(name=f"own_{next(numbers)}", figure=part, title=title, caption="", alt=title))
        elif isinstance(part, Section):
            inside = shown_parts(part.parts, part.title, numbers)
            found += [Section(title=part.title, parts=inside, name=part.name, open=part.open)] if inside else []
        elif part is not None and (part or not isinstance(part, str | tuple | list)):
            found.append(part)
    return found


def pictures_of(parts: Iterable[Any]) -> Iterator[Picture]:
    """Yield the pictures in the order of reading."""
    for part in parts:
        if isinstance(part, Picture):
            yield part
        elif isinstance(part, Fragment):
            yield from part.pictures
        elif isinstance(part, Section):
            yield from pictures_of(part.parts)
