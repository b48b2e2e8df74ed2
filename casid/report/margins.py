"""Room around the panels of a figure: for numbers, labels and titles, each measured once, and for a legend of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import LayoutEngine
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from numpy.typing import ArrayLike

_PAD = 0.06  # inches at the edges of the figure, and on either side of a gap between panels
_GUESS = (0.9, 0.5, 0.1, 0.2)  # inches left, below, right and above of a panel, with which it is measured first
_LEFT, _BELOW, _RIGHT, _ABOVE = range(4)
_SIDES = {"left": _LEFT, "bottom": _BELOW, "right": _RIGHT, "top": _ABOVE}


class Margins(LayoutEngine):
    """Panels of one grid in the proportions of its rows and columns; labels of a column and of a row are in line.

    A panel may span several cells. A legend of the figure stands above or below all panels. The constrained layout of
    matplotlib does more, but measures every text four times, and for labels in line once more for each of them.
    """

    _adjust_compatible = True
    _colorbar_gridspec = True

    def execute(self, fig: Figure) -> None:
        """Place the panels; matplotlib calls this before it draws."""
        panels = [_Panel(ax=ax, spec=spec) for ax in fig.axes if (spec := ax.get_subplotspec()) and ax.get_visible()]
        if not panels:
            return
        # as matplotlib's own engines do
        renderer: RendererBase = fig._get_renderer()  # pyright: ignore[reportAttributeAccessIssue]
        inside = _between_legends(fig, renderer)
        _place(fig, panels, [np.array(_GUESS) * fig.dpi] * len(panels), inside)
        for _ in range(2):  # an axis that became longer may have other numbers
            before = [one.numbers() for one in panels]
            around = [one.measured(renderer) for one in panels]
            _line_up(panels, around)
            _place(fig, panels, [one.needed for one in around], inside)
            for one, room in zip(panels, around, strict=True):
                one.put_labels(room.reach)
            if all(one.numbers() == numbers for one, numbers in zip(panels, before, strict=True)):
                return


@dataclass(frozen=True, eq=False, kw_only=True)
class _Room:
    """Overhang of a panel, left, below, right and above [pixels]: numbers, up to where labels begin, the size of
    labels, and texts with titles."""

    reach: np.ndarray
    labels: np.ndarray
    texts: np.ndarray

    @property
    def needed(self) -> np.ndarray:
        return np.maximum(self.reach + self.labels, self.texts)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Panel:
    """A panel and its place in the grid."""

    ax: Axes
    spec: SubplotSpec

    @property
    def begins(self) -> tuple[int, int]:
        """First column and last row, where labels stand."""
        return self.spec.colspan.start, self.spec.rowspan.stop - 1

    def numbers(self) -> list[list[float]]:
        """Return the positions of the ticks."""
        return [list(axis.get_majorticklocs()) for axis in (self.ax.xaxis, self.ax.yaxis)]

    def measured(self, renderer: RendererBase) -> _Room:
        """Measure what reaches beyond it now."""
        panel = self.ax.get_window_extent()
        point = float(np.asarray(renderer.points_to_pixels(1.0)))
        reach = np.zeros(4)
        labels = np.zeros(4)
        texts = np.zeros(4)
        for axis in (self.ax.xaxis, self.ax.yaxis):
            side = _SIDES[axis.get_label_position()]
            axis.set_label_coords(*axis.label.get_position())  # else matplotlib measures all numbers to find a place
            shown = axis.label.get_visible() and bool(axis.label.get_text())
            axis.label.set_visible(False)
            reach = np.maximum(reach, _beyond(panel, axis.get_tightbbox(renderer)))
            reach[side] = max(reach[side], point * axis.get_tick_padding())
            axis.label.set_visible(shown)
            if shown:
                reach[side] += point * axis.labelpad
                box = axis.label.get_window_extent(renderer)
                labels[side] = box.height if axis is self.ax.xaxis else box.width
        if self.ax.yaxis.offsetText.get_text():  # above which a title is moved
            self.ax._autotitlepos = True  # pyright: ignore[reportAttributeAccessIssue]
            self.ax._update_title_position(renderer)  # pyright: ignore[reportAttributeAccessIssue]
        self.ax._autotitlepos = False  # pyright: ignore[reportAttributeAccessIssue] # it would measure all numbers again
        for text in self.ax.get_children():  # titles are among them
            if isinstance(text, Text) and text.get_visible() and text.get_text():
                texts = np.maximum(texts, _beyond(panel, text.get_window_extent(renderer)))
        return _Room(reach=reach, labels=labels, texts=texts)

    def put_labels(self, reach: np.ndarray) -> None:
        """Place the labels of its axes as far out as that [pixels]."""
        panel = self.ax.get_window_extent()
        x = self.ax.xaxis
        y = self.ax.yaxis
        above = x.get_label_position() == "top"
        right = y.get_label_position() == "right"
        x.set_label_coords(0.5, 1.0 + reach[_ABOVE] / panel.height if above else -reach[_BELOW] / panel.height)
        y.set_label_coords(1.0 + reach[_RIGHT] / panel.width if right else -reach[_LEFT] / panel.width, 0.5)


def _beyond(panel: Bbox, box: Bbox | None) -> np.ndarray:
    """Return how far a box reaches beyond the panel on each side [pixels]."""
    if box is None or not np.isfinite(box.extents).all():
        return np.zeros(4)
    return np.maximum([panel.x0 - box.x0, panel.y0 - box.y0, box.x1 - panel.x1, box.y1 - panel.y1], 0.0)


def _line_up(panels: Sequence[_Panel], around: Sequence[_Room]) -> None:
    """Let labels begin equally far out in all panels of a column, and of a row."""
    for side, which in ((_LEFT, 0), (_BELOW, 1)):
        furthest: dict[int, float] = {}
        for one, room in zip(panels, around, strict=True):
            furthest[one.begins[which]] = max(furthest.get(one.begins[which], 0.0), room.reach[side])
        for one, room in zip(panels, around, strict=True):
            room.reach[side] = furthest[one.begins[which]]


def _between_legends(fig: Figure, renderer: RendererBase) -> tuple[float, float]:
    """(bottom, top) of what legends of the figure leave [pixels]."""
    bottom = 0.0
    top = fig.bbox.height
    for legend in fig.legends:
        box = legend.get_window_extent(renderer)
        if box.y0 + box.y1 > fig.bbox.height:
            top = min(top, box.y0)
        else:
            bottom = max(bottom, box.y1)
    return bottom, top


def _place(fig: Figure, panels: Sequence[_Panel], room: Sequence[np.ndarray], inside: tuple[float, float]) -> None:
    """Share out the figure, less the room around each row and column, in the proportions of the grid."""
    grid, pad, (bottom, top) = panels[0].spec.get_gridspec(), _PAD * fig.dpi, inside
    left = np.zeros(grid.ncols)
    right = np.zeros(grid.ncols)
    above = np.zeros(grid.nrows)
    below = np.zeros(grid.nrows)
    for one, needed in zip(panels, room, strict=True):
        columns = one.spec.colspan
        rows = one.spec.rowspan
        for side, most, place in (
            (_LEFT, left, columns.start),
            (_RIGHT, right, columns.stop - 1),
            (_ABOVE, above, rows.start),
            (_BELOW, below, rows.stop - 1),
        ):
            most[place] = max(most[place], needed[side])
    x0, x1 = _shared(fig.bbox.width, grid.get_width_ratios(), left, right, pad)
    y1, y0 = (top - y for y in _shared(top - bottom, grid.get_height_ratios(), above, below, pad))
    for one in panels:
        columns = one.spec.colspan
        rows = one.spec.rowspan
        corners = x0[columns.start], y0[rows.stop - 1], x1[columns.stop - 1], y1[rows.start]
        one.ax.set_position(Bbox.from_extents(*corners).transformed(fig.transFigure.inverted()))
        one.ax.set_in_layout(True)  # which `set_position` undoes
        one.ax.apply_aspect()  # as drawing does: of a square panel the labels stand beside the square


def _shared(
    length: float, ratios: ArrayLike | None, before: np.ndarray, behind: np.ndarray, pad: float
) -> tuple[np.ndarray, np.ndarray]:
    """(begin, end) of each row or column [pixels] along a length, with the room before and behind each."""
    shares = np.ones(len(before)) if ratios is None else np.asarray(ratios, dtype=float)
    free = length - before.sum() - behind.sum() - 2.0 * pad * len(before)
    sizes = max(free, 0.1 * length) * shares / shares.sum()  # a figure that is too small has panels all the same
    end = np.cumsum(before + sizes + behind + 2.0 * pad) - pad - behind
    return end - sizes, end
