"""The causes that any dynamic system may have, made for one model and its records.

Inputs: delay, lag, limits, dead zone, play. Readings: bias, scale, delay, lag, stuck. Parameters that are others in
some records. Terms that an equation lacks: monomials of states and inputs, and what the user knows besides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations_with_replacement
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import given, table_of, whole
from casid.diagnosis.systems.cause import CandidateCause, Operator, Run
from casid.diagnosis.systems.criteria import SystemCriteria
from casid.diagnosis.systems.fit import Question
from casid.errors import InputError, unknown
from casid.model import operators
from casid.model.port import ModelPort as Port
from casid.model.system import Model
from casid.records.record import Record

KINDS = (
    "input_delay",
    "actuator_lag",
    "limit_above",
    "limit_below",
    "dead_zone",
    "backlash",
    "sensor_bias",
    "sensor_scale",
    "sensor_delay",
    "sensor_lag",
    "sensor_stuck",
    "parameter_change",
    "missing_term",
)


@dataclass(frozen=True, kw_only=True)
class Library:
    """Which causes are considered.

    Attributes
    ----------
    kinds
        Of `KINDS`; default all.
    degree
        Of the monomials of states and inputs that an equation may lack; 0: none.
    regressors
        Name -> function of a namespace of the model's states and inputs, further terms; CasADi expressions.

    Raises
    ------
    InputError
        For a kind that does not exist.
    """

    kinds: tuple[str, ...] = KINDS
    degree: int = 2
    regressors: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.kinds, str):
            raise InputError(f"library: kinds is the text '{self.kinds}'; expected a list of names")
        for kind in self.kinds:
            if kind not in KINDS:
                raise unknown("kind", kind, KINDS, "library")
        if whole(self.degree, "library: degree", least=0) > 4:
            raise InputError(f"library: degree is {self.degree}; expected 0 to 4")
        for name, function in table_of(self.regressors, "library: regressors", "{'x^3': lambda s: s.x**3}").items():
            if not callable(function):
                raise InputError(f"library: regressor '{name}' is {given(function)}; expected a function")

    def terms(self, model: Model) -> dict[str, ca.SX]:
        """name -> expression in the states and inputs of the model."""
        names = (*model.states, *model.inputs)
        symbols = ca.vertsplit(ca.vertcat(model.x, model.u))
        found: dict[str, ca.SX] = {}
        if self.degree:
            found["1"] = ca.SX(1.0)
        for degree in range(1, self.degree + 1):
            for which in combinations_with_replacement(range(len(names)), degree):
                powers = {names[i]: which.count(i) for i in dict.fromkeys(which)}
                name = "*".join(n if k == 1 else f"{n}^{k}" for n, k in powers.items())
                found[name] = ca.SX(1.0)
                for i in which:
                    found[name] = found[name] * symbols[i]
        space = SimpleNamespace(**dict(zip(names, symbols, strict=True)))
        return found | {name: ca.SX(function(space)) for name, function in self.regressors.items()}


def causes_for(library: Library, model: Model, ports: Sequence[Port], question: Question) -> tuple[CandidateCause, ...]:
    """All that the library knows for this model: at its ports, and for its free parameters."""
    records, criteria = question.records, question.criteria.systems
    found: list[CandidateCause] = []
    for port in ports:
        if port.kind == "input":
            found += _of_input(port, records, criteria)
        elif port.kind == "output":
            found += _of_output(port, records, criteria)
        else:
            found += [_term(port, name, term) for name, term in library.terms(model).items()]
    if len(records) > 1:
        found += [_parameter(name, model.units.get(name, "")) for name in question.free]
    return tuple(cause for cause in found if cause.kind in library.kinds)


def _of_input(port: Port, records: Sequence[Record], criteria: SystemCriteria) -> Iterator[CandidateCause]:
    name = port.name
    series = [record[name] for record in records]
    low, high = min(s.min() for s in series), max(s.max() for s in series)
    span = high - low
    if not span > 0.0:
        return
    steps = _doubling(records)
    cuts = [share * span for share in criteria.cuts]
    # kind, operator, values, 1-sigma of each, sentence
    yield from _operators(
        port,
        records,
        criteria,
        (
            ("input_delay", operators.delay, steps, None, "{target} acts {size} later than the model has it{where}."),
            ("actuator_lag", operators.lag, steps, None, "{target} acts with a lag of {size} that the model lacks."),
            (
                "limit_above",
                lambda t, u, v: np.minimum(u, v),
                [high - c for c in cuts],
                criteria.limit_spread * span,
                "{target} does not act beyond {size}.",
            ),
            (
                "limit_below",
                lambda t, u, v: np.maximum(u, v),
                [low + c for c in cuts],
                criteria.limit_spread * span,
                "{target} does not act below {size}.",
            ),
            (
                "dead_zone",
                lambda t, u, v: operators.dead_zone(u, v, 0.0),
                cuts if low <= 0.0 <= high else [],
                None,
                "{target} acts only beyond {size} about zero.",
            ),
            (
                "backlash",
                lambda t, u, v: operators.backlash(u, v),
                [0.5 * c for c in cuts],
                None,
                "{target} acts through a play of half-width {size}.",
            ),
        ),
    )


def _operators(
    port: Port, records: Sequence[Record], criteria: SystemCriteria, rows: Iterable[tuple]
) -> Iterator[CandidateCause]:
    variation = _variation([record[port.name] for record in records])
    for kind, operator, values, spread, sentence in rows:
        grid = []
        for value in values:
            changes = [operator(record.t, record[port.name], value) - record[port.name] for record in records]
            part = np.sqrt(np.mean(np.concatenate(changes) ** 2)) / variation
            if criteria.seen < part < criteria.whole:
                grid.append((float(value), spread or criteria.near * abs(value)))
        if grid:
            yield CandidateCause(
                kind=kind,
                target=port.name,
                unit="s" if kind in ("input_delay", "actuator_lag") else port.unit,
                port=port.disturbance,
                grid=tuple(grid),
                history=_change_of_input(operator, port.name),
                operator=operator,
                slope_over=criteria.slope,
                sentence=sentence,
            )


def _change_of_input(operator: Operator, name: str) -> Callable[[Run, float], np.ndarray]:
    return lambda run, value: operator(run.t, run.inputs[name], value) - run.inputs[name]


def _of_output(port: Port, records: Sequence[Record], criteria: SystemCriteria) -> Iterator[CandidateCause]:
    name, disturbance = port.name, port.disturbance
    measured = [r[name][np.isfinite(r[name])] for r in records if name in r]
    measured = [values for values in measured if len(values)]
    if not measured:
        return
    yield CandidateCause(
        kind="sensor_bias",
        target=name,
        unit=port.unit,
        port=disturbance,
        somewhere=True,
        history=lambda run, value: np.ones(len(run.t)),
        change=lambda draft, value, flag: draft.reads(name, lambda y: y + value * flag),
        sentence="The reading of {target} is off by {size}{where}.",
    )
    yield CandidateCause(
        kind="sensor_scale",
        target=name,
        port=disturbance,
        somewhere=True,
        history=lambda run, value: run.outputs[name],
        change=lambda draft, value, flag: draft.reads(name, lambda y: y * (1.0 + value * flag)),
        sentence="The reading of {target} is off by the part {size} of itself{where}.",
    )
    variation = _variation(measured)
    yield from _behind(port, records, variation, criteria)
    mean = float(np.mean(np.concatenate(measured)))
    yield CandidateCause(
        kind="sensor_stuck",
        target=name,
        unit=port.unit,
        port=disturbance,
        grid=((mean, 2.0 * variation),),
        everywhere=False,
        onset=True,
        change=lambda draft, value, flag: draft.reads(name, lambda y: y + flag * (value - y)),
        sentence="The reading of {target} is stuck at {size}{where}.",
    )


def _behind(
    port: Port, records: Sequence[Record], variation: float, criteria: SystemCriteria
) -> Iterator[CandidateCause]:
    """Readings of a port that come late or lag, by steps that make a part of its `variation`."""
    name = port.name
    having = [r for r in records if name in r]
    whole = [np.interp(r.t, r.t[np.isfinite(r[name])], r[name][np.isfinite(r[name])]) for r in having]
    for kind, operator, change, words in (
        ("sensor_delay", operators.delay, "late", "is {size} late"),
        ("sensor_lag", operators.lag, "lagged", "lags by {size}"),
    ):
        changes = {
            step: [operator(r.t, y, step) - y for r, y in zip(having, whole, strict=True)]
            for step in _doubling(records)
        }
        part = {step: np.sqrt(np.mean(np.concatenate(of) ** 2)) / variation for step, of in changes.items()}
        grid = tuple(
            (step, criteria.near * step) for step, share in part.items() if criteria.seen < share < criteria.whole
        )
        if grid:
            yield CandidateCause(
                kind=kind,
                target=name,
                unit="s",
                port=port.disturbance,
                grid=grid,
                history=_change_of_output(operator, name),
                late=kind == "sensor_delay",
                change=_through(change, name),
                sentence=f"The reading of {{target}} {words}{{where}}.",
            )


def _change_of_output(operator: Operator, name: str) -> Callable[[Run, float], np.ndarray]:
    return lambda run, value: operator(run.t, run.outputs[name], value) - run.outputs[name]


def _through(how: str, name: str) -> Callable[[Any, Any, Any], None]:
    return lambda draft, value, flag: getattr(draft, how)(name, value)


def _parameter(name: str, unit: str) -> CandidateCause:
    return CandidateCause(
        kind="parameter_change",
        target=name,
        unit=unit,
        port=None,
        everywhere=False,
        somewhere=True,
        change=lambda draft, value, flag: draft.shifts(name, value * flag),
        sentence="The parameter {target} is other by {size}{where}.",
    )


def _term(port: Port, name: str, term: ca.SX) -> CandidateCause:
    return CandidateCause(
        kind="missing_term",
        target=port.name,
        term=name,
        port=port.disturbance,
        history=lambda run, value: run.terms[name],
        change=lambda draft, value, flag: draft.adds(port.name, value * term),
        sentence="The equation of {target} lacks a term {size} {term}.",
    )


def onsets(record: Record, count: int) -> np.ndarray:
    """(count - 1,) times [s] at which something may begin in a record."""
    return record.t[0] + record.duration * np.arange(1, count) / count


def _variation(series: Sequence[np.ndarray]) -> float:
    """r.m.s. deviation from the mean over all records."""
    return max(float(np.std(np.concatenate(series))), 1e-300)


def _doubling(records: Sequence[Record]) -> list[float]:
    """Times [s] from half a sample, each twice the one before, to a quarter of a record."""
    step, longest = 0.5 * min(r.dt for r in records), 0.25 * max(r.duration for r in records)
    return [step * 2.0**k for k in range(int(np.log2(longest / step)) + 1)]
