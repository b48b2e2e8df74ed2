"""Causes between the input of a rotor and what it does to the airframe, and in what is attached to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import combinations, product, starmap
from typing import Any

import casadi as ca
import numpy as np

from casid.model import operators, station
from casid.model.airframe import Airframe
from casid.model.causes.changes import in_numbers, shifted, turned
from casid.model.causes.controls import never_sought
from casid.model.effect import Effect, Event, Forms, Further, Series, Size, Symbols, Traits, Values, cause, grid
from casid.model.path import RotorSignal, SignalPath
from casid.model.rotors import (
    ALL,
    SPECIFIC_THRUST,
    Rotor,
    Rotors,
    about_hover,
    changed,
    command,
    delay_of,
    effectiveness,
    hover_thrusts,
    lag_of,
)

_OF_A_CURVE = ("slope", "curvature")  # of thrust by the input
_DRAG_SPEED = 5.0  # m/s: at which drag is compared with weight
_SLOPE_MATTERS = 0.1  # a loop's gain that differs by as much
_WEIGHT_SHARE = 0.05  # part of the weight, of the arm of a rotor, or of a mass that matters


def rotors_in(known: Series, target: str) -> list[str]:
    """Names of the rotors that a target names, of a record whose inputs are complete."""
    names = [name.removesuffix(command("")) for name in known if name.endswith(command(""))]
    return names if target == ALL else [target]


def _names(aircraft: Airframe) -> tuple[str, ...]:
    return aircraft.rotors.names if aircraft.rotors else ()


_rotor = partial(cause, of_rotors=True)


def _of_rotors(target: str, act: Callable[[RotorSignal, Any], None], **more: Any) -> Effect:
    """An effect that changes each rotor that its target names by its value."""

    def change(path: SignalPath, values: Symbols) -> None:
        for one in path.aircraft.required_rotors.of(target):
            act(path.rotor[one.name], values["value"])

    return Effect(station="rotors", change=change, **more)


@_rotor(
    unit="1",
    quantity="relative change of thrust; -0.15: 15 % less than by the file",
    title="{label}: effectiveness",
    sentence="The thrust of {label} differs by {percent} from that of the aircraft file.",
)
def rotor_effectiveness(target: str) -> Effect:
    def act(one: RotorSignal, value: Any) -> None:
        one.thrust = one.thrust + value * one.rotor.effectiveness * one.rotor.static_thrust(one.input)

    enters = None if target == ALL else station.control(f"thrust_{target}")
    size = Size(meaningful=0.05, limit=0.95)
    traits = Traits(balance=True, by_record=True)
    forms = in_numbers(target, lambda one, value: {"effectiveness": one.effectiveness * (1.0 + value)})
    return _of_rotors(target, act, enters=enters, size=size, traits=traits, forms=forms)


@_rotor(
    terms=_OF_A_CURVE,
    candidates=lambda aircraft: starmap(thrust_curve, product([ALL] if aircraft.rotors else [], _OF_A_CURVE)),
    unit="1",
    quantity="relative change of the slope of thrust at hover; or of its curvature: part of the hover thrust by which "
    "twice the hover thrust is more",
    title="{label}: {term} of the thrust curve",
    sentence="The thrust curve of {label} has another {term} about hover than in the aircraft file: it differs by "
    "{percent}.",
)
def thrust_curve(target: str, term: str) -> Effect:
    """Steady hover determines the level of thrust, which each rotor's effectiveness is: this changes nothing there."""

    def shaped(rotors: Rotors, weight: float, one: Rotor, thrust: Any, value: Any) -> Any:
        """A thrust of the file with another slope or curvature about hover: a number, or a polynomial in the input."""
        hover = hover_thrusts(rotors, weight)[one.name]
        return about_hover(thrust, hover, weight / len(rotors.each), **{term: value})

    def change(path: SignalPath, values: Symbols) -> None:
        rotors = path.aircraft.required_rotors
        weight = path.aircraft.mass * path.aircraft.gravity
        for one in rotors.of(target):
            signal = path.rotor[one.name]
            by_file = path.parameter[effectiveness(one.name)] * one.static_thrust(signal.input)
            signal.thrust = signal.thrust + shaped(rotors, weight, one, by_file, values["value"]) - by_file

    def into_rotors(rotors: Rotors, weight: float, value: float) -> Rotors | None:
        if any(one.speed for one in rotors.of(target)):
            return None  # a coefficient of the square has no other slope

        def curve(one: Rotor) -> dict[str, Any]:
            polynomial = shaped(rotors, weight, one, one.curve, value) / one.effectiveness
            return {"thrust": tuple(map(float, polynomial.coef))}

        return changed(rotors, target, curve)

    return Effect(
        forms=Forms(into_rotors=into_rotors),
        station="rotors",
        change=change,
        size=Size(meaningful=_SLOPE_MATTERS, limit=3.0, lowest=-1.0 if term == "slope" else None),
    )


@_rotor(
    unit="1",
    quantity="relative change of the reaction torque per thrust; -2: it turns the other way",
    title="{label}: reaction torque",
    sentence="The reaction torque of {label} differs by {percent} from that of the aircraft file; by -200 % it would "
    "turn the other way.",
)
def rotor_torque(target: str) -> Effect:
    def act(one: RotorSignal, value: Any) -> None:
        one.torque = one.torque * (1.0 + value)

    # steady flight balances all torques, whatever their size
    reads = ("r",) if target == ALL else ()
    size = Size(meaningful=0.1, limit=3.0)
    forms = in_numbers(target, lambda one, value: {"torque": one.torque * (1.0 + value)})
    return _of_rotors(target, act, reads=reads, size=size, traits=Traits(by_record=True), forms=forms)


def _timing(
    target: str, act: Callable[[np.ndarray, np.ndarray, float, float, Any], np.ndarray], limit: float, **more: Any
) -> Effect:
    """What of the input acts otherwise than by the file: `act` makes it of time, what was commanded, delay and lag of
    the file, and the value."""

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        found = {}
        for name in rotors_in(known, target):
            late = float(known[delay_of(name)][0])
            lag = float(known[lag_of(name)][0])
            commanded = known[command(name)]
            # both from the same samples: what acts was made of the record before it was averaged
            as_given = operators.lag(t, operators.delay(t, commanded, late), lag)
            found[station.control(name)] = act(t, commanded, late, lag, values["value"]) - as_given
        return found

    return Effect(linear=False, series=series, size=Size(meaningful=0.01, limit=limit), **more)


@_rotor(
    unit="s",
    quantity="time constant between input and thrust, less that of the file",
    title="{label}: lag",
    sentence="The thrust of {label} follows its input with a time constant that is {size} [longer|shorter] than in the "
    "aircraft file.",
)
def rotor_lag(target: str) -> Effect:
    def act(t: np.ndarray, commanded: np.ndarray, late: float, lag: float, value: Any) -> np.ndarray:
        return operators.lag(t, operators.delay(t, commanded, late), operators.larger(lag + value, 0.0))

    further = Further(grid=grid(value=(-0.06, -0.03, 0.015, 0.03, 0.06, 0.12)))
    forms = in_numbers(target, lambda one, value: {"lag": max(one.lag + value, 0.0)})
    return _timing(target, act, 0.5, further=further, forms=forms)


@_rotor(
    candidates=never_sought,
    unit="s",
    quantity="time constant while the input falls, less that while it rises, which is that of the file",
    title="{label}: rise unlike fall",
    sentence="The thrust of {label} falls with a time constant that is {size} [longer|shorter] than that with which it "
    "rises.",
)
def rotor_rise_fall(target: str) -> Effect:
    def act(t: np.ndarray, commanded: np.ndarray, late: float, lag: float, value: Any) -> np.ndarray:
        return operators.uneven_lag(t, operators.delay(t, commanded, late), lag, operators.larger(lag + value, 0.0))

    return _timing(target, act, 0.5)


@_rotor(
    candidates=never_sought,
    unit="N",
    quantity="largest thrust at rest",
    title="{label}: limit of thrust",
    sentence="The thrust of {label} does not go above {size}.",
)
def rotor_limit(target: str) -> Effect:
    def act(one: RotorSignal, value: Any) -> None:
        one.thrust = ca.fmin(one.thrust, value)

    return _of_rotors(target, act, linear=False)


@_rotor(
    terms=("x", "y", "z"),
    candidates=never_sought,
    unit="rad",
    quantity="angle by which the axis of its thrust is turned about the body axis that is its term",
    title="{label}: tilt about {term}",
    sentence="The axis of {label} is tilted by {size} about body {term} from where the aircraft file has it.",
)
def rotor_tilt(target: str, about: str) -> Effect:
    def act(one: RotorSignal, value: Any) -> None:
        one.axis = turned(one.axis, about, ca.cos(value), ca.sin(value))

    def numbers(one: Rotor, value: float) -> dict[str, Any]:
        return {"axis": tuple(turned(one.axis, about, math.cos(value), math.sin(value)))}

    size = Size(limit=0.5 * math.pi)
    return _of_rotors(target, act, forms=in_numbers(target, numbers), size=size, traits=Traits(balance=True))


@_rotor(
    unit="s",
    quantity="dead time between input and thrust, less that of the file",
    title="{label}: delay",
    sentence="The thrust of {label} follows its input {size} [later|earlier] than in the aircraft file.",
)
def rotor_delay(target: str) -> Effect:
    def act(t: np.ndarray, commanded: np.ndarray, late: float, lag: float, value: Any) -> np.ndarray:
        return operators.lag(t, operators.delay(t, commanded, late + value), lag)

    further = Further(grid=grid(value=(-0.02, 0.01, 0.02, 0.04, 0.08)))
    forms = in_numbers(target, lambda one, value: {"delay": max(one.delay + value, 0.0)})
    return _timing(target, act, 0.3, further=further, forms=forms)


@_rotor(
    terms=("x", "y", "z"),
    candidates=lambda aircraft: starmap(rotor_position, product(_names(aircraft), "xy")),
    unit="m",
    quantity="true minus assumed position, body axes",
    title="{label}: position along {term}",
    sentence="The {label} stands {size} along body {term} from where the aircraft file has it.",
)
def rotor_position(target: str, axis: str) -> Effect:
    def act(one: RotorSignal, value: Any) -> None:
        one.position["xyz".index(axis)] += value

    def matters(aircraft: Airframe) -> float:
        arms = [math.hypot(*one.position[:2]) for one in aircraft.required_rotors.each]
        return _WEIGHT_SHARE * float(np.mean(arms))

    size = Size(meaningful=matters, within="arm")
    forms = in_numbers(target, lambda one, value: {"position": shifted(one.position, axis, value)})
    return _of_rotors(target, act, size=size, traits=Traits(balance=True), forms=forms)


@_rotor(
    joined=True,
    candidates=lambda aircraft: map(rotor_swap, map("+".join, combinations(_names(aircraft), 2))),
    unit="1",
    quantity="part of each input that acts on the other rotor: 1, they are interchanged",
    title="{label}: inputs interchanged",
    sentence="The inputs of {label} are interchanged ({percent}).",
)
def rotor_swap(target: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        first, second = target.split("+")
        change = values["value"] * (known[second] - known[first])
        return {station.control(first): change, station.control(second): -change}

    return Effect(series=series, size=Size(meaningful=0.5, limit=1.5), traits=Traits(balance=True))


@_rotor(
    candidates=lambda aircraft: map(added_mass, _names(aircraft)),
    unit="kg",
    quantity="mass beside that of the file, at the hub of the rotor",
    title="{label}: added mass",
    sentence="A mass of {size} that the aircraft file does not have is attached at {label}.",
)
def added_mass(target: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        (one,) = path.aircraft.required_rotors.of(target)
        whole = path.mass + values["value"]
        reduced = path.mass * values["value"] / whole
        x, y, z = one.position
        squares = {"Ixx": y * y + z * z, "Iyy": x * x + z * z, "Izz": x * x + y * y}
        for name, square in (squares | {"Ixz": x * z, "Ixy": x * y, "Iyz": y * z}).items():
            path.inertia[name] += reduced * square
        path.cg = [c + values["value"] / whole * arm for c, arm in zip(path.cg, one.position, strict=True)]
        path.mass = whole

    size = Size(meaningful=lambda aircraft: _WEIGHT_SHARE * aircraft.mass)
    return Effect(station="mass", change=change, size=size, traits=Traits(balance=True, by_record=True))


@cause(
    candidates=lambda aircraft: map(mass_change, [""] if aircraft.rotors else []),
    unit="1",
    quantity="relative change of the mass from the onset on; -0.2: a fifth is dropped",
    sentence="The mass changes by {percent} in mid-record.",
)
def mass_change() -> Effect:
    """The rotors then accelerate another mass. Moments stay: what is dropped hung near the centre of gravity."""

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        more = (1.0 / (1.0 + values["value"]) - 1.0) * operators.step(t, values["onset"])
        return {station.equation(state): more * known[of_thrust] for state, of_thrust in SPECIFIC_THRUST.items()}

    return Effect(
        event=Event(recurring=True),
        further=Further(either_sign=True),
        series=series,
        traits=Traits(balance=True),
        size=Size(meaningful=_WEIGHT_SHARE, limit=2.0, lowest=-0.8),
    )


@cause(
    targets=("x", "y", "z"),
    candidates=lambda aircraft: map(body_drag, "xyz" if aircraft.rotors else ""),
    unit="N s/m",
    quantity="drag per velocity, of all rotors in hover, beside that of the file",
    title="{words} along {target}",
    sentence="The body has a drag of {size} along {target} that the aircraft file does not have.",
)
def body_drag(axis: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.drag[axis] += values["value"]

    def matters(aircraft: Airframe) -> float:
        return _WEIGHT_SHARE * aircraft.mass * aircraft.gravity / _DRAG_SPEED

    def into_rotors(rotors: Rotors, weight: float, value: float) -> Rotors:
        return replace(rotors, drag=shifted(rotors.drag, axis, value))

    size = Size(meaningful=matters)
    return Effect(station="rotors", change=change, size=size, forms=Forms(into_rotors=into_rotors))


def _of_all(number: str, **more: Any) -> Effect:
    """An effect that adds its value to a number of the path that all rotors share."""

    def change(path: SignalPath, values: Symbols) -> None:
        setattr(path, number, getattr(path, number) + values["value"])

    return Effect(station="rotors", change=change, **more)


@cause(
    candidates=lambda aircraft: map(rotor_inflow, [""] if aircraft.rotors else []),
    unit="s/m",
    quantity="part of the thrust of hover lost for each m/s along it, beside that of the file",
    sentence="The thrust changes with axial speed by {size} of itself, which the aircraft file does not have.",
)
def rotor_inflow() -> Effect:
    def into_rotors(rotors: Rotors, weight: float, value: float) -> Rotors:
        return replace(rotors, inflow=rotors.inflow + value)

    return _of_all("inflow", size=Size(meaningful=0.02, limit=1.0), forms=Forms(into_rotors=into_rotors))


@cause(
    candidates=lambda aircraft: map(battery_sag, [""] if aircraft.rotors and aircraft.rotors.voltage else []),
    unit="1",
    quantity="exponent of the battery's voltage in the thrust, beside that of the file",
    sentence="The thrust follows the voltage of the battery with an exponent that is {size} [larger|smaller] than in "
    "the aircraft file.",
)
def battery_sag() -> Effect:
    return _of_all("voltage_exponent", size=Size(meaningful=0.3, limit=5.0))
