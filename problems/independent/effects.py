"""What is hidden in a set, drawn so that it matters and is plausible.

A kind, its target, sign and unit are those of the vocabulary of casid, which is the language of the answer; what an
effect does is written in the other files of this folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from problems.independent.aircraft_file import STRUCTURE, column
from problems.independent.manoeuvres import CARDS
from problems.independent.motion import Bend, Slosh
from problems.independent.planes import Plane

RECORDS = tuple(CARDS)
FITTED = RECORDS[:-1]
_DEG = np.pi / 180.0


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One hidden effect; records that have it, and record -> start [s] of an event."""

    kind: str
    value: float
    target: str = ""
    term: str | None = None
    records: tuple[str, ...] = RECORDS
    onset_s: Mapping[str, float] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)

    def scaled(self, factor: float) -> Effect:
        """The same effect, `factor` times as large; a limit on a rate is the larger the slower it is."""
        value = self.value / factor if self.kind == "rate_limit" else self.value * factor
        return Effect(**{**self.__dict__, "value": value})


# case -> (target, term) of the sets with one effect, in the order of their numbers
ONE: Mapping[str, tuple[str, str | None]] = {
    "actuator_lag": ("delta_e", None),
    "rate_limit": ("delta_r", None),
    "backlash": ("delta_a", None),
    "sensor_delay": ("alpha", None),
    "sensor_scale": ("V", None),
    "sensor_bias": ("q", None),
    "accelerometer_position": ("x", None),
    "cg_offset": ("x", None),
    "mass": ("", None),
    "effectiveness_change": ("thrust", None),
    "aero_term": ("Cm", "alpha*q"),
    "turbulence": ("", None),
    "gust": ("z", None),
}
INSTRUMENTS = ("sensor_delay", "sensor_scale", "sensor_bias", "accelerometer_position")  # the flight does not change
# outside the catalogue of casid
OUTSIDE = ("fuel_slosh", "wing_bending")
CASES = ("clean-1", "clean-2", "clean-3", "clean-4", *ONE, *OUTSIDE)
_SHARE = (0.08, 0.12)  # of the variation of Cm, that alpha*q adds and the terms of the file cannot imitate


def draw(case: str, plane: Plane, healthy: Mapping[str, np.ndarray], rng: np.random.Generator) -> Effect | None:
    """The effect of a case; None for a clean one. `healthy` has the tables' variables along healthy flights."""
    if case.startswith("clean"):
        return None
    if case in OUTSIDE:
        return _outside(case, plane, rng)
    target, term = ONE[case]
    size, sign = _size(case, plane, healthy, rng), rng.choice((-1.0, 1.0))
    if case in ("sensor_scale", "sensor_bias", "accelerometer_position", "cg_offset", "mass", "gust"):
        size = sign * size
    some = {"cg_offset": 2, "mass": 1, "gust": 2, "effectiveness_change": 3}.get(case)
    records = RECORDS if some is None else tuple(sorted(rng.choice(FITTED, some, replace=False).tolist()))
    timed = case in ("gust", "effectiveness_change")
    return Effect(
        kind=case,
        target=target,
        term=term,
        value=float(f"{size:.4g}"),
        records=records,
        onset_s={name: round(float(rng.uniform(7.0, 17.0)), 2) for name in records} if timed else None,
        parameters={"length": round(float(rng.uniform(1.2, 2.8)), 2)} if case == "gust" else {},
    )


def _size(case: str, plane: Plane, healthy: Mapping[str, np.ndarray], rng: np.random.Generator) -> float:
    u, size = rng.uniform, plane.size
    if case == "aero_term":
        A = np.stack([column(healthy, term) for term in STRUCTURE["Cm"]], axis=1)
        new = healthy["alpha"] * healthy["q"]
        unlike = new - A @ np.linalg.lstsq(A, new, rcond=None)[0]
        return -u(*_SHARE) * float(np.std(plane.coefficients(healthy)["Cm"]) / np.std(unlike))
    return {
        "actuator_lag": u(0.12, 0.22),
        "rate_limit": 2.0 * size["delta_r"] / u(0.5, 0.8),
        "backlash": size["delta_a"] * u(0.15, 0.25),
        "sensor_delay": u(0.08, 0.16),
        "sensor_scale": u(0.05, 0.09),
        "sensor_bias": u(0.4, 0.8) * _DEG,
        "accelerometer_position": plane.chord * u(0.35, 0.8),
        "cg_offset": plane.chord * u(0.05, 0.1),
        "mass": plane.mass * u(0.08, 0.14),
        "effectiveness_change": -u(0.2, 0.35),
        "turbulence": u(0.6, 1.2),
        "gust": plane.V * u(0.045, 0.075),
    }[case]


def _outside(case: str, plane: Plane, rng: np.random.Generator) -> Effect:
    """A sloshing mass as a part of the aircraft's mass, or the part of an incidence by which a wing twists off."""
    size = rng.uniform(0.1, 0.16) if case == "fuel_slosh" else rng.uniform(0.2, 0.3)
    frequency = rng.uniform(0.5, 0.8) if case == "fuel_slosh" else rng.uniform(1.2, 1.8)
    damping = 0.03 if case == "fuel_slosh" else 0.05
    parameters = {"frequency_hz": round(float(frequency), 3), "damping": damping}
    return Effect(kind=case, value=round(float(size), 4), parameters=parameters)


def slosh(effect: Effect, plane: Plane) -> Slosh:
    """A tank above the centre of gravity, by a tenth of the span."""
    w = 2.0 * np.pi * effect.parameters["frequency_hz"]
    place = (0.0, 0.0, -0.1 * plane.span)
    return Slosh(mass=effect.value * plane.mass, frequency=w, damping=effect.parameters["damping"], place=place)


def bend(effect: Effect) -> Bend:
    w = 2.0 * np.pi * effect.parameters["frequency_hz"]
    return Bend(share=effect.value, frequency=w, damping=effect.parameters["damping"])
