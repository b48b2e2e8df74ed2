"""Figures as data: panels of curves, bands, spans, rules, bars, cells and notes, each with its look and its unit.

Two painters draw them, `svg.py` for print, mail and notebooks, `uplot.py` for a reader who zooms.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from casid.report.looks import INK, Look
from casid.report.words import channel_axis, channel_scale

# inches; a page shows them up to 40 and 46 rem wide
WIDTH = 5.6
WIDE = 8.2
_ROOM = 0.05  # part of a range that stays free around what is drawn
_ROOM_ALONG = 0.01  # the same along a curve


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """A line, or dots, through places (N,); NaN is a gap. `std` and `std_x` (N,) are drawn as bars about each place."""

    look: Look
    x: np.ndarray
    y: np.ndarray
    std: np.ndarray | None = None
    std_x: np.ndarray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Band:
    """Area between two curves (N,)."""

    look: Look
    x: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Span:
    """Area between two places of an axis; `part` of the height of the panel, from its foot."""

    look: Look
    low: float
    high: float
    axis: str = "x"
    part: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A line across the panel at a place of an axis."""

    look: Look
    at: float
    axis: str = "x"


@dataclass(frozen=True, eq=False, kw_only=True)
class Bar:
    """A bar from `low` to `high` beside a place of the vertical axis."""

    look: Look
    at: float
    low: float
    high: float
    height: float = 0.7


@dataclass(frozen=True, kw_only=True)
class Scale:
    """The colours of numbers between `low` and `high`, with a `label` where it is drawn below the panels."""

    low: float
    high: float
    colours: str
    log: bool = False
    label: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Cells:
    """Numbers (rows, columns) as colours, the first row on top, with a text (row, column) in some of them."""

    values: np.ndarray
    scale: Scale
    texts: Mapping[tuple[int, int], str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Note:
    """A text at a place; without `y` above the panel. `offset` moves it [points]."""

    text: str
    x: float
    y: float | None = None
    align: str = "left"
    offset: tuple[float, float] = (0.0, 0.0)
    bold: bool = False
    colour: str = INK


Marked = Curve | Band | Span | Rule | Bar  # parts with a look
Part = Marked | Cells | Note


@dataclass(frozen=True, kw_only=True)
class Axis:
    """An axis: its label with the unit; limits, where what is drawn does not give them; `names` of the places 0, 1, 2.

    Some names are `bold`; with `edges` they stand between the places. `step`: what is between two numbers.
    """

    label: str = ""
    low: float | None = None
    high: float | None = None
    log: bool = False
    names: tuple[str, ...] = ()
    bold: frozenset[int] = frozenset()
    edges: bool = False
    step: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """Parts in the order in which they are drawn, between two axes; the label of `y` and the `title` stand above it.

    `height` in inches. `square`: one unit is as long on both axes. `bare`: neither axes nor grid.
    """

    parts: tuple[Part, ...]
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    title: str = ""
    height: float = 1.35
    square: bool = False
    bare: bool = False

    def of(self, kind: type) -> list:
        """Return the parts of a kind."""
        return [one for one in self.parts if isinstance(one, kind)]

    @cached_property
    def heading(self) -> str:
        """Title and label of the vertical axis, which stands beside names."""
        return ": ".join(one for one in (self.title, "" if self.y.names else self.y.label) if one)

    @cached_property
    def cells(self) -> Cells | None:
        """Its matrix, where it has one."""
        return next(iter(self.of(Cells)), None)

    @property
    def can_be_zoomed(self) -> bool:
        """Return True if it is made of curves along a common axis and what is drawn behind them."""
        curves = self.of(Curve)
        lines = [one for one in curves if one.look.dash and len(one.x) > 2]
        return (
            not (self.of(Bar) or self.of(Cells) or self.x.names or self.y.names or self.square)
            and bool(lines)
            and all(one.std is None and one.std_x is None for one in curves)
            and all(bool(np.all(np.diff(one.x) >= 0.0)) for one in curves)
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Figure:
    """Rows of panels; None leaves a place free. `linked`: panels whose horizontal axes have one label have one axis;
    `alike`: all have one vertical axis. `width` in inches; `widths` are the shares of columns."""

    rows: tuple[tuple[Panel | None, ...], ...]
    width: float = WIDTH
    widths: tuple[float, ...] = ()
    linked: bool = True
    alike: bool = False

    @cached_property
    def panels(self) -> list[Panel]:
        """All panels, row by row."""
        return [one for row in self.rows for one in row if one is not None]

    @property
    def can_be_zoomed(self) -> bool:
        """Return True if every panel can be zoomed."""
        return all(one.can_be_zoomed for one in self.panels)

    @cached_property
    def legend(self) -> dict[str, Marked]:
        """Name -> the first part that is drawn so."""
        found: dict[str, Marked] = {}
        for part in (part for panel in self.panels for part in panel.parts if not isinstance(part, Cells | Note)):
            if part.look.name:
                found.setdefault(part.look.name, part)
        return found

    @cached_property
    def scale(self) -> Scale | None:
        """The colours that are explained below the panels."""
        return next((one.cells.scale for one in self.panels if one.cells and one.cells.scale.label), None)

    def linked_with(self, panel: Panel) -> list[Panel]:
        """Return the panels with the same horizontal axis."""
        return [one for one in self.panels if one is panel or (self.linked and one.x.label == panel.x.label)]

    def x_range(self, panel: Panel) -> tuple[float, float]:
        """Return the ends of the horizontal axis of a panel, the same for all that are linked."""
        return _range(self.linked_with(panel), "x")

    def y_range(self, panel: Panel) -> tuple[float, float]:
        """Return the ends of the vertical axis of a panel, the same for all that are alike."""
        return _range(self.panels if self.alike else [panel], "y")


def stacked(panels: Iterable[Panel], columns: int = 1) -> tuple[tuple[Panel | None, ...], ...]:
    """Return rows of panels in so many columns; the last row may have free places."""
    every = list(panels)
    columns = max(1, min(columns, len(every)))
    free = [None] * (-len(every) % columns)
    filled = [*every, *free]
    return tuple(tuple(filled[k : k + columns]) for k in range(0, len(filled), columns))


def in_rows(parts: Iterable[Part], x: Axis, names: Sequence[str], row: float, bold: Collection[int] = ()) -> Figure:
    """Return a figure of one panel with a row, of a height in inches, for each name; some names are `bold`."""
    y = Axis(names=tuple(names), bold=frozenset(bold))
    return Figure(rows=((Panel(parts=tuple(parts), x=x, y=y, height=row * len(names) + 0.2),),))


def _range(panels: Sequence[Panel], axis: str) -> tuple[float, float]:
    """Return the limits of an axis, or what is drawn along it and some room around."""
    own = panels[0].x if axis == "x" else panels[0].y
    if own.names:
        return -0.5, len(own.names) - (1.5 if own.edges else 0.5)
    if own.low is not None and own.high is not None:
        return own.low, own.high
    values = np.concatenate([np.ravel(one) for panel in panels for one in _drawn(panel, axis)] or [np.zeros(0)])
    values = values[np.isfinite(values) & ((values > 0.0) | (not own.log))]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    lines = any(one.look.dash and not one.look.marker for panel in panels for one in panel.of(Curve))
    room = _ROOM_ALONG if lines and axis == "x" else _ROOM
    if own.log:
        factor = (high / low) ** room if high > low else 2.0
        found = low / factor, high * factor
    else:
        free = room * (high - low) if high > low else 0.5 * abs(high) or 1.0
        found = low - free, high + free
    return (found[0] if own.low is None else own.low), (found[1] if own.high is None else own.high)


def _drawn(panel: Panel, axis: str) -> Iterator[np.ndarray | list[float]]:
    """Yield what is drawn along an axis, "x" or "y"."""
    across = axis == "x"
    for one in panel.parts:
        if isinstance(one, Curve):
            values, std = (one.x, one.std_x) if across else (one.y, one.std)
            spread = 0.0 if std is None else np.nan_to_num(std)
            yield values - spread
            yield values + spread
        elif isinstance(one, Band):
            yield from (one.x,) if across else (one.low, one.high)
        elif isinstance(one, Rule) and one.axis == axis:
            yield [one.at]
        elif (isinstance(one, Bar) and across) or (isinstance(one, Span) and one.axis == axis):
            yield [one.low, one.high]


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """A figure, of these parts or of matplotlib, with its words: `name` of the file without ending, heading, caption
    below, text instead of it."""

    name: str
    figure: Any
    title: str
    caption: str
    alt: str

    @property
    def wide(self) -> bool:
        """Return True if it is scrolled sideways where there is no room for it."""
        width = self.figure.width if isinstance(self.figure, Figure) else self.figure.get_figwidth()
        return width > WIDTH

    @property
    def can_be_zoomed(self) -> bool:
        """Return True if a script can draw it."""
        return isinstance(self.figure, Figure) and self.figure.can_be_zoomed


TIME = Axis(label="time t [s]")


def history(
    channel: str,
    t: np.ndarray,
    curves: Mapping[Look, np.ndarray],
    *,
    x: Axis = TIME,
    title: str = "",
    height: float = 1.35,
    unit: str | None = None,
) -> Panel:
    """Return a panel of a channel in the unit that people read, or as it is in a `unit` of its own: curves (N,) by
    look, what is measured first."""
    factor = channel_scale(channel)[0] if unit is None else 1.0
    label = channel_axis(channel) if unit is None else f"{channel} [{unit}]" if unit else channel
    parts = tuple(Curve(look=look, x=t, y=factor * values) for look, values in curves.items())
    return Panel(parts=parts, x=x, y=Axis(label=label), title=title, height=height)


def thinned(x: np.ndarray, y: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest value of each stretch of a curve with more points than can be seen.

    Where a gap begins is kept.
    """
    if len(x) <= points:
        return x, y
    edges = np.linspace(0, len(x), points // 2 + 1).astype(int)
    low = np.where(np.isfinite(y), y, np.inf)
    high = np.where(np.isfinite(y), y, -np.inf)
    keep = {
        place
        for first, last in zip(edges[:-1], edges[1:], strict=True)
        for place in (first + int(low[first:last].argmin()), first + int(high[first:last].argmax()))
    }
    gaps = np.flatnonzero(np.diff(np.isnan(y).astype(int)) > 0) + 1
    chosen = np.array(sorted({*keep, *gaps.tolist()}))
    return x[chosen], y[chosen]
