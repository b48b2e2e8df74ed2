"""Gazebo's AdvancedLiftDrag (gz-sim, PX4): an SDF model with mass, inertia and the coefficients of the plugin.

The plugin has lift and drag in the plane of symmetry, a parabolic polar of the whole lift, and derivatives by surface
deflection in degrees. Its link has x forward, y left, z up.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from casid.formats.absorbed import Absorbed, absorbed, in_wind_axes, need_derivatives, polar_of
from casid.formats.file_tables import in_comment
from casid.model.aircraft import Aircraft

SURFACES = {"delta_e": "elevator_joint", "delta_a": "aileron_joint", "delta_r": "rudder_joint"}
# coefficient of a file -> that of the plugin
_NAMES = {"CL": "CL", "CD": "CD", "CY": "CY", "Cl": "Cell", "Cm": "Cem", "Cn": "Cen"}
_RATES = ("p", "q", "r")
_BY_ANGLE: Mapping[str, tuple[str, ...]] = dict.fromkeys(_NAMES, ("alpha", "beta")) | {"CD": ()}
_FURTHER = {"CL": ("0",), "CD": ("0", "alpha", "alpha^2", "alpha^3"), "Cm": ("0",)}
_HELD = {c: (*angles, *_RATES, *SURFACES, *_FURTHER.get(c, ())) for c, angles in _BY_ANGLE.items()}
_STALL = math.pi / 2.0  # the plugin's own default: no stall
_ALWAYS = (
    "lift, drag and moments by dynamic pressure of the whole airspeed: the plugin leaves sideways velocity out",
    "sideslip is atan2(v, u), and not asin(v / V)",
    "density: constant, that of [trim]",
    "thrust: give the model a propeller or another plugin",
)
_DEFAULT_DENSITY = 1.2041  # of the plugin


def gazebo_text(aircraft: Aircraft) -> tuple[str, tuple[str, ...]]:
    """The file, and what it does not hold, a line each. Raises InputError for aerodynamics that are not derivatives."""
    need_derivatives(aircraft, "gazebo")
    plain = in_wind_axes(absorbed(aircraft))
    a = plain.aircraft
    polar = polar_of(plain)
    span = 2.0 * a.rate_length_lateral
    chord = 2.0 * a.rate_length_pitch
    left = [*plain.left, *plain.beyond(_HELD), *([polar.note] if polar.note else []), *_ALWAYS]
    if any(plain.value("CL", term) for term in ("beta", *SURFACES)):
        left.append("drag of the lift by sideslip and surfaces, which the plugin adds to the polar")
    left += [f"thrust line {a.thrust_line_z:.4g} m below the centre of gravity"] if a.thrust_line_z else []
    root, model = sdf_model(a)
    plugin = ET.SubElement(
        model, "plugin", filename="gz-sim-advanced-lift-drag-system", name="gz::sim::systems::AdvancedLiftDrag"
    )
    aspect = span**2 / a.area
    values = {
        "CL0": plain.value("CL", "0"),
        "CD0": polar.parasitic,
        "Cem0": plain.value("Cm", "0") * _length(a, "Cm", chord),
        "alpha_stall": _STALL,
        "Cema_stall": plain.value("Cm", "alpha") * _length(a, "Cm", chord),
        "AR": aspect,
        "mac": chord,
        "eff": 1.0 / (math.pi * polar.factor * aspect) if polar.factor else 1e9,
        "area": a.area,
        "air_density": a.trim.get("rho", _DEFAULT_DENSITY),
    }
    for c, angles in _BY_ANGLE.items():
        factor = _length(a, c, chord if c == "Cm" else span)
        values |= {f"{_NAMES[c]}{angle[0]}": plain.value(c, angle) * factor for angle in angles}
        values |= {f"{_NAMES[c]}{rate}": plain.value(c, rate) * factor for rate in _RATES}
    add_texts(plugin, {name: repr(float(value)) for name, value in values.items()})
    add_texts(plugin, {"link_name": "base_link", "forward": "1 0 0", "upward": "0 0 1", "cp": "0 0 0"})
    add_texts(plugin, {"num_ctrl_surfaces": str(len(SURFACES))})
    for surface, joint in SURFACES.items():
        _surface(plugin, plain, surface, joint)
    ET.indent(root)
    return _head(a, left) + ET.tostring(root, encoding="unicode") + "\n", tuple(left)


def _length(aircraft: Aircraft, coefficient: str, own: float) -> float:
    """Factor from the length of a moment in the file to that of the plugin; 1 for forces."""
    if coefficient == "Cm":
        return aircraft.moment_length_pitch / own
    return aircraft.moment_length_lateral / own if coefficient in ("Cl", "Cn") else 1.0


def _surface(plugin: ET.Element, plain: Absorbed, surface: str, joint: str) -> None:
    a = plain.aircraft
    node = ET.SubElement(plugin, "control_surface")
    add_texts(node, {"name": joint, "index": str(list(SURFACES).index(surface)), "direction": "1"})
    for c, name in _NAMES.items():
        own = 2.0 * (a.rate_length_pitch if c == "Cm" else a.rate_length_lateral)
        per_degree = math.radians(plain.value(c, surface) * _length(a, c, own))
        ET.SubElement(node, f"{name}_ctrl").text = repr(per_degree)


def sdf_model(aircraft: Aircraft) -> tuple[ET.Element, ET.Element]:
    """The root of an SDF file and the model in it. Its link has mass and tensor in axes whose y and z are turned about,
    x forward, y left, z up."""
    root = ET.Element("sdf", version="1.9")
    model = ET.SubElement(root, "model", name="".join(ch if ch.isalnum() else "_" for ch in aircraft.name))
    inertial = ET.SubElement(ET.SubElement(model, "link", name="base_link"), "inertial")
    J = aircraft.inertia
    tensor = {"ixx": J.Ixx, "iyy": J.Iyy, "izz": J.Izz, "ixy": J.Ixy, "ixz": J.Ixz, "iyz": -J.Iyz}
    add_texts(inertial, {"mass": repr(aircraft.mass)})
    add_texts(ET.SubElement(inertial, "inertia"), {name: repr(float(value)) for name, value in tensor.items()})
    return root, model


def add_texts(node: ET.Element, texts: Mapping[str, str]) -> None:
    """Add elements of a text each to a node."""
    for name, text in texts.items():
        ET.SubElement(node, name).text = text


def _head(aircraft: Aircraft, left: list[str]) -> str:
    lines = [
        f"{aircraft.name}, written by casid for gz::sim::systems::AdvancedLiftDrag.",
        "Join your surfaces by elevator_joint, aileron_joint and rudder_joint, positive as in the file of casid.",
        "Releases of gz-sim before the fix of August 2026 lose Cem0 and Cema: the pitching moment is then wrong.",
        "Not held:",
    ]
    written = [*(f"  {in_comment(line)}\n" for line in lines), *(f"    {in_comment(line)}\n" for line in left)]
    return f'<?xml version="1.0"?>\n<!--\n{"".join(written)}-->\n'
