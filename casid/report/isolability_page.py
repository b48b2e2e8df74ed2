"""The page of `casid isolate`: the matrix of confusion, what would add most, and every cause in numbers."""

from __future__ import annotations

from pathlib import Path

from casid.acceptance.isolability import Isolability
from casid.report.isolability_figures import addition, matrix, rivals, smallest
from casid.report.table import ReportTable, Row
from casid.report.templating import drawn_into, figures_of, render
from casid.report.words import probability_in_words, quantity

FIGURES = "isolability_figures"


def write_isolability(found: Isolability, folder: str | Path) -> None:
    """Write `isolability.html` and `isolability_figures/*.svg` into `folder`, which is made."""
    picture = matrix(found)
    drawn = drawn_into(Path(folder) / FIGURES, {picture.name: picture})
    seen = sum(one.detection > 0.5 for one in found.causes.values())
    context = {
        "colour": "#005A8F",
        "aircraft": found.aircraft,
        "manoeuvres": ", ".join(found.manoeuvres),
        "sentence": f"{seen} of {len(found.causes)} causes are detected at the size that matters in more than half of "
        f"the flights. One is rightly named with a probability of {100.0 * found.told:.0f} % on average.",
        "channels": ", ".join(found.channels),
        "additions": [addition(one, found.told) for one in found.additions[:5]],
        "sets": [", ".join(one) for one in found.sets if len(one) > 1],
        "figures": list(figures_of(drawn, {}).values()),
        "causes": _table(found),
        "left_out": ", ".join(found.left_out),
    }
    (Path(folder) / "isolability.html").write_text(render("isolability.html", context), encoding="utf-8")


def _table(found: Isolability) -> ReportTable:
    rows = tuple(
        Row(
            cells=(
                one.name,
                *(
                    cell.replace(" ", "\N{NO-BREAK SPACE}")
                    for cell in (
                        quantity(one.matters, one.unit),
                        smallest(one),
                        probability_in_words(one.detection),
                        probability_in_words(one.told),
                    )
                ),
                rivals(one),
            )
        )
        for one in sorted(found.causes.values(), key=lambda one: -one.told)
    )
    return ReportTable(
        head=("cause", "matters from", "smallest", "detected", "right", "taken for"),
        rows=rows,
        caption="Matters from: the smallest size that an engineer would want to know of. Smallest: what is detected in "
        "90 % of flights. Detected, right: at the size that matters. Taken for: how often a rival explains the data "
        "better.",
    )
