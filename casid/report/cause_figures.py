"""Figures of one cause: its shape, its onset, its frequency response, the time history that is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from casid.diagnosis.document import Document, History, ReportedCause
from casid.diagnosis.given.shape import Shape
from casid.frequency.response import FrequencyResponse
from casid.model.station import Station
from casid.model.terms import parse_term
from casid.report.history_figures import AS_GIVEN, telling_window, worst_record
from casid.report.response_figures import draw_gain_and_phase, frequency_axis
from casid.report.style import (
    BASELINE,
    EXTENDED,
    FAINT,
    MEASURED,
    RECORD_COLOURS,
    RECORD_MARKERS,
    WIDE,
    Picture,
    blank,
    channel_axis,
    channel_scale,
    draw_channel,
    legend,
    shown_unit,
    stacked,
)
from casid.report.words import EVIDENCE, place, pretty, pretty_term
from casid.signals import label_of, unit_of

_STEPS = 11
_MAX_RECORDS = 3


def shape(cause: ReportedCause) -> Picture | None:
    """The reconstructed missing coefficient against the regressor of the named term, with the named curve over it.

    None for a cause that is no aerodynamic term.
    """
    term = cause.shape
    regressor = cause.regressor
    if regressor is None or term is None:
        return None
    where = place(cause.enters)
    label, scale = _abscissa(term.variable)
    figure = blank(4.4)
    ax = figure.subplots()
    points = [one * (scale, 1.0, 1.0) for one in term.points.values()]
    for r, (name, one) in enumerate(zip(term.points, points, strict=True)):
        ax.plot(
            one[:, 0],
            one[:, 1],
            RECORD_MARKERS[r % 6],
            color=RECORD_COLOURS[r % 6],
            ms=4,
            alpha=0.4,
            mew=0,
            label=f"reconstructed, {name}",
        )
    cloud = np.concatenate(points)
    x, y, error = _binned(cloud)
    ax.errorbar(x, y, error, fmt="o", color=MEASURED, ms=6, capsize=3, zorder=4, label="their mean in steps, ±2σ")
    line = np.linspace(cloud[:, 0].min(), cloud[:, 0].max(), 200)
    ax.plot(
        line,
        cause.value * _power(regressor, line / scale),
        color=BASELINE,
        lw=2.5,
        zorder=3,
        label="the named term",
    )
    ax.set_xlabel(label)
    ax.set_ylabel(f"missing {where}")
    legend(figure, [ax], 2, markerscale=1.3)
    of = pretty_term(cause.term) if cause.term else "its rate"
    return Picture(
        name="shape",
        figure=figure,
        title=f"The missing {where} follows {of}",
        caption=(
            f"Dots: an unknown {cause.target}(t), reconstructed from the records before any cause was named and "
            "without knowing its form, less the changes of the other derivatives. Line: the term that was named, with "
            "its fitted factor."
        ),
        alt=f"Scatter of the reconstructed missing {where} over {of}; the curve of the named term "
        "runs through the dots.",
    )


def unexplained_shapes(shapes: Sequence[Shape]) -> Iterator[Picture]:
    """Every curve of what is unexplained at a coefficient, with its band."""
    for number, one in enumerate(shapes, 1):
        rate = one.over in ("p", "q", "r")
        scale, unit = (1.0, "1") if rate else shown_unit(unit_of(one.over))
        figure = blank(3.6)
        ax = figure.subplots()
        x = one.x * scale
        ax.fill_between(x, one.y - 2.0 * one.std, one.y + 2.0 * one.std, color="#BBD7EA", lw=0, label="±2σ")
        ax.plot(x, one.y, color=EXTENDED, lw=2, label="curve of the fitted records")
        ax.axhline(0.0, color=FAINT, lw=0.8)
        ax.set_xlabel(f"{one.over} [{unit}]" if unit not in ("", "1") else one.over)
        ax.set_ylabel(f"missing {one.coefficient}{f' over {one.times}' if one.times else ''}")
        legend(figure, [ax], 2)
        depends = f"{one.times} times a function of {one.over}" if one.times else f"a function of {one.over}"
        yield Picture(
            name="unexplained_shape" if number == 1 else f"unexplained_shape-{number}",
            figure=figure,
            title=f"The missing {one.coefficient} has the shape of {depends}",
            caption=(
                f"A smooth curve through what is missing in the fitted records. On held-out records it leaves "
                f"{100.0 / one.held_out:.0f} % of the missing {one.coefficient}. It describes what is missing and "
                "names no cause; its straight line is shared with the derivatives."
            ),
            alt=f"Curve of the missing {one.coefficient} over {one.over}, with a band of two deviations.",
        )


def missing_history(station: str, histories: Sequence[History], curve: bool, name: str = "missing_history") -> Picture:
    """A reconstructed input at a port in time with its ±2σ band; with `curve`, what the named causes put there."""
    at = Station.at(station)
    wind = at.kind == "wind"
    chosen = _liveliest(histories)
    figure, axes = stacked([1.75] * len(chosen), sharex=False, sharey=True)
    for ax, one in zip(axes, chosen, strict=True):
        ax.fill_between(one.t, one.mean - 2 * one.sigma, one.mean + 2 * one.sigma, color="#BBD7EA", lw=0, label="±2σ")
        ax.plot(one.t, one.mean, color=EXTENDED, label="reconstructed, form unknown")
        if curve:
            curve_here = _centred(one.named, one.mean, wind)
            ax.plot(one.t, curve_here, "--", color=BASELINE, lw=2, label="what the named causes put there")
        ax.axhline(0.0, color=FAINT, lw=0.8)
        ax.set_title(one.record, loc="left")
        ax.set_ylabel("[m/s]" if wind else f"missing {at.name}")
        ax.set_xlabel("time t [s]" if one is chosen[-1] else "")
    legend(figure, axes, 2)
    where = place(station)
    entering = "at the" if at.kind == "reading" else "as"
    return Picture(
        name=name,
        figure=figure,
        title=f"What is missing enters {entering} {where}",
        caption=(
            f"An unknown time history of the {where} that would make simulation and measurement agree, reconstructed "
            "without knowing its form."
        ),
        alt=f"Reconstructed missing {where} over time in {len(chosen)} records, with its uncertainty"
        + (" and the history that the named causes put there." if curve else "."),
    )


def wind(document: Document) -> Picture | None:
    """The moving air of a turbulent record: its components by the filter's smoother, and the r.m.s. that was named."""
    gusts = document.gusts
    if gusts is None:
        return None
    record = gusts.record
    sigma = gusts.sigma
    figure, axes = stacked([1.6] * len(gusts.velocity), sharey=True)
    for ax, (station, velocity) in zip(axes, gusts.velocity.items(), strict=True):
        ax.axhspan(-sigma, sigma, color="#FBE3D0", lw=0, label=f"± r.m.s. of the turbulence, {sigma:.2g} m/s")
        ax.plot(record.t, velocity, color=EXTENDED, label="reconstructed velocity")
        ax.set_title(place(station), loc="left")
        ax.set_ylabel("[m/s]")
        ax.margins(x=0.01)
    axes[-1].set_xlabel("time t [s]")
    legend(figure, axes, 2)
    return Picture(
        name="wind",
        figure=figure,
        title=f"The air moves (record {record.name})",
        caption=(
            "Most likely gust velocities, given the extended model and everything that was measured. Their r.m.s. was "
            "named from kinematics, which hold whatever the aerodynamics are."
        ),
        alt=f"Reconstructed gust velocity along three axes over time in record {record.name}, with a band of the named "
        f"r.m.s. velocity, {sigma:.2g} m/s.",
    )


def _abscissa(variable: str) -> tuple[str, float]:
    """(axis label, factor to what is shown) of the one variable of a term, or of the term itself."""
    term = parse_term(variable)
    if term.degree > 1 or term.stretches:
        return f"{pretty_term(term.name)} [rad{'²³'[term.degree - 2]}]", 1.0
    if variable.endswith("dot"):
        return f"dimensionless rate of {variable[:-3]} [1]", 1.0
    factor, shown = shown_unit(unit_of(variable) if variable not in ("p", "q", "r") else "1")
    return f"{variable} [{shown}]", factor


def _power(regressor: str, x: np.ndarray) -> np.ndarray:
    """Return the value of a term over its variable; a term of several variables is the abscissa itself."""
    term = parse_term(regressor)
    if term.stretches:
        return term.stretches[0].evaluate(x)
    return x ** term.factors[0][1] if len(term.factors) == 1 else x


def _binned(cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(x, y, 2-sigma of y) of what lies in equal steps of x, weighted by 1/sigma²; steps with two dots at least."""
    edges = np.linspace(cloud[:, 0].min(), cloud[:, 0].max(), _STEPS + 1)
    step = np.clip(np.searchsorted(edges, cloud[:, 0], side="right") - 1, 0, _STEPS - 1)
    rows = []
    for group in (cloud[step == k] for k in range(_STEPS)):
        if len(group) < 2:
            continue
        weight = 1.0 / np.maximum(group[:, 2], 1e-12) ** 2
        mean = np.average(group[:, :2], axis=0, weights=weight)
        scatter = np.sqrt(np.average((group[:, 1] - mean[1]) ** 2, weights=weight) / (len(group) - 1))
        rows.append((*mean, 2.0 * max(scatter, weight.sum() ** -0.5)))
    x, y, error = np.array(rows).T if rows else np.zeros((3, 0))
    return x, y, error


def _liveliest(histories: Sequence[History]) -> list[History]:
    """Up to three records in which the input is largest, in their own order."""
    largest = sorted(histories, key=lambda one: -float(np.mean(one.mean**2)))[:_MAX_RECORDS]
    return [one for one in histories if one in largest]


def _centred(curve: np.ndarray, mean: np.ndarray, wind: bool) -> np.ndarray:
    """A steady wind is not seen; the curve is shown with the mean of the reconstruction."""
    return curve - np.mean(curve) + np.mean(mean) if wind else curve


_MAX_ONSETS = 4


def onset(cause: ReportedCause) -> Picture | None:
    """Statistic of the cause over its time of onset, record by record, from the model that did not have it yet."""
    if not cause.onset_s or not cause.onsets:
        return None
    profiles = cause.onsets
    records = [name for name in profiles if name in cause.onset_s][:_MAX_ONSETS]
    figure, axes = stacked([1.6] * len(records), sharex=False)
    for ax, name in zip(axes, records, strict=True):
        t, statistic = profiles[name]
        low, high = cause.onset_s[name]
        middle = 0.5 * (low + high)
        ax.axvspan(low, high, color=BASELINE, alpha=0.35, lw=0, label="95 % interval of the onset")
        ax.axvline(middle, color=BASELINE, lw=1.2)
        ax.plot(t, statistic, color=EXTENDED, label="evidence, the size being fitted")
        ax.set_title(f"{name}: {middle:.1f} s (between {low:.1f} and {high:.1f} s)", loc="left")
        ax.set_ylim(bottom=0.0)
        ax.set_ylabel("evidence")
    axes[-1].set_xlabel("time of onset t [s]")
    legend(figure, axes, 2)
    times = ", ".join(f"{0.5 * sum(cause.onset_s[n]):.1f} s in {n}" for n in records)
    name = pretty(cause.title)
    return Picture(
        name="onset",
        figure=figure,
        title=f"When it set in: {name}",
        caption="How well the cause explains each record when it is made to begin at the time on the axis. Where the "
        f"curve is flat, nothing happened that could tell the times apart. {EVIDENCE}",
        alt=f"Likelihood over the time of onset of {name}; its peaks lie at {times}.",
    )


_LEAST = 10  # usable frequencies, fewer of which are no diagram
_SHOWN = 8.0  # s of a time history


def cause_response(document: Document, cause: ReportedCause) -> Picture | None:
    """Gain and phase of flight, of the file as given and of the extended model, beside their time histories; None where
    the records give no response with enough coherence."""
    answer = cause.answer
    if answer is None or answer.flight.usable.sum() < _LEAST:
        return None
    models = {AS_GIVEN: answer.given, document.best: answer.extended}
    shown = {name: response for name, response in models.items() if response is not None}
    return _drawn(document, cause, answer.flight, shown)


def _drawn(
    document: Document, cause: ReportedCause, flight: FrequencyResponse, models: dict[str, np.ndarray]
) -> Picture:
    figure = blank(4.4, WIDE)
    axes = figure.subplots(2, 2, width_ratios=[1.15, 1.0])
    draw_gain_and_phase(axes[0, 0], axes[1, 0], flight, models)
    axes[0, 0].sharex(axes[1, 0])
    axes[0, 0].tick_params(labelbottom=False)
    frequency_axis(axes[:, 0], flight)
    _histories(axes[0, 1], axes[1, 1], document, flight)
    legend(figure, [axes[0, 0]], 4)
    name = pretty(cause.title)
    since = " Only what was flown from the onset on is in it." if cause.onset_s else ""
    return Picture(
        name="bode",
        figure=figure,
        title=f"{name}, as gain and phase",
        caption=f"Left: response of the {label_of(flight.output)} {flight.output} to the {label_of(flight.input)} "
        f"{flight.input} over frequency, estimated alike from flight and from the simulations with the recorded "
        f"inputs. Grey: coherence below 0.6, not to be used. Right: the same in time.{since}",
        alt=f"Bode diagram of {flight.output} to {flight.input}: flight, {', '.join(models)}; and time histories.",
        wide=True,
    )


def _histories(top, bottom, document: Document, flight: FrequencyResponse) -> None:
    """The reading above, the surface below, in the most informative part of a record."""
    before = document.as_given
    after = document.extended
    r = worst_record(before, [flight.output])
    record = before.records[r]
    part = telling_window(before, after, [flight.output], r, _SHOWN)
    t = record.t[part]
    i = before.outputs.index(flight.output)
    curves = {AS_GIVEN: before.output[part, r, i], document.best: after.output[part, r, i]}
    draw_channel(top, flight.output, t, record[flight.output][part], curves)
    bottom.plot(t, channel_scale(flight.input)[0] * record[flight.input][part], color=MEASURED, lw=1.2)
    bottom.set_ylabel(channel_axis(flight.input))
    bottom.margins(x=0.01)
    top.set_title(f"record {record.name}", loc="left")
    top.tick_params(labelbottom=False)
    bottom.set_xlabel("time t [s]")
