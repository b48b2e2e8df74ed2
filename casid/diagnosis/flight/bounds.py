"""What no aircraft can have, whatever explains the records: masses, inertias, centres of gravity, lever arms, and terms
that at the limits of flight would make many times what coefficients are."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from casid.diagnosis.criteria import Criteria, SizeCriteria
from casid.model.airframe import Airframe
from casid.model.effect import Effect
from casid.model.terms import Term, parse_term

_ARMS = ("vane_position", "accelerometer_position", "thrust_asymmetry", "thrust_line")
_MOMENTS = ("Ixx", "Iyy", "Izz")


def possible(effect: Effect, aircraft: Airframe, by: Criteria) -> Effect:
    """The effect with the largest size that this aircraft can have it of, in either direction."""
    criteria = by.size
    if effect.kind == "aero_term" and effect.term is not None:
        return replace(effect, limit=min(effect.limit, largest_factor(effect.target, effect.term, aircraft, by)))
    if effect.kind in _ARMS:
        span = max(aircraft.moment_length_lateral, 2.0 * aircraft.rate_length_lateral)
        return replace(effect, limit=min(effect.limit, criteria.arm * span))
    if effect.kind == "cg_offset":
        return replace(effect, limit=min(effect.limit, criteria.cg * aircraft.moment_length_pitch))
    if effect.kind == "mass":
        return replace(effect, limit=criteria.mass * aircraft.mass)
    if effect.kind == "inertia":
        low, high = inertia_bounds(effect.target, aircraft, criteria)
        return replace(effect, limit=high, lowest=low)
    return effect


def inertia_bounds(component: str, aircraft: Airframe, criteria: SizeCriteria) -> tuple[float, float]:
    """(lowest, highest) change of an inertia: a part of it, and no more than leaves a rigid body, of which no moment is
    larger than the sum of the other two. Of the product of inertia, the part of the roll inertia."""
    inertia = aircraft.inertia
    if component not in _MOMENTS:
        return -criteria.mass * inertia.Ixx, criteria.mass * inertia.Ixx
    own = getattr(inertia, component)
    one, other = (getattr(inertia, name) for name in _MOMENTS if name != component)
    low, high = max((1.0 - criteria.mass) * own, abs(one - other)), min((1.0 + criteria.mass) * own, one + other)
    return min(low - own, 0.0), max(high - own, 0.0)


def largest_factor(coefficient: str, term: str, aircraft: Airframe, by: Criteria) -> float:
    """Largest factor of a term: at the limits of flight it makes no more than `size.term` times what the largest usual
    derivative of its coefficient makes there. Infinite for a term of variables whose range is not known."""
    most = _reached(parse_term(term), aircraft, by.size)
    usual = [one.name.partition("_") for one in fields(by.prior.usual)]
    sizes = [
        (by.prior.usual.of(f"{coefficient}_{of}") or 0.0) * (by.size.motion.of(of) or 0.0)
        for name, _, of in usual
        if name == coefficient
    ]
    return by.size.term * max(sizes) / most if most > 0.0 else np.inf


def _reached(term: Term, aircraft: Airframe, criteria: SizeCriteria) -> float:
    """What a term reaches at the limits of flight; 0 where that is not known."""
    lengths = {
        "p": aircraft.rate_length_lateral / aircraft.moment_length_lateral,
        "q": aircraft.rate_length_pitch / aircraft.moment_length_pitch,
        "r": aircraft.rate_length_lateral / aircraft.moment_length_lateral,
    }
    reached = 0.0 if term.stretches else 1.0
    for variable, power in term.factors:
        # the rates of `motion` are made with half of the lengths of moments
        most = (criteria.motion.of(variable) or 0.0) * 2.0 * lengths.get(variable, 0.5)
        reached *= most**power
    return reached
