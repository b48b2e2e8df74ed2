"""JSBSim files of an aircraft: the user's own file, extended by what flight has shown, or a new one.

Derivatives and terms become functions of the aerodynamics. Lags and limits of a surface become components behind the
one that writes it. Mass and inertia are numbers of the mass balance. What a JSBSim file cannot hold becomes a comment.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from xml.sax.saxutils import quoteattr

from casid.errors import InputError
from casid.formats.absorbed import RATE_OF, absorbed, add_term
from casid.formats.file_tables import FileTable, blanked, comment, holding, said
from casid.formats.jsbsim.aerodynamics import LIFT_SQUARED, reference_point
from casid.formats.jsbsim.aircraft import mass_properties
from casid.formats.jsbsim.functions import with_changed_table
from casid.formats.jsbsim.source import LBS_PER_SLUG, amount, body_arm, number_of, part, size_of_unit
from casid.model.aircraft import Aircraft
from casid.model.effect_value import EffectValue
from casid.model.terms import Stretch, bare, is_magnitude, parse_term
from casid.signals import FOOT, SLUG

_PROPERTIES: Mapping[str, tuple[str, ...]] = {
    "alpha": ("aero/alpha-rad",),
    "beta": ("aero/beta-rad",),
    "mach": ("velocities/mach",),
    "p": ("aero/bi2vel", "velocities/p-aero-rad_sec"),
    "q": ("aero/ci2vel", "velocities/q-aero-rad_sec"),
    "r": ("aero/bi2vel", "velocities/r-aero-rad_sec"),
    "alphadot": ("aero/ci2vel", "aero/alphadot-rad_sec"),
    "betadot": ("aero/bi2vel", "aero/betadot-rad_sec"),
    "delta_e": ("fcs/elevator-pos-rad",),
    "delta_a": ("fcs/left-aileron-pos-rad",),
    "delta_r": ("fcs/rudder-pos-rad",),
}
_WRITTEN = {
    "delta_e": ("fcs/elevator-pos-rad",),
    "delta_a": ("fcs/left-aileron-pos-rad", "fcs/right-aileron-pos-rad"),
    "delta_r": ("fcs/rudder-pos-rad",),
}
_FORCE_AXES = {"DRAG": ("DRAG", "SIDE", "LIFT"), "AXIAL": ("AXIAL", "SIDE", "NORMAL"), "X": ("X", "Y", "Z")}
_ZERO = "<value>0</value>"


def extended_text(
    text: str,
    terms: Mapping[str, Mapping[str, float]],
    effects: Sequence[EffectValue],
    axes: str,
    tables: Sequence[FileTable] = (),
) -> str:
    """The text of a file with increments of coefficients (`terms`: coefficient -> monomial -> value, force `axes` about
    the c.g.), effects, and wrong stretches of its `tables` corrected. InputError when its aerodynamics or mass balance
    are elsewhere."""
    root = ET.fromstring(text)
    for tag in ("aerodynamics", "mass_balance"):
        if part(root, tag).get("file"):
            raise InputError(f"<{tag}> is in a file of its own, '{part(root, tag).get('file')}'; put it into this one")
    total = {c: dict(row) for c, row in terms.items()}
    left: list[str] = []
    for effect in effects:
        if effect.records or effect.onset_s:
            left.append(said(effect, "is not in all records, or not always"))
        elif held := holding(tables, effect):
            text = with_changed_table(text, blanked(text), held, effect.term or "", effect.value)
        elif effect.kind in ("aero_term", "table_increment") and effect.term:
            add_term(total, effect.target, parse_term(effect.term).name, effect.value)
        elif effect.kind == "unsteady_aero" and not effect.parameters:
            add_term(total, effect.target, RATE_OF.get(effect.target, "alphadot"), effect.value)
        elif effect.kind in _COMPONENTS:
            text = _with_component(text, effect, left)
        elif effect.kind in ("mass", "cg_offset", "inertia"):
            text = _with_mass(text, root, effect)
        else:
            left.append(said(effect, "has no place in a JSBSim file"))
    for coefficient, row in total.items():
        for term in [t for t in row if _factors(t) is None]:
            left.append(f"{coefficient}: {row.pop(term):.6g} times {term}, of which JSBSim has no property")
    total = {c: kept for c, row in total.items() if (kept := {t: v for t, v in row.items() if v != 0.0})}
    if total:
        text = _with_functions(text, root, total, axes)
    if left:
        text = _before(text, "</aerodynamics>", comment(left) + "  ")
    ET.fromstring(text)
    return text


def _factors(term: str) -> list[str] | None:
    """Properties and tables whose product is the term; None when there is none for a variable."""
    names: list[str] = []
    for variable, power in parse_term(term).factors:
        if bare(variable) not in _PROPERTIES:
            return None
        own = [_property(name) for name in _PROPERTIES[bare(variable)]]
        names += [f"<abs>{name}</abs>" for name in own] if is_magnitude(variable) else own * power
    for one in parse_term(term).stretches:
        if len(_PROPERTIES.get(one.variable, ())) != 1:
            return None
        names.append(_stretch(one, *_PROPERTIES[one.variable]))
    return names


def _stretch(one: Stretch, name: str) -> str:
    """A stretch as a table, which JSBSim holds at its ends."""
    shares = zip(one.corners, (0.0, 1.0, 1.0, 0.0), strict=True)
    rows = dict(pair for pair in shares if math.isfinite(pair[0]))
    data = " ".join(f"{x!r} {share!r}\n" for x, share in rows.items())
    return f'<table><independentVar lookup="row">{name}</independentVar><tableData>\n{data}</tableData></table>'


# text: positions are found with comments blanked, so that their content is left alone


def _before(text: str, tag: str, insertion: str, start: int = 0) -> str:
    """Insertion before the tag, after `start`, at the beginning of its line when nothing else is there."""
    at = blanked(text).index(tag, start)
    line = text.rfind("\n", 0, at) + 1
    at = line if not text[line:at].strip() else at
    return text[:at] + insertion + text[at:]


def _property(name: str) -> str:
    return f"<property>{name}</property>"


def _product(*parts: str) -> str:
    return f"<product>{''.join(parts)}</product>"


def _function(name: str, body: str) -> str:
    return f'    <function name="casid/{name}">{body}</function>\n'


def _increment(row: Mapping[str, float]) -> str:
    """The sum of terms times values."""
    products = []
    for term, value in row.items():
        factors = _factors(term) or []
        products.append(_product(f"<value>{value!r}</value>", *factors) if factors else f"<value>{value!r}</value>")
    return products[0] if len(products) == 1 else f"<sum>{''.join(products)}</sum>"


def _with_functions(text: str, root: ET.Element, total: Mapping[str, Mapping[str, float]], axes: str) -> str:
    """Increments about the centre of gravity as functions, and what each axis of the file makes of them. JSBSim takes
    forces to act at its reference point, whose moment is taken off again."""
    aerodynamics = part(root, "aerodynamics")
    has = {axis.get("name", "").strip() for axis in aerodynamics.findall("axis")}
    names = next((n for first, n in _FORCE_AXES.items() if {first, n[2]} & has), _FORCE_AXES["DRAG"])
    given = {c: _increment(row) for c, row in total.items()}
    sin, cos = (f"<{f}>{_property('aero/alpha-rad')}</{f}>" for f in ("sin", "cos"))
    lines = [_function(f"d{c}", f"<sum>{body}{_ZERO}</sum>") for c, body in given.items()]
    known = {c: _property(f"casid/d{c}") for c in given}
    lift, drag = (known.get(c, _ZERO) for c in ("CL", "CD"))
    if axes == "wind" and {"CL", "CD"} & given.keys():
        x = f"<difference>{_product(lift, sin)}{_product(drag, cos)}</difference>"
        z = f"<difference>{_product('<value>-1</value>', lift, cos)}{_product(drag, sin)}</difference>"
        lines += [_function("dCX", x), _function("dCZ", z)]
        known |= {"CX": _property("casid/dCX"), "CZ": _property("casid/dCZ")}
    if "CL" in given and LIFT_SQUARED in blanked(text):
        text = _before_increments(text)
        root_of_lift = f"<sqrt>{_property(LIFT_SQUARED)}</sqrt>"
        before = f"<difference>{root_of_lift}{lift}</difference>"
        lines.append(_function("cl-squared", f"<pow>{before}<value>2</value></pow>"))
    pressure = _property("aero/qbar-psf") + _property("metrics/Sw-sqft")
    per_axis = {**_forces(names, known), **_moments(root, known)}
    for axis, body in per_axis.items():
        text = _into_axis(text, axis, f"  {_function(axis.lower(), _product(pressure, body))}")
    return _before(text, "<axis", "".join(lines), _aerodynamics_begin(text))


def _before_increments(text: str) -> str:
    """The text whose own functions see the lift (of an aircraft that is carried by it) without the increments."""
    blank = blanked(text)
    for found in reversed(list(re.finditer(re.escape(LIFT_SQUARED), blank))):
        if found.start() > _aerodynamics_begin(text) and found.end() < blank.index("</aerodynamics>"):
            text = text[: found.start()] + "casid/cl-squared" + text[found.end() :]
    return text


def _aerodynamics_begin(text: str) -> int:
    """Return the position at which the aerodynamics begin."""
    return blanked(text).index("<aerodynamics")


def _forces(names: tuple[str, ...], known: Mapping[str, str]) -> dict[str, str]:
    """Axis -> what it adds, from body or stability axes to those of the file."""
    side, x, z = (known.get(c, _ZERO) for c in ("CY", "CX", "CZ"))
    if not {"CY", "CX", "CZ"} & known.keys():
        return {}
    if names[0] != "DRAG":
        sign = "<value>-1</value>" if names[0] == "AXIAL" else "<value>1</value>"
        return {names[0]: _product(sign, x), names[1]: side, names[2]: _product(sign, z)}
    alpha = _property("aero/alpha-rad")
    beta = _property("aero/beta-rad")
    (sa, ca), (sb, cb) = ((f"<sin>{a}</sin>", f"<cos>{a}</cos>") for a in (alpha, beta))
    minus = "<value>-1</value>"
    if "CD" in known or "CL" in known:
        drag = known.get("CD", _ZERO)
        lift = known.get("CL", _ZERO)
    else:
        drag = f"<sum>{_product(minus, x, ca)}{_product(minus, z, sa)}</sum>"
        lift = f"<difference>{_product(x, sa)}{_product(z, ca)}</difference>"
    return {
        "DRAG": f"<difference>{_product(drag, cb)}{_product(side, sb)}</difference>",
        "SIDE": f"<sum>{_product(drag, sb)}{_product(side, cb)}</sum>",
        "LIFT": _product(lift, "<value>1</value>"),
    }


def _moments(root: ET.Element, known: Mapping[str, str]) -> dict[str, str]:
    """Axis -> what it adds, without the moment of the forces' increments about the centre of gravity."""
    fx, fy, fz = (known.get(c, _ZERO) for c in ("CX", "CY", "CZ"))
    dx, dy, dz = (float(v) for v in body_arm(reference_point(root), mass_properties(root).cg))
    made = {
        "ROLL": ("Cl", "metrics/bw-ft", ((-dy, fz), (dz, fy))),
        "PITCH": ("Cm", "metrics/cbarw-ft", ((-dz, fx), (dx, fz))),
        "YAW": ("Cn", "metrics/bw-ft", ((-dx, fy), (dy, fx))),
    }
    found = {}
    for axis, (coefficient, length, arms) in made.items():
        parts = [_product(_property(length), known[coefficient])] if coefficient in known else []
        parts += [_product(f"<value>{arm!r}</value>", force) for arm, force in arms if force != _ZERO and arm]
        if parts:
            found[axis] = parts[0] if len(parts) == 1 else f"<sum>{''.join(parts)}</sum>"
    return found


def _into_axis(text: str, axis: str, function: str) -> str:
    found = re.search(rf'<axis\b[^>]*name\s*=\s*"\s*{axis}\s*"[^>]*>', blanked(text))
    if found is None:
        return _before(
            text, "</aerodynamics>", f'    <axis name="{axis}">\n{function}    </axis>\n', _aerodynamics_begin(text)
        )
    return _before(text, "</axis>", function, found.end())


_COMPONENTS = {
    "actuator_lag": lambda value: f"<lag> {1.0 / value!r} </lag>",
    "rate_limit": lambda value: f"<rate_limit> {value!r} </rate_limit>",
    "backlash": lambda value: f"<hysteresis_width> {2.0 * value!r} </hysteresis_width>",
    "input_delay": lambda value: f'<delay type="time"> {value!r} </delay>',
}


def _with_component(text: str, effect: EffectValue, left: list[str]) -> str:
    """An actuator behind the component that writes a surface."""
    if effect.value <= 0.0:
        left.append(said(effect, "is not of a size that an actuator can have"))
        return text
    for written in _WRITTEN.get(effect.target, ()):
        blank = blanked(text)
        found = re.search(rf"<output>\s*({re.escape(written)})\s*</output>", blank)
        named = re.search(rf'<(\w+)\b[^>]*\bname\s*=\s*"({re.escape(written)})"', blank)
        if found is None and named is None:
            if written == _WRITTEN[effect.target][0]:
                left.append(said(effect, f"acts behind {written}, which no component of this file writes"))
            continue
        own = f"casid/{written.rsplit('/', 1)[-1]}-{effect.kind.replace('_', '-')}"
        tag = _component_around(blank, found.start()) if found else (named or [""])[1]
        inside = found or named
        assert inside is not None
        begin, finish = inside.span(1 if found else 2)
        end = blank.index(f"</{tag}>", finish) + len(tag) + 3
        actuator = (
            f'\n        <actuator name="{own}-actuator">\n          <input> {own} </input>\n'
            f"          {_COMPONENTS[effect.kind](effect.value)}\n"
            f"          <output> {written} </output>\n        </actuator>"
        )
        text = text[:begin] + own + text[finish:end] + actuator + text[end:]
    return text


def _component_around(text: str, at: int) -> str:
    """Tag of the innermost named element that is open at a position."""
    named = [m for m in re.finditer(r"<(\w+)\b[^>]*\bname\s*=[^>]*>", text[:at])]
    return next(m[1] for m in reversed(named) if f"</{m[1]}>" not in text[m.end() : at])


def _with_mass(text: str, root: ET.Element, effect: EffectValue) -> str:
    balance = part(root, "mass_balance")
    mass = mass_properties(root)
    if effect.kind == "mass":
        x, y, z = (float(v) * 12.0 for v in mass.cg)
        weight = effect.value / SLUG * LBS_PER_SLUG
        point = (
            f'    <pointmass name="casid-mass">\n      <weight unit="LBS"> {weight!r} </weight>\n'
            f'      <location unit="IN"> <x> {x!r} </x> <y> {y!r} </y> <z> {z!r} </z> </location>\n    </pointmass>\n'
        )
        return _before(text, "</mass_balance>", point)
    if effect.kind == "inertia":
        # the file's product of inertia is negated unless it states that it is not
        negated = balance.get("negated_crossproduct_inertia", "true").lower() in ("true", "1", "yes")
        sign = -1.0 if effect.target == "Ixz" and negated else 1.0
        tag = effect.target.lower()
        change = sign * effect.value / (SLUG * FOOT**2)
        if balance.find(tag) is None:
            return _before(text, "<emptywt", f'    <{tag} unit="SLUG*FT2"> {change!r} </{tag}>\n')
        return _changed(text, balance, tag, change, "SLUG*FT2")
    empty = amount(part(balance, "emptywt"), "LBS")
    sign = {"x": -1.0, "y": 1.0, "z": -1.0}[effect.target]  # of structural axes
    shift = sign * effect.value / FOOT * mass.weight / empty
    found = re.search(r'<location\b[^>]*name\s*=\s*"CG"[^>]*>', blanked(text))
    location = next(n for n in balance.findall("location") if n.get("name") == "CG")
    if found is None:
        raise InputError("<mass_balance> has no location CG")
    return _changed(text, location, effect.target, shift, location.get("unit", "IN"), found.end())


def _changed(text: str, parent: ET.Element, tag: str, change: float, unit: str, start: int | None = None) -> str:
    """The text with a number of the file changed by so much in feet, pounds or slug ft2."""
    node = part(parent, tag)
    size = size_of_unit(node, unit)
    begin = blanked(text).index("<mass_balance") if start is None else start
    found = re.compile(rf"(<{tag}\b[^>]*>)([^<]*)(</{tag}>)").search(blanked(text), begin)
    if found is None:
        raise InputError(f"<{tag}> is missing; add it")
    value = number_of(node.text, tag) + change / size
    return text[: found.start(2)] + f" {value!r} " + text[found.end(2) :]


_TRAVEL = 0.3491  # rad: 20 deg for a full command, of each surface
_IN_FILE = ("actuator_lag", "rate_limit", "backlash", "input_delay", "cg_offset")  # effects that components hold
_SURFACES = (
    ("elevator", "fcs/elevator-cmd-norm", "fcs/elevator-pos-rad", 1.0),
    ("left aileron", "fcs/aileron-cmd-norm", "fcs/left-aileron-pos-rad", 1.0),
    ("right aileron", "fcs/aileron-cmd-norm", "fcs/right-aileron-pos-rad", -1.0),
    ("rudder", "fcs/rudder-cmd-norm", "fcs/rudder-pos-rad", 1.0),
)


def jsbsim_text(aircraft: Aircraft) -> tuple[str, tuple[str, ...]]:
    """The file, and what it does not hold, a line each, effects in a comment of it. Raises InputError for tables and
    own aerodynamics."""
    if aircraft.tables or aircraft.aerodynamics is not None:
        raise InputError(
            f"'{aircraft.name}': tables and own aerodynamics are not written as a new JSBSim file; an aircraft that "
            "was read from one is written by Aircraft.write under a name that ends in .xml"
        )
    plain = absorbed(aircraft)
    a = plain.aircraft
    span = 2.0 * a.rate_length_lateral
    chord = 2.0 * a.rate_length_pitch
    factor = {"Cl": a.moment_length_lateral / span, "Cn": a.moment_length_lateral / span}
    factor["Cm"] = a.moment_length_pitch / chord
    rows = {c: {t: v * factor.get(c, 1.0) for t, v in row.items()} for c, row in plain.rows.items()}
    taken = [e for e in aircraft.effects if e.kind in _IN_FILE and not e.records and not e.onset_s]
    others = [e for e in aircraft.effects if e not in taken and not _absorbed(e)]
    text = extended_text(_skeleton(a, span, chord), rows, [*taken, *others], a.force_axes)
    left = [f"{c}: {v:.6g} times {t}" for c, row in rows.items() for t, v in row.items() if _foreign(t)]
    left += [line for line in plain.left if not line.startswith(_IN_FILE)]
    left += ["thrust: give the aircraft an engine"]
    left += [f"thrust line {a.thrust_line_z:.4g} m below the centre of gravity"] if a.thrust_line_z else []
    return text, tuple(left)


def _absorbed(effect: EffectValue) -> bool:
    always = not effect.records and not effect.onset_s
    steady = effect.kind == "unsteady_aero" and not effect.parameters
    return always and (effect.kind in ("aero_term", "mass", "inertia") or steady)


def _foreign(term: str) -> bool:
    """Return True if JSBSim has no property for a variable of a term."""
    return any(name in term.replace("^", "*").split("*") for name in ("V", "Tc"))


def _skeleton(a: Aircraft, span: float, chord: float) -> str:
    """A file of the aircraft without aerodynamics; all places are the centre of gravity."""
    J = a.inertia
    tensor = {"ixx": J.Ixx, "iyy": J.Iyy, "izz": J.Izz, "ixy": J.Ixy, "ixz": -J.Ixz, "iyz": J.Iyz}
    balance = "".join(f'    <{name} unit="KG*M2"> {value!r} </{name}>\n' for name, value in tensor.items())
    axes = ("DRAG", "SIDE", "LIFT") if a.force_axes == "wind" else ("X", "Y", "Z")
    channels = "".join(_component(*one) for one in _SURFACES)
    return f"""<?xml version="1.0"?>
<fdm_config name={quoteattr(a.name)} version="2.0" release="BETA">
  <fileheader> <author> casid </author> </fileheader>
  <metrics>
    <wingarea unit="M2"> {a.area!r} </wingarea>
    <wingspan unit="M"> {span!r} </wingspan>
    <chord unit="M"> {chord!r} </chord>
    <location name="AERORP" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
    <location name="EYEPOINT" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
    <location name="VRP" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
  </metrics>
  <mass_balance>
{balance}    <emptywt unit="KG"> {a.mass!r} </emptywt>
    <location name="CG" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
  </mass_balance>
  <ground_reactions/>
  <propulsion/>
  <flight_control name="surfaces">
    <channel name="surfaces">
{channels}    </channel>
  </flight_control>
  <aerodynamics>
{"".join(f'    <axis name="{axis}"> </axis>{chr(10)}' for axis in (*axes, "ROLL", "PITCH", "YAW"))}  </aerodynamics>
</fdm_config>
"""


def _component(name: str, command: str, written: str, sign: float) -> str:
    return f"""      <pure_gain name="{name}">
        <input> {command} </input>
        <gain> {sign * _TRAVEL!r} </gain>
        <output> {written} </output>
      </pure_gain>
"""
