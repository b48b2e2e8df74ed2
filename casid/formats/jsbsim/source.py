"""The XML of a JSBSim aircraft: the file with what it includes, numbers with their units, places."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from casid.errors import InputError, check_known
from casid.records.limits import MOST_BYTES_OF_A_MODEL, beside, of_file, read_bytes, xml_root
from casid.signals import DEGREE, FOOT

LBS_PER_SLUG = 32.174049
_INCLUDED = ("aerodynamics", "mass_balance", "metrics", "flight_control", "propulsion")
# of each quantity: unit of the file -> factor to JSBSim's own (ft2, ft, lbs, slug ft2, rad)
_UNITS = (
    {"FT2": 1.0, "M2": 1.0 / FOOT**2},
    {"FT": 1.0, "M": 1.0 / FOOT, "IN": 1.0 / 12.0},
    {"LBS": 1.0, "KG": 2.20462262},
    {"SLUG*FT2": 1.0, "KG*M2": 0.737562149},
    {"DEG": DEGREE, "RAD": 1.0},
)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def load(path: str | Path) -> ET.Element:
    """The root of a JSBSim aircraft with the sections that it keeps in other files. Raises InputError."""
    file = Path(path)
    root = _parsed(file)
    if root.tag != "fdm_config":
        raise InputError(f"{file}: the root is <{root.tag}>; a JSBSim aircraft begins with <fdm_config>")
    for section in list(root):
        name = section.get("file")
        if section.tag not in _INCLUDED or not name:
            continue
        spelled = (name, f"{name}.xml", f"Systems/{name}.xml")
        places = [beside(file.parent, one, f"{file}: <{section.tag}>") for one in spelled]
        found = next((place for place in places if place.is_file()), None)
        if found is None and section.tag in ("aerodynamics", "mass_balance", "metrics"):
            raise InputError(f"{file}: <{section.tag}> is in the file '{name}', which is not beside it")
        if found is not None:
            section.extend(list(_parsed(found)))
            del section.attrib["file"]
    for tag in ("metrics", "mass_balance", "aerodynamics"):
        if root.find(tag) is None:
            raise InputError(f"{file}: <{tag}> is missing; it is needed for an aircraft")
    return root


def _parsed(file: Path) -> ET.Element:
    raw = read_bytes(file, MOST_BYTES_OF_A_MODEL)
    with of_file(file):
        return xml_root(raw)


def bare(name: str) -> str:
    """Return the name of an element or attribute without its namespace."""
    return name.rsplit("}", 1)[-1]


def check_words(
    node: ET.Element, known: Mapping[str, tuple[Collection[str] | None, Collection[str]]], ignored: Collection[str]
) -> None:
    """Raise InputError for what a format does not have: elements and attributes, `known` by the element in which they
    stand (under "" by all others; None are any elements), and text beside elements. Nothing in `ignored` is read."""
    tag = bare(node.tag)
    elements, attributes = known.get(tag, known[""])
    check_known(f"attribute of <{tag}>", map(bare, node.attrib), attributes)
    inner = [child for child in node if bare(child.tag) not in ignored]
    if elements is not None:
        check_known(f"element of <{tag}>", [bare(child.tag) for child in inner], elements)
    beside = "".join((node.text or "", *(child.tail or "" for child in node))).strip()
    if beside and (len(node) or elements) and tag != "cn":
        raise InputError(f"<{tag}> has '{beside[:40]}' beside its elements: take that out")
    for child in inner:
        check_words(child, known, ignored)


def part(node: ET.Element, tag: str) -> ET.Element:
    """Return the child `tag`. Raises InputError when there is none, or more than one."""
    child = optional(node, tag)
    if child is None:
        raise InputError(f"<{node.tag}> has no <{tag}>; add it")
    return child


def optional(node: ET.Element, tag: str) -> ET.Element | None:
    """Return the child `tag`, or None. Raises InputError when there is more than one."""
    children = node.findall(tag)
    if len(children) > 1:
        raise InputError(f"<{node.tag}> has {len(children)} of <{tag}>; keep the one that is meant")
    return children[0] if children else None


def number_of(text: str | None, where: str) -> float:
    """Return a number of the file, written in digits of ASCII with a decimal point. Raises InputError."""
    text = (text or "").strip()
    if not _NUMBER.fullmatch(text) or not np.isfinite(float(text)):
        raise InputError(f"<{where}> must be a number, got '{text[:40]}'")
    return float(text)


def number_in(node: ET.Element) -> float:
    """Return the number that an element has, and nothing beside it. Raises InputError."""
    if len(node):
        raise InputError(f"<{node.tag}> must be a number alone; it has <{node[0].tag}> in it: take that out")
    return number_of(node.text, node.tag)


def alone(node: ET.Element) -> str:
    """Return the text of an element with numbers, and nothing beside them. Raises InputError."""
    if len(node):
        raise InputError(f"<{node.tag}> must have numbers alone; it has <{node[0].tag}> in it: take that out")
    return node.text or ""


def amount(node: ET.Element | None, unit: str) -> float:
    """Return a number in JSBSim's own unit, zero of none; the file's `unit` attribute, else `unit`, says which it has.
    Raises InputError, also for a unit of another quantity."""
    return 0.0 if node is None else number_in(node) * size_of_unit(node, unit)


def size_of_unit(node: ET.Element, unit: str) -> float:
    """Return the size of the unit of an element, that of its attribute, else `unit`, in JSBSim's own. Raises InputError
    for a unit of another quantity than `unit`."""
    units = next(units for units in _UNITS if unit in units)
    named = node.get("unit", unit).upper()
    if named not in units:
        raise InputError(f"<{node.tag}>: unit '{named}' is none of its quantity; expected {' or '.join(units)}")
    return units[named]


def place(node: ET.Element) -> np.ndarray:
    """Return (3,) x y z of a <location> [ft], structural axes: x aft, y right, z up."""
    return np.array([number_in(part(node, axis)) for axis in "xyz"]) * size_of_unit(node, "IN")


def body_arm(at: np.ndarray, cg: np.ndarray) -> np.ndarray:
    """(3,) from the centre of gravity to a place, body axes, in their unit."""
    return np.array([-1.0, 1.0, -1.0]) * (at - cg)
