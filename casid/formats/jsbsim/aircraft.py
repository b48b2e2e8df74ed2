"""A JSBSim aircraft as the fields of `Aircraft`: metrics, mass balance, aerodynamics.

Surfaces, thrust along body x and density are taken from the records. Control system, engines, ground and weather of the
file are left out.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.arguments import number
from casid.errors import check_known
from casid.formats.jsbsim.aerodynamics import JsbsimAerodynamics, metrics_of
from casid.formats.jsbsim.source import LBS_PER_SLUG, amount, body_arm, check_words, load, optional, part, place
from casid.model.airframe import Inertia
from casid.records.limits import of_file
from casid.signals import FOOT, SLUG


@dataclass(frozen=True, eq=False, kw_only=True)
class MassProperties:
    """Weight [lbs], centre of gravity (3,) [ft] in structural axes, inertia (3, 3) tensor [slug ft2] in body axes."""

    weight: float
    cg: np.ndarray
    inertia: np.ndarray


def mass_properties(root: ET.Element) -> MassProperties:
    """Add up the mass properties as JSBSim does at the start of a flight. Raises InputError."""
    balance = part(root, "mass_balance")
    empty = part(balance, "location")
    check_known("location", (empty.get("name", "CG"),), ("CG",), "<mass_balance>")
    parts = [(amount(part(balance, "emptywt"), "LBS"), place(empty), _own(balance))]
    for point in balance.findall("pointmass"):
        weight = amount(part(point, "weight"), "LBS")
        form = optional(point, "form")
        own = _own(point) if form is None else _of_form(form, weight / LBS_PER_SLUG)
        parts.append((weight, place(part(point, "location")), own))
    for tank in root.iterfind("propulsion/tank"):
        location = optional(tank, "location")
        if location is not None:
            parts.append((amount(optional(tank, "contents"), "LBS"), place(location), np.zeros((3, 3))))
    weight = sum(w for w, _, _ in parts)
    cg = sum((w * at for w, at, _ in parts), np.zeros(3)) / weight
    inertia = sum((own + _of_point(w / LBS_PER_SLUG, body_arm(at, cg)) for w, at, own in parts), np.zeros((3, 3)))
    return MassProperties(weight=weight, cg=cg, inertia=inertia)


_SIGNS = {"true": 1.0, "1": 1.0, "yes": 1.0, "false": -1.0, "0": -1.0, "no": -1.0}


def _own(node: ET.Element) -> np.ndarray:
    """The tensor that the file gives; products of inertia are negated unless it states that they are not."""
    xx, yy, zz, xy, xz, yz = (
        amount(optional(node, f"i{pair}"), "SLUG*FT2") for pair in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    negated = node.get("negated_crossproduct_inertia", "true").strip().lower()
    check_known("negated_crossproduct_inertia", (negated,), _SIGNS, f"<{node.tag}>")
    s = _SIGNS[negated]
    return np.array([[xx, -s * xy, s * xz], [-s * xy, yy, -s * yz], [s * xz, -s * yz, zz]])


def _of_point(mass: float, arm: np.ndarray) -> np.ndarray:
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def _of_form(form: ET.Element, mass: float) -> np.ndarray:
    """Return the inertia of a solid about its own centre, its axis along x."""
    r = amount(optional(form, "radius"), "FT")
    length = amount(optional(form, "length"), "FT")
    across = {"tube": mass / 12.0 * (6.0 * r**2 + length**2), "cylinder": mass / 12.0 * (3.0 * r**2 + length**2)}
    along = {"tube": mass * r**2, "cylinder": mass / 2.0 * r**2, "sphere": mass / 1.5 * r**2, "ball": mass / 2.5 * r**2}
    shape = form.get("shape", "").strip().lower()
    check_known("shape", (shape,), along, "<form>")
    first = along[shape]
    return np.diag([first, across.get(shape, first), across.get(shape, first)])


_LATERAL = ("0", "beta", "p", "r", "delta_a", "delta_r")
# derivatives that are increments, zero at first, on top of what the file has
INCREMENTS: Mapping[str, tuple[str, ...]] = {
    "CL": ("0", "alpha", "q", "delta_e"),
    "CD": ("0", "alpha"),
    "CY": _LATERAL,
    "Cl": _LATERAL,
    "Cm": ("0", "alpha", "q", "delta_e"),
    "Cn": _LATERAL,
}


def on_top(span: float, chord: float, renamed: Mapping[str, str] = MappingProxyType({})) -> dict[str, Any]:
    """Fields of `Aircraft` for increments on top of a file whose coefficients are about a span and a chord [m]."""
    return {
        "moment_length_lateral": span,
        "moment_length_pitch": chord,
        "rate_length_lateral": span / 2.0,
        "rate_length_pitch": chord / 2.0,
        "derivatives": {f"{renamed.get(c, c)}_{term}": 0.0 for c, terms in INCREMENTS.items() for term in terms},
    }


def fields_of_jsbsim(path: str | Path, held: Mapping[str, float]) -> dict[str, Any]:
    """Fields of `Aircraft`, with zero increments for derivatives. Raises InputError for what cannot be read."""
    root = load(path)
    with of_file(path):
        metrics = metrics_of(root)
        mass = mass_properties(root)
        given = {name: number(value, f"held: '{name}'") for name, value in held.items()}
        aerodynamics = aerodynamics_of(path, given)
        return {
            "name": root.get("name", Path(path).stem),
            "mass": mass.weight / LBS_PER_SLUG * SLUG,
            "inertia": _inertia(mass.inertia * SLUG * FOOT**2),
            "area": metrics["Sw-sqft"] * FOOT**2,
            **on_top(metrics["bw-ft"] * FOOT, metrics["cbarw-ft"] * FOOT),
            **_propulsion(root, mass.cg),
            "aerodynamics": aerodynamics,
        }


_ROUNDING = 1e-9  # of Iyy: a product of inertia that is less is one of mirrored masses


def _inertia(J: np.ndarray) -> Inertia:
    """Return the inertia from a (3, 3) tensor [kg m2]."""
    xy, yz = (-float(J[i, j]) if abs(J[i, j]) > _ROUNDING * J[1, 1] else 0.0 for i, j in ((0, 1), (1, 2)))
    return Inertia(Ixx=J[0, 0], Iyy=J[1, 1], Izz=J[2, 2], Ixz=-J[0, 2], Ixy=xy, Iyz=yz)


_AXES = ("x", "y", "z")
_PLACE = {"location": (_AXES, ("name", "unit")), **dict.fromkeys(_AXES, ((), ()))}
_METRICS = ("wingarea", "wingspan", "chord", "wing_incidence", "htailarea", "htailarm", "vtailarea", "vtailarm")
_INERTIAS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_WORDS: Mapping[str, Mapping[str, tuple[tuple[str, ...] | None, tuple[str, ...]]]] = {
    "metrics": {"": ((), ("unit",)), "metrics": ((*_METRICS, "location"), ()), **_PLACE},
    "mass_balance": {
        "": ((), ("unit",)),
        "mass_balance": ((*_INERTIAS, "emptywt", "location", "pointmass"), ("negated_crossproduct_inertia",)),
        "pointmass": (
            (*_INERTIAS, "weight", "location", "form"),
            ("name", "negated_crossproduct_inertia"),
        ),
        "form": (("radius", "length"), ("shape",)),
        **_PLACE,
    },
    "aerodynamics": {
        "": (None, ("name", "type", "unit")),
        "aerodynamics": (
            ("axis", "function", "property", "limitation", "alphalimits", "hysteresis_limits", "aero_ref_pt_shift_x"),
            (),
        ),
        "axis": (("function",), ("name", "unit", "frame")),
        "function": (None, ("name", "type", "apply_at_cg")),
        "property": ((), ("value",)),
        "table": (("independentVar", "tableData"), ("name", "type")),
        "independentVar": ((), ("lookup",)),
        "tableData": (None, ("breakPoint",)),
    },
}


def aerodynamics_of(path: str | Path, held: Mapping[str, float], axes: str = "wind") -> JsbsimAerodynamics:
    """The aerodynamics of a file in force `axes`; gear that cannot be retracted is down. Raises InputError."""
    root = load(path)
    for section, known in _WORDS.items():
        check_words(part(root, section), known, ("description", "documentation"))
    gear = {"gear/gear-pos-norm": 0.0 if _retracts(root) else 1.0}
    cg = mass_properties(root).cg
    made = JsbsimAerodynamics(
        path=str(Path(path).resolve()),
        text=ET.tostring(root, encoding="unicode"),
        cg=(float(cg[0]), float(cg[1]), float(cg[2])),
        held=tuple(sorted((gear | dict(held)).items())),
        axes=axes,
    )
    made.taken_as_held  # noqa: B018  raises for what cannot be read
    return made


def _retracts(root: ET.Element) -> bool:
    legs = root.iterfind("ground_reactions/contact/retractable")
    return any((leg.text or "").strip() not in ("", "0") for leg in legs)


def _propulsion(root: ET.Element, cg: np.ndarray) -> dict[str, Any]:
    """Return the places of thrusters about the c.g.: mean height of the thrust line, and each engine's y."""
    found = [node for node in root.iterfind("propulsion/engine/thruster/location")]
    arms = [body_arm(place(node), cg) * FOOT for node in found]
    if not arms:
        return {}
    return {"thrust_line_z": float(np.mean([arm[2] for arm in arms])), "engine_y": tuple(float(a[1]) for a in arms)}
