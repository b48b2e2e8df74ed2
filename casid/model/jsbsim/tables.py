"""The tables in the aerodynamics of a JSBSim file: of which coefficient they are a part, over which regressors.

What a table becomes of is found on the functions themselves: by how much the coefficients change with its values, at
some points of flight. A table is one of casid's when that is a constant times a term of the regressors.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType, SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.model.aerodynamics import FURTHER
from casid.model.grid import Grid
from casid.model.jsbsim.functions import table_grid
from casid.model.jsbsim.properties import Properties
from casid.model.jsbsim.source import part
from casid.model.tables import Table, table
from casid.model.terms import COEFFICIENTS, VARIABLES, parse_term

QUANTITIES = (*VARIABLES, *FURTHER)
# where in flight it is tried: well above the ground, and far enough from zero that no factor is lost
_TRIED: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"mach": (0.3, 0.8), "V": (-0.1, 0.1), "Tc": (0.01, 0.1), "airspeed": (60.0, 250.0), "rho": (0.4, 0.8)}
    | {"qbar": (2e3, 2e4), "thrust": (1e3, 1e5)}
)
_POINTS = 8
_SAME = 1e-6  # relative: what differs by less is rounding of the evaluation
_FACTORS = [v for v in VARIABLES if "dot" not in v]
_TERMS = ["0", *_FACTORS, *("*".join(pair) for pair in combinations(_FACTORS, 2))]
_DATA = re.compile(r"<(tableData)\b[^>]*>(.*?)</tableData>", re.DOTALL)
_TABLE = re.compile(r"<(table|t)\b[^>]*>(.*?)</\1>", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class FileTable:
    """A table of a file as one of casid's.

    index   its place among the tables of <aerodynamics>
    table   the part of the coefficient that it is, over regressors, at what of it is held
    gain    the coefficient over a value of the file
    places  of each axis of `table` in the file: 0 down its rows, 1 along its columns
    """

    index: int
    table: Table
    gain: float
    places: tuple[int, ...]

    def shares(self, term: str) -> list[np.ndarray]:
        """For rows and columns of the file, by which part a stretch changes each of them: (n,) and, with two
        dimensions, (m,); a dimension that is held changes as a whole."""
        stretches = {one.variable: one for one in parse_term(term).stretches}
        axes = dict(zip(self.places, zip(self.table.axes, self.table.grid.breakpoints, strict=True), strict=True))
        found = []
        for place in (0, 1):
            axis, points = axes.get(place, ("", ()))
            share = stretches[axis].evaluate(np.array(points)) if axis in stretches else np.ones(1)
            # corners are known to six digits: at a breakpoint the stretch is whole or absent
            found.append(np.round(share, 3))
        return found


class Tried:
    """A file's functions with an increment on every table, at some points of flight."""

    def __init__(self, root: ET.Element, look_up: Any) -> None:
        self.nodes, marked = _marked(root)
        self.marks = ca.SX.sym("mark", len(self.nodes))
        s = {name: ca.SX.sym(name) for name in QUANTITIES}
        further = {_mark(i): self.marks[i] for i in range(len(self.nodes))}
        found, look = look_up(marked, SimpleNamespace(**s), further)
        self._look: Properties = look
        self._s = s
        self.names = tuple(found)
        slopes = ca.jacobian(ca.vertcat(*found.values()), self.marks)
        slopes = ca.substitute(slopes, self.marks, ca.SX.zeros(len(self.nodes)))
        given = [ca.vertcat(*s.values())]
        self.slopes = ca.Function("slopes", given, [ca.densify(slopes)])
        rng = np.random.default_rng(1)
        bounds = np.array([_TRIED.get(name, (-0.1, 0.1)) for name in QUANTITIES])
        self.at = rng.uniform(*bounds.T, size=(_POINTS, len(QUANTITIES))).T
        count = len(self.nodes)
        evaluated = self.slopes.map(_POINTS)(self.at).full()
        self.tried = evaluated.reshape(len(self.names), _POINTS, count)  # coefficient, point, table

    def regressors(self) -> dict[str, np.ndarray]:
        """Regressor -> (points,)."""
        return dict(zip(QUANTITIES, self.at, strict=True))

    def values(self, property_name: str) -> np.ndarray:
        """(points,) a property of the file."""
        of = ca.Function("of", [ca.vertcat(*self._s.values())], [ca.SX(self._look(property_name))])
        return of.map(_POINTS)(self.at).full()[0]


def file_tables(tried: Tried) -> Iterator[FileTable]:
    """Those tables of a file that are tables of casid."""
    for index, node in enumerate(tried.nodes):
        entered = _entered(tried, index)
        if entered is None:
            continue
        try:
            names, grid = table_grid(node)
            axes = [_affine(tried, name) for name in names]
        except InputError:
            continue
        if len(names) > 2 or any(axis is None for axis in axes):
            continue
        made = _table(index, entered, [axis for axis in axes if axis is not None], grid, node)
        if made is not None:
            yield made


_Axis = tuple[str, float, float]  # regressor ("": held), factor and offset: property = factor * regressor + offset


def _entered(tried: Tried, index: int) -> tuple[str, str, float] | None:
    """(coefficient, term, gain) in which a table enters, or None. Forces come before the moments that they have."""
    slopes = dict(zip(tried.names, tried.tried[:, :, index], strict=True))
    x = tried.regressors()
    along = {"CD": np.cos(x["beta"]), "CY": np.cos(x["beta"])}  # stability axes: JSBSim's are wind axes
    for coefficient in [c for c in COEFFICIENTS if c in slopes and np.isfinite(slopes[c]).all()]:
        series = slopes[coefficient] / along.get(coefficient, 1.0)
        if np.abs(series).max() < _SAME:
            continue
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


def _table(
    index: int, entered: tuple[str, str, float], axes: Sequence[_Axis], grid: Grid, node: ET.Element
) -> FileTable | None:
    coefficient, term, gain = entered
    values = np.reshape(grid.values, grid.shape)
    for place in reversed(range(len(axes))):
        if not axes[place][0]:
            values = _at_held(values, grid.breakpoints[place], axes[place][2], place)
    free = [place for place, axis in enumerate(axes) if axis[0]]
    names = [axes[place][0] for place in free]
    if not free or len(set(names)) < len(names):
        return None
    points = [[(x - axes[place][2]) / axes[place][1] for x in grid.breakpoints[place]] for place in free]
    rounded = [[0.0 + float(f"{round(x, 12):.12g}") for x in axis] for axis in points]  # zero degrees are zero
    called = f"{coefficient} {node.get('name') or f'table {index + 1}'}"
    made = table(coefficient, names, rounded, gain * values, name=called, times=term)
    return FileTable(index=index, table=made, gain=gain, places=tuple(free))


def _at_held(values: np.ndarray, points: Sequence[float], at: float, place: int) -> np.ndarray:
    return np.apply_along_axis(lambda column: np.interp(at, points, column), place, values)


def _mark(index: int) -> str:
    return f"casid/mark-{index}"


def _marked(root: ET.Element) -> tuple[list[ET.Element], str]:
    """The tables of the aerodynamics, and the text of the file with an increment on each of them."""
    text = ET.tostring(root, encoding="unicode")
    nodes = [n for n in part(root, "aerodynamics").iter() if n.tag in ("table", "t")]
    copy = ET.fromstring(text)
    for i, node in enumerate([n for n in part(copy, "aerodynamics").iter() if n.tag in ("table", "t")]):
        inner = ET.Element("table", node.attrib)
        inner.extend(list(node))
        node.clear()
        node.tag = "sum"
        ET.SubElement(node, "value").text = "0"
        node.insert(0, inner)
        ET.SubElement(node, "property").text = _mark(i)
    return nodes, ET.tostring(copy, encoding="unicode")


def with_changed_table(text: str, blank: str, one: FileTable, term: str, value: float) -> str:
    """The text of a file with a stretch of a table changed: `value` of the coefficient at the breakpoints that it has.
    Layout stays, numbers of unchanged breakpoints too. `blank` is the text without what stands in comments."""
    begin = blank.index("<aerodynamics")
    region = list(_TABLE.finditer(blank, begin, blank.index("</aerodynamics>", begin)))[one.index]
    data = _DATA.search(blank, *region.span(2))
    if data is None:
        raise InputError(f"table '{one.table.name}' has no tableData")
    rows, columns = one.shares(term)
    flat = "column" not in region[2] or 'lookup="column"' not in re.sub(r"\s*=\s*", "=", region[2])
    changes = []
    for span, row, column in _cells(data, flat):
        share = rows[min(row, len(rows) - 1)] * columns[min(column, len(columns) - 1)]
        if share:
            changes.append((span, float(text[slice(*span)]) + value / one.gain * float(share)))
    for (first, last), number in reversed(changes):
        text = text[:first] + f"{number:.10g}".ljust(last - first) + text[last:]
    return text


def _cells(data: re.Match[str], flat: bool) -> Iterator[tuple[tuple[int, int], int, int]]:
    """(span, row, column) of every value of a table of one or two dimensions."""
    start = data.start(2)
    if flat:
        for k, token in enumerate(list(re.finditer(r"\S+", data[2]))[1::2]):
            yield (start + token.start(), start + token.end()), k, 0
        return
    lines = [line for line in re.finditer(r"[^\n]+", data[2]) if line[0].strip()]
    for row, line in enumerate(lines[1:]):
        for column, token in enumerate(list(re.finditer(r"\S+", line[0]))[1:]):
            at = start + line.start()
            yield (at + token.start(), at + token.end()), row, column
