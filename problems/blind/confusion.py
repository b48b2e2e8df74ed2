"""The figure of a campaign: what was hidden against what was named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from casid.report.style import ALERT, EXTENDED, Picture

_RIGHT = LinearSegmentedColormap.from_list("right", ("#FFFFFF", EXTENDED))
_WRONG = LinearSegmentedColormap.from_list("wrong", ("#FFFFFF", ALERT))


def confusion_matrix(
    counts: Mapping[tuple[str, str], int],
    rows: Sequence[str],
    columns: Sequence[str],
    right: Mapping[str, Sequence[str]],
    title: str,
) -> Picture:
    """What was hidden (rows; those without any are left out) against what was named first (columns), from (row, column)
    -> number of sets. `right`: row -> columns that are correct answers, framed."""
    shown = [row for row in rows if any(counts.get((row, column)) for column in columns)]
    totals = {row: sum(counts.get((row, column), 0) for column in columns) for row in shown}
    figure = Figure(figsize=(9.6, 2.4 + 0.25 * len(shown)), layout="constrained")
    ax = figure.subplots()
    for i, row in enumerate(shown):
        for j, column in enumerate(columns):
            number, correct = counts.get((row, column), 0), column in right.get(row, ())
            share = number / totals[row]
            colour = (_RIGHT if correct else _WRONG)(0.15 + 0.85 * share if number else 0.0)
            ax.add_patch(Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, facecolor=colour, edgecolor="#DDDDDD", linewidth=0.5))
            if correct:
                ax.add_patch(
                    Rectangle((j - 0.46, i - 0.46), 0.92, 0.92, fill=False, edgecolor="#444444", linewidth=0.9)
                )
            if number:
                dark = correct and share > 0.55
                ax.text(j, i, str(number), ha="center", va="center", fontsize=8.5, color="white" if dark else "black")
    ax.set_xlim(-0.5, len(columns) - 0.5)
    ax.set_ylim(len(shown) - 0.5, -0.5)
    ax.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=90, fontsize=8.5)
    ax.set_yticks(range(len(shown)), [f"{r.replace('_', ' ')}  ({totals[r]})" for r in shown], fontsize=8.5)
    ax.xaxis.set_ticks_position("top")
    ax.tick_params(length=0)
    ax.set_xlabel("what the diagnosis named first, or said instead")
    ax.set_ylabel("what was hidden (sets)")
    ax.grid(visible=False)
    for spine in ax.spines.values():
        spine.set_visible(False)
    correct = sum(n for (row, column), n in counts.items() if column in right.get(row, ()))
    total = int(np.sum(list(totals.values()))) if totals else 0
    return Picture(
        name="confusion",
        figure=figure,
        title=title,
        caption="Framed and blue: right. Red: something else. What cannot be told from the hidden effect counts as it.",
        alt=f"Confusion matrix, hidden kind by named kind: {correct} of {total} sets in the framed cells.",
    )
