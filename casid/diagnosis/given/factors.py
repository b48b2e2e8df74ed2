"""One number that accounts for many contradicted derivatives: a common factor, or another point of reference.

A wrong inertia, length, area, mass or gearing scales a whole group of derivatives by one number. Moments about a point
that is not the centre of gravity differ by the force times its distance, in every term of the force. If one number
fits as well as free derivatives, it is reported first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from casid.data_check.file_meaning import FILE_UNITS, file_units
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.given.contradicted import FlightValue
from casid.model.aircraft import Aircraft
from casid.model.causes.controls import LOOPS, feedback
from casid.model.causes.loading import moment_reference
from casid.model.effect import Effect
from casid.model.numbers import with_deviation
from casid.model.plausible import Doubt
from casid.model.terms import derivative_term
from casid.signals import SURFACES

_FORCES = ("CL", "CD", "CY", "CX", "CZ")
_MOMENTS = ("Cl", "Cm", "Cn")


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A factor common to a group of derivatives."""

    in_json: ClassVar[str] = "row factor std means derivatives cause statistic sentence"

    row: str  # the group in words, as "Cm" or "all derivatives with delta_e"
    factor: float  # factor, std: flight over file, and its 1-sigma
    std: float
    means: tuple[str, ...]  # what in the file may be wrong by that factor or its inverse
    derivatives: tuple[str, ...]  # names of the derivatives that it stands for
    statistic: float  # 2 ln of the odds against errors of the stated size that have nothing to do with each other
    # cause, unit, as_if: of a number that is no factor, the cause that these derivatives reproduce and of which it is
    # the value, its unit, and how the derivatives differ from the file, with a place for the number
    cause: str = ""
    unit: str = ""
    as_if: str = ""

    @property
    def brief(self) -> str:
        """The number in a few words."""
        return f"{self.row} {self.factor:+.2f} {self.unit}" if self.cause else f"{self.row} times {self.factor:.2f}"

    @property
    def sentence(self) -> str:
        """Sentence about the group in flight, and what it may mean."""
        if self.cause:
            number = f"{with_deviation(self.factor, self.std)} {self.unit}"
            differ = f"differ from the file {self.as_if.format(number=number)}"
            return f"{self.row}: {', '.join(self.derivatives)} {differ}. Look first at {self.means[0]}."
        causes = " or ".join([", ".join(self.means[:-1]), self.means[-1]] if self.means[1:] else self.means)
        return (
            f"{self.row}: {', '.join(self.derivatives)} are {with_deviation(self.factor, self.std)} times the values "
            f"of the file, all by the same factor. Look first at {causes}."
        )


@dataclass(frozen=True, kw_only=True)
class _Group:
    """Derivatives that one wrong number of the file scales: their name as a group, the derivatives, and the number."""

    row: str
    holds: Callable[[str, str], bool]  # of coefficient and variable
    means: tuple[str, ...]


_GROUPS: tuple[_Group, ...] = (
    _Group(
        row="all coefficients",
        holds=lambda c, v: True,
        means=("the reference area", "the dynamic pressure (airspeed or density)"),
    ),
    _Group(row="all forces", holds=lambda c, v: c in _FORCES, means=("the mass", "the scale of the accelerometers")),
    _Group(row="all moments", holds=lambda c, v: c in _MOMENTS, means=("the inertia", "the reference lengths")),
    *(
        _Group(row=row, holds=lambda c, v, row=row: c == row, means=(inertia, length))
        for row, inertia, length in (
            ("Cl", "Ixx", "the lateral moment length"),
            ("Cm", "Iyy", "the pitch moment length"),
            ("Cn", "Izz", "the lateral moment length"),
        )
    ),
    *(
        _Group(
            row=f"all derivatives with {surface}",
            holds=lambda c, v, surface=surface: v == surface,
            means=(f"the gearing or the unit of {surface}",),
        )
        for surface in SURFACES
    ),
    *(
        _Group(
            row=f"all derivatives with {angle}",
            holds=lambda c, v, angle=angle: v == angle,
            means=(f"the scale of the {angle} vane, which an upwash changes",),
        )
        for angle in ("alpha", "beta")
    ),
    _Group(
        row="all derivatives with the lateral rates",
        holds=lambda c, v: v in ("p", "r", "betadot"),
        means=("the lateral rate length (half span or span)",),
    ),
    _Group(
        row="all derivatives with the pitch rate",
        holds=lambda c, v: v in ("q", "alphadot"),
        means=("the pitch rate length (half chord or chord)",),
    ),
)


_TRIED = sum(map(len, (_GROUPS, ("a point of reference",), *LOOPS.values())))


@dataclass(frozen=True, kw_only=True)
class _Ratio:
    """One number by one derivative, and its 1-sigma with the usual misfit of a linear structure: flight value over file
    value, or the distance [m] that makes their difference. `stated` is the 1-sigma of the file in the same unit."""

    name: str
    coefficient: str
    variable: str
    ratio: float
    std: float
    stated: float


def common_factors(
    aircraft: Aircraft,
    flight: Mapping[str, FlightValue],
    criteria: Criteria | None = None,
    slopes: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Factor, ...]:
    """The common factors of groups of derivatives, the largest group first. A derivative is in one group at most.

    A group has a common factor if every derivative that flight determines is consistent with it, if the factor differs
    from 1 by more than its standard deviations and by more than 10 %, and if it is clearly more likely than errors of
    the stated size that have nothing to do with each other. At least two derivatives are required.
    `slopes` are those of derivatives by tables and own aerodynamics, to which the derivatives of the file are
    increments.
    """
    by = criteria or Criteria()
    left = _ratios(aircraft, flight, by, slopes)
    found = []
    for group in _GROUPS:
        members = [one for one in left if group.holds(one.coefficient, one.variable)]
        scope = {(one.coefficient, one.variable) for one in members}
        if len(scope) < 2 or (factor := _common(members, by, 1.0, by.parts.tenth)) is None or factor[0] <= 0.0:
            continue
        value, std, statistic = factor
        names = tuple(one.name for one in members)
        found.append(
            Factor(row=group.row, factor=value, std=std, means=group.means, derivatives=names, statistic=statistic)
        )
        left = [one for one in left if one.name not in names]
    for cause, members in _of_causes(aircraft, flight, by):
        scaled = {name for one in found for name in one.derivatives}
        members = [one for one in members if one.name not in scaled]
        least = float(cause.effect.smallest_that_matters(aircraft) or 0.0)
        if (number := _common(members, by, 0.0, least)) is not None:
            found.append(cause.factor(*number, tuple(one.name for one in members)))
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class _OneNumber:
    """A cause whose size is one number in many derivatives: the group in words, what they differ by, and its origin."""

    effect: Effect
    row: str
    as_if: str
    means: str

    def factor(self, value: float, std: float, statistic: float, derivatives: tuple[str, ...]) -> Factor:
        return Factor(
            row=self.row,
            factor=value,
            std=std,
            means=(self.means,),
            derivatives=derivatives,
            statistic=statistic,
            cause=self.effect.name,
            unit=self.effect.unit,
            as_if=self.as_if,
        )


def _of_causes(
    aircraft: Aircraft, flight: Mapping[str, FlightValue], criteria: Criteria
) -> Iterator[tuple[_OneNumber, list[_Ratio]]]:
    """Causes that derivatives reproduce, with the size that each derivative asks for."""
    yield _REFERENCE, list(_distances(aircraft, flight, criteria))
    for surface, quantities in LOOPS.items():
        for quantity in quantities:
            cause = _OneNumber(
                effect=feedback(surface, quantity),
                row=f"{surface} follows {quantity}",
                as_if=f"as a feedback of {quantity} to {surface} with a gain of {{number}} would make them",
                means="a damper or autopilot that the model lacks",
            )
            yield cause, list(_gains(aircraft, flight, criteria, (surface, quantity)))


_REFERENCE = _OneNumber(
    effect=moment_reference("x"),
    row="moments",
    as_if="as if its moments were about a point {number} from the centre of gravity along body x, forward positive",
    means="the point that the moments of the file are about",
)


def _gains(
    aircraft: Aircraft, flight: Mapping[str, FlightValue], criteria: Criteria, loop: tuple[str, str]
) -> Iterator[_Ratio]:
    """Yield, by each derivative in a quantity that flight determines, the gain from the quantity to a surface that
    makes its difference, as the surface acts in flight."""
    surface, quantity = loop
    lengths = {"q": aircraft.rate_length_pitch, **dict.fromkeys(("p", "r"), aircraft.rate_length_lateral)}
    per = aircraft.trim.get("V", 0.0) / lengths[quantity] if quantity in lengths else 1.0
    for name, given in aircraft.derivatives.items():
        coefficient = derivative_term(name)[0]
        variable = name.partition("_")[2]
        power = flight.get(f"{coefficient}_{surface}")
        if variable != quantity or power is None or name not in flight:
            continue
        arm = power.value * per
        one = flight[name].nearest(given)
        if not arm or not (one.determined and power.determined):
            continue
        ratio = (one.value - given) / arm
        stated = (aircraft.relative_uncertainty or criteria.parts.tenth) * abs(given / arm)
        share = criteria.size.share * one.value / arm
        std = float(np.linalg.norm([one.std / arm, share, ratio * power.std / power.value]))
        yield _Ratio(name=name, coefficient=coefficient, variable=variable, ratio=ratio, std=std, stated=stated)


def _distances(aircraft: Aircraft, flight: Mapping[str, FlightValue], criteria: Criteria) -> Iterator[_Ratio]:
    """Yield, by each moment derivative that flight determines, the distance of the reference point of the file ahead of
    the centre of gravity that makes its difference, as the force that has the same variable acts there."""
    force, sign = ("CL", 1.0) if aircraft.force_axes == "wind" else ("CZ", -1.0)
    arms = {"Cm": (force, sign, aircraft.moment_length_pitch), "Cn": ("CY", 1.0, aircraft.moment_length_lateral)}
    for name, given in aircraft.derivatives.items():
        coefficient, term = derivative_term(name)
        variable = name.partition("_")[2]
        beside, sign, length = arms.get(coefficient, ("", 0.0, 1.0))
        arm = sign * aircraft.derivatives.get(f"{beside}_{variable}", 0.0) / length
        if not arm or term.degree > 1 or name not in flight or not flight[name].determined:
            continue
        one = flight[name].nearest(given)
        std = math.hypot(one.std, criteria.size.share * one.value)
        stated = (aircraft.relative_uncertainty or criteria.parts.tenth) * abs(given)
        yield _Ratio(
            name=name,
            coefficient=coefficient,
            variable=variable,
            ratio=(one.value - given) / arm,
            std=std / abs(arm),
            stated=stated / abs(arm),
        )


def _ratios(
    aircraft: Aircraft, flight: Mapping[str, FlightValue], criteria: Criteria, slopes: Mapping[str, float]
) -> list[_Ratio]:
    """List the ratio of flight to file for the derivatives that flight determines; a constant has no slope to be
    scaled."""
    found = []
    for name, value in aircraft.derivatives.items():
        coefficient, term = derivative_term(name)
        beside = slopes.get(name, 0.0)
        given = value + beside
        if term.degree != 1 or not given or name not in flight or not flight[name].determined:
            continue
        one = flight[name].nearest(value)
        ratio = (one.value + beside) / given
        std = math.hypot(one.std / given, criteria.size.share * ratio)
        stated = aircraft.relative_uncertainty or criteria.parts.tenth
        variable = term.factors[0][0]
        found.append(_Ratio(name=name, coefficient=coefficient, variable=variable, ratio=ratio, std=std, stated=stated))
    return found


def _common(
    members: Sequence[_Ratio], criteria: Criteria, null: float, least: float
) -> tuple[float, float, float] | None:
    """The number that all members have in common, its 1-sigma, and 2 ln of its odds; None where there is none, or where
    it differs from that of a right file (`null`) by less than `least`."""
    if len(members) < 2:
        return None
    weights = [one.std**-2 for one in members]
    value = math.fsum(w * one.ratio for w, one in zip(weights, members, strict=True)) / math.fsum(weights)
    std = math.fsum(weights) ** -0.5
    sigmas = criteria.significance.sigmas
    alike = all(abs(one.ratio - value) <= sigmas * one.std for one in members)
    other = abs(value - null) > max(sigmas * std, least)
    each = sum(abs(one.ratio - null) > sigmas * one.std for one in members)
    # One of many groups is alike by chance more often than one would be.
    together = _deviance(members, value, 0.0) + math.log(len(members)) + 2.0 * math.log(_TRIED)
    statistic = _deviance(members, null, 1.0) - together
    likelier = statistic > criteria.significance.chance
    return (value, std, statistic) if alike and other and likelier and each >= 2 else None


def _deviance(members: Sequence[_Ratio], about: float, errors: float) -> float:
    """-2 ln L of the members, up to a constant, about one value, with `errors` times those that the file states."""
    variances = [one.std**2 + (errors * one.stated) ** 2 for one in members]
    return math.fsum((one.ratio - about) ** 2 / v + math.log(v) for one, v in zip(members, variances, strict=True))


def borne_out(
    doubts: Sequence[Doubt],
    aircraft: Aircraft,
    flight: Mapping[str, FlightValue],
    criteria: Criteria | None = None,
    slopes: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Doubt, ...]:
    """The doubts without those about a unit that flight refutes.

    A unit scales every derivative that it touches by a known factor. It is reported only when the re-estimated value of
    each of them is nearer to that factor than to the file, on the scale of logarithms. `slopes` are those of
    derivatives by tables and own aerodynamics, to which the derivatives of the file are increments.
    """
    ratios = _ratios(aircraft, flight, criteria or Criteria(), slopes)
    kept = []
    known = dict.fromkeys((*FILE_UNITS, *file_units(aircraft)))
    for doubt in doubts:
        units = [unit for unit in known if unit.parameter == doubt.parameter]
        refuted = [_refuted(unit.scale_of, ratios) for unit in units]
        if not (units and all(refuted)):
            kept.append(doubt)
    return tuple(kept)


def _refuted(scale_of: Callable[[str, str], float], ratios: Sequence[_Ratio]) -> bool:
    """Return True if a derivative that depends on the unit is nearer to the file than to the value that the unit
    implies."""
    for one in ratios:
        scale = scale_of(one.coefficient, one.variable)
        if scale == 1.0:
            continue
        if one.ratio <= 0.0 or abs(math.log(one.ratio / scale)) > abs(math.log(one.ratio)):
            return True
    return False
