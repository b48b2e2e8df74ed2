"""The figure of a test of a proof of match: flight, simulations, tolerance bands, and the inputs that were driven."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from casid.acceptance.checks import compared_channels, span
from casid.acceptance.proof import EXTENDED, GIVEN, MatchedTest, ProofOfMatch
from casid.acceptance.tolerances import Tolerance, told
from casid.errors import unknown
from casid.report.estimate_figures import file_name
from casid.report.style import (
    BASELINE,
    FAINT,
    MEASURED,
    NOISE,
    RECORD_COLOURS,
    WIDE,
    Picture,
    blank,
    channel_scale,
    settings,
    window,
)
from casid.report.style import (
    EXTENDED as BLUE,
)
from casid.signals import SURFACES, label_of

_LINES = {GIVEN: (BASELINE, "--"), EXTENDED: (BLUE, "-")}
_PANEL = 1.45  # inches


def plot(proof: ProofOfMatch, test: str | None) -> Figure:
    """The first test with this id; without one, the first of all."""
    if test is None:
        return match_figure(proof.tests[0], window).figure
    found = [one for one in proof.tests if one.test.id == test]
    if not found:
        raise unknown("test", str(test), {one.test.id for one in proof.tests}, "proof.plot")
    return match_figure(found[0], window).figure


def match_figure(one: MatchedTest, empty: Callable[[float], Figure] | None = None) -> Picture:
    """A panel for each channel that is compared, in the unit of its tolerance, and one for the inputs.

    Grey band: the tolerance about flight. A bar at the foot: where a simulation leaves it.
    """
    channels = _panels(one)
    power = "thrust" if one.test.manoeuvre == "power change" else None
    count = len(channels) + 1 + bool(power)
    with settings():
        height = _PANEL * -(-count // 2) + 0.8
        figure = blank(height, WIDE) if empty is None else empty(height)
        axes = figure.subplots(-(-count // 2), 2, sharex=True, squeeze=False)
        panels = list(axes.flat)
        for axis, (name, row) in zip(panels, channels.items(), strict=False):
            _channel(axis, one, name, row)
        _surfaces(panels[len(channels)], one)
        if power:
            _thrust(panels[len(channels) + 1], one)
        for axis in panels[count:]:
            axis.set_visible(False)
        for axis in panels[max(count - 2, 0) : count]:
            axis.tick_params(labelbottom=True)
            axis.set_xlabel("t [s]")
        drawn = (zip(*axis.get_legend_handles_labels(), strict=True) for axis in panels[: len(channels)])
        shown = {label: line for some in drawn for line, label in some}
        figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=len(shown))
    return Picture(
        name=file_name(f"{one.test.id}_{one.record.name}_{one.window.start:.0f}s"),
        figure=figure,
        title=f"{one.test.id} {one.test.title}",
        caption="Dots: flight as measured. Black: the same, its noise smoothed, which is compared. Grey: the tolerance "
        "about it. Bars at the foot of a panel: where a simulation is out of tolerance. Dotted: the manoeuvre begins.",
        alt=f"Time histories of {', '.join(map(told, channels))}: flight, tolerance band and simulation.",
        wide=True,
    )


def _panels(one: MatchedTest) -> dict[str, Tolerance | None]:
    """Channel that can be drawn -> its tolerance as a time history, if it has one."""
    by_channel = {row.channel: row for row in one.test.tolerances if row.quantity is None}
    return {name: by_channel.get(name) for name in one.test.channels if name in one.flight.samples}


def _channel(axis: Axes, one: MatchedTest, name: str, row: Tolerance | None) -> None:
    """In the unit of the tolerance of the time history; without one, in that which people read."""
    factor, unit = channel_scale(name) if row is None else (1.0 / row.factor, row.unit)
    t, curve = one.flight.t, one.flight.curves[name]
    inside, limit = np.zeros(len(t), dtype=bool), np.zeros(len(t))
    if row is not None:
        inside = span(row, t, one.window)
        limit = np.broadcast_to(row.limit(curve, float(np.abs(curve[inside]).max(initial=0.0))), curve.shape)
        low, high = factor * (curve - limit)[inside], factor * (curve + limit)[inside]
        axis.fill_between(t[inside], low, high, color=NOISE, lw=0, label="tolerance")
    axis.plot(t, factor * one.flight.samples[name], ".", color=FAINT, ms=1.6, label="flight, samples")
    axis.plot(t, factor * curve, color=MEASURED, lw=2.6, alpha=0.45, label="flight")
    for place, (label, side) in enumerate(one.sides.items()):
        simulated = compared_channels(side.flown, one.record, one.window, (name,)).get(name)
        if simulated is None:
            continue
        colour, dash = _LINES[label]
        axis.plot(t, factor * simulated, dash, color=colour, lw=1.3, label=label)
        out, foot = inside & (np.abs(simulated - curve) > limit), 0.012 + 0.03 * place
        low, high, across = np.full(len(t), foot), foot + 0.024, axis.get_xaxis_transform()
        axis.fill_between(t, low, high, where=out.tolist(), color=colour, lw=0, transform=across)
    axis.axvline(one.window.begin, color=FAINT, lw=0.8, ls=":")
    axis.set_ylabel(f"{told(name)} [{unit}]" if unit else told(name), fontsize=9.0)


def _inside(one: MatchedTest, name: str) -> np.ndarray:
    return one.record[name][(one.record.t >= one.window.start) & (one.record.t <= one.window.end)]


def _surfaces(axis: Axes, one: MatchedTest) -> None:
    """Surfaces as flown, and with what a controller added to the last simulation."""
    added, corrected = list(one.sides.values())[-1].flown.corrections, "with corrections"
    for name, colour in zip(SURFACES, (RECORD_COLOURS[2], RECORD_COLOURS[3], RECORD_COLOURS[4]), strict=True):
        if name not in one.record:
            continue
        values = np.degrees(_inside(one, name))
        axis.plot(one.flight.t, values, color=colour, lw=1.1, label=label_of(name))
        if name in added:
            axis.plot(one.flight.t, values + np.degrees(added[name]), ":", color=MEASURED, lw=1.0, label=corrected)
            corrected = "_"
    axis.axvline(one.window.begin, color=FAINT, lw=0.8, ls=":")
    axis.set_ylabel("surfaces, driven [deg]", fontsize=9.0)
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + 0.25 * (high - low))
    axis.legend(loc="upper left", ncols=4, fontsize=7.5, handlelength=1.0, columnspacing=0.8, borderpad=0.1)


def _thrust(axis: Axes, one: MatchedTest) -> None:
    axis.plot(one.flight.t, 1e-3 * _inside(one, "thrust"), color=MEASURED, lw=1.1)
    axis.axvline(one.window.begin, color=FAINT, lw=0.8, ls=":")
    axis.set_ylabel("thrust, driven [kN]", fontsize=9.0)
