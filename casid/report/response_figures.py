"""Figures of frequency responses: measured, compared with models, fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, MultipleLocator, NullLocator

from casid.frequency.mismatch import MismatchEnvelope, ResponseComparison
from casid.frequency.response import USABLE, FrequencyResponse, gain_db, phase_deg
from casid.frequency.response_fit import ResponseFit
from casid.report.estimate_figures import file_name
from casid.report.style import CURVES, EXPLAINED, FAINT, MEASURED, NOISE, Picture, blank, legend, settings, window
from casid.signals import label_of, unit_of

_SIGMAS = 2.0
_TURN = 45.0  # deg between ticks of a phase
_MARGIN = 0.15  # of what flight shows, above and below it on an axis


def plot_response(response: FrequencyResponse) -> Figure:
    """Gain, phase and coherence."""
    return bode(response, window).figure


def plot_comparison(comparison: ResponseComparison) -> Figure:
    """Gain, phase and coherence, and the mismatch of each model."""
    return bode_mismatch(comparison, window).figure


def bode(response: FrequencyResponse, empty: Callable[[float], Figure] = blank) -> Picture:
    """Gain, phase and coherence of flight; `empty` makes the figure of a height."""
    with settings():
        figure = empty(5.2)
        axes = figure.subplots(3, 1, sharex=True, height_ratios=[1.5, 1.5, 1.0])
        draw_gain_and_phase(axes[0], axes[1], response, {})
        draw_coherence(axes[2], response)
        frequency_axis(axes, response)
        legend(figure, [axes[0]], 2)
    given = f", with the part of {', '.join(response.other_inputs)} taken off" if response.other_inputs else ""
    return Picture(
        name=f"bode_{file_name(response.output)}_{file_name(response.input)}",
        figure=figure,
        histories=True,
        title=f"{_name(response.output)} to {_name(response.input)}",
        caption=f"Response of {_name(response.output)} to {_name(response.input)}{given}, from "
        f"{', '.join(response.records)}. Grey: coherence below {USABLE:g}, or as "
        "low as it comes about by chance, where the response is not to be used.",
        alt=f"Bode diagram and coherence of {response.output} to {response.input}.",
    )


def bode_mismatch(comparison: ResponseComparison, empty: Callable[[float], Figure] = blank) -> Picture:
    """Draw `bode`, with models over it and their mismatch below."""
    flight = comparison.flight
    with settings():
        figure = empty(8.2)
        axes = figure.subplots(5, 1, sharex=True, height_ratios=[1.5, 1.5, 0.9, 1.1, 1.1])
        labels = {f"{name} (J = {one.cost:.3g})": one.response for name, one in comparison.mismatches.items()}
        draw_gain_and_phase(axes[0], axes[1], flight, labels)
        draw_coherence(axes[2], flight)
        _draw_mismatch(axes[3], axes[4], comparison)
        frequency_axis(axes, flight)
        legend(figure, [axes[0]], 2)
    costs = "; ".join(f"{name}: J = {one.cost:.3g}" for name, one in comparison.mismatches.items())
    return Picture(
        name=f"bode_{file_name(flight.output)}_{file_name(flight.input)}",
        figure=figure,
        histories=True,
        title=f"{_name(flight.output)} to {_name(flight.input)}",
        caption=f"Response of {_name(flight.output)} to {_name(flight.input)}: flight and models, and models less "
        f"flight. {costs}, over {comparison.band[0]:.3g} to {comparison.band[1]:.3g} rad/s. Grey: coherence below "
        f"{USABLE:g}. J is the cost of the mismatch: up to 100 is acceptable, up to 50 nearly indistinguishable.",
        alt=f"Bode diagrams of {flight.output} to {flight.input}: flight, {', '.join(comparison.mismatches)}.",
    )


def draw_gain_and_phase(
    gain: Axes, phase: Axes, flight: FrequencyResponse, models: Mapping[str, np.ndarray], label: str = "flight"
) -> None:
    """Flight with its error of two standard deviations, and models by label."""
    omega = flight.omega
    error = np.minimum(_SIGMAS * flight.random_error, 0.999)
    shown = np.where(flight.usable, 1.0, np.nan)
    for ax, values, low, high in (
        (gain, flight.gain_db, 20.0 * np.log10(1.0 - error), 20.0 * np.log10(1.0 + error)),
        (phase, flight.phase_deg, -np.degrees(error), np.degrees(error)),
    ):
        _grey(ax, flight)
        band = (values + low) * shown, (values + high) * shown
        ax.fill_between(omega, *band, color=MEASURED, alpha=0.18, lw=0, label="± 2 standard deviations")
        ax.plot(omega, values, color=FAINT, lw=0.8)
        ax.plot(omega, values * shown, color=MEASURED, lw=2.0, label=label)
    for (name, response), (colour, dash) in zip(models.items(), CURVES, strict=False):
        gain.plot(omega, gain_db(response), dash, color=colour, lw=1.6, label=name)
        phase.plot(omega, _nearest_turn(phase_deg(response), flight), dash, color=colour, lw=1.6)
    _limit(gain, flight, [flight.gain_db, *(gain_db(one) for one in models.values())])
    _limit(phase, flight, [flight.phase_deg, *(_nearest_turn(phase_deg(one), flight) for one in models.values())])
    unit = f"({unit_of(flight.output) or '1'})/({unit_of(flight.input) or '1'})"
    gain.set_ylabel("gain [dB]" if unit in ("(1)/(1)", "(rad)/(rad)") else f"gain [dB]\n{_pretty(unit)}")
    phase.set_ylabel("phase [deg]")
    span = np.ptp(phase.get_ylim())
    phase.yaxis.set_major_locator(MultipleLocator(_TURN * max(1, round(span / _TURN / 5))))


def draw_coherence(ax: Axes, flight: FrequencyResponse) -> None:
    """Coherence, with the limit below which it is grey."""
    _grey(ax, flight)
    ax.plot(flight.omega, flight.coherence, color=MEASURED, lw=1.4, label="coherence")
    ax.plot(
        flight.omega, np.maximum(USABLE, flight.by_chance), color=FAINT, lw=0.9, ls="--", label="least that is used"
    )
    ax.set_ylim(0.0, 1.03)
    ax.set_ylabel("coherence")


def _draw_mismatch(gain: Axes, phase: Axes, comparison: ResponseComparison) -> None:
    flight = comparison.flight
    envelope = comparison.envelope
    shown = np.where(flight.usable, 1.0, np.nan)
    for ax in (gain, phase):
        _grey(ax, flight)
        ax.axhline(0.0, color=MEASURED, lw=0.9)
    if envelope is not None:
        _draw_envelope(gain, phase, envelope)
    for one, (colour, dash) in zip(comparison.mismatches.values(), CURVES, strict=False):
        for ax, values in ((gain, one.gain_db), (phase, one.phase_deg)):
            ax.plot(flight.omega, values * shown, dash, color=colour, lw=1.6)
            if one.within is not None:
                out = one.judged & ~one.within
                ax.plot(flight.omega[out], values[out], "x", color=colour, ms=5, mew=1.4)
    gain.set_ylabel("model less\nflight [dB]")
    phase.set_ylabel("model less\nflight [deg]")
    for ax in (gain, phase):
        ax.yaxis.set_major_locator(MaxNLocator(5))


def _draw_envelope(gain: Axes, phase: Axes, envelope: MismatchEnvelope) -> None:
    for ax, low, high in (
        (gain, envelope.gain_low_db, envelope.gain_high_db),
        (phase, envelope.phase_low_deg, envelope.phase_high_deg),
    ):
        ax.fill_between(envelope.omega, low, high, color=EXPLAINED, alpha=0.12, lw=0)
        for bound in (low, high):
            ax.plot(envelope.omega, bound, color=EXPLAINED, lw=1.0)
    gain.annotate(envelope.name, (0.01, 0.97), xycoords="axes fraction", va="top", fontsize=8.5, color=EXPLAINED)


def _grey(ax: Axes, flight: FrequencyResponse) -> None:
    """Grey where the coherence is low."""
    edges = np.sqrt(flight.omega[1:] * flight.omega[:-1])
    edges = np.concatenate([flight.omega[:1], edges, flight.omega[-1:]])
    low = np.concatenate([[0], (~flight.usable).astype(int), [0]])
    for start, stop in zip(np.flatnonzero(np.diff(low) == 1), np.flatnonzero(np.diff(low) == -1), strict=True):
        ax.axvspan(edges[start], edges[stop], color=NOISE, alpha=0.7, lw=0, zorder=0)


def _nearest_turn(angle: np.ndarray, flight: FrequencyResponse) -> np.ndarray:
    """A phase [deg] moved by whole turns to where that of flight is."""
    used = flight.usable if flight.usable.any() else np.ones(len(angle), dtype=bool)
    return angle + 360.0 * np.round(np.median((flight.phase_deg - angle)[used]) / 360.0)


def _limit(ax: Axes, flight: FrequencyResponse, curves: list[np.ndarray]) -> None:
    """Show what is usable, without parts of low coherence."""
    used = flight.usable if flight.usable.any() else np.ones(len(flight.omega), dtype=bool)
    values = np.concatenate([curve[used] for curve in curves])
    values = values[np.isfinite(values)]
    if len(values):
        margin = max(_MARGIN * np.ptp(values), 1.0)
        ax.set_ylim(values.min() - margin, values.max() + margin)


def frequency_axis(axes: np.ndarray, flight: FrequencyResponse) -> None:
    """The axis of the frequency below the last of the panels."""
    last: Axes = axes[-1]
    last.set_xscale("log")
    last.set_xlim(flight.omega[0], flight.omega[-1])
    last.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    last.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    last.xaxis.set_minor_locator(NullLocator())
    last.set_xlabel("frequency ω [rad/s]")


def _name(channel: str) -> str:
    label = label_of(channel)
    return label if label == channel else f"{label} {channel}"


def _pretty(unit: str) -> str:
    return unit.replace("s2", "s²").replace("m2", "m²").replace("m3", "m³")


_WIDEST = 4  # responses side by side


def plot(fit: ResponseFit) -> Figure:
    """A column for each response: points measured, a line fitted."""
    labels = list(fit.responses)
    columns = min(len(labels), _WIDEST)
    rows = -(-len(labels) // columns)
    (colour, _), *_ = CURVES[1:]
    with settings():
        figure = window(4.2 * rows)
        axes = figure.subplots(2 * rows, columns, sharex=True, squeeze=False)
        for k, label in enumerate(labels):
            gain, phase = (axes[2 * (k // columns) + part, k % columns] for part in (0, 1))
            one = fit.responses[label]
            fitted = fit.fitted[label]
            turn = 360.0 * np.round(np.mean(phase_deg(one.response) - phase_deg(fitted)) / 360.0)
            for ax, measured, model in (
                (gain, gain_db(one.response), gain_db(fitted)),
                (phase, phase_deg(one.response), phase_deg(fitted) + turn),
            ):
                ax.plot(one.omega, measured, "o", ms=4.0, color=MEASURED, label="measured")
                ax.plot(one.omega, model, color=colour, lw=1.8, label="fitted")
            gain.set_title(f"{label} (J = {fit.costs[label]:.3g})")
            phase.set_xlabel("frequency [rad/s]")
            phase.set_xscale("log")
            phase.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            phase.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            phase.xaxis.set_minor_locator(NullLocator())
            if k % columns == 0:
                gain.set_ylabel("gain [dB]")
                phase.set_ylabel("phase [deg]")
        legend(figure, [axes[0, 0]], 2)
    return figure
