"""The causes that a model of any system may have: every kind of the vocabulary at every port where it makes sense.

Inputs: what stands between a command and what acts, and the instrument that recorded it. Readings: their instruments.
Parameters that differ in some records. Terms that an equation lacks: monomials of states and inputs, terms with a kink
at zero, and terms of the user. Dry friction of a state that changes its sign.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations_with_replacement
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import given, table_of, whole
from casid.arguments import names as names_of
from casid.errors import InputError, check_known
from casid.model.causes.controls import (
    actuator_lag,
    backlash,
    dead_zone,
    input_delay,
    input_limit,
    input_offset,
    input_scale,
    rate_limit,
    second_order_actuator,
)
from casid.model.causes.equations import dry_friction, hysteresis, missing_term, parameter_change
from casid.model.causes.instruments import sensor_bias, sensor_delay, sensor_lag, sensor_scale, sensor_stuck
from casid.model.effect import KINDS, Effect, Size
from casid.model.in_force import known_of
from casid.model.port import ModelPort as Port
from casid.model.system import Model, variables
from casid.records.record import Record, filled

_WHOLE = math.sqrt(2.0)  # change of a series, of its variation, that leaves nothing of it: the two are independent
KINDS_OF_SYSTEMS = tuple(kind.kind for kind in KINDS.values() if kind.of_systems)


def as_term(name: str) -> str:
    """Name under which effects find a term of the library along the motion."""
    return f"term {name}"


@dataclass(frozen=True, kw_only=True)
class Library:
    """Causes that a diagnosis of a system considers.

    Attributes
    ----------
    kinds
        Names of kinds of causes; default all.
    degree
        Largest degree of the monomials of states and inputs that an equation may lack; 0: none is tried. Where an
        equation is still unexplained, monomials in one or two variables of one degree more are tried, and ``|x|``
        and ``x*|x|`` of each variable.
    regressors
        Name -> further term that an equation may lack: a function of a namespace of the model's states and inputs
        that returns a CasADi expression.

    Raises
    ------
    InputError
        For a kind that does not exist.

    Examples
    --------
    After the example of `define_model`:

    >>> sorted(cs.Library(degree=1).terms(lag))
    ['1', 'u', 'x']
    """

    kinds: tuple[str, ...] = KINDS_OF_SYSTEMS
    degree: int = 2
    regressors: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_known("kind", names_of(self.kinds, "library: kinds"), KINDS_OF_SYSTEMS, "library")
        if whole(self.degree, "library: degree", least=0) > 4:
            raise InputError(f"library: degree is {self.degree}; expected 0 to 4")
        for name, function in table_of(self.regressors, "library: regressors", "{'x^3': lambda s: s.x**3}").items():
            if not callable(function):
                raise InputError(f"library: regressor '{name}' is {given(function)}; expected a function")

    def terms(self, model: Model) -> dict[str, ca.SX]:
        """Name -> expression in the states and inputs of the model."""
        symbols = variables(model)
        found = {"1": ca.SX(1.0)} if self.degree else {}
        for degree in range(1, self.degree + 1):
            found |= _monomials(symbols, degree)
        space = SimpleNamespace(**symbols)
        return found | {name: ca.SX(function(space)) for name, function in self.regressors.items()}

    def further_terms(self, model: Model) -> dict[str, ca.SX]:
        """Monomials of one degree more in one or two variables, and sizes of variables, by name: what has a kink."""
        if not self.degree:
            return {}
        symbols = variables(model)
        found = _monomials(symbols, self.degree + 1)
        bent = dict[str, ca.SX]()
        for name, x in symbols.items():
            bent |= {f"|{name}|": ca.fabs(x), f"{name}*|{name}|": x * ca.fabs(x)}
        return {name: term for name, term in found.items() if name.count("*") <= 1} | bent


def _monomials(symbols: Mapping[str, ca.SX], degree: int) -> dict[str, ca.SX]:
    """Name -> product of a degree."""
    found = {}
    for which in combinations_with_replacement(symbols, degree):
        name = "*".join(one if power == 1 else f"{one}^{power}" for one, power in Counter(which).items())
        found[name] = math.prod((symbols[one] for one in which), start=ca.SX(1.0))
    return found


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Dry friction that the equation of a state may lack."""

    name: str  # of its term
    term: ca.SX
    creep: float  # speed about which it reverses


def frictions_of(model: Model, paths: Mapping[str, np.ndarray], least: float) -> dict[str, Friction]:
    """State -> dry friction, of those that change their sign along motions, record -> (N, states).

    It reverses over what the state changes in half a sample, in which no motion shows more, and steps of integration
    are stable with friction that is no larger than what moves the state.
    """
    found = {}
    for i, state in enumerate(model.states if paths else ()):
        creep = 0.5 * float(np.sqrt(np.mean(np.concatenate([np.diff(X[:, i]) for X in paths.values()]) ** 2)))
        series = np.concatenate([X[:, i] for X in paths.values()])
        if creep > 0.0 and np.std(np.tanh(series / creep)) > least:
            term = -ca.tanh(model.x[i] / creep)
            found[state] = Friction(name=f"friction of {state}", term=term, creep=creep)
    return found


def effects_of(
    library: Library,
    model: Model,
    ports: Sequence[Port],
    records: Sequence[Record],
    free: Sequence[str],
    frictions: Mapping[str, Friction],
    least: float,
) -> list[Effect]:
    """List all causes of a library for this model: at its ports, and for its `free` parameters."""
    found: list[Effect] = []
    last = library.further_terms(model)
    every = library.terms(model) | last
    scaled = _scaled_by_parameters(model, {k: v for k, v in every.items() if k not in library.regressors}, free)
    for port in ports:
        if port.kind == "input":
            found += _of_input(port, records, least)
        elif port.kind == "output":
            found += _of_output(port, records, least)
        else:
            terms = [name for name in every if (port.name, name) not in scaled]
            found += [_term(port, name, name in last) for name in terms]
            found += [_friction(port, frictions[port.name])] if port.name in frictions else []
    if len(records) > 1:
        found += [_with_unit(parameter_change(name), model.units.get(name, "")) for name in free]
    return [effect for effect in _with_equal_delays(found, ports) if effect.kind in library.kinds]


def _with_equal_delays(effects: Sequence[Effect], ports: Sequence[Port]) -> list[Effect]:
    """The effects; where there is one input and one output, a delay at either is a delay at the other."""
    acts = [port.name for port in ports if port.kind == "input"]
    read = [port.name for port in ports if port.kind == "output"]
    if len(acts) != 1 or len(read) != 1:
        return list(effects)
    before = input_delay(acts[0])
    behind = sensor_delay(read[0])
    other = {before.key: _with_unit(behind, "s"), behind.key: _with_unit(before, "s")}
    equal = {key: partial(_as_large, other=effect) for key, effect in other.items()}
    return [replace(one, traits=replace(one.traits, equal=equal.get(one.key, one.traits.equal))) for one in effects]


def _as_large(_: Any, other: Effect) -> tuple[Effect, float]:
    """Another effect and its size for one of a size of 1."""
    return other, 1.0


def _scaled_by_parameters(model: Model, terms: Mapping[str, ca.SX], free: Sequence[str]) -> set[tuple[str, str]]:
    """(state, term) where a free parameter multiplies the term in the equation: that term is the parameter's value.

    The slope of the equation by the parameter is then the same multiple of the term at any point.
    """
    by = ca.vertcat(*[model.p[model.parameters.index(name)] for name in free])
    slopes = ca.densify(ca.jacobian(model.f, by))
    values = ca.densify(ca.vertcat(*terms.values()))
    both = ca.Function("both", [model.x, model.u, model.p, model.w], [slopes, values])
    rng = np.random.default_rng(0)
    p = model.nominal_vector()
    w = np.zeros(model.w.numel())
    points = 6
    drawn = [both(rng.normal(size=model.x.numel()), rng.normal(size=model.u.numel()), p, w) for _ in range(points)]
    F = np.stack([one.full() for one, _ in drawn])
    T = np.stack([one.full().ravel() for _, one in drawn])
    with np.errstate(all="ignore"):
        ratio = F[..., None] / T[:, None, None, :]  # (points, states, parameters, terms)
        same = (np.abs(ratio - ratio[0]) <= 1e-9 * np.abs(ratio[0])).all(axis=0) & (ratio[0] != 0.0)
    return {(model.states[i], name) for i, _, j in np.argwhere(same) for name in [list(terms)[j]]}


def _with_unit(effect: Effect, unit: str) -> Effect:
    """The effect at a port of a model, with the unit there; judged by what it does, not by what aircraft have."""
    return replace(effect, unit_at_port=unit, size=replace(effect.size, meaningful=None, limit=np.inf))


def _last(effect: Effect) -> Effect:
    """The effect to be tried where something is still missing when all others were."""
    return replace(effect, traits=replace(effect.traits, last_resort=True))


def _tried(effect: Effect, port: Port, sizes: Sequence[Mapping[str, float]], unit: str) -> Effect:
    """The effect at a port, with the sizes that records can show."""
    further = replace(effect.further, grid=tuple(sizes))
    return replace(_with_unit(effect, unit), further=further, enters=port.station, kinematic=False)


def _of_input(port: Port, records: Sequence[Record], least: float) -> Iterator[Effect]:
    """Causes between a recorded input and the acting input."""
    name = port.name
    series = [record[name] for record in records]
    low = min(s.min() for s in series)
    high = max(s.max() for s in series)
    if not high > low:
        return
    steps = _doubling(records)
    fastest = max(np.max(np.abs(np.diff(record[name]) / np.diff(record.t))) for record in records)
    per_second = f"{port.unit}/s" if port.unit else ""
    swings = second_order_actuator(name)
    shares = 0.5 ** np.arange(1, 1 + math.ceil(-math.log2(least)))  # until a cut changes nothing
    cuts = (shares * (high - low)).tolist()
    through_zero = cuts if low <= 0.0 <= high else []
    rows: list[tuple[Effect, list[dict[str, float]], str]] = [
        (input_delay(name), [{"value": step} for step in steps], "s"),
        (actuator_lag(name), [{"value": step} for step in steps], "s"),
        (input_limit(name, "above"), [{"value": float(high - cut)} for cut in cuts], port.unit),
        (input_limit(name, "below"), [{"value": float(low + cut)} for cut in cuts], port.unit),
        (dead_zone(name), [{"value": cut, "about": 0.0} for cut in through_zero], port.unit),
        (backlash(name), [{"value": 0.5 * cut, "rest": 0.0} for cut in cuts], port.unit),
        (rate_limit(name), [{"value": limit} for limit in (shares * fastest).tolist()], per_second),
        (swings, [{"value": step, **swings.further.defaults} for step in steps], "s"),
    ]
    variation = _variation(series)
    yield _tried(input_offset(name), port, ({},), port.unit)
    yield _tried(input_scale(name), port, ({},), "1")
    yield _last(_tried(hysteresis(name), port, [{"stroke": cut, "rest": 0.0} for cut in cuts], port.unit))
    for effect, sizes, unit in rows:
        assert effect.series is not None
        made = effect.series
        seen = [
            one for one in sizes if _is_seen([_only(made(r.t, known_of(r), one)) for r in records], variation, least)
        ]
        if seen:
            yield _tried(effect, port, seen, unit)


def _only(series: Mapping[str, np.ndarray]) -> np.ndarray:
    (one,) = series.values()
    return one


def _of_output(port: Port, records: Sequence[Record], least: float) -> Iterator[Effect]:
    """Causes in the instrument of a reading."""
    name = port.name
    having = [record for record in records if name in record and np.isfinite(record[name]).any()]
    if not having:
        return
    whole = [filled(record, name) for record in having]
    offset = sensor_bias(name)
    yield _tried(replace(offset, traits=replace(offset.traits, constant=False)), port, ({},), port.unit)
    yield _tried(sensor_scale(name), port, ({},), "1")
    variation = _variation(whole)
    for effect in (sensor_delay(name), sensor_lag(name)):
        assert effect.output is not None
        read = effect.output
        seen = []
        for size in _doubling(records):
            changes = [read(r.t, {name: y}, {"value": size})[name] - y for r, y in zip(having, whole, strict=True)]
            if _is_seen(changes, variation, least):
                seen.append({"value": size})
        if seen:
            yield _tried(effect, port, seen, "s")
    stuck = _tried(sensor_stuck(name), port, ({},), port.unit)
    yield replace(stuck, size=Size(lowest=0.5, limit=1.5))  # of its motion, of which nothing is left


def _term(port: Port, name: str, last: bool) -> Effect:
    """A term that an equation lacks; one of a higher degree comes last."""
    effect = _with_unit(missing_term(port.name, name), "")
    return replace(_last(effect) if last else effect, enters=port.station)


def _friction(port: Port, friction: Friction) -> Effect:
    effect = _tried(dry_friction(port.name), port, ({"creep": friction.creep},), port.unit)
    return replace(effect, regressor=friction.name)


def _is_seen(changes: Sequence[np.ndarray], variation: float, least: float) -> bool:
    """Return True for a change of a series that shows, and that leaves something of it."""
    share = float(np.sqrt(np.mean(np.concatenate(changes) ** 2))) / variation
    return least < share < _WHOLE


def _variation(series: Sequence[np.ndarray]) -> float:
    """R.m.s. deviation from the mean over all records."""
    return max(float(np.std(np.concatenate(series))), 1e-300)


def _doubling(records: Sequence[Record]) -> list[float]:
    """Times [s] from half a sample, each twice the one before, to a quarter of a record."""
    step = 0.5 * min(r.dt for r in records)
    longest = 0.25 * max(r.duration for r in records)
    return [step * 2.0**k for k in range(int(np.log2(longest / step)) + 1)]
