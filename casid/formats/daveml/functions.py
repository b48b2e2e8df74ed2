"""Functions of a DAVE-ML file as CasADi expressions, and the MathML in them."""

from __future__ import annotations

import math
import operator
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import casadi as ca

from casid.errors import InputError, check_known, unknown
from casid.formats.file_tables import Entry
from casid.formats.jsbsim.source import alone, bare, check_words, number_in, number_of, optional, part
from casid.formats.operators import COMPARISONS, ONE, REDUCED, Operators
from casid.model.tables import Grid
from casid.records.limits import xml_root

Look = Callable[[str], Any]  # varID -> its expression

_OPERATORS = Operators(
    one=ONE
    | {f"arc{name}": getattr(ca, f"a{name}") for name in ("sin", "cos", "tan")}
    | {"minus": operator.neg, "plus": operator.pos, "log": ca.log10, "root": ca.sqrt, "ceiling": ca.ceil},
    two={"minus": operator.sub, "divide": operator.truediv, "power": operator.pow, "atan2": ca.atan2, "fmod": ca.fmod}
    | dict(zip(("lt", "leq", "gt", "geq", "eq", "neq"), COMPARISONS, strict=True)),
    reduced=REDUCED | {"plus": operator.add, "times": operator.mul},
)

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
    tag = node.tag
    children = list(node)
    if tag == "cn":
        return ca.SX(_constant(node))
    if tag == "ci":
        if len(node):
            raise InputError(f"<ci> must be the name of a variable alone; it has <{node[0].tag}> in it")
        return look((node.text or "").strip())
    if tag == "pi":
        return ca.SX(math.pi)
    if tag == "piecewise":
        return _piecewise(node, look)
    if tag == "math" or (tag == "apply" and len(children) == 1):
        return expression(_parts(node, 1)[0], look)
    if tag != "apply" or not children:
        raise InputError(f"<{tag}> is no MathML that casid reads")
    name = children[0].tag
    if name == "csymbol":
        name = (children[0].text or "").strip()
    given = [expression(child, look) for child in children[1:]]
    value = _OPERATORS(name, given)
    if value is None:
        raise InputError(f"<{name}> of {len(given)} arguments is no operator that casid reads")
    return value


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
    if [child.tag for child in node] != ["sep"]:
        raise InputError(f"<cn> of type '{kind}' must have two numbers with one <sep/> between them")
    if kind == "e-notation":
        return number_of(f"{(node.text or '').strip()}e{(node[0].tail or '').strip()}", "cn")
    first = number_of(node.text, "cn")
    second = number_of(node[0].tail, "cn")
    if second == 0.0:
        raise InputError("<cn> of type 'rational' is divided by zero")
    return first / second


def _piecewise(node: ET.Element, look: Look) -> Any:
    otherwise = optional(node, "otherwise")
    value = None if otherwise is None else expression(_parts(otherwise, 1)[0], look)
    for child in reversed(node.findall("piece")):
        then, condition = (expression(one, look) for one in _parts(child, 2))
        value = then if value is None else ca.if_else(condition, then, value)
    if value is None:
        raise InputError("<piecewise> has no piece")
    return value


def _parts(node: ET.Element, count: int) -> list[ET.Element]:
    """Elements in one that has `count` of them. Raises InputError."""
    if len(node) != count:
        raise InputError(f"<{node.tag}> has {len(node)} elements; expected {count}")
    return list(node)


_SEPARATORS = re.compile(r"[\s,]+")


class DaveFile:
    """Variables by varID, functions by the varID that they give, tables and breakpoints by their identifiers.

    named    varID -> name of the standard;  units  varID -> unit
    inputs   varIDs that are to be given;  outputs  varIDs that the file is for
    """

    def __init__(self, text: str) -> None:
        self._root = xml_root(text)
        for node in self._root.iter():
            node.tag = bare(node.tag)
        if self._root.tag != "DAVEfunc":
            raise InputError(f"the root is <{self._root.tag}>; a DAVE-ML file begins with <DAVEfunc>")
        check_words(self._root, _WORDS, _IGNORED)
        self._variables = _by("varID", self._root.iter("variableDef"))
        self.named = {varid: node.get("name", "") for varid, node in self._variables.items()}
        self.units = {name: node.get("units", "") for name, node in self._variables.items()}
        breakpoints = _by("bpID", self._root.iter("breakpointDef"))
        self._breakpoints = {name: _numbers(node, "bpVals") for name, node in breakpoints.items()}
        self._tables = _by("gtID", self._root.iter("griddedTableDef"))
        functions = [n for n in self._root.iter("function") if optional(n, "dependentVarRef") is not None]
        gives = _by("varID", [part(node, "dependentVarRef") for node in functions])
        self._functions = dict(zip(gives, functions, strict=True))
        for varid in self._functions:
            if optional(self._variables.get(varid, self._root), "calculation") is not None:
                raise InputError(f"variable '{varid}' has a function and a calculation; remove one")
        self.inputs = tuple(v for v, node in self._variables.items() if optional(node, "isInput") is not None)
        self.outputs = tuple(v for v, node in self._variables.items() if optional(node, "isOutput") is not None)

    def varid(self, name: str) -> str:
        """varID of a name of the standard. Raises InputError where no variable has it, or several."""
        found = [varid for varid, own in self.named.items() if own == name]
        check_known("variable", (name,), set(self.named.values()))
        if len(found) > 1:
            raise InputError(f"variables {' and '.join(map(repr, found))} are both called '{name}'; rename one")
        return found[0]

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
        calculation = optional(node, "calculation")
        if calculation is not None:
            return expression(part(calculation, "math"), look)
        if node.get("initialValue") is not None:
            return ca.SX(number_of(node.get("initialValue"), "initialValue"))
        raise InputError(f"variable '{varid}' ({node.get('name')}) has no value; hold it: held = {{\"{varid}\": 0.0}}")

    def _table(self, node: ET.Element) -> ET.Element | None:
        definition = part(node, "functionDefn")
        table = optional(definition, "griddedTableDef")
        if table is None and (reference := optional(definition, "griddedTableRef")) is not None:
            return self._tables.get(reference.get("gtID", ""))
        return table

    def _entry(self, node: ET.Element) -> Entry:
        references = node.findall("independentVarRef")
        table = self._table(node)
        if table is None:
            raise InputError(f"function '{node.get('name')}' has no gridded table; others are not read")
        axes = [self._axis(r.get("bpID", "")) for r in part(table, "breakpointRefs")]
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


def _by(key: str, nodes: Iterable[ET.Element]) -> dict[str, ET.Element]:
    """Nodes by an identifier. Raises InputError where two have the same; what has none has a name of its own."""
    found: dict[str, ET.Element] = {}
    for index, node in enumerate(nodes):
        name = node.get(key) or f"{node.tag} {index + 1} without {key}"
        if name in found:
            raise InputError(f"two of <{node.tag}> have {key} '{name}'; give one another, and say which is meant")
        found[name] = node
    return found


def _numbers(node: ET.Element, tag: str) -> list[float]:
    return [number_of(x, tag) for x in _SEPARATORS.split(alone(part(node, tag)).strip()) if x]
