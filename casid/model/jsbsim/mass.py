"""Mass, centre of gravity and inertia of a loaded JSBSim aircraft: empty, point masses, contents of the tanks."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from casid.model.jsbsim.source import LBS_PER_SLUG, amount, body_arm, part, place


@dataclass(frozen=True, eq=False, kw_only=True)
class MassProperties:
    """Weight [lbs], centre of gravity (3,) [ft] in structural axes, inertia (3, 3) tensor [slug ft2] in body axes."""

    weight: float
    cg: np.ndarray
    inertia: np.ndarray


def mass_properties(root: ET.Element) -> MassProperties:
    """As JSBSim adds them up at the start of a flight. Raises InputError."""
    balance = part(root, "mass_balance")
    empty = next((node for node in balance.findall("location") if node.get("name") in ("CG", None)), None)
    parts = [(amount(part(balance, "emptywt"), "LBS"), np.zeros(3) if empty is None else place(empty), _own(balance))]
    for point in balance.findall("pointmass"):
        weight = amount(part(point, "weight"), "LBS")
        form = point.find("form")
        own = _own(point) if form is None else _of_form(form, weight / LBS_PER_SLUG)
        parts.append((weight, place(part(point, "location")), own))
    for tank in root.iterfind("propulsion/tank"):
        location = tank.find("location")
        if location is not None:
            parts.append((amount(tank.find("contents"), "LBS"), place(location), np.zeros((3, 3))))
    weight = sum(w for w, _, _ in parts)
    cg = sum((w * at for w, at, _ in parts), np.zeros(3)) / weight
    inertia = sum((own + _of_point(w / LBS_PER_SLUG, body_arm(at, cg)) for w, at, own in parts), np.zeros((3, 3)))
    return MassProperties(weight=weight, cg=cg, inertia=inertia)


def _own(node: ET.Element) -> np.ndarray:
    """The tensor that the file gives; products of inertia are negated unless it says that they are not."""
    xx, yy, zz, xy, xz, yz = (
        amount(node.find(f"i{pair}"), "SLUG*FT2") for pair in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    negated = node.get("negated_crossproduct_inertia", "true").lower() in ("true", "1", "yes")
    s = 1.0 if negated else -1.0
    return np.array([[xx, -s * xy, s * xz], [-s * xy, yy, -s * yz], [s * xz, -s * yz, zz]])


def _of_point(mass: float, arm: np.ndarray) -> np.ndarray:
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def _of_form(form: ET.Element, mass: float) -> np.ndarray:
    """Of a solid about its own centre, its axis along x."""
    r, length = amount(form.find("radius"), "FT"), amount(form.find("length"), "FT")
    across = {"tube": mass / 12.0 * (6.0 * r**2 + length**2), "cylinder": mass / 12.0 * (3.0 * r**2 + length**2)}
    along = {"tube": mass * r**2, "cylinder": mass / 2.0 * r**2, "sphere": mass / 1.5 * r**2, "ball": mass / 2.5 * r**2}
    shape = form.get("shape", "").strip().lower()
    first = along.get(shape, 0.0)
    return np.diag([first, across.get(shape, first), across.get(shape, first)])
