"""Figures of frequency responses: measured, compared with models, fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from casid.acceptance.compared import named
from casid.frequency.mismatch import ResponseComparison
from casid.frequency.response import USABLE, FrequencyResponse, gain_db, phase_deg
from casid.frequency.response_fit import ResponseFit
from casid.records.channel_faults import stretches
from casid.report import looks
from casid.report.estimate_figures import file_name
from casid.report.figure import Axis, Band, Curve, Figure, Panel, Part, Picture, Rule, Span, stacked
from casid.report.svg import shown
from casid.report.words import pretty
from casid.signals import unit_of

_SIGMAS = 2.0
_TURN = 45.0  # deg between ticks of a phase
_MARGIN = 0.15  # of what flight shows, above and below it on an axis
_FLIGHT = replace(looks.MEASURED, width=2.0, alpha=1.0)
_POINTS = replace(looks.MEASURED, dash="", marker="o", alpha=1.0)
_EVERYWHERE = looks.Look(colour=looks.FAINT, width=0.8)
_ERROR = looks.Look(name="± 2 standard deviations", colour=looks.INK, alpha=0.18)
_UNUSED = looks.Look(name="coherence too low", colour=looks.GREY, alpha=0.7)
_LEAST = looks.Look(name="least coherence that is used", colour=looks.FAINT, width=0.9, dash="--")
_BOUND = looks.Look(colour=looks.GREEN, width=1.0)


def plot_response(response: FrequencyResponse) -> Any:
    """Return gain, phase and coherence for a notebook."""
    return shown(bode(response).figure)


def plot_comparison(comparison: ResponseComparison) -> Any:
    """Return gain, phase and coherence, and the mismatch of each model, for a notebook."""
    return shown(bode_mismatch(comparison).figure)


def bode(response: FrequencyResponse) -> Picture:
    """Return gain, phase and coherence of flight."""
    given = f", with the part of {', '.join(response.other_inputs)} taken off" if response.other_inputs else ""
    return Picture(
        name=f"bode_{file_name(response.output)}_{file_name(response.input)}",
        figure=Figure(rows=stacked([*gain_and_phase(response, {}), _coherence(response)])),
        title=f"{named(response.output)} to {named(response.input)}",
        caption=f"Response of {named(response.output)} to {named(response.input)}{given}, from "
        f"{', '.join(response.records)}. Grey: coherence below {USABLE:g}, or as "
        "low as it comes about by chance, where the response is not to be used.",
        alt=f"Bode diagram and coherence of {response.output} to {response.input}.",
    )


def bode_mismatch(comparison: ResponseComparison) -> Picture:
    """Return the same as `bode`, with models over it and their mismatch below."""
    flight = comparison.flight
    found = comparison.mismatches
    labels = {name: f"{name} (J = {one.cost:.3g})" for name, one in found.items()}
    drawn_so = {
        name: look.called(labels[name]) for name, look in looks.of_models(found, next(iter(found), None)).items()
    }
    models = {drawn_so[name]: one.response for name, one in found.items()}
    panels = [*gain_and_phase(flight, models), _coherence(flight), *_mismatch(comparison, drawn_so)]
    costs = "; ".join(f"{name}: J = {one.cost:.3g}" for name, one in found.items())
    return Picture(
        name=f"bode_{file_name(flight.output)}_{file_name(flight.input)}",
        figure=Figure(rows=stacked(panels)),
        title=f"{named(flight.output)} to {named(flight.input)}",
        caption=f"Response of {named(flight.output)} to {named(flight.input)}: flight and models, and models less "
        f"flight. {costs}, over {comparison.band[0]:.3g} to {comparison.band[1]:.3g} rad/s. Grey: coherence below "
        f"{USABLE:g}. J is the cost of the mismatch: up to 100 is acceptable, up to 50 nearly indistinguishable.",
        alt=f"Bode diagrams of {flight.output} to {flight.input}: flight, {', '.join(found)}.",
    )


def gain_and_phase(flight: FrequencyResponse, models: Mapping[looks.Look, np.ndarray]) -> tuple[Panel, Panel]:
    """Return panels of flight with its error of two standard deviations, and models by look."""
    omega = flight.omega
    error = np.minimum(_SIGMAS * flight.random_error, 0.999)
    usable = np.where(flight.usable, 1.0, np.nan)
    decibels = 20.0 * np.log10(1.0 - error), 20.0 * np.log10(1.0 + error)
    gains = {look: gain_db(one) for look, one in models.items()}
    phases = {look: _nearest_turn(phase_deg(one), flight) for look, one in models.items()}
    panels = []
    for own, (low, high), others in (
        (flight.gain_db, decibels, gains),
        (flight.phase_deg, (-np.degrees(error), np.degrees(error)), phases),
    ):
        of_a_phase = others is phases
        parts = (
            *_unused(flight),
            Band(look=_ERROR, x=omega, low=(own + low) * usable, high=(own + high) * usable),
            Curve(look=_EVERYWHERE, x=omega, y=own),
            Curve(look=_FLIGHT, x=omega, y=own * usable),
            *(Curve(look=look.called("") if of_a_phase else look, x=omega, y=y) for look, y in others.items()),
        )
        unit = f"({unit_of(flight.output) or '1'})/({unit_of(flight.input) or '1'})"
        gain = "gain [dB]" if unit in ("(1)/(1)", "(rad)/(rad)") else f"gain [dB] of {pretty(unit)}"
        bottom, top = _limits(flight, [own, *others.values()])
        label, step = ("phase [deg]", _TURN) if of_a_phase else (gain, None)
        y = Axis(label=label, low=bottom, high=top, step=step)
        panels.append(Panel(parts=parts, x=_frequency(flight), y=y, height=1.5))
    gain, phase = panels
    return gain, phase


def _coherence(flight: FrequencyResponse) -> Panel:
    """Return the coherence, with the limit below which it is grey."""
    least = np.maximum(USABLE, flight.by_chance) + np.zeros(len(flight.omega))
    parts = (
        *_unused(flight),
        Curve(look=_LEAST, x=flight.omega, y=least),
        Curve(look=replace(_FLIGHT, width=1.4), x=flight.omega, y=flight.coherence),
    )
    return Panel(parts=parts, x=_frequency(flight), y=Axis(label="coherence", low=0.0, high=1.03), height=0.95)


def _mismatch(comparison: ResponseComparison, drawn_so: Mapping[str, looks.Look]) -> list[Panel]:
    """Return the gain and the phase of models less those of flight, the envelope, and what is outside of it."""
    flight = comparison.flight
    envelope = comparison.envelope
    usable = np.where(flight.usable, 1.0, np.nan)
    panels = []
    for quantity, ending, unit in (("gain", "db", "dB"), ("phase", "deg", "deg")):
        parts: list[Part] = [*_unused(flight), Rule(look=replace(looks.ZERO, colour=looks.INK), at=0.0, axis="y")]
        if envelope is not None:
            low, high = (getattr(envelope, f"{quantity}_{end}_{ending}") for end in ("low", "high"))
            inside = looks.Look(name=f"envelope: {envelope.name}", colour=looks.GREEN, alpha=0.12)
            parts.append(Band(look=inside, x=envelope.omega, low=low, high=high))
            parts += [Curve(look=_BOUND, x=envelope.omega, y=bound) for bound in (low, high)]
        for name, one in comparison.mismatches.items():
            look = drawn_so[name].called("")
            values = getattr(one, f"{quantity}_{ending}")
            parts.append(Curve(look=look, x=flight.omega, y=values * usable))
            if one.within is not None:
                out = one.judged & ~one.within
                cross = replace(look, dash="", marker="x", size=5.0)
                parts.append(Curve(look=cross, x=flight.omega[out], y=values[out]))
        y = Axis(label=f"{quantity} of model less flight [{unit}]")
        panels.append(Panel(parts=tuple(parts), x=_frequency(flight), y=y, height=1.1))
    return panels


def _unused(flight: FrequencyResponse) -> list[Span]:
    """Return spans where the coherence is low."""
    edges = np.concatenate([flight.omega[:1], np.sqrt(flight.omega[1:] * flight.omega[:-1]), flight.omega[-1:]])
    return [
        Span(look=_UNUSED, low=float(edges[first]), high=float(edges[last + 1]))
        for first, last in stretches(~flight.usable)
    ]


def _nearest_turn(angle: np.ndarray, flight: FrequencyResponse) -> np.ndarray:
    """Return a phase [deg] moved by whole turns to where that of flight is."""
    return angle + 360.0 * np.round(np.median((flight.phase_deg - angle)[_used(flight)]) / 360.0)


def _used(flight: FrequencyResponse) -> np.ndarray:
    """Return where a response is usable; everywhere if it is nowhere."""
    return flight.usable | (not flight.usable.any())


def _limits(flight: FrequencyResponse, curves: list[np.ndarray]) -> tuple[float | None, float | None]:
    """Return limits that show what is usable; low coherence has no say."""
    values = np.concatenate([curve[_used(flight)] for curve in curves])
    values = values[np.isfinite(values)]
    if not len(values):
        return None, None
    margin = max(_MARGIN * float(np.ptp(values)), 1.0)
    return float(values.min()) - margin, float(values.max()) + margin


def _frequency(flight: FrequencyResponse) -> Axis:
    return Axis(label="frequency ω [rad/s]", log=True, low=float(flight.omega[0]), high=float(flight.omega[-1]))


_WIDEST = 4  # responses side by side


def plot(fit: ResponseFit) -> Any:
    """Return a column for each response, points measured, a line fitted, for a notebook."""
    columns = []
    (fitted_so,) = looks.of_models(["fitted"]).values()
    for label, one in fit.responses.items():
        fitted = fit.fitted[label]
        turn = 360.0 * np.round(np.mean(phase_deg(one.response) - phase_deg(fitted)) / 360.0)
        pair = []
        for name, measured, model in (
            ("gain [dB]", gain_db(one.response), gain_db(fitted)),
            ("phase [deg]", phase_deg(one.response), phase_deg(fitted) + turn),
        ):
            parts = (Curve(look=_POINTS, x=one.omega, y=measured), Curve(look=fitted_so, x=one.omega, y=model))
            title = "" if pair else f"{label} (J = {fit.costs[label]:.3g})"
            x = Axis(label="frequency ω [rad/s]", log=True)
            pair.append(Panel(parts=parts, x=x, y=Axis(label=name), title=title, height=1.8))
        columns.append(pair)
    beside = range(0, len(columns), _WIDEST)
    rows = [tuple(pair[part] for pair in columns[k : k + _WIDEST]) for k in beside for part in (0, 1)]
    return shown(Figure(rows=tuple(rows)))
