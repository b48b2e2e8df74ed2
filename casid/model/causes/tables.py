"""A wrong stretch of a table: values at neighbouring breakpoints that are all off by as much."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from casid.model import station
from casid.model.aerodynamics import Tabulated
from casid.model.airframe import Airframe
from casid.model.effect import Effect, Forms, Symbols, cause
from casid.model.path import SignalPath, evaluate, quantities
from casid.model.tables import Table
from casid.model.terms import COEFFICIENTS, Stretch, Term, parse_term

_ODD = ("beta", "p", "r", "delta_a", "delta_r")
_LATERAL = ("CY", "Cl", "Cn")


def _stretches(aircraft: Airframe) -> Iterable[Effect]:
    """Yield, for every table, stretches of neighbouring breakpoints of one axis, up to half of them, at all breakpoints
    of the other axes or at one breakpoint of one of these."""
    every = (*aircraft.tables, *_own_tables(aircraft))
    wanted = {(one.coefficient, term.name): term for one in every for term in _terms_of(one)}
    return (table_increment(*key) for key in sorted(wanted, key=lambda key: (key[0], *_extent(wanted[key]), key[1])))


def _own_tables(aircraft: Airframe) -> tuple[Table, ...]:
    """Those inside the user's own aerodynamics."""
    own = aircraft.aerodynamics
    return own.tables if isinstance(own, Tabulated) else ()


def _extent(term: Term) -> tuple[int, float]:
    """Shorter stretches first, and those of one variable: the simplest of what a record cannot separate."""
    return len(term.stretches), sum(one.corners[2] - one.corners[1] for one in term.stretches)


def _terms_of(one: Table) -> Iterator[Term]:
    if not _can_hold(one):
        return
    axes = list(zip(one.axes, one.grid.breakpoints, strict=True))
    factors = parse_term(one.times).factors
    lateral = sum(power for variable, power in factors if variable in _ODD) % 2 == 1
    for i, (axis, points) in enumerate(axes):
        if one.coefficient in _LATERAL and not lateral and axis not in _ODD:
            continue  # odd: an error is of a stretch of the sideslip, or of what rolls and yaws
        for run in _runs(points, one.grid.outside):
            main = Stretch(variable=axis, corners=run)
            yield _term(one.times, main)
            for other, beside in [pair for j, pair in enumerate(axes) if j != i]:
                for single in _runs(beside, one.grid.outside, longest=1):
                    yield _term(one.times, main, Stretch(variable=other, corners=single))


def _term(times: str, *stretches: Stretch) -> Term:
    factors = [times] if times != "0" else []
    return parse_term("*".join((*factors, *(one.name for one in stretches))))


def _can_hold(one: Table) -> bool:
    """A change at breakpoints is a stretch: not of a spline, nor of a step between equal breakpoints, nor of what looks
    at rates of the flow angles."""
    steps = any(low == high for axis in one.grid.breakpoints for low, high in pairwise(axis))
    return one.grid.method == "linear" and not one.dynamic and not one.free and not steps


def _runs(points: tuple[float, ...], outside: str, longest: int | None = None) -> Iterator[tuple[float, ...]]:
    """Corners of the stretches of up to `longest` breakpoints. A value at the end that is held there has no end; where
    the last slope goes on, its change would be no stretch."""
    padded = (-math.inf, -math.inf, *points, math.inf, math.inf)
    ends = 0 if outside == "hold" else 1
    for first in range(ends, len(points) - ends):
        for last in range(first, min(len(points) - ends, first + (longest or len(points) // 2))):
            at_low = first == 0
            at_high = last == len(points) - 1
            if at_low and at_high:
                continue  # the whole axis
            low = (-math.inf, -math.inf) if at_low else (padded[first + 1], points[first])
            high = (math.inf, math.inf) if at_high else (points[last], padded[last + 3])
            yield (*low, *high)


@cause(
    targets=COEFFICIENTS,
    needs_term=True,
    candidates=_stretches,
    unit="{term}",
    quantity="what is to be added to the values of the table there",
    title="{target} table: {term}",
    sentence="The table of the {label} is wrong in a stretch: {target} at {term} needs {size} more.",
)
def table_increment(coefficient: str, term: str) -> Effect:
    """A stretch of a table of the aircraft file: all its values there are off by as much, beyond its ends none is.
    A table inside the user's own aerodynamics has the consequences there that its values have: a lift its moment."""
    asked = parse_term(term)

    def change(path: SignalPath, values: Symbols) -> None:
        own = path.aircraft.aerodynamics
        inside = _holding(_own_tables(path.aircraft), coefficient, asked)
        if inside is None or not isinstance(own, Tabulated) or _holding(path.aircraft.tables, coefficient, asked):
            path.coefficient[coefficient] += values["value"] * evaluate(term, path)
            return
        share = values["value"] * Term(factors=(), stretches=asked.stretches).evaluate(path.regressor)
        for name, slope in own.of_table(inside, quantities(path) | path.regressor).items():
            path.coefficient[name] += share * slope

    def into_tables(tables: tuple[Table, ...], value: float) -> tuple[Table, ...] | None:
        held = _holding(tables, coefficient, asked)
        if held is None:
            return None
        return tuple(_with_change(one, asked, value) if one is held else one for one in tables)

    return Effect(
        regressor=term,
        enters=station.coefficient(coefficient),
        station="coefficients",
        change=change,
        forms=Forms(into_tables=into_tables),
    )


def _holding(tables: Iterable[Table], coefficient: str, asked: Term) -> Table | None:
    """The table of which a term is a stretch."""
    return next((one for one in tables if one.coefficient == coefficient and _is_of(one, asked)), None)


def _is_of(one: Table, asked: Term) -> bool:
    if not _can_hold(one) or not asked.stretches or asked.factors != parse_term(one.times).factors:
        return False
    points = dict(zip(one.axes, one.grid.breakpoints, strict=True))
    return all(
        stretch.variable in points
        and any(
            stretch.name == Stretch(variable=stretch.variable, corners=run).name
            for run in _runs(points[stretch.variable], one.grid.outside)
        )
        for stretch in asked.stretches
    )


def holds(one: Table, kind: str, coefficient: str, term: str) -> bool:
    """Return True if an effect is a wrong stretch of this table: its kind, and a term of its coefficient."""
    return kind == "table_increment" and _holding((one,), coefficient, parse_term(term)) is not None


def _with_change(one: Table, term: Term, value: float) -> Table:
    mesh = np.meshgrid(*one.grid.breakpoints, indexing="ij")
    share = Term(factors=(), stretches=term.stretches).evaluate(dict(zip(one.axes, mesh, strict=True)))
    # corners are known to six digits: at a breakpoint the stretch is whole or absent
    changed = np.reshape(one.grid.values, one.grid.shape) + value * np.round(share, 3)
    return replace(one, grid=replace(one.grid, values=tuple(changed.ravel())))
