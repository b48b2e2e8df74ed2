"""The F-16 of NASA's check cases as a blind aircraft: tables of its wind tunnel, flown by casid in closed loop.

Its DAVE-ML files (`F16_aero.dml`, `F16_inertia.dml`; nasa/simupy-flight) come with no right to be part of this project:
CASID_DATA names their folder, or the one that holds it as `f16`.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.trim import trim
from problems.blind.flown import Flown

AERODYNAMICS, INERTIA = "F16_aero.dml", "F16_inertia.dml"
_V, _ALTITUDE = 172.0, 3000.0  # m/s, m
_CG_PERCENT = 30.0  # of the mean chord: short period of 0.23 Hz, damping ratio 0.57


def folder() -> Path:
    """Folder of the DAVE-ML files. Raises InputError when CASID_DATA names none."""
    named = os.environ.get("CASID_DATA")
    if named:
        for place in (Path(named), Path(named) / "f16", Path(named).parent / "f16"):
            if (place / AERODYNAMICS).is_file():
                return place
    raise InputError(
        f"sets of 'f16' need {AERODYNAMICS} and {INERTIA} of NASA's check cases (nasa/simupy-flight): set CASID_DATA "
        "to the folder that has them"
    )


@cache
def plane() -> Flown:
    at = folder()
    healthy = Aircraft.from_daveml(at / AERODYNAMICS, at / INERTIA, held={"CG_PCT_MAC": _CG_PERCENT})
    level = trim(healthy, V=_V, altitude=_ALTITUDE)
    where = {"V": level.V, "alpha": level.alpha, "theta": level.theta, **level.inputs}
    return Flown(
        aircraft=replace(healthy, name="F-16", trim=where),
        level=level,
        span=2.0 * healthy.rate_length_lateral,
        sizes={"delta_e": 0.04, "delta_a": 0.025, "delta_r": 0.06, "throttle": 0.25},
        units_s={"delta_e": 0.6, "delta_a": 0.7, "delta_r": 0.8, "throttle": 1.2},
        augmentation={
            "delta_e": {"q": 0.08, "theta": 0.08},
            "delta_a": {"p": 0.02, "phi": 0.02},
            "delta_r": {"r": 0.25},
        },
    )


def without_aerodynamics(flown: Flown) -> Aircraft:
    """Mass properties, lengths and trim of an aircraft, with aerodynamics of zero, to be given derivatives."""
    coefficients = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
    return replace(
        flown.aircraft,
        aerodynamics=None,
        force_axes="wind",
        relative_uncertainty=0.3,
        derivatives={f"{c}_0": 0.0 for c in coefficients},
    )
