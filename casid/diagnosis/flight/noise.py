"""Noise that cannot be measured in the records is estimated with the model: its level and its correlation time.

A channel that was filtered, held or rounded does not show its noise (`Subject.doubted`). Its residuals consist mostly
of errors of the model. Level and correlation time are therefore estimated from the residuals by maximum likelihood, and
again after every named cause.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from casid.diagnosis.flight.evaluation import FlightFit, Free, Gram, about_motion, scaled_inverse
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import with_filtered_inputs, with_inputs_held, with_noise_above, within_the_motion
from casid.diagnosis.flight.hypothesis import Attached, readings
from casid.diagnosis.flight.subject import Subject
from casid.estimation.fitted import channel_fit
from casid.filtering.colour import most_likely
from casid.filtering.free_flight import chance_error, free_flight_sigma
from casid.filtering.slow import usual_offset, white_and_slow
from casid.model.causes.instruments import sensor_bias, sensor_delay
from casid.model.station import control
from casid.records.noise import isolated
from casid.records.record import Record
from casid.signals import SURFACES


@dataclass(frozen=True, kw_only=True)
class ChannelStatistics:
    """Statistics of one channel over all records."""

    rms: float  # r.m.s. of measured minus simulated; the simulation runs freely from each record's fitted initial state
    noise: float  # 1-sigma of the instrument, from the band above the motion
    whiteness_p: float  # Ljung-Box p-value of the innovations; a small value indicates a systematic error
    theil: float  # theil's coefficient of measured and simulated: 0 is perfect, 1 is no relation
    R2: float  # share of the variance of the channel that the simulation explains; NaN for a constant channel


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedRecords:
    """Free simulation of a fit."""

    output: np.ndarray  # (N, R, ny) readings
    residual: np.ndarray  # (N, R, ny) measured minus simulated, NaN where not measured


def free_simulation(fit: FlightFit, start: np.ndarray | None = None) -> SimulatedRecords:
    """Simulate every record from its fitted initial state, or from `start` (R, states), open loop with the recorded
    inputs.

    A result that overflows is infinite.
    """
    begin = fit.motion.X[0] if start is None else start
    model = fit.model
    batch = fit.batch
    N, R = batch.live.shape
    if fit.flight.by_innovations:
        return _predicted(fit)
    chain = fit.functions.step_function.mapaccum("chain", N - 1)
    X = np.empty((N, R, len(model.states)))
    (U0, U1), (W0, W1) = batch.ends(batch.U), batch.ends(fit.disturbances, batch.held_at(model))
    for r in range(R):
        P = np.tile(fit.parameters[r][:, None], (1, N - 1))
        given = (one[:, r].T for one in (U0, U1))
        states = chain(begin[r], *given, P, W0[:, r].T, W1[:, r].T, batch.dt[:, r][None])
        X[:, r] = np.vstack([begin[r][None], states.full().T])
    return _read_along(fit, X)


def _predicted(fit: FlightFit) -> SimulatedRecords:
    """Return each reading as the filter predicts it from those before it: innovations in units of the noise of a
    reading take the place of its residual."""
    noise = np.array([fit.noise.measurement[name] for name in fit.model.outputs])
    residual = np.where(fit.seen, fit.white * noise, np.nan)
    return SimulatedRecords(output=fit.batch.Z - residual, residual=residual)


def _read_along(fit: FlightFit, X: np.ndarray) -> SimulatedRecords:
    """Return the readings of the instruments along simulated states."""
    model = fit.model
    batch = fit.batch
    output = fit.output_along(X)
    output = readings(fit.attached, batch.names, batch.t, output, model.outputs, fit.known)
    output = np.where(np.isfinite(output), output, np.inf)
    seen = np.isfinite(batch.Z) & batch.live[..., None]
    return SimulatedRecords(output=output, residual=np.where(seen, batch.Z - output, np.nan))


def expected_error(fit: FlightFit) -> np.ndarray:
    """Return (N, R, ny) 1-sigma of the residual of a free simulation if the model is right, its initial state known."""
    return free_flight_sigma(fit.linear, fit.acting)


def most_by_chance(fit: FlightFit) -> dict[str, float]:
    """Output -> r.m.s. error of a free simulation from a measured start, as recorded and in units of its noise, that
    the right model exceeds as rarely as an interval does not hold what it should."""
    criteria = fit.criteria
    every = fit.flight.every
    error = chance_error(fit.linear, fit.acting, criteria.numerics.events.step)
    noise = np.array([fit.noise.measurement[name] for name in fit.model.outputs])
    most = np.sqrt((error.most(1.0 - criteria.priors.holds) / noise**2 + every - 1) / every)
    return dict(zip(fit.model.outputs, most.tolist(), strict=True))


def channel_fits(fit: FlightFit, simulated: SimulatedRecords) -> dict[str, ChannelStatistics]:
    """Statistics of every output that some record measures, over all records.

    Noise and error are those of the samples as recorded: the white noise that averaging removed is added again.
    """
    table = {}
    lags = round(fit.criteria.numerics.samples_per_cycle)
    every = fit.flight.every
    for i, name in enumerate(fit.model.outputs):
        error = simulated.residual[..., i]
        if not fit.seen[..., i].any() or np.isnan(error).all():
            continue
        # Use the measured samples. A late reading is compared at other samples.
        measured = np.where(np.isnan(error), np.nan, fit.batch.Z[..., i])
        flown = channel_fit(measured.ravel(), (measured - error).ravel())
        noise = fit.noise.measurement[name]
        table[name] = ChannelStatistics(
            rms=math.hypot(flown.rms, noise * math.sqrt(every - 1)),
            noise=noise * math.sqrt(every),
            whiteness_p=whiteness(fit.white[..., i], fit.seen[..., i], lags),
            theil=flown.theil,
            R2=flown.R2,
        )
    return table


def whiteness(white: np.ndarray, seen: np.ndarray, lags: int) -> float:
    """Ljung-Box p-value with a number of `lags`, pooled over the records of a channel (N, R)."""
    statistic = 0.0
    dof = 0
    for r in range(white.shape[1]):
        e = white[seen[:, r], r]
        n = len(e)
        if n <= 2 * lags:
            continue
        e = e - e.mean()
        correlation = np.array([e[k:] @ e[: n - k] for k in range(1, lags + 1)]) / (e @ e)
        statistic += n * (n + 2) * float(np.sum(correlation**2 / (n - np.arange(1, lags + 1))))
        dof += lags
    return float(scipy.stats.chi2.sf(statistic, dof)) if dof else 1.0


@dataclass(frozen=True, kw_only=True)
class Following:
    """Correlation of the innovations of an output with earlier changes of the recorded inputs."""

    output: str
    input: str  # the input that they follow most
    statistic: float  # likelihood-ratio statistic of all inputs, less its mean where they follow none


def following(fit: FlightFit) -> Following | None:
    """The output whose innovations follow earlier changes of the inputs most; None without an input that moves.

    An input may follow the air, where a pilot or an autopilot answers it, so that air and input are coherent. The
    innovations of the right model are independent of everything before them, in closed loop too (Ljung, System
    Identification, 16.6). Air that is estimated in place of something else follows the inputs.
    """
    lags = round(fit.criteria.numerics.samples_per_cycle)
    live = fit.batch.live
    U = fit.batch.U
    moved = [i for i, name in enumerate(fit.model.inputs) if name in (*SURFACES, "thrust") and np.ptp(U[live][:, i])]
    if not moved:
        return None
    before = np.zeros((*live.shape, len(moved), lags))
    changes = np.diff(U[..., moved], axis=0, prepend=U[:1][..., moved])
    for k in range(1, lags + 1):
        before[k:, ..., k - 1] = changes[:-k]
    before = before[live]
    innovations = fit.white[live]
    seen = fit.seen[live]
    found = []
    for i, output in enumerate(fit.model.outputs):
        if seen[:, i].sum() > 2 * len(moved) * lags:
            rows = before[seen[:, i]]
            e = innovations[seen[:, i], i]
            by_input = [_explained(rows[:, j], e) for j in range(len(moved))]
            statistic = _explained(rows.reshape(len(e), -1), e) - len(moved) * lags
            most = fit.model.inputs[moved[int(np.argmax(by_input))]]
            found.append(Following(output=output, input=most, statistic=statistic))
    return max(found, key=lambda one: one.statistic, default=None)


def beyond_air(fit: FlightFit) -> float:
    """Return the statistic with which innovations in moving air follow earlier changes of the inputs, which no air
    does; 0 in calm air, and where it may be chance."""
    found = following(fit) if fit.noise.coloured else None
    return found.statistic if found and found.statistic > fit.criteria.missing else 0.0


def _explained(regressors: np.ndarray, series: np.ndarray) -> float:
    """The part of the sum of squares of a series (N,) that regressors (N, k) and a constant explain beyond its mean."""
    varying = regressors - regressors.mean(axis=0)
    part, *_ = np.linalg.lstsq(varying, series - series.mean(), rcond=None)
    return float(np.sum((varying @ part) ** 2))


def band_energy(fit: FlightFit, simulated: SimulatedRecords, edges_hz: np.ndarray) -> np.ndarray:
    """(ny, bands) Energy of the free-simulation residual over that of the instrument noise, per frequency band."""
    ratio = np.full((len(fit.model.outputs), len(edges_hz) - 1), np.nan)
    for i, name in enumerate(fit.model.outputs):
        total = np.zeros(len(edges_hz) - 1)
        measured = [r for r in range(len(fit.batch.names)) if fit.seen[:, r, i].any()]
        for r in measured:
            record = fit.flight.records[r]
            error = np.nan_to_num(simulated.residual[: len(record), r, i])
            frequency, power = scipy.signal.periodogram(error - error.mean(), 1.0 / record.dt)
            floor = 2.0 * fit.noise.measurement[name] ** 2 * record.dt
            for b, (low, high) in enumerate(zip(edges_hz[:-1], edges_hz[1:], strict=True)):
                inside = (frequency >= low) & (frequency < high)
                total[b] += power[inside].mean() / floor if inside.any() else 0.0
        ratio[i] = total / len(measured) if measured else np.nan
    return ratio


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """A fitted model with its simulation and statistics of a set of records."""

    fit: FlightFit
    simulated: SimulatedRecords
    channels: Mapping[str, ChannelStatistics]

    @property
    def log_likelihood(self) -> float:
        """ln L of the innovations, with its constant."""
        samples = self.fit.readings
        return -0.5 * (self.fit.data_deviance + samples * math.log(2.0 * math.pi))

    @property
    def samples(self) -> int:
        return self.fit.readings

    @property
    def records(self) -> tuple[str, ...]:
        """Names of the records."""
        return self.fit.flight.names

    def band_energy(self, edges_hz: np.ndarray) -> np.ndarray:
        """(ny, bands) Energy of the free-simulation residual over that of the instrument noise, per frequency band."""
        return band_energy(self.fit, self.simulated, edges_hz)


def view_of(fit: FlightFit, start: np.ndarray | None = None) -> View:
    """The view of a fit; its simulation begins at the fitted initial states, or at `start` (R, states)."""
    simulated = free_simulation(fit, start)
    return View(fit=fit, simulated=simulated, channels=channel_fits(fit, simulated))


def in_colour(fitted: FlightFit, free: Free = "all") -> FlightFit:
    """The fit with the noise of doubted outputs estimated from its residuals.

    The level is estimated first, with a free simulation, and then the correlation time, from the innovations; each
    until it converges. Noise is estimated only if it was measured for no output.
    """
    numerics = fitted.criteria.numerics.fit
    if not fitted.flight.noise_by_fit:
        return fitted
    for _ in range(numerics.repeats):
        before = fitted.flight.sigma
        level = level_of(fitted)
        fitted = _under(fitted, before | level, {}, free)
        if all(abs(np.log(level[o] / before[o])) < numerics.stays for o in level):
            break
    for _ in range(numerics.repeats):
        before = fitted.noise.colour
        colour = colour_of(fitted, fitted.flight.doubted)
        fitted = _under(fitted, fitted.flight.sigma, colour, free)
        if before and all(abs(np.log(colour[o][0] / before[o][0])) < numerics.stays for o in colour):
            break
    return fitted


def is_far(fitted: FlightFit, most: float) -> bool:
    """Return True if the mean square residual exceeds `most`, in units of the measured noise.

    The residuals then contain more than instrument noise, or than a single cause could explain. It is false if the
    noise was estimated with the model.
    """
    return not fitted.flight.noise_by_fit and float(np.sum(fitted.white**2)) > most * fitted.readings


def unread(flight: Subject) -> Subject:
    """The flight with the noise of all outputs doubted, except where the file states it."""
    unsure = tuple(o for o in flight.outputs if not flight.aircraft.noise.get(o))
    return within_the_motion(replace(flight, doubted=unsure))


def _under(fitted: FlightFit, sigma: dict[str, float], colour: dict[str, tuple[float, float]], free: Free) -> FlightFit:
    """The fit under another noise of its outputs."""
    flight = replace(fitted.flight, sigma=sigma, colour=colour)
    noise = replace(fitted.noise, measurement=sigma, colour=colour)
    return fit(flight, fitted.attached, noise, fitted, free=free, extent="settled")


def level_of(fitted: FlightFit) -> dict[str, float]:
    """Output -> r.m.s. residual of a free simulation, at most the variation of the channel; for doubted outputs."""
    residual = free_simulation(fitted).residual
    found = {}
    for name in fitted.flight.doubted:
        i = fitted.model.outputs.index(name)
        measured = fitted.batch.Z[..., i]
        left = residual[..., i]
        if np.isfinite(measured).any():
            with np.errstate(over="ignore"):
                found[name] = float(min(np.sqrt(np.nanmean(left**2)), np.nanstd(measured)))
    return found


def as_slow_as_left(fitted: FlightFit, drifting: Collection[str] = ()) -> FlightFit:
    """The fit with noise of outputs that is partly white and partly slow, as its residuals are (`slow_of`)."""
    if fitted.noise.colour:
        return fitted
    noise = replace(fitted.noise, slow=slow_of(fitted, drifting))
    return fit(fitted.flight, fitted.attached, noise, fitted, free=fitted.free, extent="settled")


def as_coloured_as_left(fitted: FlightFit) -> FlightFit:
    """The fit with innovations as coloured as it leaves them.

    The model of turbulence is approximate, and leaves part of its effect in readings whose own noise is not slow.
    Residuals larger than the limit of `slow_of` are not noise.
    """
    most = fitted.criteria.parts.twice
    left = colour_of(fitted, fitted.model.outputs)
    colour = {name: (sigma, tau) for name, (sigma, tau) in left.items() if sigma**2 <= most}
    return _under(fitted, fitted.flight.sigma, colour, fitted.free)


def slow_of(fitted: FlightFit, drifting: Collection[str] = ()) -> dict[str, tuple[tuple[float, float], ...]]:
    """Slow noise of every output according to the residuals of a fit (`NoiseModel.slow`).

    It consists of an offset in every record and, if significant, a slowly varying part. Residuals larger than an
    instrument may have are not taken for noise. A drift as large as a bias that matters may be missing at the outputs
    `drifting`. Noise as slow as that would be this drift by another name, and they have none.
    """
    white = _innovations(fitted)
    sigma = fitted.noise.measurement
    significant = fitted.criteria.significance
    found = white_and_slow(fitted.batch.t, white, fitted.seen)
    drift_time = min(fitted.criteria.numerics.missing_input.slow)
    flown = sum(record.duration for record in fitted.flight.records)
    slow = {}
    offsets = np.array([one.offsets for one in found]).T + _put_in(fitted) / np.array(
        [sigma[name] for name in fitted.model.outputs]
    )
    usual = usual_offset(offsets, np.array([one.stds for one in found]).T)
    for name, one in zip(fitted.model.outputs, found, strict=True):
        largest = fitted.flight.smallest_that_matters(sensor_bias(name)) or np.inf
        # The number of independent values of a variance is the flown time over the correlation time.
        most = (fitted.criteria.parts.twice - 1.0) * (1.0 + significant.sigmas * np.sqrt(2.0 * one.tau / flown))
        parts = [(min(usual * sigma[name], largest), np.inf)] if usual else []
        faster = name not in drifting or one.tau < drift_time
        if one.gain > significant.chance and one.slow**2 < most and faster:
            parts.append((one.slow * sigma[name], one.tau))
        slow |= {name: tuple(parts)} if parts else {}
    return slow


def _put_in(fitted: FlightFit) -> np.ndarray:
    """(R, ny) Offsets of readings due to attached effects: their constant contributions."""
    batch = fitted.batch
    output = fitted.output
    found = np.zeros(output.shape[1:])
    rounding = fitted.criteria.numerics.rounding
    for one in fitted.attached:
        if one.effect.output is not None:
            added = readings([one], batch.names, batch.t, output, fitted.model.outputs, fitted.known) - output
            found += np.where(np.ptp(added, axis=0) <= rounding * np.abs(output).max(axis=0), added[0], 0.0)
    return found


def colour_of(fitted: FlightFit, outputs: Iterable[str], longest: float = np.inf) -> dict[str, tuple[float, float]]:
    """Output -> (1-sigma, correlation time [s], at most `longest`) of its innovations, in units of its noise, for
    measured outputs."""
    white = _innovations(fitted)
    seen = fitted.seen
    t = fitted.batch.t
    found = {}
    for name in outputs:
        i = fitted.model.outputs.index(name)
        series = [(t[at, r], white[at, r, i]) for r, at in enumerate(seen[..., i].T)]
        if sum(len(values) for _, values in series) > len(fitted.slots):
            found[name] = most_likely(series, longest)
    return found


def _innovations(fitted: FlightFit) -> np.ndarray:
    """(N, R, ny) Innovations of a fit whose noise model has no colour."""
    plain = replace(fitted.filter, noise=replace(fitted.filter.noise, colour={}))
    return plain.predicted(*about_motion(fitted))[0]


def with_noise_level(flight: Subject, attached: Sequence[Attached]) -> Subject:
    """The flight with its noise estimated.

    The noise of doubted outputs is estimated with the model and the effects `attached`. That of the inputs is raised if
    a filter common to all channels reduced it.
    """
    return within_the_motion(with_filtered_inputs(_by_the_model(flight, attached)))


def _by_the_model(flight: Subject, attached: Sequence[Attached]) -> Subject:
    """The flight with the noise of doubted outputs estimated with the model."""
    if not flight.doubted:
        return flight
    numerics = flight.criteria.numerics.fit
    variation = {o: float(np.nanstd(np.concatenate([r[o] for r in flight.records]))) for o in flight.doubted}
    first = {o: max(flight.sigma[o], numerics.stays * v) for o, v in variation.items()}
    now = replace(flight, sigma=flight.sigma | first)
    fitted = None
    for _ in range(numerics.repeats):
        before = now.sigma
        fitted = fit(now, attached, now.noise(), fitted)
        residual = free_simulation(fitted).residual
        now = with_noise_above(
            flight, [_left(now, record, residual[: len(record), r]) for r, record in enumerate(now.records)]
        )
        if all(abs(np.log(now.sigma[o] / before[o])) < numerics.stays for o in flight.doubted):
            break
    return now


def _left(flight: Subject, record: Record, residual: np.ndarray) -> Record:
    """The record with the residuals in place of its outputs."""
    return record.with_channels(**{o: residual[:, i] for i, o in enumerate(flight.outputs)})


def without_outliers(fitted: FlightFit) -> FlightFit:
    """The fit without the outliers that it shows, repeated until there are none."""
    for _ in range(fitted.criteria.numerics.fit.repeats):
        at = outliers(fitted)
        outputs = fitted.model.outputs
        if not at.any():
            break
        records = []
        for r, record in enumerate(fitted.flight.records):
            off = {o: at[: len(record), r, i] for i, o in enumerate(outputs) if at[:, r, i].any()}
            kept = {o: np.where(alone, np.nan, record[o]) for o, alone in off.items()}
            notes = [f"{o}: {alone.sum()} single readings far from all others left out" for o, alone in off.items()]
            records.append(replace(record.with_channels(**kept), notes=(*record.notes, *notes)))
        flight = replace(fitted.flight, records=tuple(records), _regressors={})
        fitted = fit(flight, fitted.attached, fitted.noise, fitted, extent="settled")
    return fitted


def outliers(fitted: FlightFit) -> np.ndarray:
    """(N, R, ny) True at single innovations far from their neighbours.

    Samples at which a surface moves are excluded for outputs that the surface affects immediately: a surface that is
    late by a sample causes such an innovation too.
    """
    white = fitted.white
    seen = fitted.seen
    at_once = _at_once(fitted)
    found = np.zeros(seen.shape, dtype=bool)
    for r in range(seen.shape[1]):
        for i in range(seen.shape[2]):
            at = np.flatnonzero(seen[:, r, i])
            found[at, r, i] = isolated(white[at, r, i], fitted.criteria.significance.detectable)
    return found & ~(at_once & _moving(fitted)[..., None])


def _at_once(fitted: FlightFit) -> np.ndarray:
    """(ny,) True for outputs that a surface affects without a state in between."""
    stations = [control(name) for name in SURFACES if control(name) in fitted.model.disturbances]
    index = [fitted.model.disturbances.index(name) for name in stations]
    return np.any(fitted.linear.Dw[..., index] != 0.0, axis=(0, 1, 3))


def _moving(fitted: FlightFit) -> np.ndarray:
    """(N, R) True at samples at which a surface moves, and at their neighbours."""
    flight = fitted.flight
    batch = fitted.batch
    moving = np.zeros(fitted.batch.live.shape, dtype=bool)
    for name in (one for one in SURFACES if one in fitted.model.inputs):
        U = batch.U[..., fitted.model.inputs.index(name)]
        least = flight.criteria.significance.sigmas * np.sqrt(2.0) * flight.input_sigma.get(control(name), 0.0)
        moves = np.abs(np.diff(U, axis=0)) > least
        moving[1:] |= moves
        moving[:-1] |= moves
    wide = moving.copy()
    wide[1:] |= moving[:-1]
    wide[:-1] |= moving[1:]
    return wide


def as_inputs_run(fitted: FlightFit, *, named: bool = False) -> FlightFit:
    """The fit with the behaviour of the inputs between samples that the surfaces agree on, if it is clearly better.

    Surfaces that all seem to act late, and an inertial unit that is late against them, are much alike: the fit stays as
    it is where the unit explains more.
    """
    share = held_share(fitted, named=named)
    if abs(share - fitted.flight.held) < fitted.criteria.parts.quarter:
        doubted = fitted.flight.noise_by_fit or is_far(fitted, fitted.criteria.parts.tenfold)
        if named or not doubted:
            return fitted
        share = 1.0  # a simulator that holds its inputs: tried before anything else is called wrong
    flight = with_inputs_held(fitted.flight, share)
    other = fit(flight, fitted.attached, fitted.noise, fitted, extent="settled")
    if other.deviance >= fitted.deviance - fitted.criteria.missing:
        return fitted
    by = 0.5 * (share - fitted.flight.held) * float(np.median(fitted.batch.dt)) / fitted.flight.every
    if by <= 0.0 or named:
        return other
    late = Attached(effect=sensor_delay("inertial"), values={"value": by})
    unit = fit(fitted.flight, [*fitted.attached, late], fitted.noise, fitted, extent="settled")
    return fitted if unit.deviance < other.deviance - fitted.criteria.missing else other


def held_share(fitted: FlightFit, *, named: bool = False) -> float:
    """Share of an interval between recorded samples over which inputs are held (`Batch.held`), in steps.

    Two surfaces that determine it well must agree; otherwise the present share is returned. A single surface may be
    late for other reasons. It is sufficient for inputs that are held over the complete interval, and beside causes that
    are `named` already.
    """
    shares, stds, gains = surface_shares(fitted)
    step = fitted.criteria.parts.quarter
    clear = stds < step / 2
    needed = min(2, int(clear.sum()) if named else len(shares))
    if clear.sum() < max(needed, 1):
        return fitted.flight.held
    share = float(np.clip(round(float(np.median(shares[clear])) / step) * step, -1.0, 1.0))
    agree = clear & (np.abs(shares - share) < step)
    alone = needed == 1 and not named
    if agree.sum() < needed or (alone and share != 1.0) or gains[agree].sum() < fitted.criteria.missing:
        return fitted.flight.held
    return share


def surface_shares(fitted: FlightFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(shares, their 1-sigmas, decreases of the deviance) Predicted by linearisation, for each surface that moves and
    acts.

    The innovations of each channel are taken as a first-order autoregressive process and whitened once more: timing
    shows in fast motion, and most errors of the model are slower.
    """
    linear = fitted.linear
    batch = fitted.batch
    moving = dict(zip(fitted.model.inputs, np.ptp(batch.U, axis=(0, 1)), strict=True))
    inputs = [name for name in SURFACES if moving.get(name, 0.0) > 0.0]
    stations = [fitted.model.disturbances.index(control(name)) for name in inputs]
    columns = [fitted.model.inputs.index(name) for name in inputs]
    last = batch.U[:-1, :, columns] - batch.U[1:, :, columns]
    F = 0.5 * (linear.Bw0 + linear.Bw1)[..., stations] * last[:, :, None, :]
    white = fitted.filter.whiten(np.zeros((*fitted.read.shape, len(inputs))), F)
    left, whiter = _whiter(fitted.white)
    k = len(fitted.slots)
    information = Gram(len(fitted.slots) + len(inputs))
    match = 0.0
    for r in range(left.shape[1]):  # of one record at a time, as all of them take much memory
        columns = np.concatenate([whiter(fitted.columns[:, r]), whiter(white[:, r])], axis=2)
        information.add(columns.reshape(-1, columns.shape[2]))
        match = match + left[:, r].reshape(-1) @ columns.reshape(-1, columns.shape[2])
    weight = np.r_[fitted.prior_weight, np.zeros(len(inputs))]
    covariance = scaled_inverse(information.whole + np.diag(weight))[k:]
    change = covariance @ match
    variance = np.diag(covariance[:, k:])
    acts = variance > 0.0  # a surface of an axis out of scope has no information, or a negative rounding error
    change = change[acts]
    variance = variance[acts]
    every = fitted.flight.every
    return fitted.flight.held + every * change, every * np.sqrt(variance), change**2 / variance


def _whiter(white: np.ndarray) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Innovations (N, R, ny) less their prediction from the previous sample, over the remaining r.m.s., and what does
    the same to columns (N, ny, n) of one record.

    Channels with large errors of the model therefore have less weight.
    """
    before = white[:-1]
    after = white[1:]
    carried = np.sum(before * after, axis=(0, 1)) / np.maximum(np.sum(before**2, axis=(0, 1)), 1e-300)
    left = after - carried * before
    unit = np.sqrt(np.maximum(np.mean(left**2, axis=(0, 1)), 1.0))
    return left / unit, lambda columns: (columns[1:] - carried[:, None] * columns[:-1]) / unit[:, None]
