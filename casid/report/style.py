"""Set the look of every figure: size, type, colours for colour-blind readers, and units that people read."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from casid.report.margins import Margins
from casid.signals import unit_of

# Okabe and Ito, Color Universal Design (2008)
MEASURED = "#222222"
BASELINE = "#D55E00"
EXTENDED = "#0072B2"
EXPLAINED = "#009E73"
NOISE = "#DDDDDD"
FAINT = "#9A9A9A"
ALERT = "#CC79A7"
RECORD_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
RECORD_MARKERS = ("o", "s", "^", "D", "v", "P")
CURVES = ((BASELINE, "--"), (EXTENDED, "-"), (EXPLAINED, "-."), ("#CC79A7", ":"))  # of models, the first as given
# inches; a page shows them up to 40 and 46 rem wide
WIDTH = 5.6
WIDE = 8.2
_AROUND = 0.7  # inches above and below stacked panels
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_RC: Mapping[str, Any] = MappingProxyType(
    {
        "font.size": 10.5,
        "axes.titlesize": 10.5,
        "axes.labelsize": 10.5,
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
        "lines.linewidth": 1.5,
        "svg.hashsalt": "casid",
        "path.simplify": True,
        "path.simplify_threshold": 0.3,
        "figure.facecolor": "white",
        "figure.constrained_layout.h_pad": 0.06,
    }
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """A figure with its words: `name` of the file without ending, heading, caption below, text instead of it. A `wide`
    one is scrolled sideways where there is no room for it. The curves of one of `histories` can be zoomed in a page."""

    name: str
    figure: Figure
    title: str
    caption: str
    alt: str
    wide: bool = False
    histories: bool = False

    def svg(self) -> bytes:
        """The figure as SVG, the same bytes for the same figure. The canvas itself draws once; `Figure.savefig` draws
        twice."""
        buffer = io.BytesIO()
        with settings():
            shown = self.figure.canvas
            try:
                FigureCanvasSVG(self.figure).print_svg(buffer, metadata={"Date": None})
            finally:
                self.figure.set_canvas(shown)
        return buffer.getvalue()


def settings() -> AbstractContextManager[None]:
    """The context in which figures are made and written."""
    return mpl.rc_context(rc={key: value for key, value in _RC.items()})  # pyright: ignore[reportArgumentType]


def blank(height: float, width: float = WIDTH) -> Figure:
    """An empty figure, in inches; call it under `settings`."""
    return Figure(figsize=(width, height), layout=Margins())


def window(height: float, width: float = WIDTH) -> Figure:
    """Make a figure as `blank` does, in pyplot's care: a notebook shows it, and `plt.show()` opens it."""
    from matplotlib import pyplot  # here, as it looks for a display

    return pyplot.figure(figsize=(width, height), layout="constrained")


def stacked(
    heights: Sequence[float], width: float = WIDTH, *, sharex: bool = True, sharey: bool = False
) -> tuple[Figure, Sequence[Axes]]:
    """A figure with panels of these heights [inches] above one another."""
    figure = blank(sum(heights) + _AROUND, width)
    axes = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights, sharex=sharex, sharey=sharey)
    return figure, list(axes[:, 0])


def legend(
    figure: Figure, axes: Iterable[Axes], columns: int, extra: Mapping[str, Artist] | None = None, **look: Any
) -> None:
    """A legend above all panels, of every label once; `extra` are further ones."""
    lines = {word: line for ax in axes for line, word in zip(*ax.get_legend_handles_labels(), strict=True)}
    lines |= extra or {}
    figure.legend(lines.values(), lines.keys(), loc="outside upper center", ncols=min(columns, len(lines)), **look)


def draw_channel(ax: Axes, channel: str, t: np.ndarray, measured: np.ndarray, curves: Mapping[str, np.ndarray]) -> None:
    """A channel in the unit that people read: measured pale below, and over it what models give, by label."""
    factor = channel_scale(channel)[0]
    ax.plot(t, factor * measured, color=MEASURED, lw=3.6, alpha=0.3, label="measured")
    looks = CURVES if len(curves) > 1 else CURVES[1:]
    for (label, values), (colour, dash) in zip(curves.items(), looks, strict=False):
        ax.plot(t, factor * values, dash, color=colour, lw=1.2, label=label)
    ax.set_ylabel(channel_axis(channel))
    ax.margins(x=0.01)


def shown_unit(unit: str) -> tuple[float, str]:
    """(factor, unit) that a person reads: degrees for angles and what is made of them, SI for all else."""
    if unit.startswith("rad"):
        return math.degrees(1.0), "deg" + unit[3:].replace("s2", "s²")
    return 1.0, unit.replace("s2", "s²").replace("m2", "m²").replace("m3", "m³").replace("rad2", "rad²").replace(
        "rad3", "rad³"
    )


def channel_scale(channel: str) -> tuple[float, str]:
    """(factor, unit) for showing a channel."""
    return shown_unit(unit_of(channel))


def channel_axis(channel: str) -> str:
    """Axis label of a channel with its unit, e.g. "q [deg/s]"."""
    unit = channel_scale(channel)[1]
    return f"{channel} [{unit}]" if unit else channel


def powers_of_ten(axis: Axis) -> None:
    """Number a logarithmic axis 10⁰, 10¹, without the mathtext of matplotlib, which takes longer, and minor ticks."""
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"10{str(round(math.log10(x))).translate(_RAISED)}"))
    axis.set_minor_locator(NullLocator())


def smooth(values: np.ndarray, dt: float, width_s: float = 0.1) -> np.ndarray:
    """Gaussian mean of 1-sigma width `width_s`, over what is not NaN."""
    half = int(np.ceil(3.0 * width_s / dt))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * dt / width_s) ** 2)
    seen = np.isfinite(values)
    weight = np.convolve(seen, kernel)[half : half + len(values)]
    total = np.convolve(np.where(seen, values, 0.0), kernel)[half : half + len(values)]
    return np.where(weight > 1e-6, total / np.maximum(weight, 1e-6), np.nan)
