"""Figures of one cause: its shape, its onset, its frequency response, the time history that is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.document import Document, History, ReportedCause
from casid.diagnosis.given.shape import Shape
from casid.model.station import Station
from casid.model.terms import bare, parse_term
from casid.report import looks
from casid.report.figure import TIME, WIDE, Axis, Band, Curve, Figure, Panel, Picture, Rule, Span, history, stacked
from casid.report.history_figures import compared, telling_window, worst_record
from casid.report.response_figures import gain_and_phase
from casid.report.statements import numbered
from casid.report.words import EVIDENCE, place, pretty, pretty_term, shown_unit
from casid.signals import label_of, unit_of

_STEPS = 11
_MAX_RECORDS = 3
_MEANS = looks.Look(name="their mean in steps, ±2σ", colour=looks.INK, dash="", marker="o", size=6.0)
_NAMED = looks.Look(name="the named term", colour=looks.BLUE, width=2.5)
_PUT_THERE = looks.EXPLAINED.called("what the named causes put there")
_RECONSTRUCTED = looks.EXTENDED.called("reconstructed, form unknown")


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
    points = [one * (scale, 1.0, 1.0) for one in term.points.values()]
    clouds = [
        Curve(look=replace(looks.each(r, f"reconstructed, {name}"), alpha=0.4), x=one[:, 0], y=one[:, 1])
        for r, (name, one) in enumerate(zip(term.points, points, strict=True))
    ]
    cloud = np.concatenate(points)
    x, y, error = _binned(cloud)
    line = np.linspace(cloud[:, 0].min(), cloud[:, 0].max(), 200)
    panel = Panel(
        parts=(
            *clouds,
            Curve(look=_NAMED, x=line, y=cause.value * _power(regressor, line / scale)),
            Curve(look=_MEANS, x=x, y=y, std=error),
        ),
        x=Axis(label=label),
        y=Axis(label=f"missing {where}"),
        height=3.3,
    )
    of = pretty_term(cause.term) if cause.term else "its rate"
    return Picture(
        name="shape",
        figure=Figure(rows=((panel,),)),
        title=f"The missing {where} follows {of}",
        caption=f"Dots: an unknown {cause.target}(t), reconstructed from the records before any cause was named and "
        "without knowing its form, less the changes of the other derivatives. Line: the term that was named, with "
        "its fitted factor.",
        alt=f"Scatter of the reconstructed missing {where} over {of}; the curve of the named term "
        "runs through the dots.",
    )


def unexplained_shapes(shapes: Sequence[Shape]) -> Iterator[Picture]:
    """Every curve of what is unexplained at a coefficient, with its band."""
    for number, one in enumerate(shapes, 1):
        rate = one.over in ("p", "q", "r")
        scale, unit = (1.0, "1") if rate else shown_unit(unit_of(one.over))
        x = one.x * scale
        panel = Panel(
            parts=(
                Band(look=looks.DEVIATION, x=x, low=one.y - 2.0 * one.std, high=one.y + 2.0 * one.std),
                Rule(look=looks.ZERO, at=0.0, axis="y"),
                Curve(look=looks.EXTENDED.called("curve of the fitted records"), x=x, y=one.y),
            ),
            x=Axis(label=f"{one.over} [{unit}]" if unit not in ("", "1") else one.over),
            y=Axis(label=f"missing {one.coefficient}{f' over {one.times}' if one.times else ''}"),
            height=2.6,
        )
        depends = f"{one.times} times a function of {one.over}" if one.times else f"a function of {one.over}"
        yield Picture(
            name=numbered("unexplained_shape", number),
            figure=Figure(rows=((panel,),)),
            title=f"The missing {one.coefficient} has the shape of {depends}",
            caption=f"A smooth curve through what is missing in the fitted records. On held-out records it leaves "
            f"{100.0 / one.held_out:.0f} % of the missing {one.coefficient}. It describes what is missing and "
            "names no cause; its straight line is shared with the derivatives.",
            alt=f"Curve of the missing {one.coefficient} over {one.over}, with a band of two deviations.",
        )


def missing_history(station: str, histories: Sequence[History], curve: bool, name: str = "missing_history") -> Picture:
    """A reconstructed input at a port in time with its ±2σ band; with `curve`, what the named causes put there."""
    at = Station.at(station)
    wind = at.kind == "wind"
    chosen = _liveliest(histories)
    panels = []
    for one in chosen:
        unseen = np.mean(one.mean) - np.mean(one.named) if wind else 0.0  # a steady wind is not seen
        named = (Curve(look=_PUT_THERE, x=one.t, y=one.named + unseen),) if curve else ()
        parts = (
            Band(look=looks.DEVIATION, x=one.t, low=one.mean - 2 * one.sigma, high=one.mean + 2 * one.sigma),
            Rule(look=looks.ZERO, at=0.0, axis="y"),
            Curve(look=_RECONSTRUCTED, x=one.t, y=one.mean),
            *named,
        )
        y = Axis(label="wind [m/s]" if wind else f"missing {at.name}")
        panels.append(Panel(parts=parts, x=TIME, y=y, title=one.record, height=1.5))
    where = place(station)
    entering = "at the" if at.kind == "reading" else "as"
    return Picture(
        name=name,
        figure=Figure(rows=stacked(panels), linked=False, alike=True),
        title=f"What is missing enters {entering} {where}",
        caption=f"An unknown time history of the {where} that would make simulation and measurement agree, "
        "reconstructed without knowing its form.",
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
    named = looks.Look(name=f"± r.m.s. of the turbulence, {sigma:.2g} m/s", colour="#FBE3D0")
    panels = [
        Panel(
            parts=(
                Span(look=named, low=-sigma, high=sigma, axis="y"),
                Curve(look=looks.EXTENDED.called("reconstructed velocity"), x=record.t, y=velocity),
            ),
            x=TIME,
            y=Axis(label="velocity [m/s]"),
            title=place(station),
        )
        for station, velocity in gusts.velocity.items()
    ]
    return Picture(
        name="wind",
        figure=Figure(rows=stacked(panels), alike=True),
        title=f"The air moves (record {record.name})",
        caption="Most likely gust velocities, given the extended model and everything that was measured. Their r.m.s. "
        "was named from kinematics, which hold whatever the aerodynamics are.",
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
    factor, shown = shown_unit("1" if bare(variable) in ("p", "q", "r") else unit_of(bare(variable)))
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


_MAX_ONSETS = 4


def onset(cause: ReportedCause) -> Picture | None:
    """Statistic of the cause over its time of onset, record by record, from the model that did not have it yet."""
    if not cause.onset_s or not cause.onsets:
        return None
    records = [name for name in cause.onsets if name in cause.onset_s][:_MAX_ONSETS]
    panels = []
    for name in records:
        t, statistic = cause.onsets[name]
        low, high = cause.onset_s[name]
        middle = 0.5 * (low + high)
        parts = (
            Span(
                look=looks.Look(name="95 % interval of the onset", colour=looks.YELLOW, alpha=0.35), low=low, high=high
            ),
            Rule(look=looks.Look(colour=looks.INK), at=middle),
            Curve(look=looks.EXTENDED.called("evidence, the size being fitted"), x=t, y=statistic),
        )
        title = f"{name}: {middle:.1f} s (between {low:.1f} and {high:.1f} s)"
        x = Axis(label="time of onset t [s]")
        panels.append(Panel(parts=parts, x=x, y=Axis(label="evidence", low=0.0), title=title))
    times = ", ".join(f"{0.5 * sum(cause.onset_s[n]):.1f} s in {n}" for n in records)
    name = pretty(cause.title)
    return Picture(
        name="onset",
        figure=Figure(rows=stacked(panels), linked=False),
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
    shown = {} if answer.given is None else {looks.GIVEN: answer.given}
    shown[looks.EXTENDED.called(document.best)] = answer.extended
    flight = answer.flight
    gain, phase = gain_and_phase(flight, shown)
    view = document.as_given
    r = worst_record(view, [flight.output])
    part = telling_window(view, document.extended, [flight.output], r, _SHOWN)
    record = view.records[r]
    above = replace(compared(document, flight.output, r, part), title=f"record {record.name}")
    below = history(flight.input, record.t[part], {looks.INPUT: record[flight.input][part]})
    name = pretty(cause.title)
    since = " Only what was flown from the onset on is in it." if cause.onset_s else ""
    return Picture(
        name="bode",
        figure=Figure(rows=((gain, above), (phase, below)), width=WIDE, widths=(1.15, 1.0)),
        title=f"{name}, as gain and phase",
        caption=f"Left: response of the {label_of(flight.output)} {flight.output} to the {label_of(flight.input)} "
        f"{flight.input} over frequency, estimated alike from flight and from the simulations with the recorded "
        f"inputs. Grey: coherence below 0.6, not to be used. Right: the same in time.{since}",
        alt=f"Bode diagram of {flight.output} to {flight.input}: measured, {', '.join(one.name for one in shown)}; "
        "and time histories.",
    )
