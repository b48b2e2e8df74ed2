"""Fly a model: states and outputs along given inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.model.system import Model
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulation:
    """States (N, states) and outputs (N, outputs) at the time stamps t (N,) of the record that gave the inputs."""

    model: Model
    record: Record
    states: np.ndarray
    outputs: np.ndarray

    def state(self, name: str) -> np.ndarray:
        return self.states[:, self.model.states.index(name)]

    def output(self, name: str) -> np.ndarray:
        return self.outputs[:, self.model.outputs.index(name)]

    def as_record(self, name: str | None = None) -> Record:
        """The record with its measured outputs replaced by the simulated ones."""
        channels = dict(self.record.channels) | {o: self.outputs[:, i] for i, o in enumerate(self.model.outputs)}
        return Record(
            name=name or self.record.name,
            t=self.record.t,
            channels=channels,
            hold=self.record.hold,
            source=self.record.source,
            notes=self.record.notes,
        )


def simulate(
    model: Model,
    record: Record,
    start: np.ndarray,
    values: Mapping[str, float] | None = None,
    disturbances: Mapping[str, np.ndarray] | None = None,
    substeps: int = 1,
) -> Simulation:
    """Integrate by Runge-Kutta of fourth order, `substeps` per sample; inputs linear or held as the record says.

    start        (states,) state at the first sample
    values       parameters by name, put over the model's nominal values
    disturbances known time histories (N,) of disturbances by name; the others are zero
    Raises InputError when the motion leaves the range of numbers.
    """
    n = len(record)
    U = record.matrix(model.inputs) if model.inputs else np.zeros((n, 0))
    W = np.zeros((n, len(model.disturbances)))
    for name, series in (disturbances or {}).items():
        W[:, model.disturbances.index(name)] = series
    p = model.nominal_vector(values)
    UW = np.hstack([U, W])
    after = UW[:-1] if record.hold == "held" else UW[1:]
    states = _accumulate(model, substeps, n - 1)(start, UW[:-1].T, after.T, np.diff(record.t)[None], p).full().T
    states = np.vstack([np.asarray(start, dtype=float)[None], states])
    if not np.isfinite(states).all():
        when = record.t[np.argmin(np.isfinite(states).all(axis=1))]
        raise InputError(f"simulation of '{model.name}' on record '{record.name}' diverged at t = {when:.2f} s")
    output = ca.Function("output", [model.x, model.u, model.p, model.w], [model.h])
    outputs = output.map(n)(states.T, U.T, np.repeat(p[:, None], n, 1), W.T).full().T
    return Simulation(model=model, record=record, states=states, outputs=outputs)


def _accumulate(model: Model, substeps: int, count: int) -> ca.Function:
    """(x, [u; w] at a sample, at the next, dt, p) -> states after each of `count` samples."""
    nu = len(model.inputs)
    f = ca.Function("f", [model.x, ca.vertcat(model.u, model.w), model.p], [model.f])
    x, dt = ca.SX.sym("x", len(model.states)), ca.SX.sym("dt")
    first, last = (ca.SX.sym(name, nu + len(model.disturbances)) for name in ("first", "last"))
    state, h = x, dt / substeps
    for k in range(substeps):
        u0, um, u1 = (first + (last - first) * (k + part) / substeps for part in (0.0, 0.5, 1.0))
        k1 = f(state, u0, model.p)
        k2 = f(state + h / 2 * k1, um, model.p)
        k3 = f(state + h / 2 * k2, um, model.p)
        k4 = f(state + h * k3, u1, model.p)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    step = ca.Function("step", [x, first, last, dt, model.p], [state])
    chain = step.mapaccum("chain", count)
    sx = [ca.MX.sym(f"a{i}", step.size1_in(i), count if i in (1, 2, 3) else 1) for i in range(5)]
    return ca.Function("fly", sx, [chain(sx[0], sx[1], sx[2], sx[3], ca.repmat(sx[4], 1, count))])
