"""The shape of what is missing: the reconstructed coefficient or wind against its regressor and in time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.kinematics.kinematics import WIND
from casid.diagnosis.result import Diagnosis
from casid.model.effects import effect_of
from casid.model.terms import parse_term
from casid.report.reconstruction import derivatives_beside
from casid.report.style import (
    BASELINE,
    EXTENDED,
    FAINT,
    MEASURED,
    RECORD_COLOURS,
    RECORD_MARKERS,
    Picture,
    blank,
    shown_unit,
)
from casid.report.words import place, pretty_term
from casid.signals import unit_of

_STEPS = 11
_MAX_RECORDS = 3


def shape(diagnosis: Diagnosis, cause: Cause, before: Mapping[str, MissingInput]) -> Picture | None:
    """The reconstructed missing coefficient against the regressor of the named term, with the named curve over it.

    `before`: latent inputs by station, before naming. The changes of the other derivatives that came with
    the term are taken off it, so that the term alone is left. None for a cause that is no aerodynamic term.
    """
    effect = effect_of(cause)
    missing = before.get(effect.enters or "")
    if effect.regressor is None or missing is None:
        return None
    fit = diagnosis.extended.fit
    own = cause.value * _series(fit, effect.regressor)
    others = named_series(diagnosis, missing) - own
    variable, label, scale = _abscissa(fit, effect.regressor)
    figure = blank(4.4)
    ax = figure.subplots()
    points = []
    for r, (t, mean, sigma) in enumerate(missing.history[name] for name in fit.batch.names):
        x, rest = _at(fit, variable, r, t) * scale, _at(fit, others, r, t)
        points.append(np.stack([x, mean - rest, sigma], axis=1))
        ax.plot(
            x,
            mean - rest,
            RECORD_MARKERS[r % 6],
            color=RECORD_COLOURS[r % 6],
            ms=4,
            alpha=0.4,
            mew=0,
            label=f"reconstructed, {fit.batch.names[r]}",
        )
    cloud = np.concatenate(points)
    x, y, error = _binned(cloud)
    ax.errorbar(x, y, error, fmt="o", color=MEASURED, ms=6, capsize=3, zorder=4, label="their mean in steps, ±2σ")
    line = np.linspace(cloud[:, 0].min(), cloud[:, 0].max(), 200)
    ax.plot(
        line,
        cause.value * _power(effect.regressor, line / scale),
        color=BASELINE,
        lw=2.5,
        zorder=3,
        label="the named term",
    )
    ax.set_xlabel(label)
    ax.set_ylabel(f"missing {place(missing.station)}")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2, markerscale=1.3)
    term = pretty_term(cause.term) if cause.term else "its rate"
    return Picture(
        name="shape",
        figure=figure,
        title=f"The missing {place(missing.station)} follows {term}",
        caption=(
            f"Dots: an unknown {cause.target}(t), reconstructed from the records before any cause was named and "
            "without knowing its form, less the changes of the other derivatives. Line: the term that was named, with "
            "its fitted factor."
        ),
        alt=f"Scatter of the reconstructed missing {place(missing.station)} over {term}; the curve of the named term "
        "runs through the dots.",
    )


def missing_history(diagnosis: Diagnosis, missing: MissingInput, curve: bool, name: str = "missing_history") -> Picture:
    """A reconstructed input in time with its ±2σ band; with `curve`, what the named causes put there."""
    fit = diagnosis.extended.fit if curve else diagnosis.refitted.fit
    if not missing.concerns(fit.batch.names):
        fit = diagnosis.held_out_extended.fit
    wind = missing.place.kind == "wind"
    named = named_series(diagnosis, missing) if curve else np.zeros(fit.batch.live.shape)
    chosen = _liveliest(missing, fit)
    figure = blank(1.75 * len(chosen) + 0.7)
    axes = figure.subplots(len(chosen), 1, squeeze=False, sharey=True)[:, 0]
    for ax, r in zip(axes, chosen, strict=True):
        t, mean, sigma = missing.history[fit.batch.names[r]]
        ax.fill_between(t, mean - 2 * sigma, mean + 2 * sigma, color="#BBD7EA", lw=0, label="±2σ")
        ax.plot(t, mean, color=EXTENDED, label="reconstructed, form unknown")
        if curve:
            curve_here = _centred(_at(fit, named, r, t), mean, wind)
            ax.plot(t, curve_here, "--", color=BASELINE, lw=2, label="what the named causes put there")
        ax.axhline(0.0, color=FAINT, lw=0.8)
        ax.set_title(fit.batch.names[r], loc="left")
        ax.set_ylabel("[m/s]" if wind else f"missing {missing.place.name}")
        ax.set_xlabel("time t [s]" if r == chosen[-1] else "")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    where, entering = place(missing.station), "at the" if missing.place.kind == "reading" else "as"
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


def wind(diagnosis: Diagnosis) -> Picture:
    """The moving air of a turbulent record: its components by the filter's smoother, and the r.m.s. that was named."""
    sigma, fit = diagnosis.turbulence.sigma, diagnosis.extended.fit
    # behind them stand the rotation of the air, and noise of inputs that passed through an effect
    stations = [station for station in fit.noise.coloured if station in WIND]
    gusts = fit.motion.coloured[..., : len(stations)]
    r = int(np.argmax([np.mean(gusts[: len(record), k] ** 2) for k, record in enumerate(fit.flight.records)]))
    record = fit.flight.records[r]
    figure = blank(1.6 * len(stations) + 0.7)
    axes = figure.subplots(len(stations), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for i, (ax, station) in enumerate(zip(axes, stations, strict=True)):
        ax.axhspan(-sigma, sigma, color="#FBE3D0", lw=0, label=f"± r.m.s. of the turbulence, {sigma:.2g} m/s")
        ax.plot(record.t, gusts[: len(record), r, i], color=EXTENDED, label="reconstructed velocity")
        ax.set_title(place(station), loc="left")
        ax.set_ylabel("[m/s]")
        ax.margins(x=0.01)
    axes[-1].set_xlabel("time t [s]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
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


def named_series(diagnosis: Diagnosis, missing: MissingInput) -> np.ndarray:
    """(N, R) what the extended model adds at a station to the bare one that the latent input was added to.

    Effects that enter there, and what the derivatives and terms of the coefficient differ by: both models then give the
    coefficient the same value where the extension is right.
    """
    before, after = diagnosis.bare, diagnosis.extended.fit
    total = after.disturbances[..., after.model.disturbances.index(missing.station)].copy()
    if missing.place.kind == "wind":
        return total
    coefficient, beside = missing.place.name, derivatives_beside(before, missing)
    for name, value in after.derivatives.items():
        owner, _, term = name.partition("_")
        if owner == coefficient and name in beside and "dot" not in term:
            total += (value - beside[name]) * parse_term(term).evaluate(after.regressors)
    terms = [(one, one.values["value"]) for one in after.attached]
    terms += [(one, -beside[one.name]) for one in before.attached if one.name in beside]
    for one, value in terms:
        if one.effect.regressor is not None and one.effect.target == coefficient:
            total += value * _series(after, one.effect.regressor)
    return total


def _series(fit: FlightFit, term: str) -> np.ndarray:
    return np.broadcast_to(parse_term(term).evaluate(fit.regressors), fit.batch.live.shape)


def _abscissa(fit: FlightFit, regressor: str) -> tuple[np.ndarray, str, float]:
    """(series, axis label, factor to what is shown): the one variable of the term, or the term itself."""
    term = parse_term(regressor)
    variables = [name for name, _ in term.factors] or [one.variable for one in term.stretches[:1]]
    if len(variables) == 1:
        variable = variables[0]
        if variable.endswith("dot"):
            return _series(fit, variable), f"dimensionless rate of {variable[:-3]} [1]", 1.0
        unit = unit_of(variable) if variable not in ("p", "q", "r") else "1"
        factor, shown = shown_unit(unit)
        return _series(fit, variable), f"{variable} [{shown}]", factor
    return _series(fit, regressor), f"{pretty_term(term.name)} [rad{'²³'[term.degree - 2]}]", 1.0


def _power(regressor: str, x: np.ndarray) -> np.ndarray:
    """What the term makes of its variable; of a term of several, which is the abscissa itself, that."""
    term = parse_term(regressor)
    if term.stretches:
        return term.stretches[0].evaluate(x)
    return x ** term.factors[0][1] if len(term.factors) == 1 else x


def _at(fit: FlightFit, series: np.ndarray, r: int, t: np.ndarray) -> np.ndarray:
    """A time history at the nodes of a latent input: averaged over the triangle about each node."""
    record = fit.flight.records[r]
    weight = np.maximum(0.0, 1.0 - np.abs(record.t[:, None] - t) / (t[1] - t[0]))
    return weight.T @ series[: len(record), r] / weight.sum(axis=0)


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


def _liveliest(missing: MissingInput, fit: FlightFit) -> list[int]:
    """Up to three records in which the input is largest, in their own order."""
    size = {r: float(np.mean(missing.history[name][1] ** 2)) for r, name in enumerate(fit.batch.names)}
    return sorted(sorted(size, key=lambda r: -size[r])[:_MAX_RECORDS])


def _centred(curve: np.ndarray, mean: np.ndarray, wind: bool) -> np.ndarray:
    """A steady wind is not seen; the curve is shown with the mean of the reconstruction."""
    return curve - np.mean(curve) + np.mean(mean) if wind else curve
