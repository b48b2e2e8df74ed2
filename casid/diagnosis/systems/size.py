"""Size of a cause of a plant, in units of what matters at its port, or in the readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings
from casid.diagnosis.systems.library import as_term, level, told_limit
from casid.filtering.innovations import Linear
from casid.model.port import ModelPort as Port
from casid.model.station import Station


def share_of(fit: FlightFit, one: Attached) -> float:
    """R.m.s. of the effect of a cause at its port, in units of what matters there. At an equation it is the relative
    change of a reading if that is larger: little damping is a small part of an acceleration, but a large change of a
    swing.
    """
    effect, value, share = one.effect, one.values["value"], fit.criteria.size.share
    if effect.timed:
        return abs(value) / share  # nothing is left of a reading that does not move
    if effect.relative:
        return abs(value) / (share * max(abs(fit.model.nominal[effect.target]), 1e-12))
    port = _port(fit, effect.enters)
    history = _history(fit, one)
    there = np.array([one.concerns(name) for name in fit.batch.names]) & fit.batch.live
    size = _size(history[there]) / matters_at(fit, port)
    if port.kind != "state derivative" or port.matters is not None:
        return size
    return max(size, _change_of_readings(fit, port, np.where(there, history, 0.0)) / share)


def told(fit: FlightFit, one: Attached, std: float) -> tuple[float, float]:
    """Value and 1-sigma of a cause for a person: of a limit, or of the level at which a reading is stuck."""
    effect, value, records = one.effect, one.effect.in_words(one.values)["value"], fit.flight.records
    if effect.timed:
        concerned = [record for record in records if one.concerns(record.name) and effect.target in record]
        read = [record[effect.target][record.t > one.onsets[record.name]] for record in concerned]
        seen = np.concatenate([values[np.isfinite(values)] for values in read])
        return level(seen), fit.flight.sigma[effect.target] / math.sqrt(max(len(seen), 1))
    if effect.kind in ("limit_above", "limit_below"):
        value = told_limit(effect, value, [record[effect.target] for record in records])
    return value, std


def told_at(fit: FlightFit, missing: Sequence[MissingInput]) -> list[MissingInput]:
    """Of latent inputs, strongest first, the one that is reported, with its port in words.

    Among ports with nearly equal statistics it is an input, because its effect enters an equation too.
    """
    if not missing:
        return []
    alike = [one for one in missing if missing[0].gain - one.gain < equivalence(missing[0].gain, fit.criteria)]
    best = next((one for one in alike if one.place.kind == "control"), missing[0])
    return [replace(best, called=_port(fit, best.station).words)]


def missing_share(fit: FlightFit, missing: MissingInput) -> float:
    """R.m.s. of the latent input at a port over the variation there."""
    port = _port(fit, missing.station)
    return fit.criteria.size.share * missing.rms / matters_at(fit, port)


def matters_at(fit: FlightFit, port: Port) -> float:
    """The smallest r.m.s. size that matters at a port: stated by the port, or a part of the variation there."""
    if port.matters is not None:
        return port.matters
    live = fit.batch.live
    if port.kind == "state derivative":
        x = fit.motion.X[..., fit.model.states.index(port.name)]
        there = np.gradient(x, axis=0)[live] / np.gradient(fit.batch.t, axis=0)[live]
    elif port.kind == "input":
        there = fit.batch.U[..., fit.model.inputs.index(port.name)][live]
    else:
        there = fit.linear.output[..., fit.model.outputs.index(port.name)][live]
    return max(fit.criteria.size.share * float(np.std(there)), 1e-12)


def _port(fit: FlightFit, station: str | None) -> Port:
    ports = {port.disturbance: port for port in fit.flight.ports}  # pyright: ignore[reportAttributeAccessIssue]
    if station in ports:
        return ports[station]
    return ports["y_" + Station.at(str(station)).name]


def _history(fit: FlightFit, one: Attached) -> np.ndarray:
    """(N, R) what a cause adds where it enters."""
    effect, names, t = one.effect, fit.batch.names, fit.batch.t
    if effect.regressor is not None:
        return one.values["value"] * fit.regressors[as_term(effect.regressor)]
    if effect.series is not None:
        W = disturbance_series([one], names, t, fit.known, fit.model.disturbances)
        return W[..., fit.model.disturbances.index(str(effect.enters))]
    i, read = fit.model.outputs.index(effect.target), fit.linear.output
    if effect.output is not None:
        return (readings([one], names, t, read, fit.model.outputs, fit.known) - read)[..., i]
    return one.values["value"] * (np.ones(t.shape) if effect.kind == "sensor_bias" else read[..., i])


def _size(values: np.ndarray) -> float:
    """Size of an effect: the value of a constant, the variation of anything else."""
    varies, whole = float(np.std(values)), float(np.sqrt(np.mean(values**2)))
    return varies if varies > 1e-9 * whole else whole


def _change_of_readings(fit: FlightFit, port: Port, history: np.ndarray) -> float:
    """Largest r.m.s. change of a reading by a history (N, R) at a port, over the variation of that reading; the motion
    linearised, from the same initial state."""
    linear, at = fit.linear, fit.model.disturbances.index(port.disturbance)
    change = _simulated(linear, at, history)
    variation = np.array(
        [
            max(float(np.std(linear.output[..., i][fit.batch.live])), fit.noise.measurement[name])
            for i, name in enumerate(fit.model.outputs)
        ]
    )
    return float(np.max(np.sqrt(np.mean(change[fit.batch.live] ** 2, axis=0)) / variation))


def _simulated(linear: Linear, at: int, history: np.ndarray) -> np.ndarray:
    """(N, R, ny) change of the readings by a history (N, R) at a disturbance."""
    N, R, _ = linear.X.shape
    x, found = np.zeros((R, linear.X.shape[2])), np.zeros(linear.output.shape)
    for k in range(N):
        found[k] = np.einsum("rij,rj->ri", linear.C[k], x) + linear.Dw[k, :, :, at] * history[k][:, None]
        if k < N - 1:
            x = np.einsum("rij,rj->ri", linear.A[k], x)
            x = x + linear.Bw0[k, :, :, at] * history[k][:, None] + linear.Bw1[k, :, :, at] * history[k + 1][:, None]
    return found
