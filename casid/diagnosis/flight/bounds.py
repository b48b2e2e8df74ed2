"""Physical limits of masses, inertias, centres of gravity and lever arms of an aircraft."""

from __future__ import annotations

import math
from dataclasses import replace

from casid.diagnosis.criteria import SizeCriteria
from casid.model.airframe import Airframe
from casid.model.effect import Effect

_MOMENTS = ("Ixx", "Iyy", "Izz")


def possible(effect: Effect, aircraft: Airframe, criteria: SizeCriteria) -> Effect:
    """The effect with the largest size, in either direction, that is physically possible for this aircraft."""
    size = effect.size
    if size.within == "inertia":
        low, high = inertia_bounds(effect.target, aircraft, criteria)
        return replace(effect, size=replace(size, limit=high, lowest=low))
    if size.within is not None:
        each = aircraft.rotors.each if aircraft.rotors else ()
        arm = max((math.hypot(*one.position[:2]) for one in each), default=0.0)  # farther off, no hover is in balance
        largest = {
            "span": criteria.arm * max(aircraft.moment_length_lateral, 2.0 * aircraft.rate_length_lateral),
            "chord": criteria.cg * aircraft.moment_length_pitch if aircraft.winged else arm,
            "arm": arm,
            "mass": criteria.mass * aircraft.mass,
        }
        return replace(effect, size=replace(size, limit=min(size.limit, largest[size.within])))
    return effect


def inertia_bounds(component: str, aircraft: Airframe, criteria: SizeCriteria) -> tuple[float, float]:
    """(lowest, highest) Possible change of an inertia.

    A moment of inertia changes by at most a part of itself, and no moment of a rigid body exceeds the sum of the other
    two. Beside rotors the latter alone holds: decks add 57 % to that of a Crazyflie. A product of inertia changes by at
    most the same part of the roll inertia.
    """
    inertia = aircraft.inertia
    if component not in _MOMENTS:
        return -criteria.mass * inertia.Ixx, criteria.mass * inertia.Ixx
    own = getattr(inertia, component)
    one, other = (getattr(inertia, name) for name in _MOMENTS if name != component)
    low = max((1.0 - criteria.mass) * own, abs(one - other))
    high = one + other
    high = high if aircraft.rotors else min((1.0 + criteria.mass) * own, high)
    return min(low - own, 0.0), max(high - own, 0.0)
