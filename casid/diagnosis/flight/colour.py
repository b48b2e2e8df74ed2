"""Noise that cannot be read from the records is estimated with the fit: how strong it is, and how slowly it moves.

A channel that was filtered, held or rounded does not show its noise (`Flight.doubted`), and what a model leaves of it
is mostly what the model does not have. Both are believed no more than that. What the fit leaves of such a channel is
taken for its noise, level and correlation time by maximum likelihood, and once more after every cause that is named.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit, Free
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import readings
from casid.diagnosis.flight.statistics import free_simulation
from casid.filtering.colour import most_likely
from casid.filtering.kalman import residual_about
from casid.filtering.slow import usual_offset, white_and_slow
from casid.model.causes import sensor_bias


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
