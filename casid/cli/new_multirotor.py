"""The text of an aircraft file of a multirotor from the least that is known."""

from __future__ import annotations

import math

import tomlkit

from casid.cli.options import require_positive
from casid.errors import InputError

# of two quadrotors that are known in full (Crazyflie, Hummingbird): inertia over mass times arm squared, torque per
# thrust over the arm; a motor's time constant [s]; command in hover, from 0 to 1
_ROLL = 0.25
_YAW = 0.46
_TORQUE = 0.14
_LAG = 0.05
_HOVER = 0.5
_GRAVITY = 9.80665
# rotors of the X frames of PX4 and ArduPilot, whose logs number the motors so: angle from the front to the right [deg],
# and sign of the reaction torque about z, 1 for a propeller that turns counterclockwise from above
_FRAMES = {
    4: ((45.0, 1), (-135.0, 1), (-45.0, -1), (135.0, -1)),
    6: ((90.0, -1), (-90.0, 1), (-30.0, -1), (150.0, 1), (30.0, 1), (-150.0, -1)),
    8: ((22.5, -1), (-157.5, -1), (67.5, 1), (157.5, 1), (-22.5, 1), (-112.5, 1), (-67.5, -1), (112.5, -1)),
}


def multirotor_text(name: str, count: int, mass: float, arm: float) -> str:
    """A commented file of so many rotors on a circle, numbered as PX4 and ArduPilot number their X frames.

    Raises InputError for numbers that no multirotor has.
    """
    require_positive({"mass": mass, "arm": arm})
    if count not in _FRAMES:
        raise InputError(f"--rotors {count}: expected 4, 6 or 8; write others by hand")
    square = mass * arm**2
    inertia = f"{{ Ixx = {_ROLL * square:.4g}, Iyy = {_ROLL * square:.4g}, Izz = {_YAW * square:.4g}, Ixz = 0.0 }}"
    thrust = mass * _GRAVITY / count / _HOVER**2
    text = f"""\
# A multirotor of casid: SI units and radians. 'typical' marks a guess to be replaced.
[aircraft]
name = {tomlkit.item(name).as_string()}
mass = {mass:g} # kg
inertia = {inertia} # kg m2, typical

[rotors]
thrust = [0.0, 0.0, {thrust:.4g}] # N by powers of the command, 0 to 1: hover at half of it, typical
torque = {_TORQUE * arm:.4g} # N m of reaction per N of thrust, typical
lag = {_LAG} # s from command to thrust, typical
relative_uncertainty = 0.2 # of the effectiveness of each rotor

# the motors of an X frame as PX4 and ArduPilot number them; other firmware: move the names
"""
    for i, (degrees, spin) in enumerate(_FRAMES[count], start=1):
        x = arm * math.cos(math.radians(degrees))
        y = arm * math.sin(math.radians(degrees))
        text += f"""
[[rotors.each]]
name = "m{i}" # the input channel too
position = [{x:.4g}, {y:.4g}, 0.0] # m from the c.g.: x forward, y right, z down
spin = {spin} # sign of the reaction torque about z (down): 1 turns counterclockwise from above
"""
    return text
