"""Figures of one cause: its shape, its onset, its frequency response, the time history that is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.missing_input import MissingInput, response
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import without
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import View
from casid.diagnosis.given.shape import Shape
from casid.diagnosis.kinematics.kinematics import WIND
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.frequency.response import FrequencyResponse, frequency_response
from casid.model.causes import configuration_change, group_channels
from casid.model.terms import parse_term
from casid.records.record import Record
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
    shown_unit,
)
from casid.report.words import EVIDENCE, place, pretty, pretty_term
from casid.signals import SURFACES, label_of, unit_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Reconstruction:
    """Station -> latent input there, by the re-estimated and by the extended model."""

    before: dict[str, MissingInput]
    after: dict[str, MissingInput]


def reconstruct(diagnosis: Diagnosis) -> Reconstruction:
    """Both sets of latent inputs by station."""
    return Reconstruction(before=_by_station(diagnosis.missing_before), after=_by_station(diagnosis.missing_after))


def derivatives_beside(fit: FlightFit, missing: MissingInput) -> dict[str, float]:
    """Fitted derivatives with the latent input in place, which they need not imitate any more: the mean of their joint
    posterior, by the linearisation of the input itself."""
    evidence = weigh(fit, discrepancy=False)
    series = np.zeros((*fit.batch.live.shape, 1))
    for r, record in enumerate(fit.flight.records):
        t, mean, _ = missing.history[record.name]
        series[: len(record), r, 0] = np.interp(record.t, t, mean)
    white = response(fit, missing.station, series)
    taken = fit.columns.reshape(fit.white.size, len(fit.slots)).T @ white.reshape(-1)
    values = fit.values + evidence.newton - evidence.covariance @ taken
    return {slot.name: float(value) for slot, value in zip(fit.slots, values, strict=True)}


def _by_station(found: Sequence[MissingInput]) -> dict[str, MissingInput]:
    return {one.station: one for one in found}


_STEPS = 11
_MAX_RECORDS = 3


def shape(diagnosis: Diagnosis, cause: Cause, before: Mapping[str, MissingInput]) -> Picture | None:
    """The missing coefficient as reconstructed against the regressor of the named term, with the named curve over it
    and without what the other derivatives changed by; None for a cause that is no aerodynamic term. `before`: latent
    inputs by station."""
    effect = cause.effect
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
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
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
    """(N, R) what the extended model adds at a station to the bare one that the latent input was added to: effects that
    enter there, and what the derivatives and terms of the coefficient differ by."""
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


_STEP = 0.25  # s
_MAX_ONSETS = 4


def onset(diagnosis: Diagnosis, cause: Cause) -> Picture | None:
    """Statistic of the cause over its time of onset, record by record, from the model that did not have it yet."""
    if not cause.onset_s or (found := _without(diagnosis, cause)) is None:
        return None
    base, attached = found
    profiles = onset_profiles(base, attached)
    records = [name for name in base.batch.names if name in cause.onset_s][:_MAX_ONSETS]
    figure = blank(1.6 * len(records) + 0.7)
    axes = figure.subplots(len(records), 1, squeeze=False)[:, 0]
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
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
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


def _without(diagnosis: Diagnosis, cause: Cause) -> tuple[FlightFit, Attached] | None:
    """The extended model without a cause, and the cause in it; None for one that it does not have."""
    fitted = diagnosis.extended.fit
    for one in fitted.attached:
        if one.effect.key == cause.key:
            return without(fitted, {one.name}), one
    return None


def onset_profiles(base: FlightFit, attached: Attached) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Record -> (times of onset [s], statistic of the cause if it began then), from a fit that does not have it."""
    effect = attached.effect
    if effect.members:
        effect = configuration_change(effect.members[0])
    effect = replace(effect, grid=({key: attached.values[key] for key in effect.grid[0]},))
    evidence = weigh(base)
    judge, names = Screen(evidence), base.batch.names
    longest = max(record.duration for record in base.flight.records)
    since = np.arange(_STEP, longest, _STEP)
    prints = fingerprints(evidence, [effect], since)
    table = {}
    for r, record in enumerate(base.flight.records):
        keep = np.eye(len(names))[r][None]
        inside = since < record.duration
        statistic = [judge.score([p], keep)[0] for p, i in zip(prints, inside, strict=True) if i]
        table[record.name] = (record.t[0] + since[inside], np.array(statistic))
    return table


_ANSWERS = {"delta_e": "q", "delta_a": "p", "delta_r": "r"}  # the channel that a surface moves first
_LEAST = 10  # usable frequencies, fewer of which are no diagram
_SHOWN = 8.0  # s of a time history


def cause_response(diagnosis: Diagnosis, cause: Cause) -> Picture | None:
    """Gain and phase of flight, of the file as given and of the extended model, beside their time histories.

    All are estimated in the same way, the models from their simulations, so that a cause that is not linear has one
    too. None for a cause that is neither at a surface nor in an instrument's time, and without enough coherence.
    """
    effect = cause.effect
    if effect.transfer is None and not effect.of_a_surface:
        return None
    before, after = diagnosis.as_given, diagnosis.extended
    best: tuple[FrequencyResponse, list[Record]] | None = None
    for surface, output in _pairs(group_channels(effect.target), before.fit.model.outputs):
        flown = _cut(cause, after.fit.flight.records)
        found = _response(flown, surface, output)
        if found is not None and (best is None or found.usable.sum() > best[0].usable.sum()):
            best = found, flown
    if best is None or best[0].usable.sum() < _LEAST:
        return None
    flight, flown = best
    models = {}
    for name, view in ((AS_GIVEN, before), (diagnosis.best, after)):
        records = _cut(cause, [_simulated(view, r, flight.output) for r in range(len(view.records))])
        answered = _response(records, flight.input, flight.output, flight)
        if answered is not None:
            models[name] = answered.response
    return _drawn(diagnosis, cause, flight, models) if diagnosis.best in models else None


def _pairs(channels: Sequence[str], outputs: Sequence[str]) -> Iterator[tuple[str, str]]:
    """(surface, reading) in whose response a cause at one of these channels shows."""
    for channel in channels:
        if channel in SURFACES:
            if _ANSWERS[channel] in outputs:
                yield channel, _ANSWERS[channel]
        elif channel in outputs:
            yield from ((surface, channel) for surface in SURFACES)
            return


def _cut(cause: Cause, records: Sequence[Record]) -> list[Record]:
    """The records that have the cause, from its onset on."""
    kept = [record for record in records if not cause.records or record.name in cause.records]
    onsets = cause.onset_s or {}
    return [r.between(onsets[r.name][1], float(r.t[-1])) if r.name in onsets else r for r in kept]


def _response(
    records: Sequence[Record], surface: str, output: str, like: FrequencyResponse | None = None
) -> FrequencyResponse | None:
    """The response of these records, with the frequencies and windows of another; None where there is none."""
    omega, windows = (like.omega, list(like.windows)) if like is not None else (None, None)
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            return frequency_response(records, surface, output, omega=omega, windows=windows)
        except (InputError, np.linalg.LinAlgError):
            return None


def _simulated(view: View, r: int, output: str) -> Record:
    """A record with what the simulation gives in place of the reading, missing where that is."""
    record = view.fit.flight.records[r]
    series = view.simulated.output[: len(record), r, view.fit.model.outputs.index(output)]
    return record.with_channels(**{output: np.where(np.isfinite(record[output]), series, np.nan)})


def _drawn(diagnosis: Diagnosis, cause: Cause, flight: FrequencyResponse, models: dict[str, np.ndarray]) -> Picture:
    figure = blank(4.4, WIDE)
    axes = figure.subplots(2, 2, width_ratios=[1.15, 1.0])
    draw_gain_and_phase(axes[0, 0], axes[1, 0], flight, models)
    axes[0, 0].sharex(axes[1, 0])
    axes[0, 0].tick_params(labelbottom=False)
    frequency_axis(axes[:, 0], flight)
    _histories(axes[0, 1], axes[1, 1], diagnosis, flight)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
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


def _histories(top, bottom, diagnosis: Diagnosis, flight: FrequencyResponse) -> None:
    """The reading above, the surface below, in the most informative part of a record."""
    before, after = diagnosis.as_given, diagnosis.extended
    r = worst_record(before, [flight.output])
    record = before.fit.flight.records[r]
    part = telling_window(before, after, [flight.output], r, _SHOWN)
    t, (factor, _) = record.t[part], channel_scale(flight.output)
    top.plot(t, factor * record[flight.output][part], color=MEASURED, lw=2.6, alpha=0.35)
    for view, colour, dash in ((before, BASELINE, "--"), (after, EXTENDED, "-")):
        series = view.simulated.output[part, r, view.fit.model.outputs.index(flight.output)]
        top.plot(t, factor * series, dash, color=colour, lw=1.3)
    bottom.plot(t, channel_scale(flight.input)[0] * record[flight.input][part], color=MEASURED, lw=1.2)
    for ax, channel in ((top, flight.output), (bottom, flight.input)):
        ax.set_ylabel(channel_axis(channel))
        ax.margins(x=0.01)
    top.set_title(f"record {record.name}", loc="left")
    top.tick_params(labelbottom=False)
    bottom.set_xlabel("time t [s]")
