"""How a JSBSim aircraft file is prepared, and changed when the aircraft is to have a fault.

Everything else in the file (aerodynamics, engines, propellers, tanks) stays as JSBSim delivers it.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from casid.errors import InputError, unknown
from casid.model.terms import Term, parse_term
from problems.jsbsim.airframe import FT, LBF, RATE_HZ, SLUG_FT2, Airframe
from problems.jsbsim.manoeuvres import SURFACES

_AXES = {"LIFT": "CL", "DRAG": "CD", "SIDE": "CY", "ROLL": "Cl", "PITCH": "Cm", "YAW": "Cn"}
_STRUCTURAL = {"x": -1.0, "y": 1.0, "z": -1.0}  # body axes -> JSBSim structural axes (x aft, y right, z up)
_EARTH = """<planet name="Earth without rotation">
  <equatorial_radius unit="M">6371000.0</equatorial_radius><polar_radius unit="M">6371000.0</polar_radius>
  <rotation_rate unit="RAD/SEC">0.0</rotation_rate>
  <GM unit="M3/SEC2">{gm:.6e}</GM><J2>0.0</J2>
</planet>"""
_SLIPSTREAM = ("thrust-coefficient", "thrust-coefficient-left-right")
_READS = {
    "fcs/elevator-pos-rad": "delta_e",
    "fcs/left-aileron-pos-rad": "delta_a",
    "fcs/effective-aileron-pos": "delta_a",
    "fcs/rudder-pos-rad": "delta_r",
}
_MAGNITUDES = {"fcs/mag-elevator-pos-rad": "fcs/elevator-pos-rad", "aero/mag-beta-rad": "aero/beta-rad"}
_VARIABLES: dict[str, tuple[str, ...]] = {
    "alpha": ("aero/alpha-rad",),
    "beta": ("aero/beta-rad",),
    "mach": ("velocities/mach",),
    "p": ("aero/bi2vel", "velocities/p-aero-rad_sec"),
    "q": ("aero/ci2vel", "velocities/q-aero-rad_sec"),
    "r": ("aero/bi2vel", "velocities/r-aero-rad_sec"),
    "alphadot": ("aero/ci2vel", "aero/alphadot-rad_sec"),
    "betadot": ("aero/bi2vel", "aero/betadot-rad_sec"),
    **{surface: (f"flight/{surface}-aero",) for surface in SURFACES},
}


@dataclass(frozen=True, kw_only=True)
class Edit:
    """A change of the aircraft's file, made before it is flown; the null values change nothing.

    servo         surface -> (kind, size): lag [s], delay [s], rate limit [rad/s], dead zone [rad, half width],
                  backlash [rad, half the free play]
    term          (coefficient, monomial, size): size [1/rad^n] times a monomial as in the aircraft file
    ballast_kg    point mass at the centre of gravity
    cg_shift_m    shift of the centre of gravity along body axes [m]
    inertia_kgm2  added to Ixx, Iyy, Izz or Ixz; tensor [[Ixx, 0, -Ixz], [0, Iyy, 0], [-Ixz, 0, Izz]]
    engine_shift_m  shift of the engines along body y, z [m]
    propeller_moments  torque reaction, P-factor and gyroscopic moment of the propellers
    increments    coefficients with a property flight/increment-Cl ..., 0 unless it is written to in flight
    """

    servo: Mapping[str, tuple[str, float]] = field(default_factory=lambda: MappingProxyType({}))
    term: tuple[str, str, float] | None = None
    ballast_kg: float = 0.0
    cg_shift_m: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    inertia_kgm2: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    engine_shift_m: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    propeller_moments: bool = False
    increments: tuple[str, ...] = ()


def prepare(frame: Airframe, edit: Edit, stock: Path, folder: Path) -> None:
    """Write the prepared aircraft below `folder` (a JSBSim root), from the `stock` JSBSim root.

    Raises InputError when the stock file lacks what the edit changes.
    """
    tree = ET.parse(stock / "aircraft" / frame.model / f"{frame.model}.xml")
    root = tree.getroot()
    for tag in ("flight_control", "autopilot", "system", "output", "input"):
        for node in root.findall(tag):
            root.remove(node)
    _smooth_drag(root)
    _aerodynamics(root, edit)
    _reference_height(root)
    _mass(root, edit)
    root.append(_flight_control(edit))
    target = folder / "aircraft" / frame.model
    target.mkdir(parents=True)
    tree.write(target / f"{frame.model}.xml")
    (folder / "planet.xml").write_text(_EARTH.format(gm=9.80665 * 6371000.0**2))
    (folder / "systems").symlink_to(stock / "systems")
    (folder / "engine").mkdir()
    for file in (stock / "engine").iterdir():
        text = file.read_text()
        if file.stem in frame.torque_limit_lbft:
            limit = rf"\g<1>{frame.torque_limit_lbft[file.stem]}\g<2>"
            text = re.sub(r"(<ielumaxtorque[^>]*>)[^<]*(</ielumaxtorque>)", limit, text)
        (folder / "engine" / file.name).write_text(text)


def _smooth_drag(root: ET.Element) -> None:
    """Drag that JSBSim has as |alpha|, |beta| or |delta_e|, with a kink at zero, becomes a parabola: equal at the first
    break point of a table, at 0.26 rad of a factor."""
    drag = next(axis for axis in _child(root, "aerodynamics").findall("axis") if axis.get("name", "").strip() == "DRAG")
    for product in drag.iter("product"):
        for node in list(product):
            name = (node.text or "").strip()
            if node.tag == "property" and name in _MAGNITUDES:
                node.text = _MAGNITUDES[name]
                ET.SubElement(product, "property").text = _MAGNITUDES[name]
                ET.SubElement(product, "value").text = repr(1.0 / 0.26)
            elif node.tag == "table":
                _parabola(product, node)


def _parabola(product: ET.Element, table: ET.Element) -> None:
    """Replace a one-dimensional table that is even in alpha or beta."""
    names = [(node.text or "").strip() for node in table.findall("independentVar")]
    rows = [[float(x) for x in row.split()] for row in (table.findtext("tableData") or "").strip().splitlines()]
    if names not in (["aero/alpha-rad"], ["aero/beta-rad"]):
        return
    values = {row[0]: row[1] for row in rows}
    if 0.0 not in values or any(abs(values.get(-x, math.inf) - y) > 1e-9 for x, y in values.items()):
        return
    first = min(x for x in values if x > 0.0)
    product.remove(table)
    total = ET.SubElement(product, "sum")
    ET.SubElement(total, "value").text = repr(values[0.0])
    square = ET.SubElement(total, "product")
    for _ in range(2):
        ET.SubElement(square, "property").text = names[0]
    ET.SubElement(square, "value").text = repr((values[first] - values[0.0]) / first**2)


def _reference_height(root: ET.Element) -> None:
    """Aerodynamic reference point at the height of the centre of gravity: otherwise lift alone makes Cm ~ alpha^2."""
    reference = next(n for n in _child(root, "metrics").findall("location") if n.get("name") == "AERORP")
    _child(reference, "z").text = repr(_centre_of_gravity(root)[1]["z"])


def _aerodynamics(root: ET.Element, edit: Edit) -> None:
    """Surfaces from the servos, no alpha-dot derivatives, and the edit's further term."""
    aerodynamics = _child(root, "aerodynamics")
    for product in aerodynamics.iter("product"):
        for node in list(product.findall("property")):
            name = (node.text or "").strip()
            if name in _READS:
                node.text = f"flight/{_READS[name]}-aero"
    for node in aerodynamics.iter("independentVar"):
        if (node.text or "").strip() == "aero/Re":
            node.text = "flight/reynolds-number"
    for axis in aerodynamics.findall("axis"):
        for product in axis.iter("product"):
            if any((n.text or "").strip() == "aero/alphadot-rad_sec" for n in product.findall("property")):
                ET.SubElement(product, "value").text = "0"
        coefficient = _AXES[axis.get("name", "").strip()]
        if edit.term is not None and edit.term[0] == coefficient:
            axis.append(_term(coefficient, parse_term(edit.term[1]), edit.term[2]))
        if coefficient in edit.increments:
            axis.append(_function(coefficient, "increment", [f"flight/increment-{coefficient}"], 1.0))


def _term(coefficient: str, term: Term, size: float) -> ET.Element:
    """A JSBSim function: coefficient += size * term."""
    factors = [name for variable, power in term.factors for name in power * _variable(variable)]
    return _function(coefficient, "further", factors, size)


def _function(coefficient: str, name: str, factors: Sequence[str], size: float) -> ET.Element:
    """A JSBSim function: coefficient += size * product of the properties `factors`."""
    function = ET.Element("function", name=f"aero/coefficient/{coefficient}-{name}")
    product = ET.SubElement(function, "product")
    lengths = {"Cl": ("metrics/bw-ft",), "Cm": ("metrics/cbarw-ft",), "Cn": ("metrics/bw-ft",)}.get(coefficient, ())
    for factor in ("aero/qbar-psf", "metrics/Sw-sqft", *lengths, *factors):
        ET.SubElement(product, "property").text = factor
    ET.SubElement(product, "value").text = repr(size)
    return function


def _variable(name: str) -> tuple[str, ...]:
    """JSBSim properties whose product is a variable of the aircraft file; rates with half span, half chord over V."""
    if name not in _VARIABLES:
        raise unknown("variable of a JSBSim term", name, _VARIABLES)
    return _VARIABLES[name]


def _mass(root: ET.Element, edit: Edit) -> None:
    """Ballast, centre of gravity and inertia of the empty aircraft; position of the engines."""
    balance = _child(root, "mass_balance")
    for point in balance.iter("pointmass"):
        _child(_child(point, "location"), "y").text = "0"  # whoever sits there sits in the plane of symmetry
    total, centre = _centre_of_gravity(root)
    if edit.ballast_kg:
        point = ET.SubElement(balance, "pointmass", name="ballast")
        ET.SubElement(point, "weight", unit="LBS").text = repr(edit.ballast_kg * 9.80665 / LBF)
        location = ET.SubElement(point, "location", unit="IN")
        for axis in "xyz":
            ET.SubElement(location, axis).text = repr(centre[axis])
    empty = float(_child(balance, "emptywt").text or 0.0)
    for axis, shift in edit.cg_shift_m.items():
        _add(_child(_centre(balance), axis), _STRUCTURAL[axis] * shift / FT * 12.0 * total / empty)
    for component, change in edit.inertia_kgm2.items():
        # our products of inertia have the sign opposite to the file's default
        sign = -1.0 if component == "Ixz" else 1.0
        if balance.find(component.lower()) is None:
            ET.SubElement(balance, component.lower(), unit="SLUG*FT2").text = "0"
        _add(_child(balance, component.lower()), sign * change / SLUG_FT2)
    for thruster in root.iter("thruster"):
        for axis, shift in edit.engine_shift_m.items():
            _add(_child(_child(thruster, "location"), axis), _STRUCTURAL[axis] * shift / FT * 12.0)


def _centre(balance: ET.Element) -> ET.Element:
    return next(node for node in balance.findall("location") if node.get("name") == "CG")


def _centre_of_gravity(root: ET.Element) -> tuple[float, dict[str, float]]:
    """Weight [lbs] and centre of gravity [in, structural axes] of the loaded aircraft."""
    balance = _child(root, "mass_balance")
    parts = [(_child(balance, "emptywt"), _centre(balance))]
    parts += [(_child(point, "weight"), _child(point, "location")) for point in balance.iter("pointmass")]
    parts += [(_child(tank, "contents"), _child(tank, "location")) for tank in root.iter("tank")]
    weights = [float(weight.text or 0.0) for weight, _ in parts]
    centre = {
        axis: sum(w * float(_child(place, axis).text or 0.0) for w, (_, place) in zip(weights, parts, strict=True))
        / sum(weights)
        for axis in "xyz"
    }
    return sum(weights), centre


def _flight_control(edit: Edit) -> ET.Element:
    """Servos: surface = trim + actuator(command - trim); what the air sees is effectiveness times surface."""
    control = ET.Element("flight_control", name="servos")
    ET.SubElement(control, "property", value="0").text = "flight/reynolds-number"
    for name in _SLIPSTREAM:
        ET.SubElement(control, "property", value="0").text = f"systems/propulsion/{name}"
    for coefficient in edit.increments:
        ET.SubElement(control, "property", value="0").text = f"flight/increment-{coefficient}"
    for surface in SURFACES:
        for name, value in (("command", "0"), ("trim", "0"), ("effectiveness", "1")):
            ET.SubElement(control, "property", value=value).text = f"flight/{surface}-{name}"
        channel = ET.SubElement(control, "channel", name=surface)
        _sum(channel, f"flight/{surface}-deviation", f"flight/{surface}-command", f"-flight/{surface}-trim")
        actuator = ET.SubElement(channel, "actuator", name=f"flight/{surface}-moved")
        ET.SubElement(actuator, "input").text = f"flight/{surface}-deviation"
        if surface in edit.servo:
            actuator.append(_servo_fault(*edit.servo[surface]))
        _sum(channel, f"flight/{surface}-surface", f"flight/{surface}-moved", f"flight/{surface}-trim")
        seen = ET.SubElement(channel, "fcs_function", name=f"flight/{surface}-aero")
        product = ET.SubElement(ET.SubElement(seen, "function"), "product")
        for name in ("surface", "effectiveness"):
            ET.SubElement(product, "property").text = f"flight/{surface}-{name}"
    return control


def _servo_fault(kind: str, size: float) -> ET.Element:
    """The JSBSim actuator element that makes the fault."""
    tags = {
        "actuator_lag": ("lag", 1.0 / size),
        "input_delay": ("delay", round(size * RATE_HZ) + 1),  # JSBSim's first frame delays nothing
        "rate_limit": ("rate_limit", size),
        "dead_zone": ("deadband_width", 2.0 * size),
        "backlash": ("hysteresis_width", 2.0 * size),
    }
    if kind not in tags:
        raise unknown("servo fault", kind, tags)
    tag, value = tags[kind]
    node = ET.Element(tag, {"type": "frames"} if tag == "delay" else {})
    node.text = repr(value)
    return node


def _sum(channel: ET.Element, name: str, *inputs: str) -> None:
    node = ET.SubElement(channel, "summer", name=name)
    for text in inputs:
        ET.SubElement(node, "input").text = text


def _child(node: ET.Element, tag: str) -> ET.Element:
    child = node.find(tag)
    if child is None:
        raise InputError(f"JSBSim file: <{node.tag}> has no <{tag}>; choose another airframe for this change")
    return child


def _add(node: ET.Element, amount: float) -> None:
    node.text = repr(float(node.text or 0.0) + amount)
