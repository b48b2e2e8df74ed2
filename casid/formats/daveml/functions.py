"""Functions of a DAVE-ML file as CasADi expressions, and the MathML in them."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, reduce
from types import MappingProxyType
from typing import Any

import casadi as ca

from casid.errors import InputError, check_known, unknown
from casid.formats.file_tables import Entry
from casid.formats.jsbsim.source import bare, check_words, number_in, number_of
from casid.model.tables import Grid
from casid.records.limits import xml_root

Look = Callable[[str], Any]  # varID -> its expression

_ONE: dict[str, Callable[[Any], Any]] = {
    "minus": lambda x: -x,
    "plus": lambda x: x,
    "abs": ca.fabs,
    "exp": ca.exp,
    "ln": ca.log,
    "log": ca.log10,
    "root": ca.sqrt,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "arcsin": ca.asin,
    "arccos": ca.acos,
    "arctan": ca.atan,
    "floor": ca.floor,
    "ceiling": ca.ceil,
    "not": ca.logic_not,
}
_TWO: dict[str, Callable[[Any, Any], Any]] = {
    "minus": lambda a, b: a - b,
    "divide": lambda a, b: a / b,
    "power": lambda a, b: a**b,
    "lt": lambda a, b: a < b,
    "leq": lambda a, b: a <= b,
    "gt": lambda a, b: a > b,
    "geq": lambda a, b: a >= b,
    "eq": lambda a, b: a == b,
    "neq": lambda a, b: a != b,
}
_MANY: dict[str, Callable[[Sequence[Any]], Any]] = {
    "plus": lambda x: reduce(lambda a, b: a + b, x),
    "times": lambda x: reduce(lambda a, b: a * b, x),
    "min": lambda x: reduce(ca.fmin, x),
    "max": lambda x: reduce(ca.fmax, x),
    "and": lambda x: reduce(ca.logic_and, x),
    "or": lambda x: reduce(ca.logic_or, x),
}


_VARIABLE = ("name", "varID", "units", "axisSystem", "sign", "alias", "symbol", "initialValue", "minValue", "maxValue")
_KINDS = ("isInput", "isControl", "isDisturbance", "isState", "isStateDeriv", "isOutput", "isStdAIAA")
_FUNCTION = ("independentVarPts", "dependentVarPts", "independentVarRef", "dependentVarRef", "functionDefn")
_TABLES = ("griddedTableRef", "griddedTableDef", "griddedTable")
_TABLES += ("ungriddedTableRef", "ungriddedTableDef", "ungriddedTable")
# element -> elements in it, and its attributes
_WORDS: Mapping[str, tuple[tuple[str, ...] | None, tuple[str, ...]]] = {
    **dict.fromkeys(_KINDS, ((), ())),
    "": (None, ()),
    "DAVEfunc": (("variableDef", "breakpointDef", "griddedTableDef", "ungriddedTableDef", "function"), ()),
    "variableDef": (("calculation", *_KINDS), _VARIABLE),
    "calculation": (("math",), ()),
    "breakpointDef": (("bpVals",), ("name", "bpID", "units")),
    "griddedTableDef": (("breakpointRefs", "dataTable"), ("name", "gtID", "units")),
    "breakpointRefs": (("bpRef",), ()),
    "bpRef": ((), ("bpID",)),
    "function": (_FUNCTION, ("name",)),
    "independentVarRef": ((), ("varID", "min", "max", "extrapolate", "interpolate")),
    "dependentVarRef": ((), ("varID",)),
    "functionDefn": (_TABLES, ("name",)),
    "griddedTableRef": ((), ("gtID",)),
    "piecewise": (("piece", "otherwise"), ()),
    "cn": (("sep",), ("type", "base")),
    "csymbol": ((), ("definitionURL", "encoding")),
}
_IGNORED = ("fileHeader", "checkData", "description", "provenance", "provenanceRef", "uncertainty", "confidenceBound")
_IGNORED += ("ungriddedTableDef", "ungriddedTable", "griddedTable", "independentVarPts", "dependentVarPts")


def expression(node: ET.Element, look: Look) -> Any:
    """The value of a node, variables by `look`. Raises InputError for an operator that is not known."""
    tag = bare(node.tag)
    children = list(node)
    if tag == "cn":
        return ca.SX(_constant(node))
    if tag == "ci":
        if len(node):
            raise InputError(f"<ci> must be the name of a variable alone; it has <{bare(node[0].tag)}> in it")
        return look((node.text or "").strip())
    if tag == "pi":
        return ca.SX(math.pi)
    if tag == "piecewise":
        return _piecewise(node, look)
    if tag == "math" or (tag == "apply" and len(children) == 1):
        return expression(_parts(node, 1)[0], look)
    if tag != "apply" or not children:
        raise InputError(f"<{tag}> is no MathML that casid reads")
    operator = bare(children[0].tag)
    if operator == "csymbol":
        operator = (children[0].text or "").strip()
    given = [expression(child, look) for child in children[1:]]
    if operator in _ONE and len(given) == 1:
        return _ONE[operator](given[0])
    if operator in _TWO and len(given) == 2:
        return _TWO[operator](*given)
    if operator in ("atan2", "fmod") and len(given) == 2:
        return {"atan2": ca.atan2, "fmod": ca.fmod}[operator](*given)
    if operator in _MANY and given:
        return _MANY[operator](given)
    raise InputError(f"<{operator}> of {len(given)} arguments is no operator that casid reads")


def _constant(node: ET.Element) -> float:
    """A number of MathML: as it stands, or of two parts about <sep/>."""
    kind = node.get("type", "real").strip()
    base = node.get("base", "10").strip()
    if base != "10":
        raise InputError(f"<cn> of base {base:.20}: only numbers of base 10 are read")
    if kind in ("real", "integer", "double"):
        return number_in(node)
    if kind not in ("e-notation", "rational"):
        raise InputError(f"<cn> of type '{kind:.20}' is not read; expected real, integer, e-notation or rational")
    if [bare(child.tag) for child in node] != ["sep"]:
        raise InputError(f"<cn> of type '{kind}' must have two numbers with one <sep/> between them")
    if kind == "e-notation":
        return number_of(f"{(node.text or '').strip()}e{(node[0].tail or '').strip()}", "cn")
    first = number_of(node.text, "cn")
    second = number_of(node[0].tail, "cn")
    if second == 0.0:
        raise InputError("<cn> of type 'rational' is divided by zero")
    return first / second


def _piecewise(node: ET.Element, look: Look) -> Any:
    otherwise = _find(node, "otherwise")
    value = None if otherwise is None else expression(_parts(otherwise, 1)[0], look)
    for child in reversed([c for c in node if bare(c.tag) == "piece"]):
        then, condition = (expression(part, look) for part in _parts(child, 2))
        value = then if value is None else ca.if_else(condition, then, value)
    if value is None:
        raise InputError("<piecewise> has no piece")
    return value


def _parts(node: ET.Element, count: int) -> list[ET.Element]:
    """Elements in one that has `count` of them. Raises InputError."""
    if len(node) != count:
        raise InputError(f"<{bare(node.tag)}> has {len(node)} elements; expected {count}")
    return list(node)


_SEPARATORS = re.compile(r"[\s,]+")


class DaveFile:
    """Variables by varID, functions by the varID that they give, tables and breakpoints by their identifiers.

    named    varID -> name of the standard;  units  varID -> unit
    inputs   varIDs that are to be given;  outputs  varIDs that the file is for
    """

    def __init__(self, text: str) -> None:
        self._root = xml_root(text)
        if bare(self._root.tag) != "DAVEfunc":
            raise InputError(f"the root is <{bare(self._root.tag)}>; a DAVE-ML file begins with <DAVEfunc>")
        check_words(self._root, _WORDS, _IGNORED)
        variables = self._all("variableDef")
        self._variables = _by("varID", variables)
        self.named = {varid: node.get("name", "") for varid, node in self._variables.items()}
        self.units = {name: node.get("units", "") for name, node in self._variables.items()}
        breakpoints = _by("bpID", self._all("breakpointDef"))
        self._breakpoints = {name: _numbers(node, "bpVals") for name, node in breakpoints.items()}
        self._tables = _by("gtID", self._all("griddedTableDef"))
        gives = [_child(node, "dependentVarRef") for node in self._functions_of()]
        self._functions = dict(zip(_by("varID", gives), self._functions_of(), strict=True))
        for varid in self._functions:
            if _find(self._variables.get(varid, self._root), "calculation") is not None:
                raise InputError(f"variable '{varid}' has a function and a calculation; remove one")
        self.inputs = tuple(v for v, node in self._variables.items() if _find(node, "isInput") is not None)
        self.outputs = tuple(v for v, node in self._variables.items() if _find(node, "isOutput") is not None)

    def varid(self, name: str) -> str:
        """varID of a name of the standard. Raises InputError where no variable has it, or several."""
        found = [varid for varid, own in self.named.items() if own == name]
        check_known("variable", (name,), set(self.named.values()))
        if len(found) > 1:
            raise InputError(f"variables {' and '.join(map(repr, found))} are both called '{name}'; rename one")
        return found[0]

    def _all(self, tag: str) -> list[ET.Element]:
        return [node for node in self._root.iter() if bare(node.tag) == tag]

    def _functions_of(self) -> list[ET.Element]:
        return [node for node in self._all("function") if _find(node, "dependentVarRef") is not None]

    def values(self, given: Mapping[str, Any], added: Mapping[str, Any] = MappingProxyType({})) -> Values:
        """Look-up of every variable by varID, from inputs by varID in the units of the file; `added` are increments of
        functions, by the varID that they give."""
        return Values(self, given, added)

    def functions(self) -> dict[str, Entry | None]:
        """varID that it gives -> the table of a function, None for one that is not read, or is several functions'."""
        shared = Counter(id(table) for node in self._functions.values() if (table := self._table(node)) is not None)
        found: dict[str, Entry | None] = {}
        for varid, node in self._functions.items():
            try:
                entry = self._entry(node)
            except InputError:
                entry = None
            found[varid] = entry if shared[id(self._table(node))] == 1 else None
        return found

    def within(self, varid: str, value: Any) -> Any:
        """Limit the value of a variable to what its definition allows. Raises InputError."""
        for key, limit in (("minValue", ca.fmax), ("maxValue", ca.fmin)):
            said = self._variables[varid].get(key) if varid in self._variables else None
            value = value if said is None else limit(value, number_of(said, key))
        return value

    def found(self, varid: str, look: Values) -> Any:
        """Evaluate a variable: an input's initial value, a calculation, a function. Raises InputError."""
        if varid in self._functions:
            entry = self._entry(self._functions[varid])
            return entry.grid.at(*(look(name) for name in entry.over)) + look.added.get(varid, 0.0)
        node = self._variables.get(varid)
        if node is None:
            raise unknown("variable", varid, self._variables)
        calculation = _find(node, "calculation")
        if calculation is not None:
            return expression(_child(calculation, "math"), look)
        if node.get("initialValue") is not None:
            return ca.SX(number_of(node.get("initialValue"), "initialValue"))
        raise InputError(f"variable '{varid}' ({node.get('name')}) has no value; hold it: held = {{\"{varid}\": 0.0}}")

    def _table(self, node: ET.Element) -> ET.Element | None:
        definition = _child(node, "functionDefn")
        table = _find(definition, "griddedTableDef")
        if table is None and (reference := _find(definition, "griddedTableRef")) is not None:
            return self._tables.get(reference.get("gtID", ""))
        return table

    def _entry(self, node: ET.Element) -> Entry:
        references = [child for child in node if bare(child.tag) == "independentVarRef"]
        table = self._table(node)
        if table is None:
            raise InputError(f"function '{node.get('name')}' has no gridded table; others are not read")
        axes = [self._axis(r.get("bpID", "")) for r in _child(table, "breakpointRefs")]
        beyond = {r.get("extrapolate", "neither") for r in references}
        if len(references) != len(axes) or not beyond <= {"neither", "both"} or len(beyond) > 1:
            raise InputError(f"function '{node.get('name')}': one way beyond its table, 'neither' or 'both', is read")
        outside = "hold" if beyond == {"neither"} else "linear"
        for reference, axis in zip(references, axes, strict=True):
            low, high = (
                number_of(reference.get(key, str(end)), key) for key, end in (("min", axis[0]), ("max", axis[-1]))
            )
            if low > axis[0] or high < axis[-1] or reference.get("interpolate", "linear") != "linear":
                raise InputError(
                    f"function '{node.get('name')}': only a table that is linear between all of its breakpoints is read"
                )
        grid = Grid(breakpoints=tuple(map(tuple, axes)), values=tuple(_numbers(table, "dataTable")), outside=outside)
        over = tuple(reference.get("varID", "") for reference in references)
        return Entry(name=node.get("name", ""), over=over, grid=grid)

    def _axis(self, identifier: str) -> list[float]:
        check_known("breakpoints", (identifier,), self._breakpoints)
        return self._breakpoints[identifier]


class Values:
    """varID -> expression, each made once."""

    def __init__(self, file: DaveFile, given: Mapping[str, Any], added: Mapping[str, Any]) -> None:
        self._file = file
        self._open = set[str]()
        self._known = {varid: file.within(varid, value) for varid, value in given.items()}
        self.added = added

    def __call__(self, varid: str) -> Any:
        if varid not in self._known:
            if varid in self._open:
                raise InputError(f"variable '{varid}' depends on itself")
            self._open.add(varid)
            self._known[varid] = self._file.within(varid, self._file.found(varid, self))
        return self._known[varid]


@lru_cache(maxsize=16)
def dave_file(text: str) -> DaveFile:
    """The file of a text. Raises InputError."""
    return DaveFile(text)


def _by(key: str, nodes: Sequence[ET.Element]) -> dict[str, ET.Element]:
    """Nodes by an identifier. Raises InputError where two have the same; what has none has a name of its own."""
    found: dict[str, ET.Element] = {}
    for index, node in enumerate(nodes):
        name = node.get(key) or f"{bare(node.tag)} {index + 1} without {key}"
        if name in found:
            raise InputError(f"two of <{bare(node.tag)}> have {key} '{name}'; give one another, and say which is meant")
        found[name] = node
    return found


def _find(node: ET.Element, tag: str) -> ET.Element | None:
    """The child of a name, or None. Raises InputError where there are several."""
    found = [child for child in node if bare(child.tag) == tag]
    if len(found) > 1:
        raise InputError(f"<{bare(node.tag)}> has {len(found)} of <{tag}>; keep the one that is meant")
    return found[0] if found else None


def _child(node: ET.Element, tag: str) -> ET.Element:
    child = _find(node, tag)
    if child is None:
        raise InputError(f"<{bare(node.tag)}> has no <{tag}>")
    return child


def _numbers(node: ET.Element, tag: str) -> list[float]:
    held = _child(node, tag)
    if len(held):
        raise InputError(f"<{tag}> must have numbers alone; it has <{bare(held[0].tag)}> in it: take that out")
    return [number_of(x, tag) for x in _SEPARATORS.split((held.text or "").strip()) if x]
