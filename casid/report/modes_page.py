"""The page of `casid modes`: handbook numbers side by side, pictures, and Theil's coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from casid.acceptance.handbook import Handbook, Number, rows
from casid.acceptance.theil import Theil
from casid.report.modes_figures import eigenvalues, trim_curves
from casid.report.table import ReportTable, Row
from casid.report.templating import drawn_into, figures_of, render
from casid.report.words import digits, quantity, with_std

FIGURES = "modes_figures"

TheilTable = Mapping[str, Mapping[str, Mapping[str, Theil]]]  # record -> label -> channel -> Theil


def write_modes(found: Mapping[str, Handbook], theil: TheilTable, folder: str | Path) -> None:
    """Write `modes.html` and `modes_figures/*.svg` into `folder`, which is made."""
    drawn = drawn_into(Path(folder) / FIGURES, {p.name: p for p in (eigenvalues(found), trim_curves(found))})
    first = next(iter(found.values()))
    notes = dict.fromkeys(f"{label}: {note}" for label, one in found.items() for note in one.notes)
    context = {
        "colour": "#005A8F",
        "aircraft": first.aircraft,
        "point": f"V = {digits(first.flight['V'])} m/s, density {digits(first.flight['rho'])} kg/m³",
        "numbers": _numbers(found),
        "theil": [_theil(record, table) for record, table in theil.items()],
        "figures": list(figures_of(drawn, {}).values()),
        "notes": list(notes),
    }
    (Path(folder) / "modes.html").write_text(render("modes.html", context), encoding="utf-8")


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
