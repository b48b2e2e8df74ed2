"""The painter for a reader who zooms: a figure as JSON, which `templates/interactive.js` draws with uPlot.

The library is taken from the package `uplot-python` (extra `interactive`) when a page is written. Without it a page
keeps its static figures, which are also what is printed.
"""

from __future__ import annotations

import base64
import json
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from casid.report.figure import Band, Curve, Figure, Marked, Note, Panel, Rule, Span, thinned
from casid.report.looks import Look

_CODES = 32000  # levels of a curve, more than the pixels of any screen
_NO_VALUE = -32768
_NOT_SAMPLED = -32767
_POINTS = 4000  # of a curve
_PIXELS_PER_INCH = 88.0
_LEAST_PIXELS = 84.0
_DASHES = {"--": [6, 4], ":": [2, 3], "-.": [6, 3, 2, 3]}


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


def drawing() -> dict[str, str] | None:
    """Return what a page with such figures has once: script, style and licence; None without the library."""
    found = library()
    if found is None:
        return None
    own = files("casid.report").joinpath("templates/interactive.js").read_text(encoding="utf-8")
    script, style = (one.replace("</", "<\\/") for one in (f"{found[0]}\n{own}", found[1]))
    return {"script": script, "style": style, "licence": licence()}


def curves(figure: Figure) -> str | None:
    """Write a figure as JSON that may stand in a page; None where it cannot be zoomed or the library is missing."""
    if library() is None or not figure.can_be_zoomed:
        return None
    told = json.dumps(painted(figure), separators=(",", ":"), allow_nan=False)
    return told.replace("<", "\\u003c").replace("&", "\\u0026")


def painted(figure: Figure) -> dict[str, Any]:
    """Return the panels of a figure and its legend for the script."""
    columns = max(len(row) for row in figure.rows)
    return {
        "columns": columns,
        "linked": figure.linked,
        "legend": [{"name": name, **_sign(part)} for name, part in figure.legend.items()],
        "panels": [_panel(figure, one) for one in figure.panels],
    }


def _sign(part: Marked) -> dict[str, Any]:
    """Return how the legend shows a part."""
    return _line(part.look) | {"filled": not isinstance(part, Curve | Rule)}


def _panel(figure: Figure, panel: Panel) -> dict[str, Any]:
    lines = [one for one in panel.of(Curve) if len(one.x)]
    thin = [thinned(one.x, one.y, _POINTS) for one in lines]
    bands = panel.of(Band)
    x = np.unique(np.concatenate([*(one for one, _ in thin), *(band.x for band in bands)]))
    return {
        "label": panel.heading,
        "axis": panel.x.label,
        "height": round(max(_LEAST_PIXELS, panel.height * _PIXELS_PER_INCH)),
        "log": [panel.x.log, panel.y.log],
        "domain": list(figure.x_range(panel)),
        "range": list(figure.y_range(panel)),
        "x": base64.b64encode(x.astype("<f4").tobytes()).decode(),
        "series": [
            {**_coded(x, *values), **_line(one.look), "label": one.look.name}
            for one, values in zip(lines, thin, strict=True)
        ],
        "bands": [
            {"low": _coded(x, one.x, one.low), "high": _coded(x, one.x, one.high), "colour": _rgba(one.look)}
            for one in bands
        ],
        "spans": [
            {"from": one.low, "to": one.high, "axis": one.axis, "part": list(one.part), "colour": _rgba(one.look)}
            for one in panel.of(Span)
        ],
        "marks": [{"at": one.at, "axis": one.axis, **_line(one.look)} for one in panel.of(Rule)],
        "notes": [
            {"text": one.text, "x": one.x, "y": one.y, "align": one.align, "bold": one.bold} for one in panel.of(Note)
        ],
    }


def _line(look: Look) -> dict[str, Any]:
    return {
        "colour": _rgba(look),
        "width": look.width,
        "dash": _DASHES.get(look.dash, []),
        "dots": not look.dash,
        "size": max(look.size, 2.0),
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


def _rgba(look: Look) -> str:
    red, green, blue = (int(look.colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{look.alpha:.3g})"
