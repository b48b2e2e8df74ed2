"""The budget of the error: what each step from the file as given to the best model is worth, channel by channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullFormatter

from casid.diagnosis.given.budget import Budget, BudgetSteps
from casid.report.style import ALERT, BASELINE, EXTENDED, FAINT, MEASURED, Picture, blank, settings, window

# what is taken away between one step and the next, in the order of the waterfall
_DROPS: Mapping[str, tuple[str, str, str]] = {
    "data": ("as_given", "data_mended", "#E69F00"),
    "values of the file": ("data_mended", "values", BASELINE),
    "structure (causes)": ("values", "structure", EXTENDED),
    "unexplained": ("structure", "noise", FAINT),
}
# height of a bar in rows, and of a row in inches
_BAR = 0.21
_ROW = 0.42
_LEAST = 0.02  # relative change that is drawn
_MOST = 1e4  # times the noise: a simulation that diverges ends there


def plot(found: Budget) -> Figure:
    """The picture of the budget, in pyplot's care."""
    with settings():
        return budget(found, window).figure


def budget(found: Budget, empty: Callable[[float], Figure] = blank) -> Picture:
    """A waterfall per channel on a common logarithmic axis, worst as given first; all channels together on top; `empty`
    makes the figure of a height."""
    order = sorted(found.channels, key=lambda o: -_size(found.channels[o].as_given))
    rows = {"all channels": found.together} | {_row_name(found, o): found.channels[o] for o in order}
    figure = empty(_ROW * len(rows) + 1.5)
    ax = figure.subplots()
    for y, steps in enumerate(rows.values()):
        _waterfall(ax, y, steps)
    ax.axvline(1.0, color=MEASURED, lw=1.0, ls=":")
    ax.axhline(0.5, color=FAINT, lw=0.8)
    ax.set_xscale("log")
    most = max(_size(steps.as_given) for steps in rows.values())
    least = min(_size(s.structure) for s in rows.values())
    ax.set_xlim(min(0.6, 0.9 * max(least, 1e-3)), 2.2 * max(most, *(_size(s.structure) for s in rows.values()), 2.0))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_yticks(range(len(rows)), list(rows))
    ax.set_ylim(len(rows) - 0.45, -0.55)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("r.m.s. error / noise (log scale)")
    handles = [Patch(color=colour) for _, _, colour in _DROPS.values()]
    handles += [Patch(facecolor="white", edgecolor=ALERT, hatch="////"), Line2D([], [], color=MEASURED, ls=":")]
    figure.legend(handles, [*_DROPS, "a step that makes it worse", "noise alone"], loc="outside upper center", ncols=2)
    names = ", ".join(found.records)
    together = found.together
    return Picture(
        name="budget",
        figure=figure,
        title=f"From the simulation as given to the noise, on {names} (held out)",
        caption=(
            "Each bar is the part of the error that one step removes: correcting the data, re-estimating the values of "
            "the file, adding the named causes. Grey is unexplained. The number is the error as given."
        ),
        alt=(
            f"Waterfall of the error per channel over the noise. All channels: {together.as_given:.3g} as given, "
            f"{together.data_mended:.3g} with the data corrected, {together.values:.3g} with values re-estimated, "
            f"{together.structure:.3g} with causes; worst as given: {order[0]}."
        ),
    )


def _row_name(found: Budget, channel: str) -> str:
    label = found.labels.get(channel, channel)
    return channel if label == channel else f"{label} {channel}"


def _waterfall(ax: Axes, y: int, steps: BudgetSteps) -> None:
    """The four bars of a row, one below the other, and the error as given in figures."""
    for i, (before, after, colour) in enumerate(_DROPS.values()):
        high = _size(getattr(steps, before))
        low = _size(getattr(steps, after))
        at = y + _BAR * (i - 1.5)
        if abs(high / low - 1.0) < _LEAST:
            continue
        worse = low > high
        if colour == FAINT and worse:
            continue  # a residual below the noise that was assumed: nothing is left
        bar = ax.barh(at, abs(high - low), 0.9 * _BAR, left=min(high, low), color="white" if worse else colour)
        if worse:
            bar.patches[0].set(edgecolor=ALERT, hatch="////")
    shown = f"{steps.as_given:.3g}" if np.isfinite(steps.as_given) and steps.as_given < _MOST else "diverges"
    right = max(_size(s) for s in (steps.as_given, steps.values, steps.structure, 1.0))
    ax.annotate(shown, (right, y), xytext=(5, 0), textcoords="offset points", va="center", fontsize=9)


def _size(value: float) -> float:
    """Return a size as it is drawn."""
    return float(min(value, _MOST)) if np.isfinite(value) else _MOST
