"""Other meanings of the numbers of an aircraft file: another unit, another point of its moments, other axes.

Each gives the file that is meant, so that flight can be compared with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from casid.model.aircraft import Aircraft
from casid.model.airframe import INERTIAS, Inertia
from casid.model.plausible import from_usual
from casid.model.terms import bare, parse_term
from casid.signals import DEGREE, FOOT, POUND, SLUG, TONNE


class FileMeaning(Protocol):
    """Another meaning of `parameter` of a file, and the statement of it."""

    @property
    def parameter(self) -> str: ...
    @property
    def said(self) -> str: ...
    def corrected(self, aircraft: Aircraft) -> Aircraft: ...


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

    @property
    def said(self) -> str:
        """The statement, `mass is in lb`."""
        are = "are" if self.parameter.endswith(("derivatives", "lengths", "in pitch")) else "is"
        return f"{self.parameter} {are} in {self.unit}"

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
        return math.prod(self.angle**-power for name, power in parse_term(term).factors if bare(name) in _ANGLES)


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


def file_units(aircraft: Aircraft) -> tuple[FileUnit, ...]:
    """Other units of a file, and its lengths exchanged, as far as no number that they touch leaves the usual."""
    ratio = aircraft.moment_length_pitch / aircraft.moment_length_lateral
    exchanged = FileUnit(parameter=EXCHANGED, unit="each other's place", lateral=ratio, pitch=1.0 / ratio)
    given = from_usual(aircraft)

    def nearer(meant: Aircraft) -> bool:
        return all(off <= given.get(name, 0.0) + 1e-9 for name, off in from_usual(meant).items())

    return tuple(one for one in (*FILE_UNITS, exchanged) if nearer(one.corrected(aircraft)))


EXCHANGED = "lateral and pitch lengths"

SI_OF = {
    EXCHANGED: "m",
    "mass": "kg",
    "inertia": "kg m2",
    "area": "m2",
    "lateral lengths": "m",
    "lengths in pitch": "m",
    "derivatives": "1/rad",
    "mass, inertia, area and lengths": "kg, kg m2, m2, m",
}


@dataclass(frozen=True, kw_only=True)
class MomentPoint:
    """Moments of the file about a point that lies `ahead` [m] of the c.g."""

    ahead: float
    chords: float
    parameter: str = "moment_reference"

    @property
    def said(self) -> str:
        """The statement, with the distance."""
        where = "ahead of" if self.ahead > 0.0 else "behind"
        return (
            f"the moments of the file are about a point {abs(self.ahead):.2g} m ({abs(self.chords):.2g} of the length "
            f"of pitching moments) {where} the centre of gravity"
        )

    def corrected(self, aircraft: Aircraft) -> Aircraft:
        """The aircraft with moments about the c.g.: M + r x F with the force at the point of the file."""
        pitch = self.ahead / aircraft.moment_length_pitch
        yaw = self.ahead / aircraft.moment_length_lateral
        lift, by = ("CL", pitch) if aircraft.force_axes == "wind" else ("CZ", -pitch)
        return _with_more(aircraft, {lift: ("Cm", by), "CY": ("Cn", yaw)})


def _with_more(aircraft: Aircraft, more: Mapping[str, tuple[str, float]]) -> Aircraft:
    """The aircraft with a part of one coefficient added to another: `more` has coefficient -> other, part."""
    derivatives = dict(aircraft.derivatives)
    terms = {c: dict(row) for c, row in aircraft.terms.items()}
    for name, value in aircraft.derivatives.items():
        coefficient, _, variable = name.partition("_")
        if coefficient in more:
            other, part = more[coefficient]
            derivatives[f"{other}_{variable}"] = derivatives.get(f"{other}_{variable}", 0.0) + part * value
    for coefficient, row in aircraft.terms.items():
        if coefficient in more:
            other, part = more[coefficient]
            into = terms.setdefault(other, {})
            into |= {term: into.get(term, 0.0) + part * value for term, value in row.items()}
    return replace(aircraft, derivatives=derivatives, terms=terms)


@dataclass(frozen=True, kw_only=True)
class StabilityAxes:
    """Rolling and yawing moments and rates of the file along and across the flight path at an angle `alpha` [rad]."""

    alpha: float
    parameter: str = "lateral derivatives"
    said: str = "lateral derivatives of moments are in stability axes, not in body axes"

    def corrected(self, aircraft: Aircraft) -> Aircraft:
        """The aircraft in body axes: moments and rates turned by the angle."""
        c = math.cos(self.alpha)
        s = math.sin(self.alpha)
        old = aircraft.derivatives
        new = dict(old)
        for term in {name.partition("_")[2] for name in old if name.startswith(("Cl_", "Cn_"))}:
            roll, yaw = ({axis: old.get(f"{m}_{axis}", 0.0) for axis in {term, "p", "r"}} for m in ("Cl", "Cn"))
            if term in ("p", "r"):
                by = (c, -s) if term == "p" else (s, c)
                roll[term], yaw[term] = (by[0] * row["p"] + by[1] * row["r"] for row in (roll, yaw))
            for name, value in (("Cl", c * roll[term] - s * yaw[term]), ("Cn", s * roll[term] + c * yaw[term])):
                if value != 0.0 or f"{name}_{term}" in old:
                    new[f"{name}_{term}"] = value
        return replace(aircraft, derivatives=new)


@dataclass(frozen=True, kw_only=True)
class ForceAxes:
    """Forces of the file along and across the flight path that it states along body axes, or the other way round."""

    stated: str
    parameter: str = "force derivatives"

    @property
    def said(self) -> str:
        """The statement, with `force_axes` as it should be."""
        here, there = ("CX CZ", "CL CD") if self.stated == "wind" else ("CL CD", "CX CZ")
        return f"force derivatives that the file calls {there} are {here}"

    def corrected(self, aircraft: Aircraft) -> Aircraft:
        """The aircraft with the same numbers along the other axes, which point the other way."""
        other = {"CL": "CZ", "CD": "CX"} if self.stated == "wind" else {"CZ": "CL", "CX": "CD"}
        named = {n: (*n.partition("_"), value) for n, value in aircraft.derivatives.items()}
        derivatives = {
            f"{other.get(c, c)}{mark}{term}": -value if c in other else value for c, mark, term, value in named.values()
        }
        terms = {
            other.get(c, c): {t: -v if c in other else v for t, v in row.items()} for c, row in aircraft.terms.items()
        }
        axes = "body" if self.stated == "wind" else "wind"
        return replace(aircraft, force_axes=axes, derivatives=derivatives, terms=terms)


def other_meanings(aircraft: Aircraft, alpha: float) -> tuple[FileMeaning, ...]:
    """Other units of a file, other points of its moments, and stability axes at an angle of attack [rad]. Of tables
    only their units are known."""
    found = file_units(aircraft)
    if aircraft.tables or aircraft.aerodynamics is not None:
        return found
    points = (MomentPoint(ahead=one * aircraft.moment_length_pitch, chords=one) for one in _CHORDS)
    axes = (StabilityAxes(alpha=alpha),) if abs(alpha) > _TURNED else ()
    return (*found, *points, *axes, ForceAxes(stated=aircraft.force_axes))


POINTS_APART = 0.1  # lengths of pitching moments
_CHORDS = tuple(sign * POINTS_APART * n for n in range(1, 9) for sign in (-1.0, 1.0))
_TURNED = 0.03  # rad: axes that are nearer are the same
