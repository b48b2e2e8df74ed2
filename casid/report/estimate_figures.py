"""Figures of an estimation: measured against simulated, colour of residuals, estimates with errors, correlations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from casid.errors import check_known
from casid.estimation.fit import Fit
from casid.frequency.output_error import FourierOutputError
from casid.frequency.regression import FourierEquationError
from casid.report.style import (
    CURVES,
    NOISE,
    RECORD_COLOURS,
    Picture,
    blank,
    channel_axis,
    channel_scale,
    draw_channel,
    legend,
    settings,
    window,
)

_LAGS = 30


def histories(
    record: str,
    t: np.ndarray,
    channels: Sequence[str],
    measured: np.ndarray,
    curves: Mapping[str, np.ndarray],
    empty: Callable[[float], Figure] = blank,
    inputs: Mapping[str, np.ndarray] | None = None,
    *,
    axis: str = "t [s]",
) -> Picture:
    """Measured (N, channels) and, by label, what models give (N, channels), one panel per channel; `empty` makes the
    figure of a height. `inputs`, by channel (N,), stand in panels below. Where `t` is no time, `axis` names it."""
    inputs = inputs or {}
    with settings():
        beside = 2 if max(len(channels), len(inputs)) > 1 else 1
        above = -(-len(channels) // beside)
        below = -(-len(inputs) // beside)
        figure = empty(1.35 * above + 1.0 * below + 0.7)
        heights = [1.35] * above + [1.0] * below
        axes = figure.subplots(above + below, beside, sharex=True, squeeze=False, height_ratios=heights)
        for i, channel in enumerate(channels):
            here = {label: values[:, i] for label, values in curves.items()}
            draw_channel(axes.flat[i], channel, t, measured[:, i], here)
        for ax, (channel, values) in zip(axes.flat[beside * above :], inputs.items(), strict=False):
            ax.plot(t, channel_scale(channel)[0] * values, color="black", lw=1.1, label="recorded input")
            ax.set_ylabel(channel_axis(channel))
        for ax in (*axes.flat[len(channels) : beside * above], *axes.flat[beside * above + len(inputs) :]):
            ax.set_visible(False)
        for column in axes.T:
            lowest = [ax for ax in column if ax.get_visible()][-1]
            lowest.set_xlabel(axis)
            lowest.tick_params(labelbottom=True)
        legend(figure, axes.flat, 3)
    drawn = ", ".join(["measured", *curves])
    return Picture(
        name=f"histories_{file_name(record)}",
        figure=figure,
        title=f"{record}: {drawn}",
        histories=True,
        caption=f"Outputs of {record}: {drawn}.",
        alt=f"Time histories of {', '.join(channels)}: {drawn}.",
    )


def plot_fit(fit: Fit, record: str | None) -> Figure:
    """Measured and predicted channels of one record, or their amplitudes over frequency where they are transforms."""
    records = {r.name: r for r in fit.problem.records}
    name = next(iter(records)) if record is None else record
    check_known("record", (name,), records, "fit.plot")
    predicted = fit.predictions[name]
    measured = predicted + fit.residuals[name]
    if isinstance(cost := fit.problem.cost, FourierEquationError | FourierOutputError):
        frequencies = cost.equations(fit.problem).frequencies[list(records).index(name)]
        omega = np.unique(frequencies)
        which = frequencies == omega[:, None]
        values = (measured, predicted, fit.residuals[name])
        measured, predicted, rest = (np.sqrt(which @ np.nan_to_num(one) ** 2) for one in values)
        curves = {"fitted": predicted, "difference": rest}
        return histories(name, omega, list(fit.channels), measured, curves, window, axis="frequency ω [rad/s]").figure
    return histories(name, records[name].t, list(fit.channels), measured, {"fitted": predicted}, window).figure


def autocorrelations(channels: Sequence[str], residuals: Mapping[str, np.ndarray]) -> Picture:
    """Autocorrelation of residuals (N, channels), by label, with the band in which that of white noise stays."""
    with settings():
        rows = -(-len(channels) // 4)
        figure = blank(1.6 * rows + 0.7)
        axes = figure.subplots(rows, 4, sharex=True, sharey=True, squeeze=False)
        for i, channel in enumerate(channels):
            ax = axes.flat[i]
            for (label, values), (colour, dash) in zip(residuals.items(), CURVES, strict=False):
                series = values[np.isfinite(values[:, i]), i]
                ax.plot(np.arange(_LAGS + 1), autocorrelation(series, _LAGS), dash, color=colour, label=label)
                band = 1.96 / np.sqrt(len(series))
                ax.axhspan(-band, band, color=NOISE, zorder=0)
            ax.set_title(channel)
        for ax in axes.flat[len(channels) :]:
            ax.set_visible(False)
        legend(figure, axes.flat, len(residuals))
        for ax in axes[-1]:
            ax.set_xlabel("lag [samples]")
    return Picture(
        name="autocorrelation",
        figure=figure,
        title="Are the residuals white?",
        caption="Autocorrelation of the residuals over the lag; white noise stays in the grey band 95 % of the time.",
        alt="Autocorrelation of the residuals of every channel.",
    )


def autocorrelation(series: np.ndarray, lags: int) -> np.ndarray:
    """(lags + 1,) autocorrelation of a series (N,) about its mean; zeros for a constant."""
    e = series - series.mean()
    power = float(e @ e)
    if power == 0.0:
        return np.zeros(lags + 1)
    return np.array([e[k:] @ e[: len(e) - k] for k in range(lags + 1)]) / power


def estimates(names: Sequence[str], methods: Mapping[str, Sequence[tuple[float, float]]], reference: str) -> Picture:
    """Draw, by label, (value, 1-sigma) of every parameter over its value by the method `reference`: 1 is the same,
    below 0 the opposite sign. Where that value is 0 there is no ratio: value over 1-sigma, on an axis of its own."""
    base = dict(zip(names, (value for value, _ in methods[reference]), strict=True))
    panels = [[n for n in names if base[n] != 0.0], [n for n in names if base[n] == 0.0]]
    labels = [
        f"value over that of: {reference} (bars: 2 standard errors)",
        f"value over its standard error ({reference}: 0)",
    ]
    shown = [(rows, label) for rows, label in zip(panels, labels, strict=True) if rows]
    with settings():
        figure = blank(0.32 * len(names) + 1.0 * len(shown))
        axes = figure.subplots(len(shown), 1, squeeze=False, height_ratios=[len(rows) + 1 for rows, _ in shown])
        for ax, (rows, label) in zip(axes[:, 0], shown, strict=True):
            _estimate_rows(ax, names, rows, methods, base)
            ax.set_xlabel(label)
        legend(figure, [axes[0, 0]], len(methods))
    return Picture(
        name="estimates",
        figure=figure,
        title="Estimates",
        caption=f"Estimates over those of {reference}, with 2 sigma; 1 is the same, below 0 the opposite sign.",
        alt=f"Estimates of {', '.join(names)} by {', '.join(methods)}.",
    )


def _estimate_rows(
    ax: Axes,
    names: Sequence[str],
    rows: Sequence[str],
    methods: Mapping[str, Sequence[tuple[float, float]]],
    base: Mapping[str, float],
) -> None:
    """One row for each parameter of `rows`, first at the top."""
    heights = np.arange(len(rows))[::-1]
    for k, (label, pairs) in enumerate(methods.items()):
        value, std = np.array([pair for name, pair in zip(names, pairs, strict=True) if name in rows]).T
        known = np.nan_to_num(std)
        unit = np.array([base[name] for name in rows])
        unit = np.where(unit != 0.0, unit, np.where(known > 0.0, known, 1.0))
        ax.errorbar(
            value / unit,
            heights + 0.16 * (0.5 * (len(methods) - 1) - k),
            xerr=2.0 * known / np.abs(unit),
            fmt="o",
            ms=4,
            color=RECORD_COLOURS[k % len(RECORD_COLOURS)],
            label=label,
            capsize=2,
        )
    ax.set_yticks(heights, rows)
    ax.set_ylim(-0.6, len(rows) - 0.4)


def correlations(names: Sequence[str], matrix: np.ndarray) -> Picture:
    """Correlation matrix (parameters, parameters) of the errors of the estimates."""
    with settings():
        figure = blank(min(max(0.22 * len(names), 1.8), 3.7) + 1.0)
        thin = 0.05
        ax, scale = figure.subplots(1, 2, width_ratios=(1.0, thin))
        scale.set_box_aspect(1.0 / thin)  # as high as the matrix, which is square
        image = ax.imshow(matrix, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
        ax.grid(visible=False)
        ax.set_xticks(range(len(names)), names, rotation=90, fontsize=6)
        ax.set_yticks(range(len(names)), names, fontsize=6)
        figure.colorbar(image, cax=scale, label="correlation of errors")
    return Picture(
        name="correlations",
        figure=figure,
        title="Which parameters are confused?",
        caption="Correlation of the errors of the estimates; near 1 or -1 the data hardly tell two parameters apart.",
        alt="Matrix of correlations between parameters.",
    )


def file_name(text: str) -> str:
    """A text as part of a file name: what is not a letter, digit, point or hyphen becomes an underscore."""
    return "".join(c if c.isalnum() or c in "-." else "_" for c in text)
