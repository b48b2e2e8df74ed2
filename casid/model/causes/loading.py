"""Causes in mass properties and propulsion."""

from __future__ import annotations

import math

import numpy as np

from casid.model.airframe import Airframe
from casid.model.causes.aerodynamics import aero_term
from casid.model.causes.controls import never_sought
from casid.model.effect import Effect, Forms, Size, Symbols, Traits, cause
from casid.model.path import SignalPath, wing_loads
from casid.model.rotors import ALL, Rotors, changed

# part of the mass, which is known by the fuel left, or of an inertia, which is estimated
_MASS_MATTERS = 0.03
_INERTIA_MATTERS = 0.05
_CG_MATTERS = 0.02  # m, of an aircraft without rotors; of these the same part of their arms as of the mass


@cause(
    "cg_offset",
    targets=("x", "y", "z"),
    unit="m",
    title="{words} along {target}",
    quantity="true minus assumed position, body axes",
    sentence="The centre of gravity lies {size} along body {target} from where the aircraft file has it.",
)
def cg_offset(axis: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.cg["xyz".index(axis)] += values["value"]

    def matters(aircraft: Airframe) -> float:
        if aircraft.rotors is None:
            return _CG_MATTERS
        return _MASS_MATTERS * max(math.hypot(*one.position[:2]) for one in aircraft.rotors.each)

    def into_rotors(rotors: Rotors, weight: float, value: float) -> Rotors:
        by = value * np.eye(3)["xyz".index(axis)]
        return changed(rotors, ALL, lambda one: {"position": tuple(map(float, one.position - by))})

    return Effect(
        forms=Forms(into_rotors=into_rotors),
        size=Size(within="chord", meaningful=matters, limit=3.0),
        traits=Traits(balance=True, by_record=True, relative=True, shows_as=(("accelerometer_position", axis, None),)),
        target=axis,
        station="wind",
        change=change,
    )


@cause(
    "moment_reference",
    targets=("x",),
    # the derivatives of the moments imitate it in every record: it is found by what these have in common
    candidates=never_sought,
    unit="m",
    title="moments about another point along {target}",
    quantity="position of the point that the moments of the file are about, from the c.g., forward positive",
    sentence="The moments of the file are about a point {size} along body {target} from the centre of gravity.",
)
def moment_reference(axis: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        (_, Y, Z), _ = wing_loads(path)
        path.moment[1] -= values["value"] * Z
        path.moment[2] += values["value"] * Y

    return Effect(
        target=axis,
        station="moments",
        change=change,
        size=Size(meaningful=_CG_MATTERS, limit=3.0),
    )


@cause(
    "mass",
    unit="kg",
    quantity="true minus assumed mass",
    sentence="The mass differs by {size} from that of the aircraft file.",
)
def mass(target: str = "") -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.mass += values["value"]

    def matters(aircraft: Airframe) -> float:
        return _MASS_MATTERS * aircraft.mass

    return Effect(
        size=Size(within="mass", meaningful=matters),
        station="mass",
        change=change,
        traits=Traits(by_record=True, relative=True, balance=True),
    )


@cause(
    "inertia",
    targets=("Ixx", "Iyy", "Izz", "Ixz"),
    unit="kg m2",
    title="inertia {target}",
    quantity="true minus assumed inertia",
    sentence="The inertia {target} differs by {size} from that of the aircraft file.",
)
def inertia(component: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.inertia[component] += values["value"]

    def matters(aircraft: Airframe) -> float:
        return _INERTIA_MATTERS * getattr(aircraft.inertia, "Ixx" if component == "Ixz" else component)

    return Effect(
        size=Size(within="inertia", meaningful=matters),
        target=component,
        traits=Traits(by_record=True, relative=True),
        station="mass",
        change=change,
    )


@cause(
    "thrust_asymmetry",
    unit="m",
    quantity="y at which the total thrust acts, right positive",
    sentence="The thrust acts {size} to the [right|left] of the plane of symmetry.",
)
def thrust_asymmetry(target: str = "") -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.moment[2] -= values["value"] * path.surface["thrust"]

    return Effect(
        size=Size(within="span", meaningful=0.05, limit=20.0),
        traits=Traits(
            by_record=True, equal=lambda aircraft: (aero_term("Cn", "Tc"), -1.0 / aircraft.moment_length_lateral)
        ),
        station="moments",
        change=change,
    )


@cause(
    "thrust_line",
    unit="m",
    quantity="true minus assumed z of the thrust line, down positive",
    sentence="The thrust line lies {size} [lower|higher] than the aircraft file has it.",
)
def thrust_line(target: str = "") -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.moment[1] += values["value"] * path.surface["thrust"]

    return Effect(
        size=Size(within="span", meaningful=0.05, limit=10.0),
        station="moments",
        change=change,
        traits=Traits(equal=lambda aircraft: (aero_term("Cm", "Tc"), 1.0 / aircraft.moment_length_pitch)),
    )
