"""`casid new-aircraft`: the least that an aircraft file needs, written with comments that say what to put in."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tomlkit
from rich.prompt import FloatPrompt, InvalidResponse
from rich.text import Text

from casid.cli.new_multirotor import multirotor_text
from casid.cli.options import Flag, require_positive
from casid.errors import InputError
from casid.keeping import whole_file
from casid.model.aircraft import Aircraft
from casid.model.dynamics import standard_density

GRAVITY = 9.80665
_AREA_RATIO = (0.4, 1.6)  # area over span times mean aerodynamic chord: 0.75 of a delta, 1 of a rectangle
_MOST_LIFT = 5.0  # lift coefficient; flaps reach 3 to 4
_QUESTIONS = {
    "mass": "mass in flight [kg]",
    "span": "wing span [m]",
    "chord": "mean aerodynamic chord [m]",
    "area": "wing area [m2]",
    "speed": "true airspeed of the manoeuvres [m/s]",
    "arm": "distance of each rotor from the centre [m]",
}
_WING = ("mass", "span", "chord", "area", "speed")
_SIGNS = {  # what a positive deflection does by the sign of its derivative here
    "Cm_delta_e": "typical; positive elevator: trailing edge down, nose down",
    "Cl_delta_a": "typical; positive aileron: rolls to the LEFT; change the sign if yours rolls to the right",
    "Cn_delta_r": "typical; positive rudder: trailing edge left, nose left",
}


def new_aircraft(
    target: Path,
    *,
    name: str = "my aircraft",
    mass: float | None = None,
    span: float | None = None,
    chord: float | None = None,
    area: float | None = None,
    speed: float | None = None,
    altitude: float = 0.0,
    length: float | None = None,
    rotors: int | None = None,
    arm: float | None = None,
    overwrite: Flag = False,
) -> None:
    """Write a commented aircraft file from the least that is known; asks for what is missing on a terminal.

    Inertia and derivatives are typical of conventional aircraft and marked as such; replace what you know better.

    Parameters
    ----------
    target
        The file to write, ending in .toml.
    name
        Name of the aircraft.
    mass
        Mass in flight [kg].
    span
        Wing span [m].
    chord
        Mean aerodynamic chord [m].
    area
        Wing area [m2].
    speed
        True airspeed of the manoeuvres [m/s].
    altitude
        Altitude of the manoeuvres [m].
    length
        Length of the fuselage [m]; default: the span.
    rotors
        Number of rotors of a multirotor, which has no wing; it needs the mass and the arm alone.
    arm
        Distance of each rotor from the centre [m].
    overwrite
        Replace a file that is there.
    """
    if target.suffix.lower() != ".toml":
        raise InputError(f"{target}: aircraft files are TOML; name the target so")
    if target.exists() and not overwrite:
        raise InputError(f"{target}: is there already; choose another name, or --overwrite")
    if rotors is not None:
        _write(target, multirotor_text(name, rotors, **_answered({"mass": mass, "arm": arm})))
        return
    known = _answered(dict(zip(_WING, (mass, span, chord, area, speed), strict=True)))
    if length is not None:
        known["length"] = length
    require_positive(known)
    _check_wing(known, altitude)
    _write(target, _text(name, altitude, known))
    for one in _SIGNS.values():
        print(f"  {one.removeprefix('typical; ')}")


def _write(target: Path, text: str) -> None:
    with whole_file(target) as temporary:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, encoding="utf-8")
    Aircraft.read(target)
    print(f"{target}: written; lines marked 'typical' are guesses")


def _answered(given: dict[str, float | None]) -> dict[str, float]:
    """Return what was given, and the answers to what was not."""
    missing = ", ".join(f"--{what}" for what, value in given.items() if value is None)
    if missing and not sys.stdin.isatty():
        raise InputError(f"missing: {missing}; give them as options")
    try:
        return {w: _Positive.ask(Text(_QUESTIONS[w])) if v is None else v for w, v in given.items()}
    except EOFError:
        print()
        raise InputError(
            f"the input ended before all was answered; nothing was written; give {missing} as options"
        ) from None


class _Positive(FloatPrompt):
    """Asks until the answer is a positive number."""

    def process_response(self, value: str) -> float:
        number = super().process_response(value)
        if not (math.isfinite(number) and number > 0.0):
            raise InvalidResponse("[prompt.invalid]Please enter a positive number")
        return number


def _check_wing(known: Mapping[str, float], altitude: float) -> None:
    """Raise InputError for an area that is far from span times chord, and for a lift coefficient beyond any wing."""
    mass, span, chord, area, speed = (known[what] for what in _WING)
    ratio = area / (span * chord)
    if not _AREA_RATIO[0] <= ratio <= _AREA_RATIO[1]:
        raise InputError(
            f"--area {area:g}: is {ratio:.2g} times --span {span:g} by --chord {chord:g}; wings have 0.7 to 1.1: "
            "is the area in m2, are the lengths in m?"
        )
    lift = _lift(mass, area, speed, altitude)
    if lift > _MOST_LIFT:
        raise InputError(
            f"--speed {speed:g}: level flight of --mass {mass:g} on --area {area:g} needs a lift coefficient of "
            f"{lift:.3g}; wings reach about 3: is the speed in m/s, the mass in kg, the area in m2?"
        )


def _lift(mass: float, area: float, speed: float, altitude: float) -> float:
    """Lift coefficient of level flight in the standard atmosphere."""
    return mass * GRAVITY / (0.5 * float(standard_density(np.array(altitude))) * speed**2 * area)


_FLAT = 0.8  # (Izz - larger) / smaller of roll and pitch: 0.65 Cessna 172, 0.80 Do 328, ATTAS, F-16, 0.98 Fokker 50


def inertia_of(mass: float, span: float, length: float) -> dict[str, float]:
    """Moments of inertia [kg m2] by typical radii of gyration (Raymer, Aircraft Design, table 16.1); that in yaw is
    nearly the sum of both others, as of a flat body, and so above each, however long or wide the aircraft is."""
    roll = mass * (0.25 * span / 2.0) ** 2
    pitch = mass * (0.38 * length / 2.0) ** 2
    return {"Ixx": roll, "Iyy": pitch, "Izz": max(roll, pitch) + _FLAT * min(roll, pitch), "Ixz": 0.0}


def derivatives_of(lift: float, aspect: float) -> dict[str, float]:
    """Typical derivatives per rad at a lift coefficient: lift slope after Helmbold, rolling by strip theory.

    The rest are middle values of conventional aircraft with a static margin of a fifth of the chord.
    """
    slope = 2.0 * math.pi * aspect / (2.0 + math.hypot(2.0, aspect))
    polar = 1.0 / (math.pi * 0.8 * aspect)
    return {
        "CL_0": lift,
        "CL_alpha": slope,
        "CL_delta_e": 0.3,
        "CD_0": 0.03 + polar * lift**2,
        "CD_alpha": 2.0 * polar * lift * slope,
        "CY_0": 0.0,
        "CY_beta": -0.6,
        "CY_delta_r": 0.15,
        "Cl_0": 0.0,
        "Cl_beta": -0.08,
        "Cl_p": -slope / 8.0,
        "Cl_r": lift / 4.0,
        "Cl_delta_a": -0.15,
        "Cl_delta_r": 0.01,
        "Cm_0": 0.0,
        "Cm_alpha": -0.2 * slope,
        "Cm_q": -15.0,
        "Cm_delta_e": -1.2,
        "Cn_0": 0.0,
        "Cn_beta": 0.1,
        "Cn_p": -lift / 8.0,
        "Cn_r": -0.15,
        "Cn_delta_a": 0.0,
        "Cn_delta_r": -0.08,
    }


def _text(name: str, altitude: float, known: Mapping[str, float]) -> str:
    mass, span, chord, area, speed = (known[what] for what in _WING)
    length = known.get("length", span)
    rho = float(standard_density(np.array(altitude)))
    inertia = ", ".join(f"{axis} = {_rounded(size)}" for axis, size in inertia_of(mass, span, length).items())
    derivatives = derivatives_of(_lift(mass, area, speed, altitude), span**2 / area)
    listed = "\n".join(f"{one} = {_rounded(size)} # {_SIGNS.get(one, 'typical')}" for one, size in derivatives.items())
    return f"""\
# An aircraft of casid: SI units and radians. 'typical' marks a guess to be replaced.

[aircraft]
name = {tomlkit.item(name).as_string()}
mass = {_rounded(mass)} # kg
inertia = {{{inertia}}} # kg m2, typical of a fuselage of {length:g} m; --length
gravity = {GRAVITY}

[reference]
area = {_rounded(area)} # m2
moment_length = {{lateral = {_rounded(span)}, pitch = {_rounded(chord)}}} # m: Cl = L / (qbar S span)
rate_length = {{lateral = {_rounded(0.5 * span)}, pitch = {_rounded(0.5 * chord)}}} # m: p* = p lateral / V

[sensors]
accelerometer = [0.0, 0.0, 0.0] # m from the centre of gravity; x forward, z down
alpha_vane = [0.0, 0.0, 0.0] # m from the centre of gravity; x forward, z down
beta_vane = [0.0, 0.0, 0.0] # m from the centre of gravity; x forward, z down

[trim]
V = {_rounded(speed)} # m/s
altitude = {_rounded(altitude)} # m
rho = {_rounded(rho)} # kg/m3

[aerodynamics]
force_axes = "wind" # wind: CL CD CY; body: CX CZ CY
relative_uncertainty = 0.5 # 1-sigma of every derivative, as a fraction of it; 0: no prior

[aerodynamics.derivatives]
{listed}
"""


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")
