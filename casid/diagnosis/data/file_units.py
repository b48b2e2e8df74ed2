"""Units of an aircraft file: would flight agree with its derivatives if a number of it were in another unit?

Force and moment coefficients that the motion tells scale with mass, inertia, area and lengths; derivatives per degree
are 57 times smaller than per rad. So one wrong unit puts many derivatives off by one factor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from casid.model.aircraft import Aircraft
from casid.model.airframe import INERTIAS, Inertia
from casid.model.terms import parse_term
from casid.signals import DEGREE, FOOT, POUND, SLUG, TONNE

_ANGLES = frozenset(("alpha", "beta", "delta_e", "delta_a", "delta_r"))


@dataclass(frozen=True, kw_only=True)
class FileUnit:
    """`parameter` of a file in another unit than SI: SI over number of mass, inertia, area, lengths and angles."""

    parameter: str
    unit: str
    mass: float = 1.0
    inertia: float = 1.0
    area: float = 1.0
    lateral: float = 1.0
    pitch: float = 1.0
    angle: float = 1.0

    def corrected(self, aircraft: Aircraft) -> Aircraft:
        """The aircraft that is meant, when the file has this unit."""
        return replace(
            aircraft,
            mass=self.mass * aircraft.mass,
            inertia=Inertia(**{name: self.inertia * getattr(aircraft.inertia, name) for name in INERTIAS}),
            area=self.area * aircraft.area,
            moment_length_lateral=self.lateral * aircraft.moment_length_lateral,
            rate_length_lateral=self.lateral * aircraft.rate_length_lateral,
            moment_length_pitch=self.pitch * aircraft.moment_length_pitch,
            rate_length_pitch=self.pitch * aircraft.rate_length_pitch,
            derivatives={n: value * self._on(n.split("_", 1)[1]) for n, value in aircraft.derivatives.items()},
            terms={c: {t: value * self._on(t) for t, value in row.items()} for c, row in aircraft.terms.items()},
        )

    def scale_of(self, coefficient: str, variable: str) -> float:
        """Estimated over true derivative where the numbers of the file are taken for SI: a force coefficient is
        estimated as m a / (qbar S), a moment coefficient as I omega_dot / (qbar S l), a rate as omega l / V."""
        rolls = coefficient in ("Cl", "Cn", "CY")
        length = self.lateral if rolls else self.pitch
        moment = coefficient in ("Cl", "Cm", "Cn")
        scale = self.area * (length / self.inertia if moment else 1.0 / self.mass)
        if variable in ("p", "r", "betadot"):
            scale *= self.lateral
        elif variable in ("q", "alphadot"):
            scale *= self.pitch
        return scale / self.angle if variable in _ANGLES else scale

    def _on(self, term: str) -> float:
        """Factor on a derivative by a monomial."""
        if self.angle == 1.0 or term == "0":
            return 1.0
        return math.prod(self.angle**-power for name, power in parse_term(term).factors if name in _ANGLES)


FILE_UNITS: tuple[FileUnit, ...] = (
    FileUnit(parameter="mass", unit="lb", mass=POUND),
    FileUnit(parameter="mass", unit="t", mass=TONNE),
    FileUnit(parameter="mass", unit="slug", mass=SLUG),
    FileUnit(parameter="inertia", unit="slug ft2", inertia=SLUG * FOOT * FOOT),
    FileUnit(parameter="inertia", unit="lb ft2", inertia=POUND * FOOT * FOOT),
    FileUnit(parameter="area", unit="ft2", area=FOOT * FOOT),
    FileUnit(parameter="lateral lengths", unit="ft", lateral=FOOT),
    FileUnit(parameter="lengths in pitch", unit="ft", pitch=FOOT),
    FileUnit(parameter="derivatives", unit="1/deg", angle=DEGREE),
    FileUnit(
        parameter="mass, inertia, area and lengths",
        unit="slug and ft",
        mass=SLUG,
        inertia=SLUG * FOOT * FOOT,
        area=FOOT * FOOT,
        lateral=FOOT,
        pitch=FOOT,
    ),
)

SI_OF = {
    "mass": "kg",
    "inertia": "kg m2",
    "area": "m2",
    "lateral lengths": "m",
    "lengths in pitch": "m",
    "derivatives": "1/rad",
    "mass, inertia, area and lengths": "kg, kg m2, m2, m",
}
