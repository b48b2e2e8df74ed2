"""The generic dynamic system that every estimator works on: states, inputs, parameters, outputs; f, h.

An aircraft is one of them; so is a two-state short period of three lines. All expressions are CasADi SX.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType, SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from casid.errors import InputError, unknown
from casid.records.record import Record
from casid.signals import scale_of


@dataclass(frozen=True, eq=False, kw_only=True)
class EquationError:
    """Equation-error form of a model: `target` computed from measured signals alone, `prediction` from measured
    signals and parameters (paper eq. 6-8). Both are expressions in `m`, the measured `channels`, and the model's p."""

    names: tuple[str, ...]
    channels: tuple[str, ...]
    m: ca.SX
    target: ca.SX
    prediction: ca.SX


@dataclass(frozen=True, eq=False, kw_only=True)
class Model:
    """dx/dt = f(x, u, p, w),  y = h(x, u, p, w), all SX column vectors in the order of the names.

    disturbances   unknown inputs w (null 0): where process noise, gusts or a missing effect may enter
    nominal        start value of every parameter
    state_scale    typical size of every state, for conditioning
    guess          (record) -> (N, states) first guess of the state trajectory from measurements
    prior_std      a-priori 1-sigma of parameters that have one (absent: none)
    equation       equation-error form, or None when the model has none
    units          unit of each parameter, for tables
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    disturbances: tuple[str, ...] = ()
    x: ca.SX
    u: ca.SX
    p: ca.SX
    w: ca.SX
    f: ca.SX
    h: ca.SX
    nominal: Mapping[str, float]
    state_scale: Mapping[str, float]
    guess: Callable[[Record], np.ndarray]
    prior_std: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    equation: EquationError | None = None
    units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for what, names, symbol in (
            ("states", self.states, self.x),
            ("inputs", self.inputs, self.u),
            ("parameters", self.parameters, self.p),
            ("disturbances", self.disturbances, self.w),
            ("states", self.states, self.f),
            ("outputs", self.outputs, self.h),
        ):
            if symbol.shape[0] != len(names):
                rows = symbol.shape[0]
                raise InputError(f"model '{self.name}': {len(names)} {what} but an expression of {rows} rows")
            if len(set(names)) != len(names):
                raise InputError(f"model '{self.name}': {what} are not unique: {names}")
        missing = set(self.parameters) - set(self.nominal)
        if missing:
            raise InputError(f"model '{self.name}': no nominal value for {sorted(missing)}")

    def nominal_vector(self, values: Mapping[str, float] | None = None) -> np.ndarray:
        """(parameters,) nominal values, with `values` put over them by name."""
        values = values or {}
        for name in values:
            if name not in self.parameters:
                raise unknown("parameter", name, self.parameters, f"model '{self.name}'")
        return np.array([values.get(name, self.nominal[name]) for name in self.parameters], dtype=float)

    def scale_vector(self) -> np.ndarray:
        """(states,) typical size of each state."""
        return np.array([self.state_scale[name] for name in self.states], dtype=float)


def measured_states(states: Sequence[str]) -> Callable[[Record], np.ndarray]:
    """A `Model.guess` for models whose states are channels: the measured channel, zero where it is not measured."""

    def guess(record: Record) -> np.ndarray:
        columns = []
        for name in states:
            values = record[name] if name in record else np.zeros(len(record))
            good = np.isfinite(values)
            if not good.any():
                values = np.zeros(len(record))
            elif not good.all():
                values = np.interp(record.t, record.t[good], values[good])
            columns.append(values)
        return np.stack(columns, axis=1)

    return guess


def define_model(
    name: str,
    *,
    states: Sequence[str],
    inputs: Sequence[str],
    parameters: Mapping[str, float],
    outputs: Sequence[str],
    dynamics: Callable[[Any], Mapping[str, Any]],
    output: Callable[[Any], Mapping[str, Any]],
    disturbances: Sequence[str] = (),
    state_scale: Mapping[str, float] | None = None,
    guess: Callable[[Record], np.ndarray] | None = None,
    prior_std: Mapping[str, float] | None = None,
    equation: Callable[[Any], EquationError] | None = None,
) -> Model:
    """A Model from two functions that take a namespace of symbols and return expressions by name.

    `dynamics(s)` returns {state: derivative}, `output(s)` {output: expression}; `s.q`, `s.Cm_alpha`, ... are the
    symbols. A disturbance named like "w_q" is a symbol too, zero in the nominal model. Without an equation-error
    form, `estimation` uses the state equations with measured states.
    """
    groups = {"x": tuple(states), "u": tuple(inputs), "p": tuple(parameters), "w": tuple(disturbances)}
    vectors = {key: ca.SX.sym(key, len(names)) for key, names in groups.items()}
    symbols = {name: vectors[key][i] for key, names in groups.items() for i, name in enumerate(names)}
    if len(symbols) != sum(len(names) for names in groups.values()):
        raise InputError(f"model '{name}': one name is used twice among states, inputs, parameters, disturbances")
    space = SimpleNamespace(**symbols)

    def ordered(expressions: Mapping[str, Any], names: Sequence[str], what: str) -> ca.SX:
        for key in expressions:
            if key not in names:
                raise unknown(what, key, names, f"model '{name}'")
        lacking = [n for n in names if n not in expressions]
        if lacking:
            raise InputError(f"model '{name}': no expression for {what} {lacking}")
        return ca.vertcat(*[ca.SX(expressions[n]) for n in names]) if names else ca.SX(0, 1)

    scale = {s: scale_of(s) for s in states} | dict(state_scale or {})
    return Model(
        name=name,
        states=tuple(states),
        inputs=tuple(inputs),
        parameters=tuple(parameters),
        outputs=tuple(outputs),
        disturbances=tuple(disturbances),
        x=vectors["x"],
        u=vectors["u"],
        p=vectors["p"],
        w=vectors["w"],
        f=ordered(dynamics(space), states, "state"),
        h=ordered(output(space), outputs, "output"),
        nominal=dict(parameters),
        state_scale=scale,
        guess=guess or measured_states(states),
        prior_std=dict(prior_std or {}),
        equation=equation(space) if equation else None,
    )
