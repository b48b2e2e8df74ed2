"""A wrong stretch of a table: values at neighbouring breakpoints that are all off by as much."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from casid.model import station
from casid.model.airframe import Airframe
from casid.model.effect import Effect, Symbols, cause
from casid.model.path import SignalPath, evaluate
from casid.model.tables import Table, table
from casid.model.terms import COEFFICIENTS, Stretch, Term, parse_term

_ODD = ("beta", "p", "r", "delta_a", "delta_r")
_LATERAL = ("CY", "Cl", "Cn")


def _stretches(aircraft: Airframe) -> Iterable[Effect]:
    """Of every table some neighbouring breakpoints of one axis, up to half of them, at all breakpoints of the other
    axes or at one of one of these."""
    wanted = {(one.coefficient, term.name): term for one in aircraft.tables for term in _terms_of(one)}
    return (table_increment(*key) for key in sorted(wanted, key=lambda key: (key[0], *_extent(wanted[key]), key[1])))


def _extent(term: Term) -> tuple[int, float]:
    """Shorter stretches first, and those of one variable: the simplest of what a record cannot tell apart."""
    return len(term.stretches), sum(one.corners[2] - one.corners[1] for one in term.stretches)


def _terms_of(one: Table) -> Iterator[Term]:
    if not _can_hold(one):
        return
    axes = list(zip(one.axes, one.grid.breakpoints, strict=True))
    for i, (axis, points) in enumerate(axes):
        if one.coefficient in _LATERAL and axis not in _ODD:
            continue  # odd: an error is of a stretch of the sideslip, or of what rolls and yaws
        for run in _runs(points, one.grid.outside):
            main = Stretch(variable=axis, corners=run)
            yield _term(main)
            for other, beside in [pair for j, pair in enumerate(axes) if j != i]:
                for single in _runs(beside, one.grid.outside, longest=1):
                    yield _term(main, Stretch(variable=other, corners=single))


def _term(*stretches: Stretch) -> Term:
    return parse_term("*".join(one.name for one in stretches))


def _can_hold(one: Table) -> bool:
    """A change at breakpoints is a stretch: not of a spline, nor of a step between equal breakpoints."""
    steps = any(low == high for axis in one.grid.breakpoints for low, high in pairwise(axis))
    return one.grid.method == "linear" and one.times == "0" and not one.free and not steps


def _runs(points: tuple[float, ...], outside: str, longest: int | None = None) -> Iterator[tuple[float, ...]]:
    """Corners of the stretches of up to `longest` breakpoints. A value at the end that is held there has no end; where
    the last slope goes on, its change would be no stretch."""
    padded = (-math.inf, -math.inf, *points, math.inf, math.inf)
    ends = 0 if outside == "hold" else 1
    for first in range(ends, len(points) - ends):
        for last in range(first, min(len(points) - ends, first + (longest or len(points) // 2))):
            at_low, at_high = first == 0, last == len(points) - 1
            if at_low and at_high:
                continue  # the whole axis
            low = (-math.inf, -math.inf) if at_low else (padded[first + 1], points[first])
            high = (math.inf, math.inf) if at_high else (points[last], padded[last + 3])
            yield (*low, *high)


@cause(
    "table_increment",
    targets=COEFFICIENTS,
    needs_term=True,
    candidates=_stretches,
    unit="{term}",
    quantity="what is to be added to the values of the table there",
    title="{target} table: {term}",
    sentence="The table of the {label} is wrong in a stretch: {target} at {term} needs {size} more.",
)
def table_increment(coefficient: str, term: str) -> Effect:
    """A stretch of a table of the aircraft file: all its values there are off by as much, beyond its ends none is."""

    def change(path: SignalPath, values: Symbols) -> None:
        path.coefficient[coefficient] += values["value"] * evaluate(term, path)

    def into_tables(tables: tuple[Table, ...], value: float) -> tuple[Table, ...] | None:
        asked = parse_term(term)
        for i, one in enumerate(tables):
            if one.coefficient == coefficient and any(asked == own for own in _terms_of(one)):
                return (*tables[:i], _with_change(one, asked, value), *tables[i + 1 :])
        return None

    return Effect(
        kind="table_increment",
        target=coefficient,
        term=term,
        regressor=term,
        enters=station.coefficient(coefficient),
        station="coefficients",
        change=change,
        into_tables=into_tables,
    )


def _with_change(one: Table, term: Term, value: float) -> Table:
    mesh = np.meshgrid(*one.grid.breakpoints, indexing="ij")
    share = term.evaluate(dict(zip(one.axes, mesh, strict=True)))
    # corners are known to six digits: at a breakpoint the stretch is whole or absent
    changed = np.reshape(one.grid.values, one.grid.shape) + value * np.round(share, 3)
    return table(
        one.coefficient,
        one.axes,
        one.grid.breakpoints,
        changed,
        name=one.name,
        times=one.times,
        method=one.grid.method,
        outside=one.grid.outside,
    )
