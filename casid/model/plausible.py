"""Numbers of an aircraft file that no aircraft has: another unit than SI, most often.

Every bound leaves room for what flies: model aircraft, gliders, transports, fighters, deltas. Of 48 vehicles that come
with JSBSim a ball (twice), a bomb and a model glider with the area of a larger one are outside; no other is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from casid.keeping import by_fields
from casid.model.aircraft import Aircraft
from casid.model.effect import Effect
from casid.model.effects import effect_of
from casid.model.vocabulary import effect_title
from casid.signals import GRAVITY


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """A number of the file that cannot be, or hardly."""

    parameter: str  # "mass", "area", "gravity", "trim rho", ..., "derivatives" of many together
    given: float  # its value in `unit`; NaN of many together
    unit: str
    sentence: str  # what is wrong with it, and what it may be

    to_dict = by_fields


# Bounds: lowest, highest. Gravity of the Earth up to 30 km.
_GRAVITY = (9.7, 9.9)
# Wing loading [N/m2]: foamy models 10 to 40, gliders 300, transports 7000, X-15 8000.
_WING_LOADING = (8.0, 12000.0)
# Wing area over the product of the lengths of moments: 0.75 to 1 of span and mean chord, twice or four times that where
# half of them are taken.
_AREA_RATIO = (0.25, 6.0)
# Radius of gyration in roll over the length of lateral moments: 0.12 to 0.19 of the span, 0.24 to 0.37 of half of it
# (Raymer, Aircraft Design, table of nondimensional radii of gyration); a quadcopter has 0.9 of its arm.
_ROLL_RADIUS = (0.06, 1.0)
# Radius of gyration in pitch over that in roll: 0.5 to 4, by the same table with bodies of 0.3 to 2.5 spans.
_PITCH_RADIUS = (0.2, 8.0)
# Lift slope per rad: pi/2 times the aspect ratio of slender wings, from 0.5 on; 2 pi of thin aerofoils, more with
# the compressibility before Mach 1, and twice that at a kink of a table.
_LIFT_SLOPE = (0.3, 20.0)
# Side force by sideslip per rad: a fuselage and a fin have 0.2 to 1.5.
_SIDE_SLOPE = (0.03, 6.0)
# Density [kg/m3]: the standard atmosphere at 32 km, and air of -60 deg C at sea level.
_DENSITY = (0.012, 1.7)
# Thrust over weight in trim: gliders have none; what is below a thousandth drags no aircraft along.
_THRUST_RATIO = (0.002, 3.0)
# Lift of the file in its trim over weight: three 1-sigmas of a file that is 30 % off.
_LIFT_RATIO = (0.33, 3.0)


def doubts(aircraft: Aircraft) -> tuple[Doubt, ...]:
    """List the values of a file that are impossible or implausible in themselves."""
    return (*_constants(aircraft), *_geometry(aircraft), *_slopes(aircraft), *_trim(aircraft))


def impossibilities(aircraft: Aircraft) -> tuple[Doubt, ...]:
    """List what no aircraft has, whatever it weighs: effects of an impossible size, an inertia of no rigid body."""
    found = []
    for one in aircraft.effects:
        effect = effect_of(one)
        sentence = f"{effect_title(*effect.key)}: {one.value:.3g} {effect.unit} in the file, which is impossible."
        if not possible(effect, one.value):
            found.append(Doubt(parameter=effect.name, given=one.value, unit=effect.unit, sentence=sentence))
    for note in aircraft.inertia.notes:
        found.append(Doubt(parameter="inertia", given=math.nan, unit="kg m2", sentence=f"The file's {note}."))
    return tuple(found)


def possible(effect: Effect, value: float) -> bool:
    """Return True if the size of an effect is within what is plausible, and no lag or width below zero."""
    return abs(value) <= effect.size.limit and not ("value" in effect.further.unsigned and value < 0.0)


def _outside(value: float, bounds: tuple[float, float]) -> bool:
    return not bounds[0] <= value <= bounds[1]


def _constants(a: Aircraft) -> Iterator[Doubt]:
    if _outside(a.gravity, _GRAVITY):
        sentence = f"gravity is {a.gravity:.4g} m/s2, which is nowhere on Earth; expected about 9.81."
        yield Doubt(parameter="gravity", given=a.gravity, unit="m/s2", sentence=sentence)
    loading = a.mass * GRAVITY / a.area
    if a.winged and _outside(loading, _WING_LOADING):
        sentence = (
            f"mass {a.mass:.4g} kg on an area of {a.area:.4g} m2 is a wing loading of {loading:.3g} N/m2, "
            f"which no aircraft has ({_WING_LOADING[0]:.0f} to {_WING_LOADING[1]:.0f}): is the mass in kg, the "
            "area in m2?"
        )
        yield Doubt(parameter="mass", given=a.mass, unit="kg", sentence=sentence)


def _geometry(a: Aircraft) -> Iterator[Doubt]:
    ratio = a.area / (a.moment_length_lateral * a.moment_length_pitch)
    if a.winged and _outside(ratio, _AREA_RATIO):
        sentence = (
            f"area {a.area:.4g} m2 is {ratio:.2g} times the product of the lengths of moments, "
            f"{a.moment_length_lateral:.3g} and {a.moment_length_pitch:.3g} m; wings have 0.75 to 4: is "
            "the area in m2, are the lengths in m?"
        )
        yield Doubt(parameter="area", given=a.area, unit="m2", sentence=sentence)
    roll = math.sqrt(a.inertia.Ixx / a.mass)
    pitch = math.sqrt(a.inertia.Iyy / a.mass)
    length = a.moment_length_lateral
    of = "a lateral length"
    if a.rotors is not None and not a.winged:
        length = max(math.hypot(*one.position[:2]) for one in a.rotors.each)
        of = "rotors at a distance"
    if _outside(pitch / roll, _PITCH_RADIUS) or (length > 0.0 and _outside(roll / length, _ROLL_RADIUS)):
        sentence = (
            f"inertia: radii of gyration of {roll:.3g} m in roll and {pitch:.3g} m in pitch do not fit "
            f"{of} of {length:.3g} m: is the inertia in kg m2, the mass in kg?"
        )
        yield Doubt(parameter="inertia", given=a.inertia.Ixx, unit="kg m2", sentence=sentence)


def _slopes(a: Aircraft) -> Iterator[Doubt]:
    """Derivatives per degree are 57 times smaller than per rad. Of files with tables, they are increments."""
    if a.tables or a.aerodynamics is not None:
        return
    for name, bounds in (("CL_alpha", _LIFT_SLOPE), ("CZ_alpha", _LIFT_SLOPE), ("CY_beta", _SIDE_SLOPE)):
        value = a.derivatives.get(name, 0.0)
        if value != 0.0 and _outside(abs(value), bounds):
            sentence = (
                f"{name} is {value:.3g} per rad; aircraft have {bounds[0]:.2g} to {bounds[1]:.2g} in size: "
                "is it per degree?"
            )
            yield Doubt(parameter=name, given=value, unit="1/rad", sentence=sentence)


def _trim(a: Aircraft) -> Iterator[Doubt]:
    rho = a.trim.get("rho")
    thrust = a.trim.get("thrust", 0.0)
    thin = False
    if rho is not None and _outside(rho, _DENSITY):
        thin = True
        sentence = (
            f"rho of [trim] is {rho:.3g} kg/m3; air has {_DENSITY[0]:.2g} to {_DENSITY[1]:.2g}: is it in slug/ft3?"
        )
        yield Doubt(parameter="trim rho", given=rho, unit="kg/m3", sentence=sentence)
    weight = a.mass * GRAVITY
    if thrust != 0.0 and _outside(abs(thrust) / weight, _THRUST_RATIO):
        sentence = f"thrust of [trim] is {thrust:.3g} N, {thrust / weight:.1g} of the weight: is it in kN?"
        yield Doubt(parameter="trim thrust", given=thrust, unit="N", sentence=sentence)
    lift = None if thin else lift_in_trim(a)
    if lift is not None and _outside(lift, _LIFT_RATIO):
        sentence = (
            f"the lift of the file in its [trim] is {lift:.2g} times the weight: look at mass, area, V, rho, "
            "alpha and the lift derivatives."
        )
        yield Doubt(parameter="trim lift", given=lift, unit="1", sentence=sentence)


def lift_in_trim(a: Aircraft) -> float | None:
    """Lift over weight in the trim of the file, None where it does not give them."""
    zero, slope, sign = ("CL_0", "CL_alpha", 1.0) if a.force_axes == "wind" else ("CZ_0", "CZ_alpha", -1.0)
    linear = not (a.tables or a.aerodynamics or a.terms.get(zero[:2])) and {zero, slope} <= a.derivatives.keys()
    if not linear or not {"V", "rho", "alpha"} <= a.trim.keys():
        return None
    by_tail = a.derivatives.get(f"{zero[:2]}_delta_e", 0.0) * a.trim.get("delta_e", 0.0)
    lift = sign * (a.derivatives[zero] + a.derivatives[slope] * a.trim["alpha"] + by_tail)
    return lift * 0.5 * a.trim["rho"] * a.trim["V"] ** 2 * a.area / (a.mass * GRAVITY)


def moment_in_trim(a: Aircraft) -> float | None:
    """Pitching moment coefficient that the file leaves in its own trim, None where it gives none."""
    linear = not (a.tables or a.aerodynamics or a.terms.get("Cm")) and {"Cm_0", "Cm_alpha"} <= a.derivatives.keys()
    if not linear or not {"V", "rho", "alpha", "delta_e", "thrust"} <= a.trim.keys():
        return None
    pressure = 0.5 * a.trim["rho"] * a.trim["V"] ** 2 * a.area * a.moment_length_pitch
    by_angles = sum(a.derivatives.get(f"Cm_{name}", 0.0) * a.trim[name] for name in ("alpha", "delta_e"))
    return a.derivatives["Cm_0"] + by_angles + a.thrust_line_z * a.trim["thrust"] / pressure


# Usual values: Raymer's table of radii of gyration with half or whole spans, aspect ratios from deltas to gliders.
_USUAL: dict[str, tuple[float, float]] = {
    "area over lengths": (0.6, 4.5),
    "aspect ratio": (0.7, 30.0),
    "roll radius": (0.1, 0.4),
    "pitch radius": (0.5, 4.5),
    "lift in trim": (0.5, 2.0),
}


def from_usual(a: Aircraft) -> dict[str, float]:
    """Return how far numbers of a file are from the usual, as logarithms; 0 within."""
    lateral = a.moment_length_lateral
    pitch = a.moment_length_pitch
    values = {
        "area over lengths": a.area / (lateral * pitch),
        "aspect ratio": lateral / pitch,
        "roll radius": math.sqrt(a.inertia.Ixx / a.mass) / lateral,
        "pitch radius": math.sqrt(a.inertia.Iyy / a.inertia.Ixx),
        "lift in trim": lift_in_trim(a),
    }
    return {
        name: max(math.log(least / value), math.log(value / most), 0.0)
        for name, (least, most) in _USUAL.items()
        if (value := values[name]) is not None and value > 0.0
    }


def believable(aircraft: Aircraft, found: tuple[Doubt, ...]) -> Aircraft:
    """The aircraft without what is in doubt and can be left out: entries of [trim], gravity."""
    names = {one.parameter for one in found}
    trim = {key: value for key, value in aircraft.trim.items() if f"trim {key}" not in names}
    gravity = GRAVITY if "gravity" in names else aircraft.gravity
    return replace(aircraft, trim=trim, gravity=gravity)
