"""The flight envelope that the records cover: where the verdict holds, and where the held-out records leave it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.result import Diagnosis
from casid.records.record import Record
from casid.report.style import BASELINE, EXTENDED, Picture, blank, channel_axis, channel_scale, settings
from casid.report.table import ReportTable, Row
from casid.report.words import digits
from casid.signals import label_of

_QUANTITIES = (
    "V",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "az",
    "delta_e",
    "delta_a",
    "delta_r",
    "thrust",
    "altitude",
)
_PAIRS = (("V", "alpha"), ("beta", "alpha"), ("p", "r"), ("q", "az"), ("delta_a", "delta_r"), ("alpha", "delta_e"))
_POINTS = 400  # of a record in one panel
_OUTSIDE = 0.02  # part of the held-out samples beyond the fitted range that is told


def _records(diagnosis: Diagnosis) -> tuple[Sequence[Record], Sequence[Record]]:
    """As they were judged: fitted, and held out."""
    return diagnosis.refitted.fit.flight.records, diagnosis.held_out_refitted.fit.flight.records


def _all(records: Sequence[Record], name: str) -> np.ndarray:
    """What was measured of a channel, in the unit that a person reads."""
    some = [channel_scale(name)[0] * record[name] for record in records if name in record]
    values = np.concatenate(some) if some else np.zeros(0)
    return values[np.isfinite(values)]


def envelope_table(diagnosis: Diagnosis) -> ReportTable:
    """Ranges of what was flown, in fitted and in held-out records; what of the latter lies outside is marked."""
    fitted, held = _records(diagnosis)
    rows = []
    for name in _QUANTITIES:
        seen, unseen = _all(fitted, name), _all(held, name)
        if not len(seen):
            continue
        outside = float(np.mean((unseen < seen.min()) | (unseen > seen.max()))) if len(unseen) else 0.0
        cells = (
            f"{' '.join(dict.fromkeys((label_of(name), name)))} [{channel_scale(name)[1]}]",
            _range(seen),
            _range(unseen) if len(unseen) else "–",
            f"{100.0 * outside:.0f} % of its samples" if outside > _OUTSIDE else "–",
        )
        rows.append(Row(cells=cells, marked=outside > _OUTSIDE))
    return ReportTable(
        head=("quantity", "fitted records", "held-out records", "held out, beyond the fitted range"),
        rows=tuple(rows),
        caption="The verdict and the values hold for what was flown. Beyond these ranges they are an extrapolation.",
    )


def _range(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    places = 3 if max(abs(low), abs(high)) < 1000.0 else 4
    return f"{digits(low, places)} to {digits(high, places)}"


def envelope(diagnosis: Diagnosis) -> Picture | None:
    """Pairs of quantities as they were flown; None where no pair was measured."""
    fitted, held = _records(diagnosis)
    pairs = [pair for pair in _PAIRS if all(any(name in r for r in fitted) for name in pair)]
    if not pairs:
        return None
    with settings():
        rows = (len(pairs) + 2) // 3
        figure = blank(2.1 * rows + 0.6, 8.2)
        axes = figure.subplots(rows, 3, squeeze=False).ravel()
        for axis in axes[len(pairs) :]:
            axis.set_visible(False)
        for axis, (across, up) in zip(axes, pairs, strict=False):
            for records, colour, marker, word in (
                (fitted, EXTENDED, "o", "fitted"),
                (held, BASELINE, "x", "held out"),
            ):
                for record in (r for r in records if across in r and up in r):
                    thin = slice(None, None, max(1, len(record) // _POINTS))
                    x, y = (channel_scale(name)[0] * record[name][thin] for name in (across, up))
                    axis.plot(x, y, marker, color=colour, ms=2.2, mew=0.6, alpha=0.5, label=word, rasterized=True)
            axis.set_xlabel(channel_axis(across), fontsize=9.5)
            axis.set_ylabel(channel_axis(up), fontsize=9.5)
        shown = {word: line for line, word in zip(*axes[0].get_legend_handles_labels(), strict=True)}
        figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=2, markerscale=3)
    return Picture(
        name="envelope",
        figure=figure,
        title="What was flown",
        caption="Every dot is a sample. A model that holds inside the blue cloud is an extrapolation outside of it.",
        alt=f"Scatter of {', '.join(f'{up} over {across}' for across, up in pairs)} in fitted and held-out records.",
        wide=True,
    )
