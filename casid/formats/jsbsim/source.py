"""The XML of a JSBSim aircraft: the file with what it includes, numbers with their units, places."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from casid.errors import InputError
from casid.records.limits import MOST_BYTES_OF_A_MODEL, beside, read_bytes, xml_root
from casid.signals import DEGREE, FOOT

LBS_PER_SLUG = 32.174049
_INCLUDED = ("aerodynamics", "mass_balance", "metrics", "flight_control", "propulsion")
# unit of the file -> factor to JSBSim's own (ft2, ft, in, lbs, slug ft2)
_UNITS = {
    "FT2": 1.0,
    "M2": 1.0 / FOOT**2,
    "FT": 1.0,
    "M": 1.0 / FOOT,
    "IN": 1.0 / 12.0,
    "LBS": 1.0,
    "KG": 2.20462262,
    "SLUG*FT2": 1.0,
    "KG*M2": 0.737562149,
    "DEG": DEGREE,
    "RAD": 1.0,
}


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
    try:
        return xml_root(raw)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def part(node: ET.Element, tag: str) -> ET.Element:
    """The child `tag`; raises InputError when there is none."""
    child = node.find(tag)
    if child is None:
        raise InputError(f"<{node.tag}> has no <{tag}>; add it")
    return child


def number_of(text: str | None, where: str) -> float:
    """A number of the file. Raises InputError."""
    try:
        return float(text or "")
    except ValueError:
        raise InputError(f"<{where}> must be a number, got '{(text or '').strip()[:40]}'") from None


def amount(node: ET.Element | None, unit: str, default: float = 0.0) -> float:
    """A number in JSBSim's own unit; the file's `unit` attribute, else `unit`, names the one that it has. Raises
    InputError."""
    if node is None:
        return default
    named = node.get("unit", unit).upper()
    if named not in _UNITS:
        raise InputError(f"<{node.tag}>: unit '{named}' is not known; expected one of {', '.join(_UNITS)}")
    return number_of(node.text, node.tag) * _UNITS[named]


def place(node: ET.Element) -> np.ndarray:
    """(3,) x y z of a <location> [ft], structural axes: x aft, y right, z up."""
    unit = node.get("unit", "IN").upper()
    if unit not in _UNITS:
        raise InputError(f"<location>: unit '{unit}' is not known; expected IN, FT or M")
    return np.array([number_of(part(node, axis).text, axis) for axis in "xyz"]) * _UNITS[unit]


def body_arm(at: np.ndarray, cg: np.ndarray) -> np.ndarray:
    """(3,) from the centre of gravity to a place, body axes, in their unit."""
    return np.array([-1.0, 1.0, -1.0]) * (at - cg)
