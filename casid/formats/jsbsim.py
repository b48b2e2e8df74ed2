"""A JSBSim aircraft of an aircraft file: metrics, mass balance, surfaces, and the aerodynamics as functions.

An aircraft that was read from a JSBSim file is written as that file again, see `Aircraft.write`.
"""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from casid.errors import InputError
from casid.formats.absorbed import absorbed
from casid.model.aircraft import Aircraft
from casid.model.effect_value import EffectValue
from casid.model.jsbsim.write import extended_text

_TRAVEL = 0.3491  # rad: 20 deg for a full command, of each surface
_IN_FILE = ("actuator_lag", "rate_limit", "backlash", "input_delay", "cg_offset")  # effects that components hold
_SURFACES = (
    ("elevator", "fcs/elevator-cmd-norm", "fcs/elevator-pos-rad", 1.0),
    ("left aileron", "fcs/aileron-cmd-norm", "fcs/left-aileron-pos-rad", 1.0),
    ("right aileron", "fcs/aileron-cmd-norm", "fcs/right-aileron-pos-rad", -1.0),
    ("rudder", "fcs/rudder-cmd-norm", "fcs/rudder-pos-rad", 1.0),
)


def jsbsim_text(aircraft: Aircraft) -> tuple[str, tuple[str, ...]]:
    """The file, and what it does not hold, a line each; effects that it cannot hold stand in a comment of it.

    Raises
    ------
    InputError
        For tables and own aerodynamics.
    """
    if aircraft.tables or aircraft.aerodynamics is not None:
        raise InputError(
            f"'{aircraft.name}': tables and own aerodynamics are not written as a new JSBSim file; an aircraft that "
            "was read from one is written by Aircraft.write under a name that ends in .xml"
        )
    plain = absorbed(aircraft)
    a = plain.aircraft
    span, chord = 2.0 * a.rate_length_lateral, 2.0 * a.rate_length_pitch
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
    """Whether JSBSim has no property for a variable of a term."""
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
