"""Pictures of designed inputs: what is moved, what moves, and how much less the estimates scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from casid.design.separation import NextFlight, Rivals
from casid.model.effects import effect_of
from casid.records.record import Record
from casid.report.style import (
    BASELINE,
    EXPLAINED,
    EXTENDED,
    MEASURED,
    NOISE,
    RECORD_COLOURS,
    Picture,
    channel_axis,
    channel_scale,
    legend,
    settings,
    stacked,
)
from casid.report.words import effect_name
from casid.signals import label_of


def designed_histories(name: str, records: Mapping[str, Record], channels: Sequence[str]) -> Picture:
    """Time histories of the named channels, one line per design (title -> record)."""
    with settings():
        drawn, axes = stacked([1.5] * len(channels))
        for axis, channel in zip(axes, channels, strict=True):
            for colour, (title, record) in zip(RECORD_COLOURS, records.items(), strict=False):
                axis.plot(record.t, channel_scale(channel)[0] * record[channel], color=colour, label=title)
            axis.set_ylabel(channel_axis(channel))
        axes[-1].set_xlabel("t [s]")
        legend(drawn, axes, len(records))
    return Picture(
        name=f"{name}_histories",
        figure=drawn,
        histories=True,
        title=f"Designed inputs: {', '.join(records)}",
        caption="All inputs keep the same limits of surfaces and states.",
        alt=f"Time histories of {', '.join(channels)} for {', '.join(records)}.",
    )


def separated(found: NextFlight, rivals: Rivals, number: int = 1) -> Picture:
    """The manoeuvre that separates two rivals: what is moved, and the channel that tells, with the first effect and
    with the second where it imitates the first as well as it can."""
    told = found.separation.told
    channel = max(told, key=lambda o: told[o])
    i = list(told).index(channel)
    surface = found.manoeuvre.surface
    (first,), (second,) = found.separation.first.values(), found.separation.second.values()
    names = [effect_name(effect_of(value)) for value in (rivals.first, rivals.second)]
    t = found.record.t
    factor = channel_scale(channel)[0]
    with settings():
        drawn, (above, middle, below) = stacked([1.3] * 3)
        above.plot(t, channel_scale(surface)[0] * found.record[surface], color=EXPLAINED, label="command")
        above.set_ylabel(channel_axis(surface))
        middle.plot(t, factor * first[:, i], color=EXTENDED, label=names[0])
        middle.plot(t, factor * second[:, i], "--", color=BASELINE, label=f"{names[1]}, as like as it can be")
        middle.set_ylabel(channel_axis(channel))
        below.axhspan(-1.0, 1.0, color=NOISE, lw=0, label="±1σ noise of the instrument")
        below.plot(t, (first[:, i] - second[:, i]) / rivals.noise[channel], color=MEASURED, label="difference")
        below.set_ylabel("difference / σ")
        below.set_xlabel("time t [s]")
        legend(drawn, (above, middle, below), 2)
    return Picture(
        name="next_flight" if number == 1 else f"next_flight-{number}",
        figure=drawn,
        histories=True,
        title=f"Next flight: {names[0]}, or {names[1]}?",
        caption=(
            f"What is moved, and what {label_of(channel)} would read with either cause, the derivatives and the start "
            f"of the second fitted to the first. {channel} carries "
            f"{100.0 * told[channel] / max(sum(told.values()), 1e-300):.0f} % of what tells them apart."
        ),
        alt=f"Time histories of {surface} and {channel} with {names[0]} and with {names[1]}, and their difference over "
        "the noise.",
    )
