"""The Do 328 as a blind aircraft, flown by casid."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from casid.model.trim import trim
from problems.blind.flown import Flown
from problems.do328 import THRUST, V_TRIM, do328

_SPAN = 20.98  # m; the lengths of its rates are half of 20.8 m


@cache
def plane() -> Flown:
    level = trim(do328(), V=V_TRIM, thrust=THRUST)
    at = {"V": level.V, "alpha": level.alpha, "theta": level.theta, **level.inputs}
    return Flown(
        aircraft=replace(do328(), trim=at, relative_uncertainty=0.3),
        level=level,
        span=_SPAN,
        sizes={"delta_e": 0.035, "delta_a": 0.055, "delta_r": 0.055, "throttle": 0.25},
        units_s={"delta_e": 0.6, "delta_a": 0.8, "delta_r": 0.9, "throttle": 1.2},
    )
