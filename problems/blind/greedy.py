"""A yardstick for the diagnosis: the same hypotheses, `solve`, and one rule, which adds the one with the highest odds.

Screening   `catalogue` by one linearisation, derivatives and initial states free; events at every second.
Odds        over the model without it: ln L of fitted records + ln prior of derivatives - 1/2 ln(readings) for each size
            (Laplace, a prior worth one reading: Kass and Wasserman, JASA 90, 1995) + ln L of the held-out record,
            predicted from its first seconds + ln prior odds of the kind.
Discrepancy ln L = -sum over channels of N / tau ln(r.m.s. of residuals), and noise weighs tau times as much in a fit.
            tau is the correlation length [samples] of the residuals without the hypothesis: 1 + 2 sum of their
            autocorrelations up to the first below 0.05. Recorded inputs are taken without their noise.
Rule        The best of MOST is added while its odds exceed 10; its set is what is within 10 of it. No other rule.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

import casid as cs
from casid.errors import CasidError
from casid.model.dynamics import flight_inputs
from casid.model.effects import catalogue, effect_of
from casid.model.in_force import known_of
from casid.records.noise import mean_over, pooled_sigma, quiet_windows
from casid.signals import SURFACES

MOST = 6  # hypotheses that are solved in a round
ADDED = 3  # at most
NAMED = np.log(10.0)
UNLIKELY = {"clock_drift": 1e-3, "sensor_misalignment": 1e-3}  # prior odds of a wrong clock or frame
SECONDS = 30.0  # of a solve
_ESTIMATED = ("", ".onset", ".frequency_hz", ".length", ".time_constant")  # sizes: the value, and these beside it
_SAMPLES = 600  # of a record in the linearisation
_LEAST = 1e-4  # of a response, when all that is free has followed it
_Row = tuple[Any, Mapping[str, float], Any]  # an effect, its sizes, and its onset [s] after the first sample


@dataclass(frozen=True, eq=False, kw_only=True)
class Account:
    """A model with effects, its fit, and measured minus predicted (N, outputs) of fitted and held-out records."""

    effects: tuple[cs.EffectValue, ...]
    fit: cs.Fit
    left: Sequence[np.ndarray]
    held_out: Sequence[np.ndarray]


def search(aircraft: cs.Aircraft, records: Sequence[cs.Record]) -> list[list[tuple[cs.EffectValue, float]]]:
    """Sets of effects with ln odds, the best first, in the order of their addition; the last record is held out."""
    sigma = {c: pooled_sigma([one[c] for one in records]) for c in (*SURFACES, "thrust") if c in records[0]}
    still = [{c: mean_over(r[c], *quiet_windows(r[c], noise)) for c, noise in sigma.items()} for r in records]
    records = [one.with_channels(**inputs) for one, inputs in zip(records, still, strict=True)]
    now = _settled(aircraft, (), records, {})
    found: list[list[tuple[cs.EffectValue, float]]] = []
    while len(found) < ADDED:
        trials = []
        for one in screened(aircraft, now):
            try:
                trial = _account(aircraft, (*now.effects, one), records, now.fit.values, now.fit.problem.noise)
            except (CasidError, ArithmeticError):  # it cannot be flown, or not be told from what is free
                continue
            trials.append((one, _log_odds(one, trial, now)))
        trials = sorted((one for one in trials if one[1] >= NAMED), key=lambda one: -one[1])
        if not trials:
            break
        found.append([one for one in trials if one[1] > trials[0][1] - NAMED])
        now = _settled(aircraft, (*now.effects, trials[0][0]), records, now.fit.values)
    return found


def _settled(aircraft: cs.Aircraft, effects: Any, records: Any, start: Mapping[str, float]) -> Account:
    """The fit with noise of its own, in which a reading weighs as one of the `correlation_length`."""
    free = _account(aircraft, effects, records, start, None)
    root = dict(zip(free.fit.problem.model.outputs, np.sqrt(correlation_length(free.left)).tolist(), strict=True))
    noise = {name: free.fit.noise.get(name, 1.0) * of for name, of in root.items()}  # 1: of what is not measured
    return _account(aircraft, effects, records, free.fit.values, noise)


def _account(aircraft: cs.Aircraft, effects: Any, records: Any, start: Mapping[str, float], noise: Any) -> Account:
    """The fit of derivatives and sizes, from a start."""
    model = cs.aircraft_model(aircraft.with_effects(effects))
    sizes = {effect_of(one).name + key for one in effects for key in _ESTIMATED}
    free = [n for n in model.parameters if n[0] == "C" or n in sizes or n.split("[")[0] in sizes]
    begin = {n: value for n, value in start.items() if n in model.parameters}
    problem = cs.Problem(model, records[:-1], free=free, prior=True, noise=noise, start=begin)
    fit = cs.solve(problem, cs.MultipleShooting(), cs.GaussNewton(seconds=SECONDS))
    last = model.ready(records[-1], fit.values)
    held_out = [problem.outputs_of(last) - fit.predict(last).outputs]
    return Account(effects=tuple(effects), fit=fit, left=list(fit.residuals.values()), held_out=held_out)


def _log_odds(one: cs.EffectValue, trial: Account, base: Account) -> float:
    readings, gain = _gain(trial.left, base.left)
    prior = trial.fit.log_prior - base.fit.log_prior + np.log(UNLIKELY.get(one.kind, 1.0))
    sizes = 0.5 * np.log(readings) * (len(trial.fit.values) - len(base.fit.values))
    return float(gain + prior - sizes + _gain(trial.held_out, base.held_out)[1])


def _gain(left: Sequence[np.ndarray], base: Sequence[np.ndarray]) -> tuple[float, float]:
    """How many readings residuals are worth, and by how much ln L is larger than with those of `base`."""
    count = np.isfinite(np.concatenate(base)).sum(axis=0) / correlation_length(base)
    after, before = (np.nansum(np.concatenate(of) ** 2, axis=0) for of in (left, base))
    seen = before > 0.0
    return float(count[seen].sum()), float(-0.5 * count[seen] @ np.log(after[seen] / before[seen]))


def correlation_length(left: Sequence[np.ndarray]) -> np.ndarray:
    """(channels,) samples after which a residual is a new reading, at least 1."""
    left = [np.nan_to_num(one) for one in left]
    most = min(map(len, left)) // 2
    sums = np.array([sum((one[k:] * one[: len(one) - k]).sum(axis=0) for one in left) for k in range(most)])
    rho = sums[1:] / np.maximum(sums[0], 1e-300)
    return 1.0 + 2.0 * (rho * np.logical_and.accumulate(rho > 0.05)).sum(axis=0)


def screened(aircraft: cs.Aircraft, now: Account) -> list[cs.EffectValue]:
    """The MOST hypotheses by which the weighed sum of squares falls most, with their sizes there."""
    records = now.fit.problem.records
    effects = [one for one in catalogue(aircraft, now.fit.channels) if one.name not in now.fit.values]
    within = [one for one in effects if one.change is not None and one.series is None]
    rows: list[_Row] = [(one, {}, None) for one in within]
    seconds = np.arange(1.0, max(record.duration for record in records)).tolist()
    for one in [one for one in effects if one not in within]:
        rows += [(one, sizes, at) for sizes in one.further.grid for at in (seconds if one.timed else [None])]
    model = cs.aircraft_model(aircraft.with_effects([*now.effects, *(_value(one, {}, 0.0) for one in within)]))
    parts = [_products(aircraft, model, now, rows, i) for i in range(len(records))]
    inverse = np.linalg.inv(sum(part[0] for part in parts) + np.diag(now.fit.problem.prior_std**-2.0))
    best: dict[str, tuple[float, cs.EffectValue]] = {}
    for these in (range(len(parts)), *((i,) for i in range(len(parts)))):
        cross, square, match = (np.sum([parts[i][k] for i in these], axis=0) for k in (1, 2, 3))
        match = match - cross.T @ (inverse @ sum(part[4] for part in parts))  # of every few samples, a slope is left
        left = square - (cross * (inverse @ cross)).sum(axis=0)
        scale = np.where(left > _LEAST * square, match / np.maximum(left, 1e-300), 0.0)
        for (one, sizes, at), size, gain in zip(rows, scale.tolist(), (scale * match).tolist(), strict=True):
            alone = records[these[0]] if len(these) == 1 else None
            acts = one.timed == bool(alone) or alone and one.traits.by_record
            if acts and (one.linear or size > 0.0) and gain > best.get(one.name, (0.0,))[0]:
                best[one.name] = gain, _value(one, sizes, size if one.linear else sizes["value"], alone, at)
    return [one for _, one in sorted(best.values(), key=lambda one: -one[0])[:MOST]]


def _value(one: Any, sizes: Any, value: float, record: cs.Record | None = None, at: Any = None) -> cs.EffectValue:
    further = {**one.further.defaults, **{name: size for name, size in sizes.items() if name != "value"}}
    found = cs.EffectValue(kind=one.kind, target=one.target, term=one.term, value=value, parameters=further)
    if record is not None and one.timed:
        return replace(found, onset_s={record.name: (record.t[0] + at,) * 2})
    return replace(found, records=(record.name,) if record is not None else ())


def _products(aircraft: cs.Aircraft, model: cs.Model, now: Account, rows: list[_Row], index: int) -> tuple[Any, ...]:
    """Of one record, its initial state eliminated: information on what is free, products of the responses to all rows
    with that, with themselves, and with the residuals."""
    fit = now.fit
    record = model.ready(fit.problem.records[index], fit.values)
    p = model.nominal_vector(fit.values)
    t = record.t
    every = -(-len(t) // _SAMPLES)
    known = known_of(flight_inputs(aircraft, record)) | {f"read {c}": record[c] for c in model.outputs if c in record}
    known |= dict(zip(model.outputs, fit.predictions[record.name].T, strict=False))
    for angle, length in (("alpha", aircraft.rate_length_pitch), ("beta", aircraft.rate_length_lateral)):
        known[f"{angle}dot"] = np.gradient(known[angle], t) * length / known["V"]
    places = (*model.disturbances, *model.inputs, *(f"reading_{c}" for c in model.outputs))
    history = [row for row in rows if row[0].series or row[0].output]
    inside = [model.parameters.index(name) for name in (*fit.values, *(row[0].name for row in rows[: -len(history)]))]
    added = np.zeros((len(t[::every]), len(places), len(history)), dtype=np.float32)
    for j, (one, sizes, at) in enumerate(history):
        given = {"value": 1.0, **one.further.defaults, **sizes, "onset": t[0] + (at or 0.0)}
        made = one.series(t, known, given) if one.series else one.output(t, known, given) if one.output else {}
        for name, series in made.items():
            place = name if one.series else f"reading_{name}"
            if place in places:
                added[:, places.index(place), j] = (series if one.series else series - known[name])[::every]
    n, ny, k = len(model.states), len(model.outputs), len(fit.values)
    u = np.column_stack([np.zeros((len(t), len(model.disturbances))), *(record[name] for name in model.inputs)])
    to = (model.x, model.p, ca.vertcat(model.w, model.u))
    wrt = ca.vertcat(model.x, model.p[inside], to[2])
    slopes = ca.Function("slopes", to, [ca.jacobian(ca.vertcat(model.f, model.h), wrt)])
    half = 0.5 * every * record.dt
    x = np.hstack([np.zeros((n, k + len(rows))), np.eye(n)])
    ahead = x
    response = np.zeros((len(added), ny, x.shape[1]), dtype=np.float32)
    for i, of in enumerate(added):
        J = slopes(fit.states[record.name].trajectory[i * every], p, u[i * every]).full()
        fed = J[:, n + len(inside) :] @ of[:-ny]
        fed[n:] += of[-ny:]
        fed = np.hstack([J[:, n : n + len(inside)], fed, np.zeros((n + ny, n))])
        x = np.linalg.solve(np.eye(n) - half * J[:n, :n], ahead + half * fed[:n]) if i else x
        ahead = x + half * (J[:n, :n] @ x + fed[:n])
        response[i] = J[n:, :n] @ x + fed[n:]
    weight = np.sqrt(every) / np.array([fit.noise.get(name, np.inf) for name in model.outputs])
    z = (fit.residuals[record.name][::every] * weight).ravel()
    white = (response * weight[:, None]).reshape(len(z), -1)[np.isfinite(z)]
    begin = np.linalg.qr(white[:, -n:])[0]
    white = white[:, :-n] - begin @ (begin.T @ white[:, :-n])
    free = white[:, :k].astype(float)
    z = z[np.isfinite(z)]
    return free.T @ free, free.T @ white[:, k:], (white[:, k:] ** 2).sum(axis=0), z @ white[:, k:], free.T @ z
