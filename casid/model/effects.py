"""The catalogue of effects that make sense for an aircraft and its instruments."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations_with_replacement

from casid.model.aircraft import Aircraft, EffectValue
from casid.model.causes import aero_term, unsteady_aero
from casid.model.effect import CAUSES, TARGETS, Effect
from casid.model.path import aerodynamic_parameters, coefficient_names
from casid.model.terms import parse_term
from casid.signals import SURFACES

_VARIABLES = ("alpha", "beta", "p", "q", "r", *SURFACES)


def aero_candidates(aircraft: Aircraft) -> list[Effect]:
    """Every polynomial and cross term of second and third order, every first-order term and Mach, on the six
    coefficients, that the aircraft file does not have."""
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    terms = [*_VARIABLES, "mach"]
    for degree in (2, 3):
        terms += [parse_term("*".join(v)).name for v in combinations_with_replacement(_VARIABLES, degree)]
    coefficients = coefficient_names(aircraft.force_axes)
    return [aero_term(c, term) for c in coefficients for term in terms if (c, term) not in present]


def catalogue(aircraft: Aircraft, outputs: Iterable[str]) -> list[Effect]:
    """Every effect that makes sense for this aircraft and these measured outputs, turbulence apart."""
    measured = set(outputs)
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    found = aero_candidates(aircraft)
    for coefficient in coefficient_names(aircraft.force_axes):
        rate = "betadot" if coefficient in ("CY", "Cl", "Cn") else "alphadot"
        if (coefficient, rate) not in present:
            found.append(unsteady_aero(coefficient))
    for kind, targets in TARGETS.items():
        for target in targets:
            if kind.startswith("sensor_") or kind == "structural_mode":
                derivative_with_rate = target.endswith("dot") and target[:-3] in measured and kind != "sensor_bias"
                if (target not in measured and target != "inertial") or derivative_with_rate:
                    continue
            if kind == "vane_position" and target not in measured:
                continue
            if kind == "accelerometer_position" and not measured & {"ax", "ay", "az"}:
                continue
            if kind != "turbulence":
                found.append(CAUSES[kind](target))
    return found


def effect_of(value: EffectValue) -> Effect:
    """The Effect that an `[[effects]]` entry of an aircraft file speaks of."""
    return CAUSES[value.kind](value.target or "", value.term) if value.term else CAUSES[value.kind](value.target or "")
