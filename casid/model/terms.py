"""Monomials of aerodynamic regressors: `alpha^2`, `alpha*beta`, `q`, ...; read by a small parser, never as code.

Variables and their meaning inside a term (all dimensionless or in rad):
    alpha, beta                  angle of attack, sideslip angle [rad]
    p, q, r                      the dimensionless rates p*, q*, r* of the derivatives: rate times rate length over V
    delta_e, delta_a, delta_r    surface deflections [rad]
    mach                         Mach number
    alphadot, betadot            made dimensionless like q and r
    V                            the relative speed change (V - V_trim) / V_trim
    Tc                           the thrust coefficient, thrust over dynamic pressure and reference area
The constant term is written `0`, as in `CL_0`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from casid.errors import InputError, unknown

VARIABLES = ("alpha", "beta", "p", "q", "r", "delta_e", "delta_a", "delta_r", "mach", "alphadot", "betadot", "V", "Tc")
COEFFICIENTS = ("CL", "CD", "CY", "CX", "CZ", "Cl", "Cm", "Cn")
_PURE_NUMBERS = ("mach", "V", "Tc")
_MAX_POWER = 9
_FACTOR = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\^\s*([1-9]))?\s*", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Term:
    """A monomial: `factors` are (variable, power) in the order of VARIABLES, powers from 1; empty is the constant."""

    factors: tuple[tuple[str, int], ...]

    @property
    def name(self) -> str:
        """Canonical spelling, one per monomial: `beta*alpha` is `alpha*beta`, `alpha*alpha` is `alpha^2`."""
        return "*".join(v if power == 1 else f"{v}^{power}" for v, power in self.factors) or "0"

    def __str__(self) -> str:
        return self.name

    @property
    def degree(self) -> int:
        """Sum of the powers; 0 for the constant."""
        return sum(power for _, power in self.factors)

    @property
    def unit(self) -> str:
        """Unit of the term's coefficient: "1", "1/rad", "1/rad2", ...; the Mach number, V and Tc are pure numbers."""
        angles = sum(power for variable, power in self.factors if variable not in _PURE_NUMBERS)
        return "1" if angles == 0 else "1/rad" if angles == 1 else f"1/rad{angles}"

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """The product of the factors; `values` holds floats, arrays of one shape, or CasADi expressions by variable.

        The constant term gives 1.0. Raises InputError when a variable has no value.
        """
        product: Any = 1.0
        for index, (variable, power) in enumerate(self.factors):
            if variable not in values:
                raise InputError(f"term '{self.name}': no value for '{variable}'; given are {sorted(values)}")
            factor = values[variable] if power == 1 else values[variable] ** power
            product = factor if index == 0 else product * factor
        return product


def parse_term(text: str, where: str = "") -> Term:
    """The Term that `text` spells, e.g. `alpha*beta^2`; `where` names the place in messages.

    Raises InputError for an unknown variable, a power that is not 1..9, and everything that is no monomial.
    """
    prefix = f"{where}: " if where else ""
    if text.strip() == "0":
        return Term(factors=())
    powers: dict[str, int] = {}
    for factor in text.split("*"):
        match = _FACTOR.fullmatch(factor)
        if not match:
            raise InputError(
                f"{prefix}'{text}' is not a monomial; expected variables with powers 1 to {_MAX_POWER}, "
                "like 'alpha^2' or 'alpha*delta_e'"
            )
        variable, power = match[1], int(match[2] or 1)
        if variable not in VARIABLES:
            raise unknown("variable", variable, VARIABLES, f"{prefix}term '{text}'")
        powers[variable] = powers.get(variable, 0) + power
        if powers[variable] > _MAX_POWER:
            raise InputError(f"{prefix}term '{text}': '{variable}' has a power above {_MAX_POWER}")
    return Term(factors=tuple((v, powers[v]) for v in VARIABLES if v in powers))


def derivative_term(name: str, where: str = "", coefficients: Iterable[str] = COEFFICIENTS) -> tuple[str, Term]:
    """Coefficient and term of a parameter: `Cm_delta_e` -> ("Cm", delta_e), `CL_0` -> ("CL", constant).

    Further terms follow the same rule, `Cm_alpha*beta` -> ("Cm", alpha*beta). `coefficients` are those allowed.
    Raises InputError with the nearest name.
    """
    allowed = tuple(coefficients)
    coefficient, _, regressor = name.partition("_")
    plain = ("0", *VARIABLES)
    if coefficient not in allowed or (regressor not in plain and not set(regressor) & set("*^")):
        likely = [c for c in allowed if name.startswith(c)] or allowed
        raise unknown("derivative", name, [f"{c}_{v}" for c in likely for v in plain], where)
    return coefficient, parse_term(regressor, f"{where}: '{name}'" if where else f"'{name}'")


def derivative_name(coefficient: str, term: Term) -> str:
    """The parameter's name, inverse of `derivative_term`: ("Cm", delta_e) -> `Cm_delta_e`."""
    return f"{coefficient}_{term.name}"
