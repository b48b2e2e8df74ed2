"""Noise that cannot be read from the records is estimated with the fit: how strong it is, and how slowly it moves.

A channel that was filtered, held or rounded does not show its noise (`Flight.doubted`), and what a model leaves of it
is mostly what the model does not have. Both are believed no more than that. What the fit leaves of such a channel is
taken for its noise, level and correlation time by maximum likelihood, and once more after every cause that is named.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit, Free, scaled_inverse
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached, readings
from casid.diagnosis.flight.statistics import free_simulation
from casid.filtering.colour import most_likely
from casid.filtering.kalman import residual_about
from casid.filtering.slow import usual_offset, white_and_slow
from casid.model.causes import sensor_bias
from casid.model.station import control
from casid.records.noise import isolated
from casid.records.record import Record
from casid.signals import SURFACES


def in_colour(fitted: FlightFit, free: Free = "all") -> FlightFit:
    """The fit with the noise of doubted outputs as it leaves it: first how strong it is, by a free simulation, then how
    slowly it moves, by its innovations; each until it stays. With forces free, which no simulation flies, only that."""
    numerics = fitted.criteria.numerics.fit
    if not fitted.flight.noise_by_fit:
        return fitted
    for _ in range(numerics.noise_level_fits):
        before, level = fitted.flight.sigma, level_of(fitted)
        fitted = _under(fitted, before | level, {}, free)
        if all(abs(np.log(level[o] / before[o])) < numerics.noise_stays for o in level):
            break
    for _ in range(numerics.colour_fits):
        before, colour = fitted.noise.colour, colour_of(fitted, fitted.flight.doubted)
        fitted = _under(fitted, fitted.flight.sigma, colour, free)
        if before and all(abs(np.log(colour[o][0] / before[o][0])) < numerics.noise_stays for o in colour):
            break
    return fitted


def is_far(fitted: FlightFit, most: float) -> bool:
    """Whether what is left per reading is `most` times the noise or more, in squares, though that was read: then it is
    no noise of the instruments, nor what a single cause could explain."""
    return not fitted.flight.noise_by_fit and float(np.sum(fitted.white**2)) > most * fitted.readings


def unread(flight: Flight) -> Flight:
    """The flight with the noise of all outputs doubted that the file does not state."""
    unsure = tuple(o for o in flight.outputs if not flight.aircraft.noise.get(o))
    return replace(flight, doubted=unsure).within_the_motion()


def _under(fitted: FlightFit, sigma: dict[str, float], colour: dict[str, tuple[float, float]], free: Free) -> FlightFit:
    """The fit under other noise of its outputs."""
    flight = replace(fitted.flight, sigma=sigma, colour=colour)
    noise = replace(fitted.noise, measurement=sigma, colour=colour)
    return fit(flight, fitted.attached, noise, fitted, free=free, iterations=15)


def level_of(fitted: FlightFit) -> dict[str, float]:
    """Output -> r.m.s. of what a free simulation leaves of every doubted one, and no more than it varies by."""
    residual, found = free_simulation(fitted).residual, {}
    for name in fitted.flight.doubted:
        i = fitted.model.outputs.index(name)
        measured, left = fitted.batch.Z[..., i], residual[..., i]
        if np.isfinite(measured).any():
            with np.errstate(over="ignore"):
                found[name] = float(min(np.sqrt(np.nanmean(left**2)), np.nanstd(measured)))
    return found


def as_slow_as_left(fitted: FlightFit) -> FlightFit:
    """The fit with noise of outputs that is white in part and slow in part, as it leaves it (`slow_of`)."""
    if fitted.noise.colour:
        return fitted
    noise = replace(fitted.noise, slow=slow_of(fitted))
    return fit(fitted.flight, fitted.attached, noise, fitted, free=fitted.free, iterations=15)


def as_coloured_as_left(fitted: FlightFit) -> FlightFit:
    """The fit with innovations as coloured as it leaves them: of what moving air does a process is a rough model, and
    leaves some of it in readings without noise of their own being slow. More than that is not noise (`slow_of`)."""
    most = fitted.criteria.noise.slow
    left = colour_of(fitted, fitted.model.outputs)
    colour = {name: (sigma, tau) for name, (sigma, tau) in left.items() if sigma**2 <= most}
    return _under(fitted, fitted.flight.sigma, colour, fitted.free)


def slow_of(fitted: FlightFit) -> dict[str, tuple[tuple[float, float], ...]]:
    """Slow noise of every output as a fit leaves it (`NoiseModel.slow`): an offset in every record, and a part that
    moves, where that gains. More than instruments may have of that is not theirs, and no noise."""
    white, criteria, sigma = _innovations(fitted), fitted.criteria.noise, fitted.noise.measurement
    found = white_and_slow(fitted.batch.t, white, fitted.linear.seen)
    flown, slow = sum(record.duration for record in fitted.flight.records), {}
    offsets = np.array([one.offsets for one in found]).T + _put_in(fitted) / np.array(
        [sigma[name] for name in fitted.model.outputs]
    )
    usual = usual_offset(offsets, np.array([one.stds for one in found]).T)
    for name, one in zip(fitted.model.outputs, found, strict=True):
        largest = sensor_bias(name).smallest_that_matters(fitted.flight.aircraft) or np.inf
        # a variance is known from as many independent values as correlation times were flown
        most = (criteria.slow - 1.0) * (1.0 + criteria.slow_sigmas * np.sqrt(2.0 * one.tau / flown))
        parts = [(min(usual * sigma[name], largest), np.inf)] if usual else []
        if one.gain > criteria.slow_gain and one.slow**2 < most:
            parts.append((one.slow * sigma[name], one.tau))
        slow |= {name: tuple(parts)} if parts else {}
    return slow


def _put_in(fitted: FlightFit) -> np.ndarray:
    """(R, ny) offsets of readings that attached effects make: what they add there and does not change with time."""
    batch, output = fitted.batch, fitted.linear.output
    found, rounding = np.zeros(output.shape[1:]), fitted.criteria.structure.rounding
    for one in fitted.attached:
        if one.effect.output is not None:
            added = readings([one], batch.names, batch.t, output, fitted.model.outputs, fitted.known) - output
            found += np.where(np.ptp(added, axis=0) <= rounding * np.abs(output).max(axis=0), added[0], 0.0)
    return found


def colour_of(fitted: FlightFit, outputs: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Output -> (1-sigma, correlation time [s]) of the innovations of each of these that is measured, in units of its
    noise."""
    white, seen, t = _innovations(fitted), fitted.linear.seen, fitted.batch.t
    found = {}
    for name in outputs:
        i = fitted.model.outputs.index(name)
        series = [(t[at, r], white[at, r, i]) for r, at in enumerate(seen[..., i].T)]
        if sum(len(values) for _, values in series) > len(fitted.slots):
            found[name] = most_likely(series)
    return found


def _innovations(fitted: FlightFit) -> np.ndarray:
    """(N, R, ny) innovations of a fit, of no colour."""
    plain = replace(fitted.filter, noise=replace(fitted.filter.noise, colour={}))
    through = fitted.filter.through
    column = residual_about(fitted.linear, fitted.acting, fitted.motion.coloured, fitted.errors, through)
    return plain.whiten(*column)[..., 0]


def with_noise_level(flight: Flight, attached: Sequence[Attached]) -> Flight:
    """The flight with the noise of its doubted outputs judged by the model that `attached` extends, and that of its
    inputs by what a filter common to all channels took from the outputs."""
    return _by_the_model(flight, attached).with_filtered_inputs().within_the_motion()


def _by_the_model(flight: Flight, attached: Sequence[Attached]) -> Flight:
    if not flight.doubted:
        return flight
    criteria, numerics = flight.criteria.noise, flight.criteria.numerics.fit
    variation = {o: float(np.nanstd(np.concatenate([r[o] for r in flight.records]))) for o in flight.doubted}
    first = {o: max(flight.sigma[o], criteria.first * v) for o, v in variation.items()}
    now = replace(flight, sigma=flight.sigma | first)
    fitted = None
    for _ in range(numerics.noise_fits):
        tolerance = numerics.noise_tolerance
        fitted = fit(now, attached, now.noise(), fitted, iterations=numerics.noise_iterations, tolerance=tolerance)
        residual = free_simulation(fitted).residual
        now = flight.with_noise_above(
            [_left(now, record, residual[: len(record), r]) for r, record in enumerate(now.records)]
        )
    return now


def _left(flight: Flight, record: Record, residual: np.ndarray) -> Record:
    return record.with_channels(**{o: residual[:, i] for i, o in enumerate(flight.outputs)})


def without_outliers(fitted: FlightFit) -> FlightFit:
    """The fit without the outliers that it shows, and without those that then show; the same when there is none."""
    for _ in range(fitted.criteria.numerics.fit.outlier_fits):
        at, outputs = outliers(fitted), fitted.model.outputs
        if not at.any():
            break
        records = []
        for r, record in enumerate(fitted.flight.records):
            off = {o: at[: len(record), r, i] for i, o in enumerate(outputs) if at[:, r, i].any()}
            kept = {o: np.where(alone, np.nan, record[o]) for o, alone in off.items()}
            notes = [f"{o}: {alone.sum()} single readings far from all others left out" for o, alone in off.items()]
            records.append(replace(record.with_channels(**kept), notes=(*record.notes, *notes)))
        flight = replace(fitted.flight, records=tuple(records), _regressors={})
        fitted = fit(flight, fitted.attached, fitted.noise, iterations=20)
    return fitted


def outliers(fitted: FlightFit) -> np.ndarray:
    """(N, R, ny) True at single innovations far from those before and behind. Not of an output that a surface enters
    at once, where one moves: a surface that is late by a sample makes such an innovation, too."""
    white, seen, at_once = fitted.white, fitted.linear.seen, _at_once(fitted)
    found = np.zeros(seen.shape, dtype=bool)
    for r in range(seen.shape[1]):
        for i in range(seen.shape[2]):
            at = np.flatnonzero(seen[:, r, i])
            found[at, r, i] = isolated(white[at, r, i], fitted.criteria.noise.outlier)
    return found & ~(at_once & _moving(fitted)[..., None])


def _at_once(fitted: FlightFit) -> np.ndarray:
    """(ny,) True of outputs that a surface enters without a state between."""
    stations = [control(name) for name in SURFACES if control(name) in fitted.model.disturbances]
    index = [fitted.model.disturbances.index(name) for name in stations]
    return np.any(fitted.linear.Dw[..., index] != 0.0, axis=(0, 1, 3))


def _moving(fitted: FlightFit) -> np.ndarray:
    """(N, R) samples at which a surface moves, and those beside them that feel it."""
    flight, batch, moving = fitted.flight, fitted.batch, np.zeros(fitted.batch.live.shape, dtype=bool)
    for name in (one for one in SURFACES if one in fitted.model.inputs):
        U = batch.U[..., fitted.model.inputs.index(name)]
        least = flight.criteria.noise.outlier_input * np.sqrt(2.0) * flight.input_sigma.get(control(name), 0.0)
        moves = np.abs(np.diff(U, axis=0)) > least
        moving[1:] |= moves
        moving[:-1] |= moves
    wide = moving.copy()
    wide[1:] |= moving[:-1]
    wide[:-1] |= moving[1:]
    return wide


def as_inputs_run(fitted: FlightFit, *, named: bool = False) -> FlightFit:
    """The fit with inputs that run between samples as the surfaces agree that they do, if that is another way and gains
    enough. And, beside causes that are `named` already, if it is worth another naming."""
    criteria, share = fitted.criteria.input_timing, held_share(fitted, named=named)
    late = 2.0 * criteria.change_s / float(np.median(fitted.batch.dt))
    worth = min(criteria.change, late) if named else criteria.step
    if abs(share - fitted.flight.held) < worth:
        return fitted
    flight = fitted.flight.with_inputs_held(share)
    other = fit(flight, fitted.attached, fitted.noise, fitted, iterations=20)
    return other if other.deviance < fitted.deviance - criteria.gain else fitted


def held_share(fitted: FlightFit, *, named: bool = False) -> float:
    """Share of a sample interval over which inputs are held (`Batch.held`), in steps, on which two surfaces agree that
    move enough to tell; as it is where they do not. One that tells alone may be late for other reasons: it does so of
    inputs that are wholly held, and beside causes that are `named` already."""
    shares, stds, gains = surface_shares(fitted)
    criteria = fitted.criteria.input_timing
    clear = stds < criteria.std
    needed = min(criteria.surfaces, int(clear.sum()) if named else len(shares))
    if clear.sum() < max(needed, 1):
        return fitted.flight.held
    share = float(np.clip(round(float(np.median(shares[clear])) / criteria.step) * criteria.step, -1.0, 1.0))
    agree = clear & (np.abs(shares - share) < criteria.agreement)
    alone = needed == 1 and not named
    if agree.sum() < needed or (alone and share != 1.0) or gains[agree].sum() < criteria.gain:
        return fitted.flight.held
    return share


def surface_shares(fitted: FlightFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each surface that moves and acts the share that linearisation predicts, its 1-sigma, and the deviance's drop.

    What the fit leaves of each channel is taken as a first-order autoregressive process, whitened once more: timing
    shows in quick movements, and most of what a model may miss is slower.
    """
    linear, batch = fitted.linear, fitted.batch
    moving = dict(zip(fitted.model.inputs, np.ptp(batch.U, axis=(0, 1)), strict=True))
    inputs = [name for name in SURFACES if moving.get(name, 0.0) > 0.0]
    stations = [fitted.model.disturbances.index(control(name)) for name in inputs]
    columns = [fitted.model.inputs.index(name) for name in inputs]
    last = batch.U[:-1, :, columns] - batch.U[1:, :, columns]
    F = 0.5 * (linear.Bw0 + linear.Bw1)[..., stations] * last[:, :, None, :]
    white = fitted.filter.whiten(np.zeros((*fitted.read.shape, len(inputs))), F)
    left, (slots, shifted) = _whiter(fitted.white, (fitted.columns, white))
    k, both = len(fitted.slots), np.concatenate([slots, shifted], axis=3).reshape(left.size, -1)
    information = both.T @ both
    information[range(k), range(k)] += fitted.prior_weight
    covariance = scaled_inverse(information)[k:]
    change, variance = covariance @ (both.T @ left.reshape(-1)), np.diag(covariance[:, k:])
    acts = variance > 0.0  # a surface of axes that do not move tells nothing, and rounding may leave less than that
    change, variance = change[acts], variance[acts]
    return fitted.flight.held + change, np.sqrt(variance), change**2 / variance


def _whiter(white: np.ndarray, parts: Sequence[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Innovations (N, R, ny), and (N, R, ny, columns) with them, less what the sample before tells, in units of what is
    left: channels that the model misses count for less."""
    before, after = white[:-1], white[1:]
    carried = np.sum(before * after, axis=(0, 1)) / np.maximum(np.sum(before**2, axis=(0, 1)), 1e-300)
    left = after - carried * before
    unit = np.sqrt(np.maximum(np.mean(left**2, axis=(0, 1)), 1.0))
    return left / unit, [(one[1:] - carried[:, None] * one[:-1]) / unit[:, None] for one in parts]
