"""What no aircraft can have, whatever explains the records: masses, inertias, centres of gravity and lever arms."""

from __future__ import annotations

from dataclasses import replace

from casid.diagnosis.criteria import SizeCriteria
from casid.model.airframe import Airframe
from casid.model.effect import Effect

_ARMS = ("vane_position", "accelerometer_position", "thrust_asymmetry", "thrust_line")
_MOMENTS = ("Ixx", "Iyy", "Izz")


def possible(effect: Effect, aircraft: Airframe, criteria: SizeCriteria) -> Effect:
    """The effect with the largest size that this aircraft can have it of, in either direction."""
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
