"""Panels of a figure have room for what stands around them: geometry of the boxes of all texts."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from casid.report.estimate_figures import correlations
from casid.report.svg import blank, paint, settings

_ROUNDING = 0.5  # pixels


def boxes_of(figure: Figure) -> list[Bbox]:
    """Every panel with its texts, and every legend, as drawn."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    panels = [box for ax in figure.axes if (box := ax.get_tightbbox(renderer)) is not None]
    return [*panels, *(legend.get_window_extent(renderer) for legend in figure.legends)]


def crowded(legend: str) -> Figure:
    """Panels of unlike numbers with titles, labels, a note at the right edge and a legend; one spans two cells."""
    with settings():
        figure = blank(6.0, 5.6)
        grid = figure.add_gridspec(3, 2, height_ratios=(1.0, 2.0, 0.3))
        places = [grid[0, 0], grid[0, 1], grid[1, 0], grid[1, 1], grid[2, :]]
        for k, ax in enumerate(figure.add_subplot(place) for place in places):
            ax.plot([0.0, 1.0], [0.0, 10.0 ** (2 * k)], label=f"line {k}")
            ax.set_xlabel(f"time {k} [s]")
            ax.set_ylabel(f"y {k}", rotation=0 if k == 2 else 90, ha="right" if k == 2 else "center")
            ax.set_title("title", loc="left")
            if k == 1:
                ax.yaxis.set_label_position("right")
                ax.yaxis.tick_right()
            if k == 3:
                ax.annotate("a note", (1.02, 0.5), xycoords="axes fraction")
        figure.legend(loc=f"outside {legend} center", ncols=2)  # pyright: ignore[reportArgumentType]
    return figure


@pytest.mark.parametrize("legend", ["upper", "lower"])
def test_nothing_overlaps_and_nothing_is_cut_off(legend: str) -> None:
    figure = crowded(legend)
    boxes = boxes_of(figure)
    assert len(boxes) == 6
    for box in boxes:
        assert min(box.x0, box.y0, figure.bbox.width - box.x1, figure.bbox.height - box.y1) > -_ROUNDING
    for one, other in itertools.combinations(boxes, 2):
        common = Bbox.intersection(one, other)
        assert common is None or min(common.width, common.height) < _ROUNDING


def test_rows_have_the_proportions_of_the_grid_and_labels_of_a_column_are_in_line() -> None:
    figure = crowded("upper")
    boxes_of(figure)
    heights = [ax.get_window_extent().height for ax in figure.axes]
    np.testing.assert_allclose(np.array(heights) / heights[0], [1.0, 1.0, 2.0, 2.0, 0.3])
    edges = [figure.axes[k].yaxis.label.get_window_extent().x1 for k in (0, 2, 4)]
    np.testing.assert_allclose(edges, edges[0], atol=2.0)  # the descent of a letter


def test_a_figure_that_is_too_small_is_drawn_all_the_same() -> None:
    with settings():
        figure = blank(0.5, 0.5)
        figure.subplots(3, 3)
    boxes_of(figure)
    assert all(ax.get_window_extent().height > 0.0 for ax in figure.axes)


@pytest.mark.parametrize("count", [2, 6, 40])
def test_the_scale_below_a_square_matrix_stands_off_it_and_its_label_off_its_numbers(count: int) -> None:
    """The square is smaller than its cell where the figure is wide: labels go by what is drawn, not by the cell."""
    figure = paint(correlations([f"Cm_{k}" for k in range(count)], np.eye(count)).figure)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    matrix, scale = figure.axes
    label = scale.xaxis.label.get_window_extent(canvas.get_renderer())
    numbers = [one.get_window_extent(canvas.get_renderer()) for one in scale.get_xticklabels() if one.get_text()]
    assert numbers and label.y1 < min(box.y0 for box in numbers) + _ROUNDING
    assert scale.get_window_extent().y1 < matrix.get_window_extent().y0
    assert label.y0 >= -_ROUNDING
