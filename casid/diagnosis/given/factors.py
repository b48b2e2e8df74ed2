"""Common factors: one number by which a group of derivatives differs from the file, and what it may mean.

A wrong inertia, length, area, mass or gearing scales a whole group of derivatives by one number. If one number fits as
well as free derivatives, it is reported first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from casid.data_check.relations import FILE_UNITS
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.given.contradicted import FlightValue
from casid.model.aircraft import Aircraft
from casid.model.numbers import with_deviation
from casid.model.plausible import Doubt
from casid.model.terms import derivative_term
from casid.signals import SURFACES

_FORCES, _MOMENTS = ("CL", "CD", "CY", "CX", "CZ"), ("Cl", "Cm", "Cn")


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A factor common to a group of derivatives.

    Attributes
    ----------
    row
        The group in words, as "Cm" or "all derivatives with delta_e".
    factor, std
        Flight over file, and its 1-sigma.
    means
        What in the file may be wrong by that factor or its inverse.
    derivatives
        Names of the derivatives that it stands for.
    """

    row: str
    factor: float
    std: float
    means: tuple[str, ...]
    derivatives: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """What flight says of the group, and what it may mean."""
        causes = " or ".join([", ".join(self.means[:-1]), self.means[-1]] if self.means[1:] else self.means)
        return (
            f"{self.row}: {', '.join(self.derivatives)} are {with_deviation(self.factor, self.std)} times the values "
            f"of the file, all by the same factor. Look first at {causes}."
        )

    def to_dict(self) -> dict[str, Any]:
        """One entry of `factors` in diagnosis.json."""
        return {
            "row": self.row,
            "factor": self.factor,
            "std": self.std,
            "means": list(self.means),
            "derivatives": list(self.derivatives),
            "sentence": self.sentence,
        }


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


@dataclass(frozen=True, kw_only=True)
class _Ratio:
    """Flight value over file value of a derivative, and its 1-sigma with the usual misfit of a linear structure."""

    name: str
    coefficient: str
    variable: str
    ratio: float
    std: float


def common_factors(
    aircraft: Aircraft,
    flight: Mapping[str, FlightValue],
    criteria: Criteria | None = None,
    slopes: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Factor, ...]:
    """The common factors of groups of derivatives, the largest group first. A derivative is in one group at most.

    A group has a common factor if every derivative that flight determines is consistent with it, and if the factor
    differs from 1 by more than its standard deviations and by more than 10 %. At least two derivatives are required.
    `slopes` are those of derivatives by tables and own aerodynamics, to which the derivatives of the file are
    increments.
    """
    by = criteria or Criteria()
    left, found = _ratios(aircraft, flight, by, slopes), []
    for group in _GROUPS:
        members = [one for one in left if group.holds(one.coefficient, one.variable)]
        scope = {(one.coefficient, one.variable) for one in members}
        if len(scope) < 2 or (factor := _common(members, by)) is None:
            continue
        value, std = factor
        names = tuple(one.name for one in members)
        found.append(Factor(row=group.row, factor=value, std=std, means=group.means, derivatives=names))
        left = [one for one in left if one.name not in names]
    return tuple(found)


def _ratios(
    aircraft: Aircraft, flight: Mapping[str, FlightValue], criteria: Criteria, slopes: Mapping[str, float]
) -> list[_Ratio]:
    """Of the derivatives that flight determines; a constant has no slope to be scaled."""
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
        found.append(_Ratio(name=name, coefficient=coefficient, variable=term.factors[0][0], ratio=ratio, std=std))
    return found


def _common(members: Sequence[_Ratio], criteria: Criteria) -> tuple[float, float] | None:
    """The common factor and its 1-sigma; None where there is none."""
    weights = [one.std**-2 for one in members]
    value = math.fsum(w * one.ratio for w, one in zip(weights, members, strict=True)) / math.fsum(weights)
    std = math.fsum(weights) ** -0.5
    by, sigmas = criteria.prior, criteria.significance.sigmas
    alike = all(abs(one.ratio - value) <= sigmas * one.std for one in members)
    other = abs(value - 1.0) > max(sigmas * std, by.unstated)
    each = sum(abs(one.ratio - 1.0) > sigmas * one.std for one in members)
    return (value, std) if alike and other and value > 0.0 and each >= 2 else None


def borne_out(doubts: Sequence[Doubt], aircraft: Aircraft, flight: Mapping[str, FlightValue]) -> tuple[Doubt, ...]:
    """The doubts without those about a unit that flight refutes.

    A unit scales every derivative that it touches by a known factor. It is said only when the re-estimated value of
    each of them is nearer to that factor than to the file, on the scale of logarithms.
    """
    ratios = _ratios(aircraft, flight, Criteria(), {})
    kept = []
    for doubt in doubts:
        units = [unit for unit in FILE_UNITS if unit.parameter == doubt.parameter]
        refuted = [_refuted(unit.scale_of, ratios) for unit in units]
        if not (units and all(refuted)):
            kept.append(doubt)
    return tuple(kept)


def _refuted(scale_of: Callable[[str, str], float], ratios: Sequence[_Ratio]) -> bool:
    """Whether a derivative that depends on the unit is nearer to the file than to the value that the unit implies."""
    for one in ratios:
        scale = scale_of(one.coefficient, one.variable)
        if scale == 1.0:
            continue
        if one.ratio <= 0.0 or abs(math.log(one.ratio / scale)) > abs(math.log(one.ratio)):
            return True
    return False
