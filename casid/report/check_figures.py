"""The picture of a check: every channel that is suspected, as it was recorded and as it should be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from casid.diagnosis.data.check import DataFindings
from casid.records.record import Record
from casid.report.style import ALERT, EXPLAINED, MEASURED, Picture, blank, channel_scale, settings
from casid.signals import label_of

_MOST = 8  # channels drawn
_HEIGHT = 1.25  # inches per channel
_APART = 1.0  # s between records on the time axis


def check_figure(findings: DataFindings) -> Picture | None:
    """Suspected channels over all records, one after the other; None when nothing is suspected.

    Grey: as recorded; green: as corrected; samples that are left out are marked.
    """
    there = {name for record in findings.recorded for name in record.channels}
    suspected = [name for name in _suspected(findings) if name in there][:_MOST]
    if not suspected:
        return None
    with settings():
        figure = blank(_HEIGHT * len(suspected) + 0.8)
        axes = figure.subplots(len(suspected), 1, sharex=True, squeeze=False)[:, 0]
        for axis, name in zip(axes, suspected, strict=True):
            _draw(axis, name, findings.recorded, findings.records)
        axes[-1].set_xlabel("time, records one after the other [s]")
        shown = {label: line for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
        figure.legend(shown.values(), shown.keys(), loc="outside upper right", ncols=3)
    said = " ".join(one.sentence for one in findings.findings)
    return Picture(
        name="check",
        figure=figure,
        title="Data that are not as they should be",
        caption=f"Grey: as recorded. Green: as corrected. Marked: left out. {said}",
        alt=said,
    )


def _suspected(findings: DataFindings) -> list[str]:
    names = [name for one in findings.findings for name in one.target.split("+") if name != "t"]
    return list(dict.fromkeys(names))


def _draw(axis: Axes, name: str, recorded: Sequence[Record], mended: Sequence[Record]) -> None:
    factor, unit = channel_scale(name)
    begin, first = 0.0, True
    for before, after in zip(recorded, mended, strict=True):
        if name not in before:
            continue
        t = before.t - before.t[0] + begin
        old, new = factor * before[name], factor * after[name]
        out = np.isfinite(old) & ~np.isfinite(new)
        changed = np.isfinite(new) & (old != new)
        axis.plot(t, old, color=MEASURED, alpha=0.45, linewidth=1.0, label="recorded" if first else None)
        if changed.any():
            axis.plot(t, np.where(changed, new, np.nan), color=EXPLAINED, label="corrected" if first else None)
        if out.any():
            axis.plot(t[out], old[out], ".", color=ALERT, markersize=3.0, label="left out" if first else None)
        begin, first = t[-1] + _APART, False
    axis.set_title(label_of(name), loc="left")
    axis.set_ylabel(unit)
