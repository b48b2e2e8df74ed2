"""The picture of manoeuvres in a long record: surfaces and rates of rotation, manoeuvres shaded and numbered."""

from __future__ import annotations

from collections.abc import Sequence

from casid.records.record import Record
from casid.records.segments import Segment
from casid.report.estimate_figures import file_name
from casid.report.style import EXPLAINED, MEASURED, WIDE, Picture, blank, channel_axis, channel_scale, settings
from casid.signals import SURFACES

_SHOWN = (*SURFACES, "p", "q", "r")


def segment_figure(record: Record, found: Sequence[Segment]) -> Picture:
    """Surfaces and rates over the whole record; the manoeuvres are shaded and numbered."""
    names = [name for name in _SHOWN if name in record]
    with settings():
        figure = blank(1.1 * len(names) + 0.8, WIDE)
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for ax, name in zip(axes, names, strict=True):
            ax.plot(record.t, channel_scale(name)[0] * record[name], color=MEASURED, lw=0.8)
            ax.set_ylabel(channel_axis(name))
            for one in found:
                ax.axvspan(one.start, one.stop, color=EXPLAINED, alpha=0.18, lw=0.0)
            ax.margins(x=0.005)
        for number, one in enumerate(found, 1):
            place = 0.5 * (one.start + one.stop)
            label = f"{number}\n{'+'.join(one.axes)}"
            axes[0].annotate(
                label, (place, 1.02), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=8
            )
        axes[-1].set_xlabel("t [s]")
    return Picture(
        name=f"segments_{file_name(record.name)}",
        figure=figure,
        title=f"{record.name}: manoeuvres",
        caption="Surfaces and rates of rotation. Shaded and numbered: the manoeuvres that were found.",
        alt=f"{len(found)} manoeuvres in {record.name}.",
        wide=True,
    )
