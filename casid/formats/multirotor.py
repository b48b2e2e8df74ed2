"""Multirotors for other simulators: gz-sim's motor model (PX4), a frame of ArduPilot's SITL, RotorPy, and a table.

A motor constant is thrust over the square of a speed; a rotor whose input is no speed has none, and is refused where
the target wants it.
"""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.formats.absorbed import absorbed
from casid.formats.file_tables import in_comment
from casid.formats.gazebo import add_texts, sdf_model
from casid.model.aircraft import Aircraft
from casid.model.rotors import Rotor, Rotors, hover_thrusts

_FLIP = np.diag([1.0, -1.0, -1.0])  # between forward-right-down and forward-left-up
_FASTEST = 2.0  # of the speed in hover, where a target wants a limit that no file of casid has
Made = tuple[str, tuple[str, ...]]


def in_numbers(aircraft: Aircraft, to: str) -> tuple[Aircraft, Rotors, list[str]]:
    """An aircraft without a wing, its rotors, and what of its effects these numbers do not hold. Raises InputError for
    any other aircraft."""
    if aircraft.rotors is None or aircraft.winged:
        raise InputError(f"'{aircraft.name}': {to} is for an aircraft with rotors and without a wing")
    plain = absorbed(aircraft)
    assert plain.aircraft.rotors is not None
    return plain.aircraft, plain.aircraft.rotors, list(plain.left)


def motor_constant(rotor: Rotor, to: str) -> float:
    """Thrust over the square of the speed [N s2/rad2]. Raises InputError for a rotor whose input is no speed."""
    if not rotor.speed:
        raise InputError(
            f"rotor '{rotor.name}': {to} wants a motor constant; give thrust = {{ coefficient = ... }} and the speed "
            "[rad/s] as input"
        )
    return rotor.effectiveness * rotor.thrust[2]


def _left_of(rotors: Rotors, *, lag: bool, air: bool = False) -> list[str]:
    """List what a target does not hold of the rotors; some hold a `lag`, or forces of the `air`."""
    lost = {
        "lag of the rotors": not lag and any(one.lag for one in rotors.each),
        "delay of the rotors": any(one.delay for one in rotors.each),
        "drag of the rotors": not air and any(rotors.drag),
        "loss of thrust with axial speed": not air and rotors.inflow,
        "thrust by the voltage of the battery": rotors.voltage,
    }
    return [what for what, is_lost in lost.items() if is_lost]


def _hover(aircraft: Aircraft, rotors: Rotors) -> float:
    """Largest speed of a rotor in hover with equal thrusts [rad/s]."""
    shares = hover_thrusts(rotors, aircraft.mass * aircraft.gravity)
    return max(one.input_for(shares[one.name]) for one in rotors.each)


def exponent(rotor: Rotor, hover: float) -> float:
    """The share e of the square in (1 - e) u + e u^2, u from 0 to 1, whose relative slope at a thrust `hover` [N] is
    that of the rotor: MOT_THST_EXPO of ArduPilot, THR_MDL_FAC of PX4. Raises InputError where no input hovers."""
    u = rotor.input_for(hover)
    power = u * float(rotor.curve.deriv()(u)) / hover
    return (power - 1.0) / ((power - 1.0) + u * (2.0 - power))


def gazebo_rotors_text(aircraft: Aircraft) -> Made:
    """An SDF model with one gz-sim MulticopterMotorModel for each rotor, and what it does not hold. Raises InputError
    for a wing, and a rotor whose input is no speed."""
    aircraft, rotors, left = in_numbers(aircraft, "gazebo")
    left += _left_of(rotors, lag=True)
    root, model = sdf_model(aircraft)
    fastest = _FASTEST * _hover(aircraft, rotors)
    for number, one in enumerate(rotors.each):
        place = " ".join(repr(float(x)) for x in _FLIP @ np.array(one.position))
        rotor = ET.SubElement(model, "link", name=f"rotor_{number}")
        add_texts(rotor, {"pose": f"{place} 0 0 0"})
        joint = ET.SubElement(model, "joint", name=f"rotor_{number}_joint", type="revolute")
        add_texts(joint, {"parent": "base_link", "child": f"rotor_{number}"})
        add_texts(ET.SubElement(joint, "axis"), {"xyz": "0 0 1"})
        plugin = ET.SubElement(
            model,
            "plugin",
            filename="gz-sim-multicopter-motor-model-system",
            name="gz::sim::systems::MulticopterMotorModel",
        )
        values = {
            "jointName": f"rotor_{number}_joint",
            "linkName": f"rotor_{number}",
            "turningDirection": "ccw" if one.spin > 0.0 else "cw",
            "timeConstantUp": repr(one.lag),
            "timeConstantDown": repr(one.lag),
            "maxRotVelocity": repr(fastest),
            "motorConstant": repr(motor_constant(one, "gazebo")),
            "momentConstant": repr(one.torque),
            "commandSubTopic": "command/motor_speed",
            "motorNumber": str(number),
            "rotorDragCoefficient": "0",
            "rollingMomentCoefficient": "0",
            "motorType": "velocity",
        }
        add_texts(plugin, values)
    left.append("the largest speed, here twice that of hover")
    ET.indent(root)
    head = [f"{aircraft.name}, written by casid for gz::sim::systems::MulticopterMotorModel. Not held:", *left]
    comment = "".join(f"  {in_comment(line)}\n" for line in head)
    return f"<!--\n{comment}-->\n{ET.tostring(root, encoding='unicode')}\n", tuple(left)


def ardupilot_frame_text(aircraft: Aircraft) -> Made:
    """A frame of ArduPilot's SITL (`--model quad:FILE`), and what it does not hold. Raises InputError for a wing, and
    for thrust that no share of the largest gives."""
    aircraft, rotors, effects = in_numbers(aircraft, "ardupilot-json")
    arms = [math.hypot(*one.position[:2]) for one in rotors.each]
    J = aircraft.inertia
    document: dict[str, Any] = {
        "mass": aircraft.mass,
        "diagonal_size": 2.0 * max(arms),
        "moment_inertia": [J.Ixx, J.Iyy, J.Izz],
        "num_motors": len(rotors.each),
    }
    for number, one in enumerate(rotors.each, start=1):
        document[f"motor{number}_position"] = [float(x) for x in one.position]
        document[f"motor{number}_vector"] = [float(x) for x in one.axis]
        document[f"motor{number}_yaw"] = one.spin
    left = [*effects, *_left_of(rotors, lag=False)]
    hover = _hover(aircraft, rotors)
    if hover < 1.0 and not any(one.speed for one in rotors.each):
        shares = hover_thrusts(rotors, aircraft.mass * aircraft.gravity)
        document["hoverThrOut"] = hover
        document["propExpo"] = float(np.mean([exponent(one, shares[one.name]) for one in rotors.each]))
        left += ["thrust curve of each rotor: propExpo, as MOT_THST_EXPO, has the relative slope at hover for all"]
    else:
        left += ["thrust curve: the input of the rotors is no command from 0 to 1"]
    left += ["torque of each rotor: the frame has refRotRate for all"]
    if any(one.effectiveness != rotors.each[0].effectiveness for one in rotors.each):
        left.append("differences of effectiveness between the rotors")
    return json.dumps(document, indent=1) + "\n", tuple(left)


def rotorpy_text(aircraft: Aircraft) -> Made:
    """A module with `quad_params` of RotorPy, and what it does not hold. Raises InputError for a wing, and a rotor
    whose input is no speed."""
    aircraft, rotors, left = in_numbers(aircraft, "rotorpy")
    constants = [motor_constant(one, "rotorpy") for one in rotors.each]
    mean = float(np.mean(constants))
    hover = _hover(aircraft, rotors)
    J = aircraft.inertia
    whole = hover * len(rotors.each)
    parameters: dict[str, Any] = {
        "mass": aircraft.mass,
        **{"Ixx": J.Ixx, "Iyy": J.Iyy, "Izz": J.Izz, "Ixy": J.Ixy, "Iyz": -J.Iyz, "Ixz": J.Ixz},
        "num_rotors": len(rotors.each),
        "rotor_pos": {
            f"r{i}": [float(x) for x in _FLIP @ np.array(one.position)] for i, one in enumerate(rotors.each, 1)
        },
        "rotor_directions": [-one.spin for one in rotors.each],
        "rI": [0.0, 0.0, 0.0],
        **{"c_Dx": 0.0, "c_Dy": 0.0, "c_Dz": 0.0},
        "k_eta": mean,
        "k_m": mean * float(np.mean([one.torque for one in rotors.each])),
        "k_d": 0.5 * (rotors.drag[0] + rotors.drag[1]) / whole,
        "k_z": rotors.drag[2] / whole + rotors.inflow * mean * hover,
        **{"k_h": 0.0, "k_flap": 0.0},
        "tau_m": float(np.mean([one.lag for one in rotors.each])),
        **{"rotor_speed_min": 0.0, "rotor_speed_max": _FASTEST * hover, "motor_noise_std": 0.0},
    }
    left += _left_of(rotors, lag=True, air=True)
    if len(set(constants)) > 1:
        left.append("differences of effectiveness between the rotors: k_eta is their mean")
    left.append("the largest speed, here twice that of hover")
    rows = "".join(f"    {name!r}: {_as_python(value)},\n" for name, value in parameters.items())
    notes = "".join(f"# not held: {' '.join(line.split())}\n" for line in left)
    head = f"# Parameters of RotorPy, written by casid.\n{notes}import numpy as np\n\n"
    return f"{head}quad_params = {{\n{rows}}}\n", tuple(left)


def _as_python(value: Any) -> str:
    if isinstance(value, list):
        return f"np.array({value!r})"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name!r}: {_as_python(one)}" for name, one in value.items()) + "}"
    return repr(value)


def table_text(aircraft: Aircraft) -> Made:
    """A table of parameters as environments for learning want them, and what it does not hold: mass, arm, inertia,
    thrust and torque per square of a speed, largest thrust over weight. Raises InputError for a wing, and an input that
    is no speed."""
    aircraft, rotors, left = in_numbers(aircraft, "gym-json")
    constants = [motor_constant(one, "gym-json") for one in rotors.each]
    J = aircraft.inertia
    mean = float(np.mean(constants))
    document = {
        "m": aircraft.mass,
        "l": float(np.mean([math.hypot(*one.position[:2]) for one in rotors.each])),
        **{"ixx": J.Ixx, "iyy": J.Iyy, "izz": J.Izz},
        "kf": mean,
        "km": mean * float(np.mean([one.torque for one in rotors.each])),
        "kf_each": constants,
        "tau": float(np.mean([one.lag for one in rotors.each])),
        "thrust2weight": _FASTEST**2,
        "gravity": aircraft.gravity,
    }
    left += [*_left_of(rotors, lag=True), "the largest speed, here twice that of hover"]
    return json.dumps(document, indent=1) + "\n", tuple(left)


MULTIROTOR: Mapping[str, Callable[[Aircraft], Made]] = {
    "gazebo": gazebo_rotors_text,
    "ardupilot-json": ardupilot_frame_text,
}
