"""Monomials of aerodynamic regressors: `alpha^2`, `alpha*beta`, `beta*|beta|`, ...; read by a small parser, never as
code.

Variables and their meaning inside a term (all dimensionless or in rad):
    alpha, beta                  angle of attack, sideslip angle [rad]
    p, q, r                      the dimensionless rates p*, q*, r* of the derivatives: rate times rate length over V
    delta_e, delta_a, delta_r    surface deflections [rad]
    mach                         Mach number
    alphadot, betadot            made dimensionless like q and r
    V                            the relative speed change (V - V_trim) / V_trim
    Tc                           the thrust coefficient, thrust over dynamic pressure and reference area
The constant term is written `0`, as in `CL_0`. `|beta|` is the magnitude of a variable.

A stretch of a variable, `alpha[0.1,0.14,0.24,0.28]`, is a factor too: 1 between the inner two numbers, 0 beyond the
outer ones, straight in between; `-inf` or `inf` twice where it has no end. It is what breakpoints of a table change.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from casid.errors import InputError, check_known, unknown

VARIABLES = ("alpha", "beta", "p", "q", "r", "delta_e", "delta_a", "delta_r", "mach", "alphadot", "betadot", "V", "Tc")
# of the motion in the plane of symmetry, and out of it
IN_PLANE = ("alpha", "q", "delta_e", "alphadot")
OUT_OF_PLANE = ("beta", "p", "r", "delta_a", "delta_r", "betadot")
COEFFICIENTS = ("CL", "CD", "CY", "CX", "CZ", "Cl", "Cm", "Cn")
_PURE_NUMBERS = ("mach", "V", "Tc")
_MAX_POWER = 9
_FACTOR = re.compile(r"\s*(?:([A-Za-z_]\w*)\s*(?:\^\s*([1-9]))?|\|\s*([A-Za-z_]\w*)\s*\|)\s*", re.ASCII)
_STRETCH = re.compile(r"\s*([A-Za-z_]\w*)\s*\[([^\[\]]*)\]\s*", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A part of the range of a variable: 1 between the inner two of its corners, 0 beyond the outer ones."""

    variable: str
    corners: tuple[float, ...]

    @property
    def name(self) -> str:
        """Canonical spelling, corners to six digits."""
        return f"{self.variable}[{','.join(f'{corner:.6g}' for corner in self.corners)}]"

    @property
    def words(self) -> str:
        """For a person, angles in degrees: "alpha 8 to 14 deg", "mach near 0.7", "alpha above 14 deg"."""
        pure = self.variable in _PURE_NUMBERS or self.variable in ("p", "q", "r", "alphadot", "betadot")
        low, high = (f"{x if pure else math.degrees(x):.3g}" for x in self.corners[1:3])
        unit = "" if pure else " deg"
        if not math.isfinite(self.corners[1]):
            return f"{self.variable} below {high}{unit}"
        if not math.isfinite(self.corners[2]):
            return f"{self.variable} above {low}{unit}"
        return f"{self.variable} near {low}{unit}" if low == high else f"{self.variable} {low} to {high}{unit}"

    def evaluate(self, x: Any) -> Any:
        """Its share at x: a float, an array or a CasADi expression."""
        first, begin, end, last = self.corners
        entered = _passed((x - first) * (1.0 / (begin - first))) if math.isfinite(begin) else 1.0
        left = _passed((x - end) * (1.0 / (last - end))) if math.isfinite(end) else 0.0
        return entered - left


def _passed(part: Any) -> Any:
    """Between 0 and 1, of any algebra."""
    return 0.5 * (abs(part) - abs(part - 1.0) + 1.0)


@dataclass(frozen=True, kw_only=True)
class Term:
    """A monomial: `factors` are (variable, power) in the order of VARIABLES, powers from 1; empty is the constant. The
    magnitude of a variable, |beta|, is a factor of power 1. `stretches` multiply it, in the same order."""

    factors: tuple[tuple[str, int], ...]
    stretches: tuple[Stretch, ...] = ()

    @property
    def name(self) -> str:
        """Canonical spelling, one per monomial: `beta*alpha` is `alpha*beta`, `alpha*alpha` and `|alpha|*|alpha|` are
        `alpha^2`."""
        monomial = [v if power == 1 else f"{v}^{power}" for v, power in self.factors]
        return "*".join([*monomial, *(one.name for one in self.stretches)]) or "0"

    def __str__(self) -> str:
        return self.name

    @property
    def variables(self) -> frozenset[str]:
        """Names of the variables of its factors."""
        return frozenset(bare(variable) for variable, _ in self.factors)

    @property
    def degree(self) -> int:
        """Sum of the powers; 0 for the constant."""
        return sum(power for _, power in self.factors)

    @property
    def linear(self) -> bool:
        """Return True for the constant and for one variable alone."""
        return self.degree <= 1 and not any(is_magnitude(variable) for variable, _ in self.factors)

    @property
    def unit(self) -> str:
        """Unit of the term's coefficient: "1", "1/rad", "1/rad2", ...; the Mach number, V and Tc are pure numbers."""
        angles = sum(power for variable, power in self.factors if bare(variable) not in _PURE_NUMBERS)
        return "1" if angles == 0 else "1/rad" if angles == 1 else f"1/rad{angles}"

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """The product of the factors, 1.0 of none; `values` has floats, arrays of one shape, or CasADi expressions by
        variable, or InputError is raised."""
        product: Any = 1.0
        for index, (variable, power) in enumerate(self.factors):
            if bare(variable) not in values:
                raise InputError(f"term '{self.name}': no value for '{bare(variable)}'; given are {sorted(values)}")
            factor = values[bare(variable)] if power == 1 else values[variable] ** power
            factor = abs(factor) if is_magnitude(variable) else factor
            product = factor if index == 0 else product * factor
        for one in self.stretches:
            if one.variable not in values:
                raise InputError(f"term '{self.name}': no value for '{one.variable}'; given are {sorted(values)}")
            product = product * one.evaluate(values[one.variable])
        return product

    def slope(self, variable: str, values: Mapping[str, float]) -> float:
        """Its derivative with respect to a variable, at these values; stretches are taken as constant there."""
        total = 0.0
        for one, power in self.factors:
            if bare(one) == variable:
                lowered = tuple((v, p - (v == one)) for v, p in self.factors)
                rest = Term(factors=tuple((v, p) for v, p in lowered if p), stretches=self.stretches)
                sign = math.copysign(1.0, values[variable]) if is_magnitude(one) else 1.0
                total += power * sign * float(rest.evaluate(values))
        return total


def bare(variable: str) -> str:
    """Return the name of a variable from that of its magnitude, |beta|; its own as it is."""
    return variable.strip("|")


def is_magnitude(variable: str) -> bool:
    """Return True for the magnitude of a variable, |beta|."""
    return variable.startswith("|")


@cache
def parse_term(text: str, where: str = "") -> Term:
    """The Term that `text` spells, e.g. `alpha*beta^2`; `where` names the place in messages. Raises InputError for an
    unknown variable, a power that is not 1..9, and everything that is no monomial."""
    prefix = f"{where}: " if where else ""
    if text.strip() == "0":
        return Term(factors=())
    powers: dict[str, int] = {}
    stretches: dict[str, Stretch] = {}
    for factor in text.split("*"):
        if "[" in factor:
            one = _stretch(factor, f"{prefix}term '{text}'")
            if one.variable in stretches:
                raise InputError(f"{prefix}term '{text}': two stretches of '{one.variable}'; expected one")
            stretches[one.variable] = one
            continue
        match = _FACTOR.fullmatch(factor)
        if not match:
            raise InputError(
                f"{prefix}'{text}' is not a monomial; expected variables with powers 1 to {_MAX_POWER}, "
                "like 'alpha^2', 'alpha*delta_e' or '|beta|'"
            )
        variable = match[1] or match[3]
        check_known("variable", (variable,), VARIABLES, f"{prefix}term '{text}'")
        name = variable if match[1] else f"|{variable}|"
        powers[name] = powers.get(name, 0) + int(match[2] or 1)
        if powers.get(f"|{variable}|", 0) == 2:
            powers[variable] = powers.get(variable, 0) + powers.pop(f"|{variable}|")
        if powers.get(variable, 0) > _MAX_POWER:
            raise InputError(f"{prefix}term '{text}': '{variable}' has a power above {_MAX_POWER}")
    order = [name for variable in VARIABLES for name in (variable, f"|{variable}|")]
    return Term(
        factors=tuple((v, powers[v]) for v in order if v in powers),
        stretches=tuple(stretches[v] for v in VARIABLES if v in stretches),
    )


def _stretch(text: str, where: str) -> Stretch:
    """Return the stretch that a text spells; corners are rounded to six digits."""
    match = _STRETCH.fullmatch(text)
    if not match:
        raise InputError(f"{where}: '{text.strip()}' is no stretch of a variable; expected alpha[0.1,0.14,0.24,0.28]")
    check_known("variable", (match[1],), VARIABLES, where)
    try:
        corners = tuple(float(f"{float(number):.6g}") for number in match[2].split(","))
    except ValueError:
        corners = ()
    if len(corners) != 4 or any(map(math.isnan, corners)):
        raise InputError(f"{where}: '{text.strip()}' needs four numbers: where it sets in, is whole, until there, ends")
    first, begin, end, last = corners
    rises = first < begin if math.isfinite(begin) else first == begin == -math.inf
    falls = end < last if math.isfinite(end) else end == last == math.inf
    if not (rises and falls and begin <= end) or not math.isfinite(first if math.isfinite(begin) else 0.0):
        raise InputError(f"{where}: '{text.strip()}' must ascend; write -inf or inf twice where it has no end")
    if not math.isfinite(last if math.isfinite(end) else 0.0) or not (math.isfinite(begin) or math.isfinite(end)):
        raise InputError(f"{where}: '{text.strip()}' has no end at either side, or one that is not straight")
    return Stretch(variable=match[1], corners=(first, begin, end, last))


def in_words(text: str) -> str:
    """The spelling of a term with its stretches as a person reads them: "alpha 8 to 14 deg"."""
    if "[" not in text:
        return text
    return ", ".join(_stretch(part, text).words if "[" in part else part for part in text.split("*"))


def derivative_term(name: str, where: str = "") -> tuple[str, Term]:
    """Coefficient and term of a parameter: `Cm_delta_e` -> ("Cm", delta_e), `CL_0` -> ("CL", constant), `Cm_alpha*beta`
    -> ("Cm", alpha*beta). Raises InputError with the nearest name."""
    coefficient, _, regressor = name.partition("_")
    plain = ("0", *VARIABLES)
    if coefficient not in COEFFICIENTS or (regressor not in plain and not set(regressor) & set("*^[|")):
        likely = [c for c in COEFFICIENTS if name.startswith(c)] or COEFFICIENTS
        raise unknown("derivative", name, [f"{c}_{v}" for c in likely for v in plain], where)
    return coefficient, parse_term(regressor, f"{where}: '{name}'" if where else f"'{name}'")


def derivative_name(coefficient: str, term: Term) -> str:
    """The parameter's name, inverse of `derivative_term`: ("Cm", delta_e) -> `Cm_delta_e`."""
    return f"{coefficient}_{term.name}"
