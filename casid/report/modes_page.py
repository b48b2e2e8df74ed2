"""Natural modes and handling qualities: their figures and their page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from casid.acceptance.handbook import Handbook, Number, rows
from casid.acceptance.theil import Theil
from casid.report.style import (
    RECORD_COLOURS,
    RECORD_MARKERS,
    WIDE,
    Picture,
    blank,
    channel_axis,
    channel_scale,
    legend,
    settings,
    window,
)
from casid.report.templating import ReportTable, Row, write_page
from casid.report.words import digits, quantity, with_std

_FAST = ("short period", "dutch roll", "roll")
_SLOW = ("phugoid", "spiral")
_CURVES = ("delta_e", "alpha", "thrust")


def plot(handbook: Handbook) -> Figure:
    """Eigenvalues and trim curves of an aircraft, in one figure."""
    found = {handbook.aircraft: handbook}
    with settings():
        figure = window(6.4)
        above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
        _draw_eigenvalues(above, found)
        _draw_curves(below, found)
    return figure


def eigenvalues(found: Mapping[str, Handbook]) -> Picture:
    """The modes in the complex plane, fast and slow ones apart."""
    with settings():
        drawn = blank(3.6, WIDE)
        _draw_eigenvalues(drawn, found)
    return Picture(
        name="eigenvalues",
        figure=drawn,
        title="Modes of motion",
        caption="Eigenvalues of the linearised aircraft, of each pair the upper one, with 2-sigma intervals. "
        "Left of the dashed line a motion decays.",
        alt=f"Eigenvalues of the modes of {', '.join(found)} in the complex plane.",
    )


def trim_curves(found: Mapping[str, Handbook]) -> Picture:
    """Elevator, angle of attack and thrust of level flight over airspeed."""
    with settings():
        drawn = blank(2.9, WIDE)
        _draw_curves(drawn, found)
    return Picture(
        name="trim_curves",
        figure=drawn,
        title="Trim of level flight",
        caption="What level flight takes at every airspeed, with 2-sigma bands; dotted: the flight point of the modes.",
        alt=f"Elevator, angle of attack and thrust over airspeed for {', '.join(found)}.",
    )


def _draw_eigenvalues(figure: Any, found: Mapping[str, Handbook]) -> None:
    axes = figure.subplots(1, 2)
    others = {name for one in found.values() for name in one.modes} - {*_FAST, *_SLOW}
    slow_others = {n for one in found.values() for n in others & one.modes.keys() if abs(one.modes[n].eigenvalue) < 0.3}
    groups = (("fast modes", {*_FAST, *(others - slow_others)}), ("slow modes", {*_SLOW, *slow_others}))
    for ax, (title, group) in zip(axes, groups, strict=True):
        for k, (label, one) in enumerate(found.items()):
            for name, mode in one.modes.items():
                if name not in group:
                    continue
                re = mode.eigenvalue.real
                im = mode.eigenvalue.imag
                spread = [2.0 * s if np.isfinite(s) else 0.0 for s in mode.eigenvalue_std]
                ax.errorbar(
                    [re],
                    [im],
                    xerr=[spread[0]],
                    yerr=[spread[1]] if im > 0.0 else None,
                    color=RECORD_COLOURS[k % len(RECORD_COLOURS)],
                    marker=RECORD_MARKERS[k % len(RECORD_MARKERS)],
                    markersize=5,
                    capsize=2.5,
                    linestyle="none",
                    label=label,
                )
                if k == 0:
                    ax.annotate(name, (re, im), xytext=(5, 6), textcoords="offset points", fontsize=9)
        ax.axvline(0.0, color="#222222", linewidth=0.9, linestyle="--")
        ax.set_title(title)
        ax.set_xlabel("decay σ [1/s]")
        ax.margins(0.18, 0.18)
    axes[0].set_ylabel("ω [rad/s]")
    if len(found) > 1:
        legend(figure, axes, len(found))


def _draw_curves(figure: Any, found: Mapping[str, Handbook]) -> None:
    axes = figure.subplots(1, len(_CURVES))
    for ax, name in zip(axes, _CURVES, strict=True):
        factor = channel_scale(name)[0]
        for k, (label, one) in enumerate(found.items()):
            curves = one.trim_curves
            colour = RECORD_COLOURS[k % len(RECORD_COLOURS)]
            value = factor * curves.values[name]
            spread = 2.0 * factor * np.nan_to_num(curves.std[name])
            ax.fill_between(curves.V, value - spread, value + spread, color=colour, alpha=0.18, lw=0)
            ax.plot(curves.V, value, color=colour, label=label)
            ax.axvline(one.flight["V"], color=colour, linewidth=0.9, linestyle=":")
        ax.set_title(channel_axis(name))
        ax.set_xlabel("V [m/s]")
    if len(found) > 1:
        legend(figure, axes, len(found))


TheilTable = Mapping[str, Mapping[str, Mapping[str, Theil]]]  # record -> label -> channel -> Theil


def write_modes(found: Mapping[str, Handbook], theil: TheilTable, folder: str | Path) -> None:
    """Write `modes.html` and `modes_figures/*.svg` into `folder`, which is made."""
    first = next(iter(found.values()))
    notes = dict.fromkeys(f"{label}: {note}" for label, one in found.items() for note in one.notes)
    context = {
        "colour": "#005A8F",
        "aircraft": first.aircraft,
        "point": f"V = {digits(first.flight['V'])} m/s, density {digits(first.flight['rho'])} kg/m³",
        "numbers": _numbers(found),
        "theil": [_theil(record, table) for record, table in theil.items()],
        "notes": list(notes),
    }
    write_page(folder, "modes", [eigenvalues(found), trim_curves(found)], context)


def text_table(found: Mapping[str, Handbook]) -> str:
    """The numbers of all aircraft as text, one line each."""
    table = _numbers(found)
    widths = [max(len(row[k]) for row in (table.head, *(r.cells for r in table.rows))) for k in range(len(table.head))]
    lines = [_line(table.head, widths), *(_line(row.cells, widths) for row in table.rows)]
    notes = dict.fromkeys(f"! {label}: {note}" for label, one in found.items() for note in one.notes)
    return "\n".join([*lines, *notes]) + "\n"


def theil_text(theil: TheilTable) -> str:
    """Theil's coefficients and their parts as text."""
    lines: list[str] = []
    for record, by_label in theil.items():
        lines += [f"{record}: Theil's coefficient (bias / variance / covariance of the squared error)"]
        for label, channels in by_label.items():
            lines += [f"  {label}  {name:6} {t.coefficient:.3f}  ({_shares(t)})" for name, t in channels.items()]
    return "\n".join(lines)


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    first, *others = (f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
    return "  ".join([first.strip().ljust(widths[0]), *others])


def _shares(one: Theil) -> str:
    return " / ".join(f"{100.0 * share:.0f}" for share in (one.bias, one.variance, one.covariance)) + " %"


def _numbers(found: Mapping[str, Handbook]) -> ReportTable:
    labels = dict.fromkeys(label for one in found.values() for label, _ in rows(one))
    by_aircraft = [dict(rows(one)) for one in found.values()]
    cells = [(label, *(_cell(numbers.get(label)) for numbers in by_aircraft)) for label in labels]
    return ReportTable(
        head=("number", *found),
        rows=tuple(Row(cells=row) for row in cells),
        caption="± is one standard deviation, from what is known of the parameters; none where nothing is known. "
        "Margins are parts of the length of pitching moments.",
        numeric=True,
    )


def _cell(one: Number | None) -> str:
    if one is None:
        return "–"
    turning = one.unit == "rad/s"  # a circular frequency, which nobody reads in degrees
    unit = "" if turning else one.unit
    told = (
        with_std(one.value, one.std, unit) if np.isfinite(one.std) and one.std > 0.0 else quantity(one.value, unit, 4)
    )
    return f"{told.strip()} rad/s" if turning else told


def _theil(record: str, by_label: Mapping[str, Mapping[str, Theil]]) -> ReportTable:
    channels = dict.fromkeys(name for table in by_label.values() for name in table)
    cells = []
    for name in channels:
        row = [name]
        for table in by_label.values():
            one = table.get(name)
            row += [f"{one.coefficient:.3f}", _shares(one)] if one else ["–", "–"]
        cells.append(Row(cells=tuple(row)))
    head = [cell for label in by_label for cell in (f"{label}: U", "bias / variance / covariance")]
    return ReportTable(
        head=("channel", *head),
        rows=tuple(cells),
        caption=f"{record}, flown open loop: Theil's inequality coefficient U and the parts of its squared error.",
        numeric=True,
    )
