"""Aerodynamic regressors along the measured and the estimated motion of a flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from casid.filtering.innovations import at_points, make_batch
from casid.model import operators
from casid.model.aircraft import Aircraft
from casid.model.path import (
    AIR_STATES,
    STATES,
    SignalPath,
    air_data_station,
    disturbance_names,
    given_series,
    surface_station,
    wind_station,
)
from casid.model.station import control
from casid.model.system import Model
from casid.model.terms import Term
from casid.native.compiler import Compilable
from casid.records.noise import mean_over, quiet_windows
from casid.records.record import Record


class Flown(Protocol):
    """Interface of a flight with regressors."""

    @property
    def aircraft(self) -> Aircraft: ...
    @property
    def records(self) -> Sequence[Record]: ...
    @property
    def turning(self) -> Mapping[str, float]: ...
    @property
    def input_sigma(self) -> Mapping[str, float]: ...
    def measured(self, model: Model) -> np.ndarray: ...


class Regressors:
    """The aerodynamic regressors of an aircraft along trajectories by name, its inputs, and its own aerodynamics.

    The last are the series of `given_series`.
    """

    def __init__(self, flight: Flown, model: Model) -> None:
        named = dict(zip((*model.states, *model.inputs), (*ca.vertsplit(model.x), *ca.vertsplit(model.u)), strict=True))
        moving = dict(zip(model.disturbances, ca.vertsplit(model.w), strict=True))
        air = [AIR_STATES[axis][0] for axis in flight.turning]
        path = SignalPath(
            aircraft=flight.aircraft,
            state={s: named[s] for s in (*STATES, *air) if s in named},
            inputs=named,
            parameter={},
            turning={axis: sign for axis, sign in flight.turning.items() if AIR_STATES[axis][0] in named},
            disturbance={d: moving.get(d, ca.SX(0)) for d in disturbance_names(flight.aircraft.force_axes)},
        )
        for station in (surface_station, wind_station, air_data_station):
            station(path)
        rows = path.regressor | given_series(path)
        self.names = tuple(rows)
        self._inputs, self._states, self._sigma = model.inputs, model.states, flight.input_sigma
        self._batch = make_batch(model, flight.records)
        self._lengths = {"alpha": flight.aircraft.rate_length_pitch, "beta": flight.aircraft.rate_length_lateral}
        expressions = ca.vertcat(*rows.values(), path.air["V"])
        self._function = Compilable(ca.Function("regressors", [model.x, model.u, model.w], [expressions]))
        self._measured, self._disturbances = flight.measured(model), len(model.disturbances)
        self._windows = {name: self._quiet(i, name) for i, name in enumerate(self._inputs)}
        quiet = self.inputs({})
        self.recorded = {name: quiet[..., i] for i, name in enumerate(self._inputs)}

    def _quiet(self, i: int, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each record, the windows over which an input may be averaged."""
        sigma, samples = self._sigma.get(control(name), 0.0), self._batch.live.sum(axis=0)
        return [quiet_windows(self._batch.U[:n, j, i], sigma) for j, n in enumerate(samples)]

    def inputs(self, noise: Mapping[str, np.ndarray]) -> np.ndarray:
        """(N, R, nu) Recorded inputs corrected by their most likely `noise` (disturbance -> (N, R)), and denoised.

        Noise of a recorded input is also in the regressors computed from it, and would correlate with the residual that
        it causes. The noise that remains beside the motion does not. Noise larger than possible indicates a fault; it
        is reduced in proportion to its excess.
        """
        U, live = self._batch.U.copy(), self._batch.live
        for i, name in enumerate(self._inputs):
            if (station := control(name)) in noise:
                power = np.sum(noise[station] ** 2, axis=0) / live.sum(axis=0) / self._sigma[station] ** 2
                U[..., i] += noise[station] / np.maximum(power, 1.0)
            for j, windows in enumerate(self._windows[name]):
                samples = len(windows[0])
                U[:samples, j, i] = mean_over(U[:samples, j, i], *windows)
                U[samples:, j, i] = U[samples - 1, j, i]
        return U

    def variation(self, term: Term) -> float:
        """Standard deviation of a term along the measured motion."""
        return float(np.std(self.measured(term)))

    def measured(self, term: Term) -> np.ndarray:
        """(samples,) A term along the measured motion."""
        live = self._batch.live
        return np.broadcast_to(term.evaluate(self._as_measured), live.shape)[live]

    @cached_property
    def _as_measured(self) -> dict[str, np.ndarray]:
        X = self._measured
        return self.along(X, np.zeros((*X.shape[:2], self._disturbances)), self._batch.U)

    def along(self, X: np.ndarray, W: np.ndarray, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Name -> (N, R) regressors and inputs along a trajectory.

        Rates of the flow angles, from finite differences, are included.

        Parameters
        ----------
        X
            (N, R, nx) Trajectory.
        W
            (N, R, nw) Disturbances, including moving air.
        inputs
            (N, R, nu) Inputs.
        """
        values = at_points(self._function, X, inputs, W)[0][..., 0]
        table = {name: inputs[..., i] for i, name in enumerate(self._inputs)}
        table |= {name: values[..., i] for i, name in enumerate(self.names)}
        motion = {name: X[..., i] for i, name in enumerate(self._states)}
        table |= {name: motion[name] for name in ("phi", "theta") if name in motion}
        if all(name in motion for name in operators.TURNING):
            columns = zip(self._batch.t.T, *(motion[name].T for name in operators.TURNING), strict=True)
            table["turned"] = np.stack([operators.turned(*column) for column in columns], axis=1)
        for angle, length in self._lengths.items():
            rate = [np.gradient(series, t) for series, t in zip(table[angle].T, self._batch.t.T, strict=True)]
            table[f"{angle}dot"] = np.stack(rate, axis=1) * length / values[..., -1]
        return table
