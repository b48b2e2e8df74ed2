"""Statistics of a fitted model for each channel: residual, whiteness, Theil's coefficient, R2, spectrum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import signal, stats

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import readings
from casid.estimation.fitted import channel_fit


@dataclass(frozen=True, kw_only=True)
class ChannelStatistics:
    """Statistics of one channel over all records.

    rms          r.m.s. of measured minus simulated; the simulation runs freely from each record's fitted initial state
    noise        1-sigma of the instrument, from the band above the motion
    whiteness_p  Ljung-Box p-value of the innovations; a small value indicates a systematic error
    theil        Theil's coefficient of measured and simulated: 0 is perfect, 1 is no relation
    R2           share of the variance of the channel that the simulation explains; NaN for a constant channel
    """

    rms: float
    noise: float
    whiteness_p: float
    theil: float
    R2: float


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedRecords:
    """Free simulation of a fit.

    output    (N, R, ny) readings
    residual  (N, R, ny) measured minus simulated, NaN where not measured
    """

    output: np.ndarray
    residual: np.ndarray


def free_simulation(fit: FlightFit, start: np.ndarray | None = None) -> SimulatedRecords:
    """Simulate every record from its fitted initial state, or from `start` (R, states), open loop with the recorded
    inputs.

    A result that overflows is infinite.
    """
    begin = fit.linear.X[0] if start is None else start
    model, batch = fit.model, fit.batch
    N, R = batch.live.shape
    chain = fit.functions.step_function.mapaccum("chain", N - 1)
    X = np.empty((N, R, len(model.states)))
    (U0, U1), (W0, W1) = batch.ends(batch.U), batch.ends(fit.disturbances, batch.held_at(model))
    for r in range(R):
        P = np.tile(fit.parameters[r][:, None], (1, N - 1))
        given = (one[:, r].T for one in (U0, U1))
        states = chain(begin[r], *given, P, W0[:, r].T, W1[:, r].T, batch.dt[:, r][None])
        X[:, r] = np.vstack([begin[r][None], states.full().T])
    output = fit.output_along(X)
    output = readings(fit.attached, batch.names, batch.t, output, model.outputs, fit.known)
    output = np.where(np.isfinite(output), output, np.inf)
    seen = np.isfinite(batch.Z) & batch.live[..., None]
    return SimulatedRecords(output=output, residual=np.where(seen, batch.Z - output, np.nan))


def channel_fits(fit: FlightFit, simulated: SimulatedRecords) -> dict[str, ChannelStatistics]:
    """Statistics of every output that some record measures, over all records."""
    table, lags = {}, fit.criteria.numerics.fit.whiteness_lags
    for i, name in enumerate(fit.model.outputs):
        error = simulated.residual[..., i]
        if not fit.linear.seen[..., i].any() or np.isnan(error).all():
            continue
        # Use the measured samples. A late reading is compared at other samples.
        measured = np.where(np.isnan(error), np.nan, fit.batch.Z[..., i])
        flown = channel_fit(measured.ravel(), (measured - error).ravel())
        table[name] = ChannelStatistics(
            rms=flown.rms,
            noise=fit.noise.measurement[name],
            whiteness_p=whiteness(fit.white[..., i], fit.linear.seen[..., i], lags),
            theil=flown.theil,
            R2=flown.R2,
        )
    return table


def whiteness(white: np.ndarray, seen: np.ndarray, lags: int = 20) -> float:
    """Ljung-Box p-value with a number of `lags`, pooled over the records of a channel (N, R)."""
    statistic, dof = 0.0, 0
    for r in range(white.shape[1]):
        e = white[seen[:, r], r]
        n = len(e)
        if n <= 2 * lags:
            continue
        e = e - e.mean()
        correlation = np.array([e[k:] @ e[: n - k] for k in range(1, lags + 1)]) / (e @ e)
        statistic += n * (n + 2) * float(np.sum(correlation**2 / (n - np.arange(1, lags + 1))))
        dof += lags
    return float(stats.chi2.sf(statistic, dof)) if dof else 1.0


def band_energy(fit: FlightFit, simulated: SimulatedRecords, edges_hz: np.ndarray) -> np.ndarray:
    """(ny, bands) Energy of the free-simulation residual over that of the instrument noise, per frequency band."""
    ratio = np.full((len(fit.model.outputs), len(edges_hz) - 1), np.nan)
    for i, name in enumerate(fit.model.outputs):
        total = np.zeros(len(edges_hz) - 1)
        measured = [r for r in range(len(fit.batch.names)) if fit.linear.seen[:, r, i].any()]
        for r in measured:
            record = fit.flight.records[r]
            error = np.nan_to_num(simulated.residual[: len(record), r, i])
            frequency, power = signal.periodogram(error - error.mean(), 1.0 / record.dt)
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

    def to_dict(self) -> dict[str, Any]:
        """`as_given`, `refitted` or `extended` of diagnosis.json."""
        channels = {
            name: {"rms": c.rms, "noise": c.noise, "whiteness_p": c.whiteness_p, "theil": c.theil, "R2": c.R2}
            for name, c in self.channels.items()
        }
        return {"channels": channels, "log_likelihood": self.log_likelihood}


def view_of(fit: FlightFit, start: np.ndarray | None = None) -> View:
    """The view of a fit; its simulation begins at the fitted initial states, or at `start` (R, states)."""
    simulated = free_simulation(fit, start)
    return View(fit=fit, simulated=simulated, channels=channel_fits(fit, simulated))
