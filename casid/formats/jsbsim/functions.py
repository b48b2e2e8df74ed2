"""Functions and tables of a JSBSim file as CasADi expressions."""

from __future__ import annotations

import math
import operator
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.formats.file_tables import Entry, FileTable, with_numbers
from casid.formats.jsbsim.source import alone, number_in, number_of, part
from casid.formats.operators import COMPARISONS, ONE, REDUCED, Operators
from casid.model.tables import Grid

Look = Callable[[str], Any]  # property -> its expression

_OPERATORS = Operators(
    one=ONE
    | {name: getattr(ca, name) for name in ("sqrt", "log10", "asin", "acos", "atan", "ceil")}
    | {
        "log2": lambda x: ca.log(x) / math.log(2.0),
        "sign": lambda x: ca.if_else(x < 0.0, -1.0, 1.0),
        "toradians": lambda x: x * (math.pi / 180.0),
        "todegrees": lambda x: x * (180.0 / math.pi),
    },
    two={"quotient": operator.truediv, "pow": operator.pow, "atan2": ca.atan2}
    | dict(zip(("lt", "le", "gt", "ge", "eq", "nq"), COMPARISONS, strict=True)),
    reduced=REDUCED | {"product": operator.mul, "sum": operator.add, "difference": operator.sub, "avg": operator.add},
)
_SAID = ("description", "documentation")


def value_of(node: ET.Element, look: Look) -> Any:
    """The value of a node of a function, properties by `look`. Raises InputError for an operator that is not known."""
    tag = node.tag
    if tag in ("property", "p"):
        return look((node.text or "").strip())
    if tag in ("value", "v"):
        return ca.SX(number_in(node))
    if tag == "pi":
        return ca.SX(math.pi)
    if tag in ("table", "t"):
        return _look_up(node, look)
    given = [value_of(child, look) for child in node if child.tag not in _SAID]
    if tag == "function":
        return given[0] if given else ca.SX(0.0)
    value = ca.if_else(*given) if tag == "ifthen" and len(given) == 3 else _OPERATORS(tag, given)
    if value is None:
        raise InputError(f"<{tag}> with {len(given)} arguments is no operator of a function that casid reads")
    return value / len(given) if tag == "avg" else value


def _look_up(node: ET.Element, look: Look) -> Any:
    names, grid = table_grid(node)
    return grid.at(*(look(name) for name in names))


def table_grid(node: ET.Element) -> tuple[list[str], Grid]:
    """The properties that a table is over, in the order of the axes of its grid: rows and columns, before these what
    chooses the page. Raises InputError."""
    variables = node.findall("independentVar")
    rows = {child.get("lookup", "row"): (child.text or "").strip() for child in variables}
    data = node.findall("tableData")
    if not variables or not data:
        raise InputError(f"<table> '{node.get('name', '')}' has no independentVar or no tableData")
    if set(rows) - {"row", "column", "table"}:
        raise InputError("<table> of four dimensions is not read")
    if len(rows) != len(variables):
        called = node.get("name", "")
        raise InputError(f"<table> '{called}': two of independentVar have one lookup; expected row and column")
    if len(variables) == 1:
        numbers = _numbers(data[0])
        return [rows["row"]], _grid([numbers[::2]], numbers[1::2])
    pages = pages_of(node)
    if len(variables) == 2:
        return [rows["row"], rows["column"]], pages[0]
    stations = [number_of(one.get("breakPoint"), "tableData breakPoint") for one in data]
    axes = [sorted({x for page in pages for x in page.breakpoints[i]}) for i in (0, 1)]
    # a page is bilinear between the breakpoints of all pages, too
    values = np.concatenate([_resampled(page, *axes) for page in pages])
    return [rows["table"], rows["row"], rows["column"]], _grid([stations, *axes], values.tolist())


def pages_of(node: ET.Element) -> list[Grid]:
    """The pages of a table of two or three dimensions. Raises InputError."""
    return [_page(one) for one in node.findall("tableData")]


def _page(node: ET.Element) -> Grid:
    """A table of two dimensions: keys of the columns in the first line, of the row in the first column."""
    lines = [line.split() for line in alone(node).splitlines() if line.split()]
    columns = [number_of(x, "tableData") for x in lines[0]]
    rows = [[number_of(x, "tableData") for x in line] for line in lines[1:]]
    if any(len(row) != len(columns) + 1 for row in rows):
        raise InputError("<tableData>: a row has not as many values as there are columns")
    return _grid([[row[0] for row in rows], columns], [x for row in rows for x in row[1:]])


def _resampled(page: Grid, rows: Sequence[float], columns: Sequence[float]) -> np.ndarray:
    x = ca.SX.sym("x", 2)
    at = ca.Function("page", [x], [page.at(x[0], x[1])])
    mesh = np.stack(np.meshgrid(rows, columns, indexing="ij")).reshape(2, -1)
    return at(mesh).full()[0]


def _grid(axes: Sequence[Sequence[float]], values: Sequence[float]) -> Grid:
    return Grid(breakpoints=tuple(map(tuple, axes)), values=tuple(values))


def _numbers(node: ET.Element) -> list[float]:
    found = [number_of(x, "tableData") for x in alone(node).split()]
    if len(found) % 2:
        raise InputError("<tableData> of one dimension must have pairs of numbers")
    return found


_DATA = re.compile(r"<(tableData)\b[^>]*>(.*?)</tableData>", re.DOTALL)
_TABLE = re.compile(r"<(table|t)\b[^>]*>(.*?)</\1>", re.DOTALL)


def entries(root: ET.Element) -> Iterator[Entry | None]:
    """The tables of a file in their order. None for one that is not read, and for one of three dimensions whose pages
    have breakpoints of their own: what changes at these is no stretch of all of it."""
    nodes = [n for n in part(root, "aerodynamics").iter() if n.tag in ("table", "t")]
    for index, node in enumerate(nodes):
        try:
            names, grid = table_grid(node)
            alike = len(names) < 3 or len({page.breakpoints for page in pages_of(node)}) == 1
        except InputError:
            alike = False
        called = node.get("name") or f"table {index + 1}"
        yield Entry(name=called, over=tuple(names), grid=grid) if alike else None


def mark(index: int) -> str:
    """The property that is added to a table."""
    return f"casid/mark-{index}"


def marked(root: ET.Element) -> str:
    """The text of a file with an increment on each table of its aerodynamics, the properties `mark`."""
    text = ET.tostring(root, encoding="unicode")
    copy = ET.fromstring(text)
    for i, node in enumerate([n for n in part(copy, "aerodynamics").iter() if n.tag in ("table", "t")]):
        inner = ET.Element("table", node.attrib)
        inner.extend(list(node))
        node.clear()
        node.tag = "sum"
        ET.SubElement(node, "value").text = "0"
        node.insert(0, inner)
        ET.SubElement(node, "property").text = mark(i)
    return ET.tostring(copy, encoding="unicode")


def with_changed_table(text: str, blank: str, one: FileTable, term: str, value: float) -> str:
    """The text of a file with a stretch of a table changed: `value` of the coefficient at the breakpoints that it has.
    Layout stays, numbers of unchanged breakpoints too. `blank` is the text with comments blanked."""
    begin = blank.index("<aerodynamics")
    region = list(_TABLE.finditer(blank, begin, blank.index("</aerodynamics>", begin)))[one.index]
    data = list(_DATA.finditer(blank, *region.span(2)))
    if not data:
        raise InputError(f"table '{one.table.name}' has no tableData")
    share = one.share(term)
    cells = [(span, share[place]) for span, place in _cells(data, len(one.shape))]
    return with_numbers(text, [(span, value / one.gain * float(by)) for span, by in cells if by])


def _cells(pages: Sequence[re.Match[str]], dimensions: int) -> Iterator[tuple[tuple[int, int], tuple[int, ...]]]:
    """(span, place in the grid) of every value of a table."""
    for page, data in enumerate(pages):
        start = data.start(2)
        if dimensions == 1:
            for k, token in enumerate(list(re.finditer(r"\S+", data[2]))[1::2]):
                yield (start + token.start(), start + token.end()), (k,)
            continue
        lines = [line for line in re.finditer(r"[^\n]+", data[2]) if line[0].strip()]
        for row, line in enumerate(lines[1:]):
            for column, token in enumerate(list(re.finditer(r"\S+", line[0]))[1:]):
                at = start + line.start()
                yield (at + token.start(), at + token.end()), (page, row, column)[3 - dimensions :]
