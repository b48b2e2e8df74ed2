"""The painter for print, mail and notebooks: a figure by matplotlib, and its SVG."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis as AxisOfMatplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_rgba
from matplotlib.figure import Figure as FigureOfMatplotlib
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, MultipleLocator, NullLocator

from casid.report.figure import Axis, Band, Bar, Cells, Curve, Figure, Marked, Note, Panel, Rule, Scale, Span, thinned
from casid.report.looks import Look
from casid.report.margins import Margins

_HEAD = 0.2  # inches above a panel for its heading, and for notes above it
_FOOT = 0.45  # inches below the last panel
_LINE = 0.2  # inches of a line of the legend
_LETTER = 0.072  # inches of a letter of the legend
_HANDLE = 0.55  # inches of a line in the legend
_NAME = 40  # letters of a name beside an axis
_POINTS = 1000  # of a curve
_DOTS = 2000  # of a curve, more of which become pixels
_DECADES = (0.7, 1.7, 4.0)  # of a logarithmic axis: numbers 1 to 9; 1, 2, 5; powers of ten
_TEXT = 0.55  # of a scale: on darker cells a text is white
_LUMINANCE = (0.3, 0.59, 0.11)  # of red, green and blue
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_RC: dict[Any, Any] = {
    "font.size": 10.5,
    "axes.titlesize": 10.0,
    "axes.labelsize": 10.0,
    "legend.fontsize": 9.5,
    "xtick.labelsize": 9.5,
    "ytick.labelsize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "svg.hashsalt": "casid",
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    "figure.facecolor": "white",
    "figure.constrained_layout.h_pad": 0.06,
}


def settings() -> AbstractContextManager[None]:
    """Return the context in which figures are made and written."""
    return mpl.rc_context(rc=_RC)


def blank(height: float, width: float) -> FigureOfMatplotlib:
    """Return an empty figure, in inches."""
    return FigureOfMatplotlib(figsize=(width, height), layout=Margins())


def window(height: float, width: float) -> FigureOfMatplotlib:
    """Return an empty figure in pyplot's care: a notebook shows it, and `plt.show()` opens it."""
    from matplotlib import pyplot  # here, as it looks for a display

    return pyplot.figure(figsize=(width, height), layout="constrained")


def svg(figure: Figure | FigureOfMatplotlib) -> bytes:
    """Return a figure as SVG, the same bytes for the same figure."""
    buffer = io.BytesIO()
    painted = paint(figure) if isinstance(figure, Figure) else figure
    with settings():
        if painted is figure:  # it may be in a window, which a canvas of our own would take it from
            painted.savefig(buffer, format="svg", metadata={"Date": None})
        else:  # the canvas draws once, `savefig` twice
            FigureCanvasSVG(painted).print_svg(buffer, metadata={"Date": None})
    return buffer.getvalue()


def shown(figure: Figure) -> FigureOfMatplotlib:
    """Paint a figure in pyplot's care."""
    return paint(figure, window)


def paint(figure: Figure, empty: Callable[[float, float], FigureOfMatplotlib] = blank) -> FigureOfMatplotlib:
    """Paint a figure into an `empty` one of a height and width."""
    rows = figure.rows
    columns = math.lcm(*(len(row) for row in rows))
    heights = [max((one.height for one in row if one), default=1.0) for row in rows]
    legend = {name: _handle(part) for name, part in figure.legend.items()}
    across = _columns(legend, figure.width)
    around = sum(_HEAD * _lines_above(row) for row in rows) + _FOOT * (1 if figure.linked else len(rows))
    scale = figure.scale
    height = sum(heights) + around + _LINE * math.ceil(len(legend) / across) + (_FOOT if scale else 0.0)
    with settings():
        painted = empty(height, figure.width)
        ratios = [*heights, *([0.12] if scale else [])]
        widths = figure.widths or (1.0,) * columns
        grid = painted.add_gridspec(len(ratios), columns, height_ratios=ratios, width_ratios=widths)
        axes: dict[int, Axes] = {}
        for r, row in enumerate(rows):
            for c, panel in enumerate(row):
                if panel is None:
                    continue
                span = columns // len(row)
                first = axes.get(id(figure.linked_with(panel)[0]))
                ax = painted.add_subplot(grid[r, c * span : (c + 1) * span], sharex=first)
                axes[id(panel)] = ax
                lowest = all(len(below) != len(row) or below[c] is None for below in rows[r + 1 :])
                _panel(ax, figure, panel, lowest)
        if scale:
            bar = painted.colorbar(_colours(scale), cax=painted.add_subplot(grid[-1, :]), orientation="horizontal")
            bar.set_label(scale.label)
            if scale.log:
                _powers(bar.ax.xaxis)
        if legend:
            painted.legend(list(legend.values()), list(legend), loc="outside upper center", ncols=across)
    return painted


def _lines_above(row: Sequence[Panel | None]) -> int:
    return max((bool(one.heading) + any(note.y is None for note in one.of(Note)) for one in row if one), default=0)


def _handle(part: Marked) -> Artist:
    look = part.look
    if isinstance(part, Curve | Rule):
        line: dict[str, Any] = _line(look) | {"ms": max(min(look.size, 5.0), 4.0)}
        return Line2D([], [], **line)
    return Patch(**_face(look))


def _columns(legend: Iterable[str], width: float) -> int:
    """Return how many entries of a legend have room beside each other."""
    longest = max((len(name) for name in legend), default=0)
    return max(1, min(sum(1 for _ in legend), int(width / (_HANDLE + _LETTER * longest))))


def _line(look: Look) -> dict[str, Any]:
    style: dict[str, Any] = {"color": look.colour, "lw": look.width, "alpha": look.alpha}
    style |= {"ls": look.dash or "none", "marker": look.marker or "none", "ms": look.size}
    return style | ({"mew": 0.0} if look.marker in ("o", ".") and look.alpha < 1.0 else {})


def _face(look: Look) -> dict[str, Any]:
    face: dict[str, Any] = {"facecolor": to_rgba(look.colour, look.alpha), "lw": 0.8 if look.edge else 0.0}
    return face | ({"edgecolor": look.edge} if look.edge else {}) | ({"hatch": look.hatch} if look.hatch else {})


def _panel(ax: Axes, figure: Figure, panel: Panel, lowest: bool) -> None:
    for part in panel.parts:
        _PAINTERS[type(part)](ax, part)
    above = any(note.y is None for note in panel.of(Note))
    if panel.heading:
        ax.set_title(panel.heading, loc="left", pad=16.0 if above else 4.0)
    _axis(ax.xaxis, panel.x, figure.x_range(panel))
    _axis(ax.yaxis, panel.y, figure.y_range(panel), room=panel.height)
    ax.set_ylabel(panel.y.label if panel.y.names else "")
    ax.set_xlabel(panel.x.label if lowest or not figure.linked else "")
    if figure.linked:
        ax.tick_params(labelbottom=lowest)
    if panel.y.names:
        ax.grid(axis="y", visible=False)
    if panel.cells:
        _matrix(ax, panel)
    if panel.square:
        ax.set_aspect("equal")
    if panel.bare:
        ax.axis("off")


def _axis(axis: AxisOfMatplotlib, told: Axis, ends: tuple[float, float], room: float | None = None) -> None:
    """Set scale, limits and numbers of an axis; `room` is the height of a vertical one [inches]."""
    if told.log:
        axis._set_axes_scale("log")  # pyright: ignore[reportAttributeAccessIssue]
    upward = room is not None
    low, high = ends
    limits = axis.axes.set_ylim if upward else axis.axes.set_xlim
    limits(*((high, low) if upward and told.names else (low, high)))
    if told.names:
        places = np.arange(len(told.names)) - (0.5 if told.edges else 0.0)
        names = [textwrap.fill(name, _NAME) for name in told.names]
        axis.set_ticks(places, names)
        for k in told.bold:
            axis.get_ticklabels()[k].set_fontweight("bold")
    elif told.log:
        decades = math.log10(high / low)
        if decades > _DECADES[2]:
            _powers(axis)
        else:
            subs = range(1, 10) if decades < _DECADES[0] else (1.0, 2.0, 5.0) if decades < _DECADES[1] else (1.0,)
            axis.set_major_locator(LogLocator(subs=tuple(subs)))
            axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            axis.set_minor_locator(NullLocator())
    elif told.step:
        axis.set_major_locator(MultipleLocator(told.step * max(1, round((high - low) / told.step / 5))))
    elif room is not None:
        axis.set_major_locator(MaxNLocator(min(6, max(2, round(3.0 * room)))))


def _powers(axis: AxisOfMatplotlib) -> None:
    """Number a logarithmic axis 10⁰, 10¹, without the mathtext of matplotlib, which takes longer."""
    axis.set_major_locator(LogLocator())
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"10{str(round(math.log10(x))).translate(_RAISED)}"))
    axis.set_minor_locator(NullLocator())


def _curve(ax: Axes, one: Curve) -> None:
    with_bars = one.std is not None or one.std_x is not None
    x, y = (one.x, one.y) if with_bars else thinned(one.x, one.y, _POINTS)
    dots = not one.look.dash
    ax.plot(x, y, **_line(one.look), rasterized=dots and len(x) > _DOTS, clip_on=not dots, zorder=2.5)
    if with_bars:
        bars = {"ecolor": one.look.colour, "elinewidth": 1.3, "capsize": 2.5, "fmt": "none"}
        ax.errorbar(one.x, one.y, xerr=one.std_x, yerr=one.std, **bars)


def _band(ax: Axes, one: Band) -> None:
    ax.fill_between(one.x, one.low, one.high, **_face(one.look), zorder=1.0)


def _span(ax: Axes, one: Span) -> None:
    draw = ax.axvspan if one.axis == "x" else ax.axhspan
    draw(one.low, one.high, *one.part, **_face(one.look), zorder=0.9)


def _rule(ax: Axes, one: Rule) -> None:
    look = one.look
    draw = ax.axvline if one.axis == "x" else ax.axhline
    draw(one.at, color=look.colour, lw=look.width, ls=look.dash, alpha=look.alpha, zorder=1.5)


def _bar(ax: Axes, one: Bar) -> None:
    ax.barh(one.at, one.high - one.low, one.height, left=one.low, **_face(one.look))


def _note(ax: Axes, one: Note) -> None:
    upward = "bottom" if one.y is None else "center"
    where: dict[str, Any] = {"xytext": one.offset, "textcoords": "offset points", "annotation_clip": False}
    where["xycoords"] = ("data", "axes fraction") if one.y is None else "data"
    place = (one.x, 1.02 if one.y is None else one.y)
    weight = "bold" if one.bold else "normal"
    ax.annotate(one.text, place, ha=one.align, va=upward, fontsize=9.0, weight=weight, color=one.colour, **where)


def _cells(ax: Axes, one: Cells) -> None:
    mapped = _colours(one.scale)
    colours = mapped.to_rgba(np.clip(one.values, one.scale.low, one.scale.high))
    ax.imshow(colours, aspect="auto")
    for (i, j), text in one.texts.items():
        dark = colours[i, j, :3] @ _LUMINANCE < _TEXT
        ax.text(j, i, text, ha="center", va="center", color="white" if dark else "black", fontsize=8.0)


def _matrix(ax: Axes, panel: Panel) -> None:
    """Names of columns on top, upright where they are long; thin lines between cells."""
    cells = panel.cells
    assert cells is not None
    if not panel.x.edges:
        ax.xaxis.tick_top()
        ax.xaxis.set_label_position("top")
        if max(map(len, panel.x.names), default=0) > 3:
            ax.tick_params(axis="x", labelrotation=90)
    ax.grid(visible=False)
    ax.tick_params(length=0)
    for which, count in ((ax.xaxis, cells.values.shape[1]), (ax.yaxis, cells.values.shape[0])):
        which.set_minor_locator(FixedLocator(list(np.arange(count + 1) - 0.5)))
    ax.grid(visible=True, which="minor", color="#EEEEEE", linewidth=0.5)
    ax.tick_params(which="minor", length=0)
    for spine in ax.spines.values():
        spine.set_visible(False)


def _colours(scale: Scale) -> ScalarMappable:
    norm = LogNorm if scale.log else Normalize
    return ScalarMappable(norm(scale.low, scale.high), scale.colours)


_PAINTERS: Mapping[type, Callable[[Axes, Any], None]] = {
    Curve: _curve,
    Band: _band,
    Span: _span,
    Rule: _rule,
    Bar: _bar,
    Cells: _cells,
    Note: _note,
}
