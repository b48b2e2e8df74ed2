"""The picture of faults of the data: every channel that is suspected, as recorded and as it should be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from casid.diagnosis.data.finding import Finding
from casid.records.record import Record
from casid.report.style import ALERT, EXPLAINED, MEASURED, WIDE, Picture, blank, channel_scale, settings
from casid.signals import label_of

_MOST = 8  # channels drawn
_HEIGHT = 1.25  # inches per channel
_APART = 1.0  # s between records on the time axis


def check_figure(findings: Sequence[Finding], recorded: Sequence[Record], judged: Sequence[Record]) -> Picture | None:
    """Suspected channels over all records, one after the other; None when nothing is suspected.

    `recorded` are the records as they were given, `judged` the same as they should be. Grey: as recorded; green: as
    corrected; what a finding says of a part of a record is shaded.
    """
    there = {name for record in recorded for name in record.channels}
    suspected = [name for name in _suspected(findings) if name in there][:_MOST]
    if not suspected:
        return None
    with settings():
        figure = blank(_HEIGHT * len(suspected) + 1.0, WIDE)
        axes = figure.subplots(len(suspected), 1, sharex=True, squeeze=False)[:, 0]
        for axis, name in zip(axes, suspected, strict=True):
            concerned = [one for one in findings if name in one.target.split("+")]
            _draw(axis, name, list(zip(recorded, judged, strict=True)), concerned)
        axes[-1].set_xlabel("time, records one after the other [s]")
        shown = {label: line for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
        figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=4)
    said = " ".join(one.sentence for one in findings)
    return Picture(
        name="check",
        figure=figure,
        title="Data that are not as they should be",
        caption="Grey: as recorded. Green: as corrected. Shaded: the time that a fault says. Dots: samples left out.",
        alt=said,
        wide=True,
    )


def _suspected(findings: Sequence[Finding]) -> list[str]:
    names = [name for one in findings for name in one.target.split("+") if name != "t"]
    return list(dict.fromkeys(names))


def _draw(axis: Axes, name: str, pairs: Sequence[tuple[Record, Record]], findings: Sequence[Finding]) -> None:
    factor, unit = channel_scale(name)
    begin, said = 0.0, set[str]()

    def once(word: str) -> str:
        """A word for the legend, the first time that it is wanted."""
        new = "" if word in said else word
        said.add(word)
        return new

    for before, after in pairs:
        shift = begin - before.t[0]
        end = before.t[-1] + shift
        axis.annotate(before.name, (begin, 1.02), xycoords=("data", "axes fraction"), fontsize=9, annotation_clip=False)
        for low, high in (part for one in findings for part in one.intervals_s.get(before.name, ())):
            axis.axvspan(low + shift, high + shift, color=ALERT, alpha=0.3, lw=0.8, label=once("a fault"))
        if name in before:
            t, old = before.t + shift, factor * before[name]
            axis.plot(t, old, color=MEASURED, alpha=0.45, linewidth=1.0, label=once("recorded"))
            if name in after and len(after) == len(before):
                new = factor * after[name]
                out, changed = np.isfinite(old) & ~np.isfinite(new), np.isfinite(new) & (old != new)
                if changed.any():
                    axis.plot(t, np.where(changed, new, np.nan), color=EXPLAINED, label=once("corrected"))
                if out.any():
                    axis.plot(t[out], old[out], ".", color=ALERT, markersize=3.0, label=once("left out"))
        begin = end + _APART
    axis.set_title(label_of(name), loc="right")
    axis.set_ylabel(f"{name} [{unit}]")
    axis.margins(x=0.005)
