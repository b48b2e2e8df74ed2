"""The page of a check: what is wrong with the data, suspected channels as a picture, and every channel in numbers."""

from __future__ import annotations

from pathlib import Path

from casid.diagnosis.data.check import DataFindings
from casid.report import tables
from casid.report.check_figures import check_figure
from casid.report.claims import about_data
from casid.report.table import ReportTable, Row
from casid.report.templating import drawn_into, figures_of, render
from casid.report.words import digits, pretty, to_noise

FIGURES = "check_figures"
_COLOURS = {True: "#00694E", False: "#A3122A"}


def write_check(found: DataFindings, folder: str | Path) -> None:
    """Write `check.html` and `check_figures/*.svg` into `folder`, which is made."""
    picture = check_figure(found.findings, found.recorded, found.records)
    drawn = drawn_into(Path(folder) / FIGURES, {picture.name: picture} if picture else {})
    context = {
        "colour": _COLOURS[found.clean],
        "records": ", ".join(record.name for record in found.recorded),
        "sentences": list(found.sentences),
        "figures": list(figures_of(drawn, {}).values()),
        "findings": tables.findings(found.findings),
        "channels": _channels(found),
        "remarks": [f"{record.name}: {note}" for record in found.recorded for note in record.notes],
    }
    (Path(folder) / "check.html").write_text(render("check.html", context), encoding="utf-8")


def _channels(found: DataFindings) -> ReportTable:
    suspected = {name: number for number, one in enumerate(found.findings, 1) for name in one.target.split("+")}
    rows = tuple(
        Row(
            cells=(
                f"{row.name} [{pretty(row.unit)}]",
                *(to_noise(value, row.noise) for value in (row.least, row.median, row.most)),
                digits(row.noise, 2),
                digits(row.rate_hz),
                f"{100.0 * row.missing:.2g} %",
                str(row.records),
            ),
            claim=about_data(suspected[row.name]) if row.name in suspected else "",
            marked=row.name in suspected,
        )
        for row in found.table
    )
    return ReportTable(
        head=("channel", "least", "median", "most", "noise 1σ", "rate [Hz]", "missing", "records"),
        rows=rows,
        caption="Every channel of all records; suspected ones are marked. Noise: what the high band shows as white.",
        numeric=True,
    )
