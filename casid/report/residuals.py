"""What the simulation gets wrong in time: histories on held-out records, residuals over their noise."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from casid.diagnosis.flight.view import View
from casid.diagnosis.result import Diagnosis
from casid.report.style import (
    BASELINE,
    EXPLAINED,
    EXTENDED,
    MEASURED,
    NOISE,
    Picture,
    blank,
    channel_axis,
    channel_scale,
    smooth,
)
from casid.signals import label_of

_DEPARTED = 1e9  # standard deviations of noise: further away is no more telling
AS_GIVEN = "file as given"
_WINDOW = 14.0  # s


def misfit(view: View) -> dict[str, float]:
    """Channel -> r.m.s. of the free simulation's residual over the instrument's noise."""
    return {name: c.rms / c.noise for name, c in view.channels.items()}


def telling_channels(before: View, after: View, count: int) -> list[str]:
    """The channels whose innovations lose most from the file as given to the extended model."""
    outputs = before.fit.model.outputs
    drop = np.sum(before.fit.white**2 - after.fit.white**2, axis=(0, 1))
    return [outputs[i] for i in np.argsort(-drop)[:count]]


def histories(diagnosis: Diagnosis) -> Picture:
    """Measured, as given and by the best model in one held-out record."""
    before, after = diagnosis.held_out_as_given, diagnosis.held_out_extended
    old, new = misfit(before), misfit(after)
    channels = sorted(old, key=lambda o: new[o] - old[o])[:3]
    r = worst_record(before, channels)
    record = before.fit.flight.records[r]
    window = telling_window(before, after, channels, r)
    figure = blank(1.75 * len(channels) + 0.6)
    axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, channel in zip(axes, channels, strict=True):
        i, (factor, _) = before.fit.model.outputs.index(channel), channel_scale(channel)
        t = record.t[window]
        ax.plot(t, factor * record[channel][window], color="#C4C4C4", lw=4.5, label="measured")
        ax.plot(t, factor * before.simulated.output[window, r, i], "--", color=BASELINE, label=AS_GIVEN)
        ax.plot(t, factor * after.simulated.output[window, r, i], color=EXTENDED, label=diagnosis.best)
        ax.set_ylabel(channel_axis(channel))
        ax.set_title(label_of(channel), loc="left")
        ax.margins(x=0.01)
    axes[-1].set_xlabel("time t [s]")
    figure.align_ylabels(axes)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    names = ", ".join(label_of(c) for c in channels)
    part = "" if window.stop - window.start == len(record) else f"The {_WINDOW:.0f} s that tell most. "
    return Picture(
        name="histories",
        figure=figure,
        title=f"Flown again: record {record.name}, which no fit has seen",
        caption=(
            "Open-loop simulation with the recorded control inputs, against the measurement: by the file as given, "
            f"from the state that fits the first seconds best, and by the {diagnosis.best}. {part}The channels that "
            "differ most."
        ),
        alt=f"Time histories of {names} in held-out record {record.name}: measured, simulated by the file as given, "
        f"and by the {diagnosis.best}.",
    )


def telling_window(before: View, after: View, channels: list[str], r: int, seconds: float = _WINDOW) -> slice:
    """The seconds of record r in which the simulations differ most, or without an extension, miss most."""
    record = before.fit.flight.records[r]
    index = [before.fit.model.outputs.index(c) for c in channels]
    noise = np.array([before.channels[c].noise for c in channels])
    wrong = _within(before.simulated.residual[: len(record), r, :][:, index] / noise)
    outputs = [_within(view.simulated.output[: len(record), r, :][:, index] / noise) for view in (after, before)]
    moved = outputs[0] - outputs[1]
    size = np.sum((moved if moved.any() else wrong) ** 2, axis=1)
    count = int(seconds / record.dt)
    if count >= len(record):
        return slice(0, len(record))
    total = np.convolve(size, np.ones(count), mode="valid")
    start = int(np.argmax(total))
    return slice(start, start + count)


def worst_record(view: View, channels: list[str]) -> int:
    """The record in which these channels are furthest from their simulation, in units of the noise."""
    index = [view.fit.model.outputs.index(c) for c in channels]
    noise = np.array([view.channels[c].noise for c in channels])
    seen = np.isfinite(view.simulated.residual[..., index])
    total = np.sum(_within(view.simulated.residual[..., index] / noise) ** 2, axis=(0, 2))
    return int(np.argmax(total / np.maximum(seen.sum(axis=(0, 2)), 1)))


def _within(values: np.ndarray) -> np.ndarray:
    """Numbers to compute with: nothing for what is missing, a large one for a simulation that has departed."""
    return np.clip(np.nan_to_num(values, nan=0.0, posinf=_DEPARTED, neginf=-_DEPARTED), -_DEPARTED, _DEPARTED)


def residuals(diagnosis: Diagnosis, channels: list[str] | None = None, name: str = "residuals") -> Picture:
    """Residual over its noise in a fitted record: before, what the causes explain of it, and what is left.

    Before is the re-estimated model where causes were found: what new values explain does not point to a cause.
    """
    before, after = diagnosis.refitted if diagnosis.causes else diagnosis.as_given, diagnosis.extended
    wrong_by = "re-estimated model" if diagnosis.causes else AS_GIVEN
    channels = channels or telling_channels(before, after, 3)
    r = worst_record(before, channels)
    record = before.fit.flight.records[r]
    n = len(record)
    figure = blank(1.85 * len(channels) + 0.7)
    axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, channel in zip(axes, channels, strict=True):
        i, noise = before.fit.model.outputs.index(channel), before.channels[channel].noise
        wrong = smooth(before.simulated.residual[:n, r, i] / noise, record.dt)
        ax.axhspan(-1.0, 1.0, color=NOISE, lw=0, label="±1σ noise of the instrument")
        ax.plot(record.t, wrong, color=BASELINE, label=f"error of the {wrong_by}")
        explained = smooth((after.simulated.output - before.simulated.output)[:n, r, i] / noise, record.dt)
        left = smooth(after.simulated.residual[:n, r, i] / noise, record.dt)
        ax.plot(record.t, explained, "--", color=EXPLAINED, label=f"explained by the {diagnosis.best}")
        ax.plot(record.t, left, color=EXTENDED, lw=1.1, label="left after it")
        ax.set_title(f"{label_of(channel)} {channel}", loc="left")
        ax.set_ylabel("residual / σ")
        ax.margins(x=0.01)
    axes[-1].set_xlabel("time t [s]")
    figure.align_ylabels(axes)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return Picture(
        name=name,
        figure=figure,
        title=f"What the {wrong_by} gets wrong, in units of the noise (record {record.name})",
        caption=(
            "Measured minus simulated over the instrument's 1σ, smoothed over 0.1 s. What stays inside the grey band "
            "is noise."
        ),
        alt=f"Residuals of {', '.join(channels)} in record {record.name} over a grey noise band, what the "
        f"{diagnosis.best} explains of them, and what is left.",
    )


def gain(diagnosis: Diagnosis) -> Picture:
    """Residual over noise per channel on held-out records, as given and by the best model."""
    before, after = diagnosis.held_out_as_given, diagnosis.held_out_extended
    old, new = misfit(before), misfit(after)
    order = sorted(old, key=lambda o: new[o] / old[o], reverse=True)
    figure = blank(0.31 * len(order) + 1.3)
    ax = figure.subplots()
    ax.axvline(1.0, color=MEASURED, lw=1.0, ls=":")
    for y, channel in enumerate(order):
        ax.plot([old[channel], new[channel]], [y, y], color=NOISE, lw=4, zorder=1, solid_capstyle="butt")
        change = 100.0 * (new[channel] / old[channel] - 1.0)
        ax.annotate(
            f"{change:+.0f} %".replace("-", "−"), (1.01, y), xycoords=("axes fraction", "data"), va="center", fontsize=9
        )
    ax.plot([old[o] for o in order], range(len(order)), "o", color=BASELINE, label=AS_GIVEN)
    ax.plot([new[o] for o in order], range(len(order)), "D", color=EXTENDED, ms=5, label=diagnosis.best)
    ax.set_xscale("log")
    ax.set_yticks(range(len(order)), [f"{label_of(o)} {o}" for o in order])
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.tick_params(axis="x", which="both", labelsize=9.5, length=4)
    # not 0.9 beside 1
    ax.xaxis.set_minor_formatter(FuncFormatter(lambda x, _: f"{x:g}" if _few(ax) and f"{x:e}"[0] in "235" else ""))
    ax.set_xlabel("r.m.s. residual / noise (dotted: only noise)")
    ax.grid(axis="y", visible=False)
    figure.legend(loc="outside upper center", ncols=2)
    names, turbulent = ", ".join(before.fit.flight.names), diagnosis.turbulence.named
    best = order[-1]
    return Picture(
        name="gain",
        figure=figure,
        title=f"Gain per channel on {names}, which no fit has seen",
        caption=(
            "R.m.s. of measured minus open-loop simulation over the noise; the number is its change."
            + (" Gusts are new in every record: no open-loop simulation can repeat them." if turbulent else "")
        ),
        alt=f"Residual over noise per channel on held-out {names}, before and after; the largest change is that of "
        f"{label_of(best)}, by {100.0 * (new[best] / old[best] - 1.0):+.0f} per cent.",
    )


def _few(ax: Axes) -> bool:
    """Whether the logarithmic axis spans less than a decade, so that its minor ticks have room for numbers."""
    low, high = ax.get_xlim()
    return high / low < 10.0
