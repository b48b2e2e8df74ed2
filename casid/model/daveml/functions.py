"""A DAVE-ML file: its variables, breakpoints and gridded tables, and what they come to."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca

from casid.errors import InputError, unknown
from casid.model.daveml.mathml import bare, expression, number
from casid.model.grid import Grid

_SEPARATORS = re.compile(r"[\s,]+")


class DaveFile:
    """Variables by varID, functions by the varID that they give, tables and breakpoints by their identifiers.

    names    name of the standard -> varID;  units  varID -> unit
    inputs   varIDs that are to be given;  outputs  varIDs that the file is for
    """

    def __init__(self, text: str) -> None:
        try:
            self._root = ET.fromstring(text)
        except ET.ParseError as error:
            raise InputError(f"is no XML: {error}") from None
        if bare(self._root) != "DAVEfunc":
            raise InputError(f"the root is <{bare(self._root)}>; a DAVE-ML file begins with <DAVEfunc>")
        variables = self._all("variableDef")
        self._variables = {node.get("varID", ""): node for node in variables}
        self.names = {node.get("name", ""): node.get("varID", "") for node in variables}
        self.units = {name: node.get("units", "nd") for name, node in self._variables.items()}
        self._breakpoints = {node.get("bpID", ""): _numbers(node, "bpVals") for node in self._all("breakpointDef")}
        self._tables = {node.get("gtID", ""): node for node in self._all("griddedTableDef")}
        self._functions = {_child(node, "dependentVarRef").get("varID", ""): node for node in self._functions_of()}
        self.inputs = tuple(v for v, node in self._variables.items() if _find(node, "isInput") is not None)
        self.outputs = tuple(v for v, node in self._variables.items() if _find(node, "isOutput") is not None)

    def _all(self, tag: str) -> list[ET.Element]:
        return [node for node in self._root.iter() if bare(node) == tag]

    def _functions_of(self) -> list[ET.Element]:
        return [node for node in self._all("function") if _find(node, "dependentVarRef") is not None]

    def values(self, given: Mapping[str, Any]) -> Values:
        """Look-up of every variable by varID, from inputs by varID in the units of the file."""
        return Values(self, given)

    def shots(self) -> list[tuple[str, dict[str, float], dict[str, tuple[float, float]]]]:
        """(name, inputs, outputs with tolerance) of the static check cases, by the standard's names."""
        found = []
        for shot in self._all("staticShot"):
            signals = [
                {_name(s): _value(s, "signalValue") for s in _child(shot, part) if bare(s) == "signal"}
                for part in ("checkInputs", "checkOutputs")
            ]
            tolerances = {_name(s): _value(s, "tol") for s in _child(shot, "checkOutputs") if bare(s) == "signal"}
            outputs = {name: (value, tolerances[name]) for name, value in signals[1].items()}
            found.append((shot.get("name", ""), signals[0], outputs))
        return found

    def found(self, varid: str, look: Values) -> Any:
        """What a variable is made of: an input's initial value, a calculation, a function. Raises InputError."""
        if varid in self._functions:
            return self._function(self._functions[varid], look)
        node = self._variables.get(varid)
        if node is None:
            raise unknown("variable", varid, self._variables)
        calculation = _find(node, "calculation")
        if calculation is not None:
            return expression(_child(calculation, "math"), look)
        if node.get("initialValue") is not None:
            return ca.SX(number(node.get("initialValue"), "initialValue"))
        raise InputError(f"variable '{varid}' ({node.get('name')}) has no value; hold it: held = {{\"{varid}\": 0.0}}")

    def _function(self, node: ET.Element, look: Values) -> Any:
        references = [child for child in node if bare(child) == "independentVarRef"]
        definition = _child(node, "functionDefn")
        table = _find(definition, "griddedTableDef")
        if table is None and (reference := _find(definition, "griddedTableRef")) is not None:
            table = self._tables.get(reference.get("gtID", ""))
        if table is None:
            raise InputError(f"function '{node.get('name')}' has no gridded table; others are not read")
        axes = [self._axis(r.get("bpID", "")) for r in _child(table, "breakpointRefs")]
        beyond = {r.get("extrapolate", "neither") for r in references}
        if len(references) != len(axes) or not beyond <= {"neither", "both"} or len(beyond) > 1:
            raise InputError(f"function '{node.get('name')}': one way beyond its table, 'neither' or 'both', is read")
        outside = "hold" if beyond == {"neither"} else "linear"
        values = tuple(_numbers(table, "dataTable"))
        grid = Grid(breakpoints=tuple(map(tuple, axes)), values=values, outside=outside)
        return grid.at(*(look(reference.get("varID", "")) for reference in references))

    def _axis(self, identifier: str) -> list[float]:
        if identifier not in self._breakpoints:
            raise unknown("breakpoints", identifier, self._breakpoints)
        return self._breakpoints[identifier]


class Values:
    """varID -> expression, each made once."""

    def __init__(self, file: DaveFile, given: Mapping[str, Any]) -> None:
        self._file, self._known, self._open = file, dict(given), set[str]()

    def __call__(self, varid: str) -> Any:
        if varid not in self._known:
            if varid in self._open:
                raise InputError(f"variable '{varid}' depends on itself")
            self._open.add(varid)
            self._known[varid] = self._file.found(varid, self)
        return self._known[varid]


@lru_cache(maxsize=16)
def dave_file(text: str) -> DaveFile:
    """The file of a text. Raises InputError."""
    return DaveFile(text)


def _find(node: ET.Element, tag: str) -> ET.Element | None:
    return next((child for child in node if bare(child) == tag), None)


def _child(node: ET.Element, tag: str) -> ET.Element:
    child = _find(node, tag)
    if child is None:
        raise InputError(f"<{bare(node)}> has no <{tag}>")
    return child


def _numbers(node: ET.Element, tag: str) -> list[float]:
    text = "".join(_child(node, tag).itertext())
    return [number(x, tag) for x in _SEPARATORS.split(text.strip()) if x]


def _name(signal: ET.Element) -> str:
    node = _find(signal, "signalName")
    return ((node if node is not None else _child(signal, "varID")).text or "").strip()


def _value(signal: ET.Element, tag: str) -> float:
    return number(_child(signal, tag).text, tag)
