"""Causes in mass properties and propulsion."""

from __future__ import annotations

import math

from casid.model.airframe import Airframe
from casid.model.causes.aerodynamics import aero_term
from casid.model.causes.changes import in_numbers, shifted
from casid.model.causes.controls import never_sought
from casid.model.effect import Effect, Size, Symbols, Traits, cause
from casid.model.path import SignalPath, wing_loads
from casid.model.rotors import ALL

# part of the mass, which is known by the fuel left, or of an inertia, which is estimated
_MASS_MATTERS = 0.03
_INERTIA_MATTERS = 0.05
_CG_MATTERS = 0.02  # m, of an aircraft without rotors; of these the same part of their arms as of the mass


@cause(
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

    return Effect(
        forms=in_numbers(ALL, lambda one, value: {"position": shifted(one.position, axis, -value)}),
        size=Size(within="chord", meaningful=matters, limit=3.0),
        traits=Traits(balance=True, by_record=True, relative=True, shows_as=(("accelerometer_position", axis, None),)),
        station="wind",
        change=change,
    )


@cause(
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

    return Effect(station="moments", change=change, size=Size(meaningful=_CG_MATTERS, limit=3.0))


@cause(
    unit="kg",
    quantity="true minus assumed mass",
    sentence="The mass differs by {size} from that of the aircraft file.",
)
def mass() -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.mass += values["value"]

    size = Size(within="mass", meaningful=lambda aircraft: _MASS_MATTERS * aircraft.mass)
    traits = Traits(by_record=True, relative=True, balance=True)
    return Effect(size=size, station="mass", change=change, traits=traits)


@cause(
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

    size = Size(within="inertia", meaningful=matters)
    return Effect(size=size, traits=Traits(by_record=True, relative=True), station="mass", change=change)


@cause(
    unit="m",
    quantity="y at which the total thrust acts, right positive",
    sentence="The thrust acts {size} to the [right|left] of the plane of symmetry.",
)
def thrust_asymmetry() -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.moment[2] -= values["value"] * path.surface["thrust"]

    def equal(aircraft: Airframe) -> tuple[Effect, float]:
        return aero_term("Cn", "Tc"), -1.0 / aircraft.moment_length_lateral

    size = Size(within="span", meaningful=0.05, limit=20.0)
    return Effect(size=size, traits=Traits(by_record=True, equal=equal), station="moments", change=change)


@cause(
    unit="m",
    quantity="true minus assumed z of the thrust line, down positive",
    sentence="The thrust line lies {size} [lower|higher] than the aircraft file has it.",
)
def thrust_line() -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.moment[1] += values["value"] * path.surface["thrust"]

    def equal(aircraft: Airframe) -> tuple[Effect, float]:
        return aero_term("Cm", "Tc"), 1.0 / aircraft.moment_length_pitch

    size = Size(within="span", meaningful=0.05, limit=10.0)
    return Effect(size=size, traits=Traits(equal=equal), station="moments", change=change)
