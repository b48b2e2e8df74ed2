"""The aerodynamics of a JSBSim file as a function of the regressors: coefficients of casid, about the c.g."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from types import MappingProxyType, SimpleNamespace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from casid.above import ask_above
from casid.errors import InputError
from casid.formats.file_tables import QUANTITIES, Tried
from casid.formats.jsbsim.functions import entries, mark, marked, value_of
from casid.formats.jsbsim.properties import Metrics, Properties
from casid.formats.jsbsim.source import amount, body_arm, optional, part, place
from casid.model.effect_value import EffectValue
from casid.model.tables import Table
from casid.records.limits import of_file

_FORCES = (("DRAG", "SIDE", "LIFT"), ("AXIAL", "SIDE", "NORMAL"), ("X", "Y", "Z"))
_MOMENTS = ("ROLL", "PITCH", "YAW")
LIFT_SQUARED = "aero/cl-squared"
_NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class JsbsimAerodynamics:
    """`<aerodynamics>` of a file."""

    format: ClassVar[str] = "jsbsim"

    path: str  # of the aircraft's XML, and its `text` with all that it includes, as it was read
    text: str = field(repr=False)
    cg: tuple[float, float, float]  # centre of gravity [ft], structural axes, about which moments are taken
    held: tuple[tuple[str, float], ...] = ()  # pairs of property and value that the user holds
    axes: str = "wind"  # "wind": CL CD CY, "body": CX CZ CY

    def __call__(self, s: Any) -> dict[str, Any]:
        """Coefficient -> expression in the quantities of `Aircraft.aerodynamics`. Raises InputError."""
        return self.coefficients(s)[0]

    def section(self) -> dict[str, Any]:
        """Keys and values of [aerodynamics] from which these aerodynamics are read again."""
        return {"jsbsim": self.path, "held": dict(self.held)}

    @property
    def taken_as_held(self) -> dict[str, float]:
        """Properties of the control system, engines and systems that are held, with their values."""
        return self.coefficients(SimpleNamespace(**{name: ca.SX.sym(name) for name in QUANTITIES}))[1].held

    @property
    def notes(self) -> tuple[str, ...]:
        """List what of the file is left out, and what is held."""
        held = self.taken_as_held | dict(self.held)
        shown = ", ".join(f"{name} = {value:g}" for name, value in sorted(held.items()))
        left_out = "recorded surfaces and thrust stand for its control system and engines, which are left out"
        return (f"JSBSim file: {left_out}; held are {shown}",)

    @cached_property
    def _tried(self) -> Tried:
        root = _root(self.text)
        with_marks = replace(self, text=marked(root))

        def look_up(s: Any, marks: ca.SX) -> tuple[dict[str, Any], Properties]:
            return with_marks.coefficients(s, {mark(i): marks[i] for i in range(marks.numel())})

        return Tried(list(entries(root)), look_up)

    @property
    def tables(self) -> tuple[Table, ...]:
        """The tables of the file that are over regressors, and enter a coefficient as they are or times a term."""
        return tuple(one.table for one in self._tried.tables)

    def of_table(self, one: Table, s: Mapping[str, Any]) -> dict[str, Any]:
        """Coefficient -> by how much it grows with the values of one of `tables`, as a part of its own coefficient:
        forces have moments about the c.g. Expressions in the quantities of `Aircraft.aerodynamics`."""
        return self._tried.of_table(one, s)

    def rewritten(self, text: str, terms: Mapping[str, Mapping[str, float]], effects: Sequence[EffectValue]) -> str:
        """The `text` of the file with further terms and effects; see `extended_text`."""
        return ask_above("JsbsimAerodynamics.rewritten", text, terms, effects, self.axes, self._tried.tables)

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # what is cached is found again

    def coefficients(self, s: Any, further: Mapping[str, Any] = _NOTHING) -> tuple[dict[str, Any], Properties]:
        """The coefficients, and the properties that were looked up for them; `further` are properties of ours."""
        root = _root(self.text)
        aerodynamics = part(root, "aerodynamics")
        functions: dict[str, ET.Element] = {}
        for node in aerodynamics.iter("function"):
            name = node.get("name", "").strip()
            if name in functions:
                raise InputError(f"{self.path}: two functions are called '{name}'; rename or remove one")
            functions |= {name: node} if name else {}
        look = Properties(s, metrics_of(root), functions, root)
        look.given |= dict(self.held)
        look.values |= further
        with of_file(self.path):
            fx, fy, fz, *moment = _forces_and_moments(aerodynamics, look, metrics_of(root))
        dx, dy, dz = (float(x) for x in body_arm(reference_point(root), np.array(self.cg)))
        dx = dx + _shift(aerodynamics, look, metrics_of(root))
        moment = [moment[0] + dy * fz - dz * fy, moment[1] + dz * fx - dx * fz, moment[2] + dx * fy - dy * fx]
        m = metrics_of(root)
        found = {"Cl": moment[0] / m["bw-ft"], "Cm": moment[1] / m["cbarw-ft"], "Cn": moment[2] / m["bw-ft"], "CY": fy}
        if self.axes == "body":
            return found | {"CX": fx, "CZ": fz}, look
        sin_a = ca.sin(s.alpha)
        cos_a = ca.cos(s.alpha)
        return found | {"CL": fx * sin_a - fz * cos_a, "CD": -fx * cos_a - fz * sin_a}, look


@lru_cache(maxsize=16)
def _root(text: str) -> ET.Element:
    return ET.fromstring(text)


def metrics_of(root: ET.Element) -> Metrics:
    """Raises InputError when wing area, span or chord is missing."""
    node = part(root, "metrics")
    values = {
        "Sw-sqft": amount(part(node, "wingarea"), "FT2"),
        "bw-ft": amount(part(node, "wingspan"), "FT"),
        "cbarw-ft": amount(part(node, "chord"), "FT"),
        "iw-rad": amount(optional(node, "wing_incidence"), "DEG"),
        "Sh-sqft": amount(optional(node, "htailarea"), "FT2"),
        "lh-ft": amount(optional(node, "htailarm"), "FT"),
        "Sv-sqft": amount(optional(node, "vtailarea"), "FT2"),
        "lv-ft": amount(optional(node, "vtailarm"), "FT"),
    }
    for name, tag in (("Sw-sqft", "wingarea"), ("bw-ft", "wingspan"), ("cbarw-ft", "chord")):
        if values[name] <= 0.0:
            raise InputError(f"<metrics>: <{tag}> must be positive, got {values[name]:g}")
    return values


def reference_point(root: ET.Element) -> np.ndarray:
    """(3,) [ft] where aerodynamic forces act, structural axes. Raises InputError."""
    found = [node for node in part(root, "metrics").findall("location") if node.get("name") == "AERORP"]
    if len(found) != 1:
        many = f"has {len(found)} locations" if found else "has no location"
        raise InputError(f"<metrics> {many} AERORP, about which aerodynamic moments are given; expected one")
    return place(found[0])


def _shift(aerodynamics: ET.Element, look: Properties, metrics: Metrics) -> Any:
    """Return the distance by which the reference point moves forward [ft]: structural x, in chords, points aft."""
    node = optional(aerodynamics, "aero_ref_pt_shift_x")
    if node is None:
        return 0.0
    return -value_of(part(node, "function"), look) * metrics["cbarw-ft"]


def _forces_and_moments(aerodynamics: ET.Element, look: Properties, metrics: Metrics) -> list[Any]:
    """X Y Z L M N about the reference point, over dynamic pressure and wing area."""
    axes: dict[str, list[ET.Element]] = {}
    for axis in aerodynamics.findall("axis"):
        if axis.get("frame") or axis.get("unit", "LBS") != "LBS":
            raise InputError(f'<axis name="{axis.get("name")}"> in a frame or unit of its own is not read')
        name = axis.get("name", "").strip()
        if name in axes:
            raise InputError(
                f'<axis name="{name}"> stands twice, and JSBSim takes the last one alone; put all functions into one'
            )
        axes[name] = axis.findall("function")
        if any(node.get("apply_at_cg", "false").strip().lower() not in ("false", "0") for node in axes[name]):
            raise InputError(f'<axis name="{name}">: a function that is applied at the c.g. (apply_at_cg) is not read')
    known = {name for names in (*_FORCES, _MOMENTS) for name in names}
    for name in axes:
        if name not in known:
            raise InputError(f'<axis name="{name}"> is not read; expected one of {", ".join(sorted(known))}')
    scale = look("aero/qbar-psf") * metrics["Sw-sqft"]

    def total(name: str) -> Any:
        return sum((value_of(node, look) for node in axes.get(name, ())), ca.SX(0.0)) / scale

    frames = [names for names in _FORCES if (set(names) - {"SIDE"}) & set(axes)]
    if len(frames) > 1:
        raise InputError(f"forces along {' and '.join('/'.join(names) for names in frames)} at once are not read")
    names = frames[0] if frames else _FORCES[0]
    if names[0] == "DRAG":
        lift = total("LIFT")
        look.values[LIFT_SQUARED] = lift**2
        force = _wind_to_body(total("DRAG"), total("SIDE"), lift, look)
    else:
        sign = -1.0 if names[0] == "AXIAL" else 1.0
        force = [sign * total(names[0]), total(names[1]), sign * total(names[2])]
    return [*force, *(total(name) for name in _MOMENTS)]


def _wind_to_body(drag: Any, side: Any, lift: Any, look: Properties) -> list[Any]:
    alpha = look("aero/alpha-rad")
    beta = look("aero/beta-rad")
    sin_a = ca.sin(alpha)
    cos_a = ca.cos(alpha)
    sin_b = ca.sin(beta)
    cos_b = ca.cos(beta)
    return [
        -drag * cos_a * cos_b - side * cos_a * sin_b + lift * sin_a,
        -drag * sin_b + side * cos_b,
        -drag * sin_a * cos_b - side * sin_a * sin_b - lift * cos_a,
    ]
