"""The page of a check of compatibility: errors of the instruments, measured and reconstructed histories."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from casid.diagnosis.kinematics.compatibility import Compatibility
from casid.report.estimate_figures import histories
from casid.report.style import Picture
from casid.report.table import ReportTable, Row
from casid.report.templating import drawn_into, figures_of, render
from casid.report.words import digits, pretty
from casid.signals import for_a_person

FIGURES = "compatibility_figures"
_COLOURS = {True: "#00694E", False: "#A3122A"}


def write_compatibility(found: Compatibility, folder: str | Path) -> None:
    """Write `compatibility.html` and `compatibility_figures/*.svg` into `folder`, which is made."""
    pictures = compatibility_figures(found)
    drawn = drawn_into(Path(folder) / FIGURES, {picture.name: picture for picture in pictures})
    context = {
        "colour": _COLOURS[found.passed],
        "found": found,
        "records": ", ".join(record.name for record in found.records),
        "figures": list(figures_of(drawn, {}).values()),
        "errors": _errors(found),
        "channels": _channels(found),
    }
    (Path(folder) / "compatibility.html").write_text(render("compatibility.html", context), encoding="utf-8")


def compatibility_figures(found: Compatibility) -> list[Picture]:
    """Measured and reconstructed histories of every record."""
    names = list(found.left)
    times = {record.name: record.t for record in found.records}
    return [
        histories(name, times[name], names, measured, {"reconstructed": found.reconstructed[name]})
        for name, measured in found.measured.items()
        if np.isfinite(measured).any()
    ]


def _errors(found: Compatibility) -> ReportTable:
    rows = []
    for one in found.errors:
        factor, unit = for_a_person(one.unit)
        cells = (
            f"{one.kind.removeprefix('sensor_').replace('_', ' ')}: {one.target}",
            digits(factor * one.value),
            digits(factor * one.std, 2),
            digits(factor * one.allowed, 2),
            pretty(unit),
            "pass" if one.passed else "FAIL",
        )
        rows.append(Row(cells=cells, marked=not one.passed))
    return ReportTable(
        head=("error", "value", "1σ", "allowed", "unit", "verdict"),
        rows=tuple(rows),
        caption="Errors of the instruments, measured minus true. An error fails that is clear and larger than allowed.",
        numeric=True,
    )


def _channels(found: Compatibility) -> ReportTable:
    rows = []
    for name, left in found.left.items():
        rows.append(Row(cells=(name, digits(left, 2))))
    return ReportTable(
        head=("channel", "left over noise"),
        rows=tuple(rows),
        caption="r.m.s. of measured minus reconstructed, over the noise of the channel. Near 1 the measurements agree; "
        "accelerations are followed more closely, because the forces are free.",
        numeric=True,
    )
