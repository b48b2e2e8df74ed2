"""Causes that enter as coefficients: missing terms, unsteady aerodynamics, an unrecorded change of configuration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np

from casid.model import operators, station
from casid.model.airframe import Airframe
from casid.model.causes.controls import never_sought
from casid.model.effect import Effect, Event, Further, Series, Size, Symbols, Traits, Values, cause, grid, of_kind
from casid.model.path import SignalPath, aerodynamic_parameters, evaluate
from casid.model.terms import COEFFICIENTS, OUT_OF_PLANE, derivative_name, derivative_term, parse_term
from casid.signals import SURFACES

_VARIABLES = ("alpha", "beta", "p", "q", "r", *SURFACES)
_TOGETHER = 2  # variables of one term
_BENT = tuple(term for v in ("beta", *SURFACES) for term in (f"|{v}|", f"{v}*|{v}|"))
_LATERAL = ("CY", "Cl", "Cn")
_LARGEST = Size(limit=60.0)  # derivative in the rate of a flow angle
# Behind a propeller, power makes a tail stronger, and drag on what is washed.
_IN_THE_SLIPSTREAM = {"CD": ("Tc",), "CX": ("Tc",), "Cm": ("delta_e*Tc",), "Cn": ("delta_r*Tc",)}


def _missing_terms(aircraft: Airframe) -> Iterable[Effect]:
    """Terms of second and third order in two variables at most, of first order, and Mach, that the file lacks; and
    what grows with the magnitude of a surface or of sideslip, as one side unlike the other.

    What three variables make together, wind tunnels do not measure. Rates do not act across the plane of symmetry: yaw
    rate on the pitching moment is the gyroscopic moment of a rotor. A slipstream at the tail at a constant deflection
    looks like another thrust line.
    """
    terms = [*_VARIABLES, "mach", *_BENT]
    for degree in (2, 3):
        products = combinations_with_replacement(_VARIABLES, degree)
        terms += [parse_term("*".join(v)).name for v in products if len(set(v)) <= _TOGETHER]
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    return (
        aero_term(c, term)
        for c in aircraft.coefficients
        for term in (*terms, *_IN_THE_SLIPSTREAM.get(c, ()))
        if (c, term) not in present and not (_across_symmetry(c, term) and (_has_a_rate(term) or term in _BENT))
    )


def _has_a_rate(term: str) -> bool:
    return bool(parse_term(term).variables & {"p", "q", "r"})


def _across_symmetry(coefficient: str, term: str) -> bool:
    """Return True if the term couples the motion in the plane of symmetry with the motion out of it."""
    odd = sum(power for variable, power in parse_term(term).factors if variable in OUT_OF_PLANE) % 2 == 1
    return odd != (coefficient in _LATERAL)


@cause(
    targets=COEFFICIENTS,
    needs_term=True,
    candidates=_missing_terms,
    unit="{term}",
    quantity="factor of the term",
    title="{target}: {term}",
    sentence="The {label} depends on {term} with a factor of {size}, a term that the model does not have.",
)
def aero_term(coefficient: str, term: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.coefficient[coefficient] += values["value"] * evaluate(term, path)

    washed = term in _IN_THE_SLIPSTREAM.get(coefficient, ())
    return Effect(
        regressor=term,
        enters=station.coefficient(coefficient),
        station="coefficients",
        change=change,
        traits=Traits(improbable=_across_symmetry(coefficient, term), expected=washed),
    )


@cause(
    targets=(derivative_name(c, parse_term(v)) for c in COEFFICIENTS for v in _VARIABLES),
    candidates=never_sought,
    unit="{term}",
    quantity="the derivative that the file does not have",
    title="{target}: not in the file",
    sentence="The file does not have the derivative {target}, which is {size}.",
)
def missing_derivative(name: str) -> Effect:
    coefficient, term = derivative_term(name)
    linear = aero_term(coefficient, term.name)
    return replace(linear, target=name, term=None, regressor=None, traits=Traits(equal=lambda _: (linear, 1.0)))


def _missing_rates(aircraft: Airframe) -> Iterable[Effect]:
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    yield from (e for c in aircraft.coefficients if (c, (e := unsteady_aero(c)).regressor) not in present)
    yield from (lagged_aero(c) for c in aircraft.coefficients)


def _flow_angle(coefficient: str) -> str:
    return "beta" if coefficient in _LATERAL else "alpha"


@of_kind("unsteady_aero")
def lagged_aero(coefficient: str) -> Effect:
    """Unsteady aerodynamics with a memory: the rate is that of the flow angle behind a first-order lag (stall, downwash
    that has still to reach the tail); a time constant of zero would be `unsteady_aero`."""
    angle = _flow_angle(coefficient)
    behind = f"{angle}_lagged_{coefficient}"

    def change(path: SignalPath, values: Symbols) -> None:
        aircraft = path.aircraft
        length = aircraft.rate_length_lateral if angle == "beta" else aircraft.rate_length_pitch
        path.derivative[behind] = (path.air[angle] - path.state[behind]) / values["time_constant"]
        path.coefficient[coefficient] += values["value"] * path.derivative[behind] * length / path.air["V"]

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        rate = operators.lag(t, known[f"{angle}dot"], values["time_constant"])
        return {station.coefficient(coefficient): values["value"] * rate}

    return Effect(
        variant="lagged",
        enters=station.coefficient(coefficient),
        size=_LARGEST,
        further=Further(grid=grid(time_constant=(0.1, 0.3, 0.8)), unsigned=("time_constant",)),
        units={"time_constant": "s"},
        states={behind: angle},
        station="coefficients",
        change=change,
        series=series,
    )


@cause(
    targets=COEFFICIENTS,
    candidates=_missing_rates,
    variants={"time_constant": lagged_aero},
    unit="1/rad",
    quantity="derivative in the dimensionless rate of the angle of attack, or of sideslip",
    title="{target}: {words}",
    sentence="The {label} depends on how fast the flow angle changes ({size}), which the model leaves out.",
)
def unsteady_aero(coefficient: str) -> Effect:
    rate = f"{_flow_angle(coefficient)}dot"

    def change(path: SignalPath, values: Symbols) -> None:
        path.coefficient[coefficient] += values["value"] * path.regressor[rate]

    enters = station.coefficient(coefficient)
    return Effect(regressor=rate, enters=enters, station="coefficients", change=change, size=_LARGEST)


@cause(
    targets=COEFFICIENTS,
    joined=True,
    # which coefficients switch together is found by a search of its own, see `diagnosis/evidence/onsets.py`
    candidates=never_sought,
    unit="1",
    quantity="step of the first coefficient at the onset; the others stand in the parameters",
    title="{target}: {words}",
    sentence="The configuration changes in mid-record: a jump of {label}, {target} by {size}.",
)
def configuration_change(coefficients: str) -> Effect:
    names = tuple(coefficients.split("+"))

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        moved = operators.transition(t, values["onset"], values.get("duration", 0.0))
        return {station.coefficient(name): values["value" if name == names[0] else name] * moved for name in names}

    absent = {"duration": 0.0, **dict.fromkeys(names[1:], 0.0)}
    return Effect(
        members=names,
        enters=station.coefficient(names[0]),
        event=Event(recurring=True, extent="duration"),
        further=Further(grid=grid(duration=(0.1, 2.0, 5.0)), defaults=absent),
        series=series,
    )
