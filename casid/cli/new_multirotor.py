"""The text of an aircraft file of a multirotor from the least that is known."""

from __future__ import annotations

import math

from casid.errors import InputError

# of two quadrotors that are known in full (Crazyflie, Hummingbird): inertia over mass times arm squared, torque per
# thrust over the arm; a motor's time constant [s]; command in hover, from 0 to 1
_ROLL, _YAW, _TORQUE, _LAG, _HOVER = 0.25, 0.46, 0.14, 0.05, 0.5
_GRAVITY = 9.80665


def multirotor_text(name: str, count: int, mass: float | None, arm: float | None) -> str:
    """A commented file of so many rotors on a circle, the first in front on the right, then clockwise.

    Raises InputError for numbers that are missing or that no multirotor has.
    """
    missing = [what for what, value in (("mass", mass), ("arm", arm)) if value is None]
    if missing or mass is None or arm is None:
        raise InputError(f"missing: {', '.join(f'--{what}' for what in missing)}; give them as options")
    for what, value in (("mass", mass), ("arm", arm)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"--{what} {value:g}: expected a positive number")
    if count not in (4, 6, 8):
        raise InputError(f"--rotors {count}: expected 4, 6 or 8; write others by hand")
    square = mass * arm**2
    inertia = f"{{ Ixx = {_ROLL * square:.4g}, Iyy = {_ROLL * square:.4g}, Izz = {_YAW * square:.4g}, Ixz = 0.0 }}"
    thrust = mass * _GRAVITY / count / _HOVER**2
    lines = [
        "# A multirotor of casid: SI units and radians. 'typical' marks a guess to be replaced.",
        "[aircraft]",
        f'name = "{name}"',
        f"mass = {mass:g} # kg",
        f"inertia = {inertia} # kg m2, typical",
        "",
        "[rotors]",
        f"thrust = [0.0, 0.0, {thrust:.4g}] # N by powers of the command, 0 to 1: hover at half of it, typical",
        f"torque = {_TORQUE * arm:.4g} # N m of reaction per N of thrust, typical",
        f"lag = {_LAG} # s from command to thrust, typical",
        "relative_uncertainty = 0.2 # of the effectiveness of each rotor",
    ]
    for i in range(count):
        angle = (i + 0.5) * 2.0 * math.pi / count
        x, y = arm * math.cos(angle), arm * math.sin(angle)
        lines += [
            "",
            "[[rotors.each]]",
            f'name = "m{i + 1}" # the input channel too',
            f"position = [{x:.4g}, {y:.4g}, 0.0] # m from the c.g.: x forward, y right, z down",
            f"spin = {1 if i % 2 == 0 else -1} # sign of the reaction torque about z (down)",
        ]
    return "\n".join(lines) + "\n"
