"""Tables inside an aerodynamics file: the coefficient and the regressors of each, and how its numbers are corrected.

The functions of the file are evaluated at some points of flight, with an increment on each table. The change of the
coefficients shows which of them a table enters. A table becomes one of casid's if this change is a constant times a
term of the regressors.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial, reduce
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.model.aerodynamics import FURTHER
from casid.model.causes.tables import holds
from casid.model.effect_value import EffectValue
from casid.model.tables import Grid, Table, table
from casid.model.terms import COEFFICIENTS, VARIABLES, parse_term

QUANTITIES = (*VARIABLES, *FURTHER)
# where in flight it is tried: well above the ground, and far enough from zero that no factor is lost
_TRIED = {"mach": (0.3, 0.8), "V": (-0.1, 0.1), "Tc": (0.01, 0.1), "airspeed": (60.0, 250.0), "rho": (0.4, 0.8)}
_TRIED |= {"qbar": (2e3, 2e4), "thrust": (1e3, 1e5)}
_POINTS = 8
_SAME = 1e-6  # relative: what differs by less is rounding of the evaluation
_FACTORS = [v for v in VARIABLES if "dot" not in v]
_TERMS = ["0", *_FACTORS, *("*".join(pair) for pair in combinations(_FACTORS, 2))]


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A table as written in a file."""

    name: str  # what it is called there
    over: tuple[str, ...]  # names of the file, one per axis of its grid
    grid: Grid


@dataclass(frozen=True, kw_only=True)
class FileTable:
    """A table of a file as one of casid's."""

    index: int  # its place among the entries
    table: Table  # the part of the coefficient that it is, over regressors, at what of it is held
    gain: float  # the coefficient over a value of the file
    shape: tuple[int, ...]  # of the table in the file
    places: tuple[int, ...]  # axis of the file that each axis of `table` is

    def share(self, term: str) -> np.ndarray:
        """Return the part by which a stretch changes each value of the file, in its shape; along what is held, all
        of them."""
        stretches = {one.variable: one for one in parse_term(term).stretches}
        axes = dict(zip(self.places, zip(self.table.axes, self.table.grid.breakpoints, strict=True), strict=True))
        along = []
        for place, count in enumerate(self.shape):
            axis, points = axes.get(place, ("", ()))
            along.append(stretches[axis].evaluate(np.array(points)) if axis in stretches else np.ones(count))
        # corners are known to six digits: at a breakpoint the stretch is whole or absent
        return np.round(reduce(np.multiply.outer, along), 3)


# quantities and an increment per table -> coefficients, and the look-up of names of the file
LookUp = Callable[[SimpleNamespace, ca.SX], tuple[Mapping[str, Any], Callable[[str], Any]]]


class Tried:
    """A file's functions with an increment on every table, at some points of flight.

    entries   the tables in the order of their increments; None for what cannot be read
    """

    def __init__(self, entries: Sequence[Entry | None], look_up: LookUp) -> None:
        self.entries = tuple(entries)
        count = len(self.entries)
        marks = ca.SX.sym("mark", count)
        s = {name: ca.SX.sym(name) for name in QUANTITIES}
        found, self._look = look_up(SimpleNamespace(**s), marks)
        self._s = s
        self.names = tuple(found)
        slopes = ca.jacobian(ca.vertcat(*found.values()), marks)
        slopes = ca.substitute(slopes, marks, ca.SX.zeros(count))
        self.slopes = ca.Function("slopes", [ca.vertcat(*s.values())], [ca.densify(slopes)])
        rng = np.random.default_rng(1)
        bounds = np.array([_TRIED.get(name, (-0.1, 0.1)) for name in QUANTITIES])
        self.at = rng.uniform(*bounds.T, size=(_POINTS, len(QUANTITIES))).T
        evaluated = self.slopes.map(_POINTS)(self.at).full()
        self.tried = evaluated.reshape(len(self.names), _POINTS, count)  # coefficient, point, table

    def regressors(self) -> dict[str, np.ndarray]:
        """Regressor -> (points,)."""
        return dict(zip(QUANTITIES, self.at, strict=True))

    def values(self, name: str) -> np.ndarray:
        """(points,) the value of a name of the file."""
        of = ca.Function("of", [ca.vertcat(*self._s.values())], [ca.SX(self._look(name))])
        return of.map(_POINTS)(self.at).full()[0]

    @cached_property
    def tables(self) -> tuple[FileTable, ...]:
        """The tables that are over regressors, and enter a coefficient as they are or times a term."""
        return tuple(file_tables(self))

    def of_table(self, one: Table, s: Mapping[str, Any]) -> dict[str, Any]:
        """Coefficient -> by how much it grows with a table's part of its own: forces have moments about the c.g."""
        own = next(each for each in self.tables if each.table == one)
        slopes = self.slopes(ca.vertcat(*(s.get(name, 0.0) for name in QUANTITIES)))[:, own.index] / own.gain
        return dict(zip(self.names, ca.vertsplit(slopes), strict=True))


def file_tables(tried: Tried) -> Iterator[FileTable]:
    """Those tables of a file that are tables of casid."""
    for index, entry in enumerate(tried.entries):
        entered = _entered(tried, index)
        if entry is None or entered is None:
            continue
        try:
            axes = [_affine(tried, name) for name in entry.over]
        except InputError:
            continue
        if any(axis is None for axis in axes):
            continue
        made = _table(index, entered, [axis for axis in axes if axis is not None], entry)
        if made is not None:
            yield made


# regressor ("": held), factor and offset: what the file has = factor * regressor + offset
_Axis = tuple[str, float, float]


def _entered(tried: Tried, index: int) -> tuple[str, str, float] | None:
    """(coefficient, term, gain) in which a table enters, or None. Forces come before the moments that they have."""
    slopes = dict(zip(tried.names, tried.tried[:, :, index], strict=True))
    x = tried.regressors()
    turned = {"CD": np.cos(x["beta"]), "CY": np.cos(x["beta"])}  # stability axes: JSBSim's are wind axes
    for coefficient in [c for c in COEFFICIENTS if c in slopes and np.isfinite(slopes[c]).all()]:
        if np.abs(slopes[coefficient]).max() < _SAME:
            continue
        for series in (slopes[coefficient], slopes[coefficient] / turned.get(coefficient, 1.0)):
            for term in _TERMS:
                gain = series / parse_term(term).evaluate(x)
                if np.ptp(gain) < _SAME * np.abs(gain).max():
                    return coefficient, parse_term(term).name, float(gain.mean())
    return None


def _affine(tried: Tried, name: str) -> _Axis | None:
    values = tried.values(name)
    if not np.isfinite(values).all():
        return None
    if np.ptp(values) <= _SAME * np.abs(values).max():
        return "", 0.0, float(values[0])
    for variable, x in tried.regressors().items():
        factor, offset = np.polyfit(x, values, 1)
        left = np.abs(values - factor * x - offset).max()
        if variable in VARIABLES and factor > 0.0 and left < _SAME * np.ptp(values):
            return variable, float(factor), float(offset)
    return None


def _table(index: int, entered: tuple[str, str, float], axes: Sequence[_Axis], entry: Entry) -> FileTable | None:
    (coefficient, term, gain), grid = entered, entry.grid
    values = np.reshape(grid.values, grid.shape)
    for place in reversed(range(len(axes))):
        if not axes[place][0]:
            at_held = partial(np.interp, axes[place][2], grid.breakpoints[place])
            values = np.apply_along_axis(at_held, place, values)
    free = [place for place, axis in enumerate(axes) if axis[0]]
    names = [axes[place][0] for place in free]
    if not free or len(set(names)) < len(names):
        return None
    points = [[(x - axes[place][2]) / axes[place][1] for x in grid.breakpoints[place]] for place in free]
    rounded = [[0.0 + float(f"{round(x, 12):.12g}") for x in axis] for axis in points]  # zero degrees are zero
    called = f"{coefficient} {entry.name}"
    made = table(
        coefficient, names, rounded, gain * values, name=called, times=term, outside=grid.outside, method=grid.method
    )
    return FileTable(index=index, table=made, gain=gain, shape=grid.shape, places=tuple(free))


_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def blanked(text: str) -> str:
    """XML of the same length with comments blanked: positions in it are positions in the text."""
    return _COMMENT.sub(lambda found: " " * len(found.group()), text)


def with_numbers(text: str, changes: Iterable[tuple[tuple[int, int], float]]) -> str:
    """The text with numbers grown, each at its (first, last) position; layout stays as far as there is room."""
    for (first, last), by in sorted(changes, reverse=True):
        number = float(text[first:last]) + by
        text = text[:first] + f"{number:.10g}".ljust(last - first) + text[last:]
    return text


def holding(tables: Sequence[FileTable], effect: EffectValue) -> FileTable | None:
    """The table of the file of which an effect is a wrong stretch."""
    kind = effect.kind
    coefficient = effect.target
    term = effect.term or "0"
    return next((one for one in tables if holds(one.table, kind, coefficient, term)), None)


def said(effect: EffectValue, why: str) -> str:
    """An effect that a file cannot have, for a comment in it."""
    target = f"({effect.target}{':' + effect.term if effect.term else ''})" if effect.target else ""
    return f"{effect.kind}{target} {effect.value:.6g} {effect.unit}: it {why}"


def in_comment(text: str) -> str:
    """Return a text as one line that is valid in a comment of XML: no -- in it, and no - at its end."""
    return re.sub(r"-(?=-|$)", "- ", " ".join(text.split()))


def comment(left: Sequence[str]) -> str:
    """Write what a file cannot hold, as a comment of it."""
    lines = "".join(f"\n       {in_comment(line)}" for line in left)
    return f"    <!-- casid found what stands in no function of this file:{lines}\n    -->\n"
