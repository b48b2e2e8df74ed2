"""Pictures of designed inputs: what is moved, what moves, and how much less the estimates scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from casid.records.record import Record
from casid.report.style import RECORD_COLOURS, Picture, blank, channel_axis, channel_scale, settings


def designed_histories(name: str, records: Mapping[str, Record], channels: Sequence[str]) -> Picture:
    """Time histories of the named channels, one line per design (title -> record)."""
    with settings():
        drawn = blank(1.5 * len(channels))
        axes = np.atleast_1d(drawn.subplots(len(channels), 1, sharex=True))
        for axis, channel in zip(axes, channels, strict=True):
            for colour, (title, record) in zip(RECORD_COLOURS, records.items(), strict=False):
                axis.plot(record.t, channel_scale(channel)[0] * record[channel], color=colour, label=title)
            axis.set_ylabel(channel_axis(channel))
        axes[-1].set_xlabel("t [s]")
        drawn.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(records))
    return Picture(
        name=f"{name}_histories",
        figure=drawn,
        title=f"Designed inputs, {name}",
        caption="All inputs keep the same limits of surfaces and states.",
        alt=f"Time histories of {', '.join(channels)} for {', '.join(records)}.",
    )


def scatter_bars(name: str, parameters: Sequence[str], ratios: Mapping[str, Sequence[tuple[float, float]]]) -> Picture:
    """(measured, predicted) scatter over that of the standard input, per design and parameter."""
    with settings():
        drawn = blank(0.9 + 0.28 * len(parameters))
        axis = drawn.subplots()
        at = np.arange(len(parameters))
        for k, (colour, (title, pairs)) in enumerate(zip(RECORD_COLOURS[1:], ratios.items(), strict=False)):
            offset = 0.8 * ((k + 0.5) / len(ratios) - 0.5)
            axis.barh(at + offset, [m for m, _ in pairs], 0.8 / len(ratios), color=colour, label=title)
            axis.plot([p for _, p in pairs], at + offset, "k|", markersize=8)
        axis.axvline(1.0, color="#222222", linewidth=1.0)
        axis.set_yticks(at, parameters)
        axis.invert_yaxis()
        axis.set_xlabel("scatter of the estimates over that of the standard 3-2-1-1")
        drawn.legend(*axis.get_legend_handles_labels(), loc="outside upper center", ncols=len(ratios))
    return Picture(
        name=f"{name}_scatter",
        figure=drawn,
        title=f"What it gains, {name}",
        caption="Bars: measured in simulated flights. Marks: predicted by the bound.",
        alt="Bars of the scatter of each parameter relative to the standard 3-2-1-1.",
    )
