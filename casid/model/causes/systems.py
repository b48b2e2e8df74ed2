"""The causes that any dynamic system may have, made for one model and its records.

Inputs: delay, lag, limits, dead zone, play. Readings: bias, scale, delay, lag, stuck. Parameters that differ in some
records. Terms that an equation lacks: monomials of states and inputs, and terms of the user.
"""

from __future__ import annotations

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
from casid.criterion import number
from casid.errors import InputError, check_known
from casid.model import operators
from casid.model.effect import Effect, Event, Forms, Further, Series, Size, Traits, Values, Words
from casid.model.port import ModelPort as Port
from casid.model.station import reading
from casid.model.system import Model
from casid.records.record import Record


@dataclass(frozen=True, kw_only=True)
class SystemCriteria:
    """Which causes of a system are tried, and how widely."""

    record: float = number(
        26.0,
        "length of a record for which all numbers in seconds are meant; those of a system are longer or shorter with "
        "its records",
        "measured: the records of aircraft by which these were set",
    )
    seen: float = number(0.01, "r.m.s. change by an operator, of the variation, from which its size is tried")
    whole: float = number(1.2, "the same, beyond which nothing of the signal is left")
    wholly: float = number(
        0.5, "part of the motion of a reading within which one that is stuck has lost all of it", "derived: half"
    )
    cuts: tuple[float, ...] = number((0.03, 0.06, 0.12, 0.25, 0.5), "sizes of what cuts an input, of its range")


# kind -> sentence, with fields target, term, size and [late|early]
SENTENCES = {
    "input_delay": "{target} acts {size} [late|early] by the model.",
    "actuator_lag": "{target} acts with a lag of {size} that the model lacks.",
    "limit_above": "{target} does not act beyond {size}.",
    "limit_below": "{target} does not act below {size}.",
    "dead_zone": "{target} acts only beyond {size} about zero.",
    "backlash": "{target} acts through a play of half-width {size}.",
    "sensor_bias": "The reading of {target} is off by {size}.",
    "sensor_scale": "The reading of {target} is off by the part {size} of itself.",
    "sensor_delay": "The reading of {target} is {size} [late|early].",
    "sensor_lag": "The reading of {target} lags by {size}.",
    "sensor_stuck": "The reading of {target} is stuck at {size}.",
    "parameter_change": "The parameter {target} is other by {size}.",
    "missing_term": "The equation of {target} lacks a term {size} {term}.",
}
KINDS = tuple(SENTENCES)
_IN_SECONDS = ("input_delay", "actuator_lag", "sensor_delay", "sensor_lag")

Operator = Callable[[np.ndarray, np.ndarray, float], np.ndarray]  # (t, series, value) -> series


def stuck(output: str) -> str:
    """Disturbance that takes away the motion of a reading: 0 none of it, 1 all."""
    return f"stuck_{output}"


def as_read(output: str) -> str:
    """Name under which effects find a channel as it was measured."""
    return f"read {output}"


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
        equation is still unexplained, monomials in one or two variables of one degree more are tried.
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

    kinds: tuple[str, ...] = KINDS
    degree: int = 2
    regressors: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_known("kind", names_of(self.kinds, "library: kinds"), KINDS, "library")
        if whole(self.degree, "library: degree", least=0) > 4:
            raise InputError(f"library: degree is {self.degree}; expected 0 to 4")
        for name, function in table_of(self.regressors, "library: regressors", "{'x^3': lambda s: s.x**3}").items():
            if not callable(function):
                raise InputError(f"library: regressor '{name}' is {given(function)}; expected a function")

    def terms(self, model: Model) -> dict[str, ca.SX]:
        """Name -> expression in the states and inputs of the model."""
        names = (*model.states, *model.inputs)
        symbols = ca.vertsplit(ca.vertcat(model.x, model.u))
        found = {"1": ca.SX(1.0)} if self.degree else {}
        for degree in range(1, self.degree + 1):
            found |= _monomials(names, symbols, degree)
        space = SimpleNamespace(**dict(zip(names, symbols, strict=True)))
        return found | {name: ca.SX(function(space)) for name, function in self.regressors.items()}

    def further_terms(self, model: Model) -> dict[str, ca.SX]:
        """Monomials of one degree more in one or two variables, by name."""
        symbols = ca.vertsplit(ca.vertcat(model.x, model.u))
        names = (*model.states, *model.inputs)
        found = _monomials(names, symbols, self.degree + 1) if self.degree else {}
        return {name: term for name, term in found.items() if name.count("*") <= 1}


def _monomials(names: Sequence[str], symbols: Sequence[ca.SX], degree: int) -> dict[str, ca.SX]:
    """Name -> product of a degree."""
    found = {}
    for which in combinations_with_replacement(range(len(names)), degree):
        powers = {i: which.count(i) for i in dict.fromkeys(which)}
        name = "*".join(names[i] if k == 1 else f"{names[i]}^{k}" for i, k in powers.items())
        found[name] = ca.SX(1.0)
        for i in which:
            found[name] = found[name] * symbols[i]
    return found


def effects_of(
    library: Library,
    model: Model,
    ports: Sequence[Port],
    records: Sequence[Record],
    free: Sequence[str],
    criteria: SystemCriteria,
) -> list[Effect]:
    """All causes of a library for this model: at its ports, and for its `free` parameters."""
    found: list[Effect] = []
    last = library.further_terms(model)
    every = library.terms(model) | last
    scaled = _scaled_by_parameters(model, {k: v for k, v in every.items() if k not in library.regressors}, free)
    for port in ports:
        if port.kind == "input":
            found += _of_input(port, records, criteria)
        elif port.kind == "output":
            found += _of_output(port, records, criteria)
        else:
            terms = [name for name in every if (port.name, name) not in scaled]
            found += [_term(port, name, name in last) for name in terms]
    if len(records) > 1:
        found += [_parameter(name) for name in free]
    return [replace(effect, words=_words(effect, model, ports)) for effect in found if effect.kind in library.kinds]


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


def _unit(effect: Effect, model: Model, ports: Sequence[Port]) -> str:
    """Unit of the value of an effect; empty if it is not stated."""
    if effect.kind in _IN_SECONDS:
        return "s"
    if effect.traits.relative:
        return model.units.get(effect.target, "")
    if effect.regressor is not None or effect.kind == "sensor_scale":
        return ""
    return next((port.unit for port in ports if port.name == effect.target and port.kind != "state derivative"), "")


def _words(effect: Effect, model: Model, ports: Sequence[Port]) -> Words:
    told = {"limit_above": _from_above, "limit_below": _from_below}.get(effect.kind)
    return Words(unit=_unit(effect, model, ports), sentence=SENTENCES[effect.kind], told=told)


def _from_above(cut: float, series: Sequence[np.ndarray]) -> float:
    """Value of a limit on an input whose recorded `series` exceeds it by the given amount."""
    return max(float(one.max()) for one in series) - cut


def _from_below(cut: float, series: Sequence[np.ndarray]) -> float:
    return min(float(one.min()) for one in series) + cut


def _of_input(port: Port, records: Sequence[Record], criteria: SystemCriteria) -> Iterator[Effect]:
    """Causes between a recorded input and the acting input. The size of a limit is the amount that it removes of the
    range.
    """
    name = port.name
    series = [record[name] for record in records]
    low = min(s.min() for s in series)
    high = max(s.max() for s in series)
    if not high > low:
        return
    steps = _doubling(records)
    cuts = [share * (high - low) for share in criteria.cuts]
    rows: list[tuple[str, Operator, list[float]]] = [
        ("input_delay", operators.delay, steps),
        ("actuator_lag", operators.lag, steps),
        ("limit_above", lambda t, u, v: np.minimum(u, high - abs(v)), cuts),
        ("limit_below", lambda t, u, v: np.maximum(u, low + abs(v)), cuts),
        ("dead_zone", lambda t, u, v: operators.dead_zone(u, v, 0.0), cuts if low <= 0.0 <= high else []),
        ("backlash", lambda t, u, v: operators.backlash(u, v), [0.5 * cut for cut in cuts]),
    ]
    variation = _variation(series)
    for kind, operator, sizes in rows:
        changes = {v: [operator(r.t, r[name], v) - r[name] for r in records] for v in sizes}
        grid = _seen(changes, variation, criteria)
        if grid:
            yield Effect(
                kind=kind,
                target=name,
                linear=False,
                further=Further(grid=grid, unsigned=() if kind == "input_delay" else ("value",)),
                enters=port.disturbance,
                series=partial(_acts, operator, name, port.disturbance),
            )


def _acts(
    operator: Operator, name: str, station: str, t: np.ndarray, known: Series, values: Values
) -> dict[str, np.ndarray]:
    return {station: operator(t, known[name], values["value"]) - known[name]}


def _of_output(port: Port, records: Sequence[Record], criteria: SystemCriteria) -> Iterator[Effect]:
    name = port.name
    having = [record for record in records if name in record and np.isfinite(record[name]).any()]
    if not having:
        return
    whole = [np.interp(r.t, r.t[np.isfinite(r[name])], r[name][np.isfinite(r[name])]) for r in having]
    entering = {"target": name, "reads": (name,), "enters": reading(name)}
    yield Effect(
        kind="sensor_bias",
        traits=Traits(by_record=True),
        change=lambda draft, values: draft.reads(name, lambda y: y + values["value"]),
        **entering,
    )
    yield Effect(
        kind="sensor_scale",
        traits=Traits(by_record=True),
        change=lambda draft, values: draft.reads(name, lambda y: y * (1.0 + values["value"])),
        **entering,
    )
    variation = _variation(whole)
    slow: tuple[tuple[str, Operator, Callable, Forms], ...] = (
        ("sensor_delay", operators.delay, _delayed, Forms(undo=partial(_earlier, name))),
        ("sensor_lag", operators.lag, _lagged, Forms(instrument=_follows)),
    )
    for kind, operator, output, forms in slow:
        steps = _doubling(records)
        changes = {v: [operator(r.t, y, v) - y for r, y in zip(having, whole, strict=True)] for v in steps}
        if grid := _seen(changes, variation, criteria):
            yield Effect(
                kind=kind,
                linear=False,
                further=Further(grid=grid, unsigned=("value",) if kind == "sensor_lag" else ()),
                traits=Traits(late=True),
                output=partial(output, name),
                forms=forms,
                **entering,
            )
    stays = partial(_stays, name, port.disturbance)
    yield Effect(
        kind="sensor_stuck",
        event=Event(),
        series=stays,
        size=Size(lowest=1.0 - criteria.wholly, limit=1.0 + criteria.wholly),
        **entering,
    )


def _delayed(name: str, t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
    return {name: operators.delay(t, known[name], values["value"])}


def _earlier(name: str, t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
    return {name: operators.earlier(t, known[name], values["value"])}


def _follows(true: Any, reading: Any, values: Any) -> Any:
    """Rate of the reading of an instrument that lags."""
    return (true - reading) / ca.fabs(values["value"])


def _lagged(name: str, t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
    """A lagged reading; its initial value is near the first reading."""
    behind = operators.lag(t, known[name], values["value"])
    T = abs(values["value"])
    if T < 1e-9:
        return {name: behind}
    fades = np.exp(-(t - t[0]) / T)
    left = known[as_read(name)] - behind
    there = np.isfinite(left)
    start = float(fades[there] @ left[there]) / max(float(fades[there] @ fades[there]), 1e-300)
    return {name: behind + start * fades}


def _stays(name: str, station: str, t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
    """A reading that is constant from the onset on."""
    from_there = values["value"] * operators.step(t, values["onset"])
    return {stuck(name): from_there, station: from_there * level(known[as_read(name)][t > values["onset"]])}


def level(read: np.ndarray) -> float:
    """Mean of readings, of which some may be missing; 0 where all are."""
    seen = read[np.isfinite(read)]
    return float(seen.mean()) if len(seen) else 0.0


def _parameter(name: str) -> Effect:
    return Effect(
        kind="parameter_change",
        target=name,
        traits=Traits(by_record=True, relative=True),
        change=lambda draft, values: draft.shifts(name, values["value"]),
    )


def _term(port: Port, name: str, last: bool) -> Effect:
    return Effect(
        kind="missing_term",
        target=port.name,
        term=name,
        regressor=name,
        traits=Traits(last_resort=last),
        enters=port.disturbance,
        change=lambda draft, values: draft.adds(port.name, values["value"] * draft.terms[name]),
    )


def _seen(
    changes: Mapping[float, Sequence[np.ndarray]], variation: float, criteria: SystemCriteria
) -> tuple[Mapping[str, float], ...]:
    """Sizes of an operator at which it changes a series, and leaves something of it."""
    part = {v: np.sqrt(np.mean(np.concatenate(of) ** 2)) / variation for v, of in changes.items()}
    return tuple({"value": float(v)} for v, share in part.items() if criteria.seen < share < criteria.whole)


def _variation(series: Sequence[np.ndarray]) -> float:
    """r.m.s. deviation from the mean over all records."""
    return max(float(np.std(np.concatenate(series))), 1e-300)


def _doubling(records: Sequence[Record]) -> list[float]:
    """Times [s] from half a sample, each twice the one before, to a quarter of a record."""
    step = 0.5 * min(r.dt for r in records)
    longest = 0.25 * max(r.duration for r in records)
    return [step * 2.0**k for k in range(int(np.log2(longest / step)) + 1)]
