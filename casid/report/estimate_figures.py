"""Figures of an estimation: measured against simulated, colour of residuals, estimates with errors, correlations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from casid.errors import check_known
from casid.estimation.fit import Fit
from casid.frequency.output_error import FourierOutputError
from casid.frequency.regression import FourierEquationError
from casid.report import looks
from casid.report.figure import TIME, Axis, Cells, Curve, Figure, Panel, Picture, Rule, Scale, Span, history, stacked
from casid.report.svg import shown

_LAGS = 30
_INPUT_HEIGHT = 0.9  # inches
_WHITE = looks.Look(name="white noise", colour=looks.GREY)


def histories(
    record: str,
    t: np.ndarray,
    channels: Sequence[str],
    measured: np.ndarray,
    curves: Mapping[str, np.ndarray],
    inputs: Mapping[str, np.ndarray] | None = None,
    *,
    given: str | None = None,
    axis: Axis = TIME,
    units: Mapping[str, str | None] | None = None,
) -> Picture:
    """Return measured (N, channels) and, by label, what models give (N, channels), one panel per channel.

    The model called `given`, or the first of several, is that as given. `inputs`, by channel (N,), stand in panels
    below. Where `t` is no time, `axis` names it. `units`: of channels that have another one than their names say.
    """
    inputs = inputs or {}
    units = units or {}
    drawn_so = looks.of_models(curves, given)
    outputs = [
        history(
            channel,
            t,
            {looks.MEASURED: measured[:, i]} | {drawn_so[label]: one[:, i] for label, one in curves.items()},
            x=axis,
            unit=units.get(channel),
        )
        for i, channel in enumerate(channels)
    ]
    below = [
        history(name, t, {looks.INPUT: values}, x=axis, height=_INPUT_HEIGHT, unit=units.get(name))
        for name, values in inputs.items()
    ]
    beside = 2 if max(len(channels), len(inputs)) > 1 else 1
    drawn = ", ".join(["measured", *curves])
    return Picture(
        name=f"histories_{file_name(record)}",
        figure=Figure(rows=(*stacked(outputs, beside), *stacked(below, beside))),
        title=f"{record}: {drawn}",
        caption=f"Outputs of {record}: {drawn}.",
        alt=f"Time histories of {', '.join(channels)}: {drawn}.",
    )


def plot_fit(fit: Fit, record: str | None) -> Any:
    """Return measured and predicted channels of one record, or their amplitudes over frequency, for a notebook."""
    records = {r.name: r for r in fit.problem.records}
    name = next(iter(records)) if record is None else record
    check_known("record", (name,), records, "fit.plot")
    predicted = fit.predictions[name]
    measured = predicted + fit.residuals[name]
    channels = list(fit.channels)
    if isinstance(cost := fit.problem.cost, FourierEquationError | FourierOutputError):
        frequencies = cost.equations(fit.problem).frequencies[list(records).index(name)]
        omega = np.unique(frequencies)
        which = frequencies == omega[:, None]
        values = (measured, predicted, fit.residuals[name])
        measured, predicted, rest = (np.sqrt(which @ np.nan_to_num(one) ** 2) for one in values)
        curves = {"fitted": predicted, "difference": rest}
        axis = Axis(label="frequency ω [rad/s]")
        return shown(histories(name, omega, channels, measured, curves, given="", axis=axis).figure)
    return shown(histories(name, records[name].t, channels, measured, {"fitted": predicted}).figure)


def autocorrelations(channels: Sequence[str], residuals: Mapping[str, np.ndarray]) -> Picture:
    """Return the autocorrelation of residuals (N, channels), by label, with the band of white noise."""
    lags = np.arange(_LAGS + 1.0)
    panels = []
    for i, channel in enumerate(channels):
        series = {label: one[np.isfinite(one[:, i]), i] for label, one in residuals.items()}
        widest = 1.96 / np.sqrt(min(map(len, series.values())))
        curves = [
            Curve(look=look, x=lags, y=autocorrelation(series[n], _LAGS))
            for n, look in looks.of_models(series, "").items()
        ]
        panels.append(
            Panel(
                parts=(
                    Span(look=_WHITE, low=-widest, high=widest, axis="y"),
                    Rule(look=looks.ZERO, at=0.0, axis="y"),
                    *curves,
                ),
                x=Axis(label="lag [samples]"),
                y=Axis(high=1.05),
                title=channel,
                height=1.1,
            )
        )
    return Picture(
        name="autocorrelation",
        figure=Figure(rows=stacked(panels, 4), alike=True),
        title="Are the residuals white?",
        caption="Autocorrelation of the residuals over the lag; white noise stays in the grey band 95 % of the time.",
        alt="Autocorrelation of the residuals of every channel.",
    )


def autocorrelation(series: np.ndarray, lags: int) -> np.ndarray:
    """Return (lags + 1,) autocorrelation of a series (N,) about its mean; zeros for a constant."""
    e = series - series.mean()
    power = float(e @ e)
    if power == 0.0:
        return np.zeros(lags + 1)
    return np.array([e[k:] @ e[: len(e) - k] for k in range(lags + 1)]) / power


def estimates(names: Sequence[str], methods: Mapping[str, Sequence[tuple[float, float]]], reference: str) -> Picture:
    """Return by label (value, 1-sigma) of every parameter over its value by the method `reference`.

    1 is the same, below 0 the opposite sign. Where that value is 0 there is no ratio: value over 1-sigma, on an axis of
    its own.
    """
    base = dict(zip(names, (value for value, _ in methods[reference]), strict=True))
    groups = (
        (f"value / {reference} value (bars: ±2 standard errors)", [n for n in names if base[n] != 0.0]),
        (f"value / its standard error ({reference} value: 0)", [n for n in names if base[n] == 0.0]),
    )
    panels = [_estimate_rows(label, names, rows, methods, base) for label, rows in groups if rows]
    return Picture(
        name="estimates",
        figure=Figure(rows=stacked(panels), linked=False),
        title="Estimates",
        caption=f"1: the {reference} value itself; below 0: the opposite sign. Bars: ±2 standard errors.",
        alt=f"Estimates of {', '.join(names)} by {', '.join(methods)}.",
    )


def _estimate_rows(
    label: str,
    names: Sequence[str],
    rows: Sequence[str],
    methods: Mapping[str, Sequence[tuple[float, float]]],
    base: Mapping[str, float],
) -> Panel:
    """Return one row for each parameter of `rows`, first at the top."""
    parts = []
    for k, ((_, pairs), look) in enumerate(zip(methods.items(), looks.of_models(methods).values(), strict=True)):
        value, std = np.array([pair for name, pair in zip(names, pairs, strict=True) if name in rows]).T
        known = np.nan_to_num(std)
        unit = np.array([base[name] for name in rows])
        unit = np.where(unit != 0.0, unit, np.where(known > 0.0, known, 1.0))
        heights = np.arange(len(rows)) - 0.16 * (0.5 * (len(methods) - 1) - k)
        dots = replace(look, dash="", marker="o")
        parts.append(Curve(look=dots, x=value / unit, y=heights, std_x=2.0 * known / np.abs(unit)))
    return Panel(parts=tuple(parts), x=Axis(label=label), y=Axis(names=tuple(rows)), height=0.2 + 0.26 * len(rows))


def correlations(names: Sequence[str], matrix: np.ndarray) -> Picture:
    """Return the correlation matrix (parameters, parameters) of the errors of the estimates."""
    axis = Axis(names=tuple(names))
    scale = Scale(low=-1.0, high=1.0, colours="RdBu_r", label="correlation of errors")
    panel = Panel(
        parts=(Cells(values=matrix, scale=scale),),
        x=axis,
        y=axis,
        height=min(1.8 + 0.14 * len(names), 5.4),
        square=True,
    )
    return Picture(
        name="correlations",
        figure=Figure(rows=((panel,),)),
        title="Which parameters are confused?",
        caption="Correlation of the errors of the estimates; near 1 or -1 the data hardly tell two parameters apart.",
        alt="Matrix of correlations between parameters.",
    )


def file_name(text: str) -> str:
    """Return a text as part of a file name: what is not a letter, digit, point or hyphen becomes an underscore."""
    return "".join(c if c.isalnum() or c in "-." else "_" for c in text)
