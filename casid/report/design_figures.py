"""Pictures of designed inputs: what is moved, what moves, and how much less the estimates scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from casid.design.separation import NextFlight, Rivals
from casid.model.effects import effect_of
from casid.records.record import Record
from casid.report import looks
from casid.report.figure import TIME, Axis, Curve, Figure, Panel, Picture, Span, history, stacked
from casid.report.statements import numbered
from casid.report.words import effect_name
from casid.signals import label_of


def designed_histories(name: str, records: Mapping[str, Record], channels: Sequence[str]) -> Picture:
    """Return time histories of the named channels, one line per design (title -> record)."""
    lines = {title: replace(looks.each(k, title), dash="-", marker="") for k, title in enumerate(records)}
    panels = []
    for channel in channels:
        own = [history(channel, record.t, {lines[title]: record[channel]}) for title, record in records.items()]
        panels.append(replace(own[0], parts=tuple(part for panel in own for part in panel.parts)))
    return Picture(
        name=f"{name}_histories",
        figure=Figure(rows=stacked(panels)),
        title=f"Designed inputs: {', '.join(records)}",
        caption="All inputs keep the same limits of surfaces and states.",
        alt=f"Time histories of {', '.join(channels)} for {', '.join(records)}.",
    )


def separated(found: NextFlight, rivals: Rivals, number: int = 1) -> Picture:
    """Return the manoeuvre that separates two rivals: what is moved, and the channel that tells.

    It is drawn with the first effect and with the second where it imitates the first as well as it can.
    """
    told = found.separation.told
    channel = max(told, key=lambda o: told[o])
    i = list(told).index(channel)
    surface = found.manoeuvre.surface
    (first,), (second,) = found.separation.first.values(), found.separation.second.values()
    names = [effect_name(effect_of(value)) for value in (rivals.first, rivals.second)]
    t = found.record.t
    with_either = {
        looks.EXTENDED.called(names[0]): first[:, i],
        looks.RIVAL.called(f"{names[1]}, as like as it can be"): second[:, i],
    }
    difference = (first[:, i] - second[:, i]) / rivals.noise[channel]
    panels = (
        history(surface, t, {looks.INPUT.called("command"): found.record[surface]}),
        history(channel, t, with_either),
        Panel(
            parts=(
                Span(look=looks.NOISE, low=-1.0, high=1.0, axis="y"),
                Curve(look=replace(looks.MEASURED, name="difference", width=1.3, alpha=1.0), x=t, y=difference),
            ),
            x=TIME,
            y=Axis(label="difference / σ"),
        ),
    )
    return Picture(
        name=numbered("next_flight", number),
        figure=Figure(rows=stacked(panels)),
        title=f"Next flight: {names[0]}, or {names[1]}?",
        caption=f"What is moved, and what {label_of(channel)} would read with either cause, the derivatives and the "
        f"start of the second fitted to the first. {channel} carries "
        f"{100.0 * told[channel] / max(sum(told.values()), 1e-300):.0f} % of what tells them apart.",
        alt=f"Time histories of {surface} and {channel} with {names[0]} and with {names[1]}, and their difference over "
        "the noise.",
    )
