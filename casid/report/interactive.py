"""Figures of time histories and responses that a reader can zoom, taken from the figures of matplotlib themselves.

Curves, bands, shaded spans and marks of a figure become plain arrays, which a page draws with uPlot. It is taken from
the package `uplot-python` (extra `interactive`) when a page is written. Without it a page keeps its static figures,
which are also what is printed.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

_CODES = 32000  # levels of a curve, more than the pixels of any screen
_NO_VALUE = -32768
_NOT_SAMPLED = -32767
_POINTS = 4000  # of a curve: beyond, the least and the largest value of each stretch
_FEWEST = 3  # points of a line: fewer are marks
_PIXELS_PER_INCH = 88.0
_LEAST_PIXELS = 92.0
_ENDS = 2


@cache
def library() -> tuple[str, str] | None:
    """Read script and style sheet of uPlot from its package; None: it is not installed."""
    found = find_spec("uplot")  # not imported: that would import IPython
    if found is None or not found.submodule_search_locations:
        return None
    folder = Path(next(iter(found.submodule_search_locations))) / "static"
    try:
        script, style = ((folder / name).read_text(encoding="utf-8") for name in ("uPlot.iife.js", "uPlot.min.css"))
        return script, style
    except OSError:
        return None


def licence() -> str:
    """Quote the comment at the head of the library, which names its author and its licence."""
    script = (library() or ("", ""))[0]
    lines = [line.strip("/* ") for line in script.partition("*/")[0].splitlines()]
    told = [line for line in lines if any(word in line for word in ("uPlot.js", "github", "Copyright", "Licensed"))]
    return ", ".join(line.rstrip(".") for line in told)


def data_of(figure: Figure) -> str:
    """Write the curves of a figure as JSON that is safe in a page."""
    told = json.dumps(panels_of(figure), separators=(",", ":"), allow_nan=False)
    return told.replace("<", "\\u003c").replace("&", "\\u0026")


def panels_of(figure: Figure) -> dict[str, Any]:
    """Take the panels of a figure: their curves, bands, shaded spans and marks."""
    axes = [axis for axis in figure.axes if axis.get_visible() and axis.lines]
    names = _names(figure, axes)
    height = figure.get_figheight() * _PIXELS_PER_INCH
    columns = len({round(axis.get_position().x0, 2) for axis in axes})
    return {
        "columns": min(columns, _ENDS),
        "x": next((text for axis in reversed(axes) if (text := axis.get_xlabel())), ""),
        "panels": [_panel(axis, names, height * axis.get_position().height) for axis in axes],
    }


def _names(figure: Figure, axes: Iterable[Axes]) -> dict[tuple, str]:
    """Look of a curve -> what a legend calls it."""
    found: dict[tuple, str] = {}
    for legend in (*figure.legends, *(axis.get_legend() for axis in axes)):
        if legend is None:
            continue
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=False):
            if isinstance(handle, Line2D):
                found.setdefault(_look(handle), text.get_text())
    for axis in axes:
        for line in axis.lines:
            if not str(line.get_label()).startswith("_") and line.get_label():
                found.setdefault(_look(line), str(line.get_label()))
    return found


def _look(line: Line2D) -> tuple:
    colour = to_rgba(line.get_color(), line.get_alpha())  # pyright: ignore[reportArgumentType]
    return _rgba(colour), line.get_linestyle(), round(line.get_linewidth(), 2), line.get_marker()


def _panel(axis: Axes, names: Mapping[tuple, str], height: float) -> dict[str, Any]:
    curves: dict[tuple, list[tuple[np.ndarray, np.ndarray]]] = {}
    marks = []
    for line in axis.lines:
        x, y = (np.asarray(one, dtype=float) for one in line.get_data(orig=False))
        on_data = _on_data(axis, line)
        if all(on_data) and len(x) >= _FEWEST:
            curves.setdefault(_look(line), []).append((x, y))
        elif on_data[0] and len(x) == _ENDS and x[0] == x[1]:
            marks.append({"x": float(x[0]), "colour": to_hex(line.get_color())})
    bands, spans = _shaded(axis)
    thin = {look: _thinned(*_joined(parts)) for look, parts in curves.items()}
    x = np.unique(np.concatenate([one for one, _ in thin.values()] + [band[0] for band in bands] or [np.zeros(0)]))
    series = [_series(look, names, x, *values) for look, values in thin.items()]
    return {
        "label": " ".join(axis.get_ylabel().split()) or axis.get_title() or "",
        "height": round(max(_LEAST_PIXELS, height)),
        "log": [axis.get_xscale() == "log", axis.get_yscale() == "log"],
        "range": [float(one) for one in axis.get_ylim()],
        "x": base64.b64encode(x.astype("<f4").tobytes()).decode(),
        "series": series,
        "bands": [
            {"low": _coded(x, at, low), "high": _coded(x, at, high), "colour": colour}
            for at, low, high, colour in bands
        ],
        "spans": spans,
        "marks": marks,
    }


def _on_data(axis: Axes, artist: Any) -> tuple[bool, bool]:
    """Say of both axes whether an artist is drawn in their data, and not across the panel."""
    return tuple(artist.get_transform().contains_branch_seperately(axis.transData))


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Put lines of one look one after the other, with a gap between them."""
    if len(parts) == 1:
        return parts[0]
    *before, last = parts
    x = [np.append(one, one[-1] + 1e-6 * max(1.0, abs(one[-1]))) for one, _ in before] + [last[0]]
    y = [np.append(one, np.nan) for _, one in before] + [last[1]]
    order = np.argsort(np.concatenate(x), kind="stable")
    return np.concatenate(x)[order], np.concatenate(y)[order]


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keep the least and the largest value of each stretch of a curve that has more points than can be seen."""
    if len(x) <= _POINTS:
        return x, y
    edges = np.linspace(0, len(x), _POINTS // 2 + 1).astype(int)
    low = np.where(np.isfinite(y), y, np.inf)
    high = np.where(np.isfinite(y), y, -np.inf)
    keep = {
        place
        for first, last in zip(edges[:-1], edges[1:], strict=True)
        for place in (first + int(low[first:last].argmin()), first + int(high[first:last].argmax()))
    }
    chosen = np.array(sorted(keep))
    return x[chosen], y[chosen]


def _series(look: tuple, names: Mapping[tuple, str], x: np.ndarray, own: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    colour, style, width, marker = look
    return {
        **_coded(x, own, y),
        "label": names.get(look, ""),
        "colour": colour,
        "width": width,
        "dash": {"--": [6, 4], ":": [2, 3], "-.": [6, 3, 2, 3]}.get(style, []),
        "dots": style in ("None", "none", "") and marker not in ("None", None, ""),
    }


def _coded(x: np.ndarray, own: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    """Code a curve at `own` places for the common `x` in two bytes a sample."""
    seen = y[np.isfinite(y)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 0.0)
    step = (high - low) / (2 * _CODES) or 1.0
    codes = np.full(len(x), _NOT_SAMPLED, dtype="<i2")
    places = np.searchsorted(x, own)
    codes[places] = np.where(np.isfinite(y), np.round((np.nan_to_num(y) - low) / step) - _CODES, _NO_VALUE)
    return {"low": low, "step": step, "y": base64.b64encode(codes.tobytes()).decode()}


def _shaded(axis: Axes) -> tuple[list[tuple[np.ndarray, np.ndarray, np.ndarray, str]], list[dict[str, Any]]]:
    """Take bands about curves (x, low, high, colour), and spans from one x to another."""
    bands = []
    spans = []
    for one in axis.collections:
        if not isinstance(one, PolyCollection):
            continue
        on_data = _on_data(axis, one)
        colour = _rgba(one.get_facecolor()[0])
        found = [_edges(np.asarray(path.vertices)) for path in one.get_paths()]
        if all(on_data):
            found = [edges for edges in found if len(edges[0]) >= _FEWEST]
            if found:
                (x, low), (_, high) = (_joined([(edges[0], edges[k]) for edges in found]) for k in (1, 2))
                bands.append((x, low, high, colour))
        elif on_data[0]:
            spans += [{"from": float(x[0]), "to": float(x[-1]), "colour": colour, "foot": True} for x, _, _ in found]
    for patch in axis.patches:
        if isinstance(patch, Rectangle) and _on_data(axis, patch)[0] and not _on_data(axis, patch)[1]:
            first = float(patch.get_x())
            span = {"from": first, "to": first + float(patch.get_width()), "colour": _rgba(patch.get_facecolor())}
            spans.append(span | {"foot": False})
    return bands, spans


def _edges(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Take places, lower and upper edge of a polygon between two curves."""
    x, places = np.unique(corners[:, 0], return_inverse=True)
    low = np.full(len(x), np.inf)
    high = np.full(len(x), -np.inf)
    np.minimum.at(low, places, corners[:, 1])
    np.maximum.at(high, places, corners[:, 1])
    return x, low, high


def _rgba(colour: Any) -> str:
    red, green, blue, alpha = to_rgba(colour)
    return f"rgba({round(255 * red)},{round(255 * green)},{round(255 * blue)},{alpha:.3g})"
