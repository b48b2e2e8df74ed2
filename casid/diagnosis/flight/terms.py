"""The terms of a model along trajectories, beside its inputs, states and readings, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType

import casadi as ca
import numpy as np

from casid.filtering.innovations import Batch, at_points
from casid.model.library import as_term
from casid.model.station import control
from casid.model.system import Model
from casid.model.terms import Term, parse_term
from casid.native.compiler import Compilable
from casid.records.noise import mean_over, quiet_windows

Table = dict[str, np.ndarray]
# (motion by state, table so far, times (N, R), whether the motion is predicted from the samples before) -> more of it
Further = Callable[[Table, Table, np.ndarray, bool], Table]


def _nothing(*_: object) -> Table:
    return {}


class Terms:
    """Expressions of a model along trajectories by name, its inputs, and what goes with them.

    model, batch  the model and its records
    rows          name -> expression in states, inputs and disturbances
    measured      (N, R, states) measured motion
    sigma         disturbance -> 1-sigma of the noise of a recorded input
    states        names of states that the table has too;  read: name -> (N, R) series that do not follow the motion
    further       what is made of the motion by differences along time
    quiet         whether inputs are averaged where they rest
    """

    def __init__(
        self,
        model: Model,
        batch: Batch,
        rows: Mapping[str, ca.SX],
        measured: np.ndarray,
        sigma: Mapping[str, float],
        *,
        states: Sequence[str] = (),
        read: Mapping[str, np.ndarray] = MappingProxyType({}),
        further: Further = _nothing,
        quiet: bool = False,
    ) -> None:
        self.names = tuple(rows)
        self._inputs = model.inputs
        self._states = model.states
        self._shown = tuple(states)
        self._read = read
        self._further = further
        self._sigma = sigma
        self._batch = batch
        self._measured = measured
        self._disturbances = len(model.disturbances)
        expressions = ca.densify(ca.vertcat(*rows.values())) if rows else ca.SX(0, 1)
        self._function = Compilable(ca.Function("terms", [model.x, model.u, model.w], [expressions]))
        self._windows = {name: self._quiet(i, name) for i, name in enumerate(self._inputs)} if quiet else {}
        recorded = self.inputs({})
        self.recorded = {name: recorded[..., i] for i, name in enumerate(self._inputs)}

    def _quiet(self, i: int, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each record, the windows over which an input may be averaged."""
        sigma = self._sigma.get(control(name), 0.0)
        samples = self._batch.live.sum(axis=0)
        return [quiet_windows(self._batch.U[:n, j, i], sigma) for j, n in enumerate(samples)]

    def inputs(self, noise: Mapping[str, np.ndarray]) -> np.ndarray:
        """(N, R, nu) Recorded inputs corrected by their most likely `noise` (disturbance -> (N, R)), and denoised.

        Noise of a recorded input is also in the terms computed from it, and would correlate with the residual that it
        causes. The noise that remains beside the motion does not. Noise larger than possible indicates a fault; it is
        reduced in proportion to its excess.
        """
        U = self._batch.U.copy()
        live = self._batch.live
        for i, name in enumerate(self._inputs):
            if (station := control(name)) in noise:
                power = np.sum(noise[station] ** 2, axis=0) / live.sum(axis=0) / self._sigma[station] ** 2
                U[..., i] += noise[station] / np.maximum(power, 1.0)
            for j, windows in enumerate(self._windows.get(name, ())):
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
    def _as_measured(self) -> Table:
        X = self._measured
        return self.along(X, np.zeros((*X.shape[:2], self._disturbances)), self._batch.U)

    def along(self, X: np.ndarray, W: np.ndarray, inputs: np.ndarray, ahead: bool = False) -> Table:
        """Name -> (N, R) terms and inputs along a trajectory X (N, R, nx), with disturbances W (N, R, nw), moving air
        among them, and inputs (N, R, nu). `ahead`: the motion is predicted from the samples before."""
        motion = {name: X[..., i] for i, name in enumerate(self._states)}
        table = {name: motion[name] for name in self._shown}
        table |= {name: inputs[..., i] for i, name in enumerate(self._inputs)} | dict(self._read)
        if self.names:
            values = at_points(self._function, X, inputs, W)[0][..., 0]
            table |= {name: values[..., i] for i, name in enumerate(self.names)}
        return table | self._further(motion, table, self._batch.t, ahead)


def term_along(regressor: str, table: Mapping[str, np.ndarray]) -> np.ndarray | float:
    """(N, R) A term of the library, or a product of what the table has."""
    name = as_term(regressor)
    return table[name] if name in table else parse_term(regressor or "0").evaluate(table)
