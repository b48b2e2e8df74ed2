"""Arrays and words of a document: all linearisations for a page are here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.document import Answer, Detectable, Gusts, History, Ranked, ReportedCause, Simulated, Term, Tried
from casid.diagnosis.engine.trial import Round
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.missing_input import MissingInput, response
from casid.diagnosis.evidence.screening import Candidate, Screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import without
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import View
from casid.diagnosis.kinematics.turbulence import WIND
from casid.errors import InputError
from casid.frequency.response import FrequencyResponse, frequency_response
from casid.model.causes.aerodynamics import configuration_change
from casid.model.causes.instruments import group_channels
from casid.model.effect import Effect, with_grid
from casid.model.effects import effect_named
from casid.model.terms import parse_term
from casid.model.vocabulary import title_of
from casid.records.record import Record
from casid.signals import SURFACES


def simulated_of(view: View, figures: bool = True) -> Simulated:
    """The simulation of a view. Innovations and bands are for `figures`, and empty without."""
    fit = view.fit
    model = view.fit.model
    records = tuple(fit.flight.records)
    fastest = 0.5 / max(record.dt for record in records)
    bands = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # Hz, their edges; the records hold some of them
    edges = np.array([edge for edge in bands if edge < fastest and figures])
    of_aircraft = fit.flight.coefficients
    return Simulated(
        records=records,
        outputs=tuple(model.outputs),
        inputs=tuple(model.inputs),
        units={} if of_aircraft else {name: model.units.get(name, "") for name in model.outputs},
        channels=view.channels,
        output=view.simulated.output,
        residual=view.simulated.residual,
        white=fit.white if figures else np.zeros((0, 0, 0)),
        log_likelihood=view.log_likelihood,
        samples=view.samples,
        bands=edges,
        energy=view.band_energy(edges) if figures else np.zeros((0, 0)),
    )


def reported(cause: Cause, **curves: Any) -> ReportedCause:
    """A cause in words and numbers, with its `curves`."""
    own = {one.name for one in fields(ReportedCause)} - {"enters", "regressor", "stochastic"}
    effect = cause.effect
    return ReportedCause(
        **{name: getattr(cause, name) for name in own if hasattr(cause, name)},
        enters=effect.enters or "",
        regressor=effect.regressor,
        stochastic=effect.stochastic,
        **curves,
    )


def drawn_cause(
    cause: Cause, bare: FlightFit, views: tuple[View, View], missing: Mapping[str, MissingInput]
) -> ReportedCause:
    """A cause with what its figures show: `views` as given and extended, and what was `missing` by port in the `bare`
    model, before any cause was named."""
    if cause.effect.stochastic:
        return reported(cause)
    extended = views[1].fit
    there = missing.get(cause.effect.enters or "")
    named = None if there is None else named_series(bare, extended, there)
    return reported(
        cause,
        shape=None if there is None or named is None else _term(extended, cause, there, named),
        onsets=_onsets(extended, cause),
        answer=_answer(cause, *views),
        histories=() if there is None else tuple(histories_of(extended, there, named)),
    )


def tried_of(rounds: Sequence[Round]) -> Iterator[Tried]:
    """The causes that were fitted, round by round."""
    for number, round_ in enumerate(rounds, 1):
        for place, trial in enumerate(round_.trials):
            yield Tried(
                round=number,
                name=trial.candidate.name,
                title=title_of(trial.effect),
                key=trial.effect.key,
                value=trial.candidate.attached.values["value"],
                unit=trial.effect.unit,
                statistic=trial.gain.raw,
                named=place == 0 and round_.named,
                refuted=trial.refuted,
                meaningful=trial.meaningful,
            )


def alike_of(rounds: Sequence[Round]) -> tuple[tuple[str, ...], np.ndarray]:
    """Titles of the causes fitted in the first round, and |cos| between their fingerprints."""
    trials = [one for one in rounds[0].trials if one.fingerprint.size] if rounds else []
    if not trials:
        return (), np.zeros((0, 0))
    prints = np.stack([one.fingerprint for one in trials], axis=1).astype(float)
    prints /= np.maximum(np.linalg.norm(prints, axis=0), 1e-300)
    return tuple(title_of(one.effect) for one in trials), np.abs(prints.T @ prints)


def ranked_of(candidates: Iterable[Candidate]) -> Iterator[Ranked]:
    """The causes of a ranking."""
    for one in candidates:
        effect = one.attached.effect
        yield Ranked(
            title=title_of(effect),
            kind=effect.kind,
            target=effect.target,
            term=effect.term,
            value=one.value,
            std=one.std,
            unit=effect.unit,
            statistic=one.statistic,
            surviving=one.surviving,
        )


def detectable_of(effects: Iterable[Effect], sizes: Mapping[str, float]) -> Iterator[Detectable]:
    """The smallest detectable sizes by cause; a set of coefficients has no one size."""
    known = {effect.name: effect for effect in effects if not effect.members}
    for name, size in sizes.items():
        if (effect := known.get(name)) is not None:
            label = " ".join(part for part in (effect.target, effect.term or "", effect.variant) if part)
            yield Detectable(kind=effect.kind, label=label, size=size, unit=effect.unit, limit=effect.size.limit)


def titled(name: str, effects: Mapping[str, Effect]) -> str:
    """Short name of a cause from its name in tables: "actuator_lag(delta_e)" -> "elevator: actuator lag"."""
    effect = effects[name] if name in effects else effect_named(name)
    return f"{title_of(effect)} ({effect.variant})" if effect.variant else title_of(effect)


def gusts_of(fit: FlightFit, sigma: float) -> Gusts | None:
    """Reconstruct the moving air of a turbulent flight by the filter's smoother; `sigma` is the named velocity."""
    # they are followed by the rotation of the air, and noise of inputs that passed through an effect
    stations = [station for station in fit.noise.coloured if station in WIND]
    if not stations:
        return None
    gusts = fit.motion.coloured[..., : len(stations)]
    records = fit.flight.records
    r = int(np.argmax([np.mean(gusts[: len(record), k] ** 2) for k, record in enumerate(records)]))
    velocity = {station: gusts[: len(records[r]), r, i] for i, station in enumerate(stations)}
    return Gusts(record=records[r], velocity=velocity, sigma=sigma)


def histories_of(fit: FlightFit, missing: MissingInput, named: np.ndarray | None = None) -> Iterator[History]:
    """The latent input in each record of a fit, with what the named causes put there (N, R)."""
    series = np.zeros(fit.batch.live.shape) if named is None else named
    for r, name in enumerate(fit.batch.names):
        t, mean, sigma = missing.history[name]
        yield History(record=name, t=t, mean=mean, sigma=sigma, named=_at(fit, series, r, t))


def derivatives_beside(fit: FlightFit, missing: MissingInput) -> dict[str, float]:
    """Fitted derivatives with the latent input in place, which they need not imitate any more.

    The mean of the joint posterior of derivatives and input, from the same linearisation as the input itself.
    """
    evidence = weigh(fit, discrepancy=False)
    series = np.zeros((*fit.batch.live.shape, 1))
    for r, record in enumerate(fit.flight.records):
        t, mean, _ = missing.history[record.name]
        series[: len(record), r, 0] = np.interp(record.t, t, mean)
    white = response(fit, missing.station, series)
    taken = fit.columns.reshape(fit.white.size, len(fit.slots)).T @ white.reshape(-1)
    values = fit.values + evidence.newton - evidence.covariance @ taken
    return {slot.name: float(value) for slot, value in zip(fit.slots, values, strict=True)}


def named_series(before: FlightFit, after: FlightFit, missing: MissingInput) -> np.ndarray:
    """(N, R) what the extended model adds at a station to the bare one that the latent input was added to.

    Effects that enter there, and what the derivatives and terms of the coefficient differ by: both models then give the
    coefficient the same value where the extension is right.
    """
    total = after.disturbances[..., after.model.disturbances.index(missing.station)].copy()
    if missing.place.kind == "wind":
        return total
    coefficient = missing.place.name
    beside = derivatives_beside(before, missing)
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


def _at(fit: FlightFit, series: np.ndarray, r: int, t: np.ndarray) -> np.ndarray:
    """A time history at the nodes of a latent input: averaged over the triangle about each node."""
    record = fit.flight.records[r]
    weight = np.maximum(0.0, 1.0 - np.abs(record.t[:, None] - t) / (t[1] - t[0]))
    return weight.T @ series[: len(record), r] / weight.sum(axis=0)


def _term(fit: FlightFit, cause: Cause, missing: MissingInput, named: np.ndarray) -> Term | None:
    """The missing coefficient over the variable of a named term; None for a cause that is no term."""
    if cause.effect.regressor is None:
        return None
    others = named - cause.value * _series(fit, cause.effect.regressor)
    variable = _variable(cause.effect.regressor)
    points = dict[str, np.ndarray]()
    x = _series(fit, variable)
    for r, name in enumerate(fit.batch.names):
        t, mean, sigma = missing.history[name]
        points[name] = np.stack([_at(fit, x, r, t), mean - _at(fit, others, r, t), sigma], axis=1)
    return Term(points=points, variable=variable)


def _variable(regressor: str) -> str:
    """The one variable of a term, or the term itself."""
    term = parse_term(regressor)
    variables = [name for name, _ in term.factors] or [one.variable for one in term.stretches[:1]]
    return variables[0] if len(variables) == 1 else regressor


def _onsets(fitted: FlightFit, cause: Cause) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Statistic of a cause over its time of onset, from the model that did not have it yet."""
    one = next((a for a in fitted.attached if a.effect.key == cause.key), None)
    return {} if one is None or not cause.onset_s else onset_profiles(without(fitted, {one.name}), one)


def onset_profiles(base: FlightFit, attached: Attached) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Record -> (times of onset [s], statistic of the cause if it began then), from a fit that does not have it."""
    effect = attached.effect
    if effect.members:
        effect = configuration_change(effect.members[0])
    effect = with_grid(effect, {key: attached.values[key] for key in effect.further.grid[0]})
    evidence = weigh(base)
    judge = Screen(evidence)
    names = base.batch.names
    step = base.criteria.numerics.events.gust_step
    longest = max(record.duration for record in base.flight.records)
    since = np.arange(step, longest, step)
    prints = fingerprints(evidence, [effect], since)
    table = {}
    for r, record in enumerate(base.flight.records):
        keep = np.eye(len(names))[r][None]
        inside = since < record.duration
        statistic = [judge.score([p], keep)[0] for p, i in zip(prints, inside, strict=True) if i]
        table[record.name] = (record.t[0] + since[inside], np.array(statistic))
    return table


def _answer(cause: Cause, before: View, after: View) -> Answer | None:
    """Frequency responses at a cause, all three estimated in the same way, so that also a cause that is not linear has
    one.

    None for a cause that is neither at a surface nor in the time of an instrument, and where the records give no
    response.
    """
    effect = cause.effect
    if effect.forms.transfer is None and not effect.of_a_surface:
        return None
    flown = _cut(cause, after.fit.flight.records)
    pairs = _pairs(group_channels(effect.target), before.fit.model.outputs)
    found = [one for one in (_response(flown, *pair) for pair in pairs) if one is not None]
    if not found:
        return None
    flight = max(found, key=lambda one: one.usable.sum())
    answers = []
    for view in (before, after):
        records = _cut(cause, [_simulated(view, r, flight.output) for r in range(len(view.records))])
        answered = _response(records, flight.input, flight.output, flight)
        answers.append(None if answered is None else answered.response)
    given, extended = answers
    return None if extended is None else Answer(flight=flight, given=given, extended=extended)


_ANSWERS = {"delta_e": "q", "delta_a": "p", "delta_r": "r"}  # the channel that a surface moves first


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
