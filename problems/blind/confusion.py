"""The figure of a campaign: what was hidden against what was named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from casid.report.figure import WIDE, Axis, Cells, Figure, Panel, Picture, Scale


def confusion_matrix(
    counts: Mapping[tuple[str, str], int],
    rows: Sequence[str],
    columns: Sequence[str],
    right: Mapping[str, Sequence[str]],
    title: str,
) -> Picture:
    """What was hidden (rows; those without any are left out) against what was named first (columns), from (row, column)
    -> number of sets. `right`: row -> columns that are correct answers."""
    shown = [row for row in rows if any(counts.get((row, column)) for column in columns)]
    totals = {row: sum(counts.get((row, column), 0) for column in columns) for row in shown}
    table = np.zeros((len(shown), len(columns)))
    texts = {}
    for (i, row), (j, column) in product(enumerate(shown), enumerate(columns)):
        number = counts.get((row, column), 0)
        correct = column in right.get(row, ())
        table[i, j] = (1.0 if correct else -1.0) * number / totals[row]
        if number or correct:
            texts[i, j] = str(number) if number else "–"
    names = tuple(f"{row.replace('_', ' ')}  ({totals[row]})" for row in shown)
    panel = Panel(
        parts=(Cells(values=table, scale=Scale(low=-1.0, high=1.0, colours="RdBu"), texts=texts),),
        x=Axis(
            label="what the diagnosis named first, or said instead", names=tuple(c.replace("_", " ") for c in columns)
        ),
        y=Axis(label="what was hidden (sets)", names=names),
        height=0.25 * len(shown) + 0.2,
    )
    correct = sum(n for (row, column), n in counts.items() if column in right.get(row, ()))
    total = int(np.sum(list(totals.values()))) if totals else 0
    return Picture(
        name="confusion",
        figure=Figure(rows=((panel,),), width=WIDE),
        title=title,
        caption="Blue: right, a dash where that was never named. Red: something else. What cannot be told from the "
        "hidden effect counts as it.",
        alt=f"Confusion matrix, hidden kind by named kind: {correct} of {total} sets in the cells that are right.",
    )
