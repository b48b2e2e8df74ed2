"""The user's own aerodynamics: tables, and whatever computes the six coefficients, from a Python function to JSBSim.

The derivatives and terms of an aircraft file are increments on top of these. What depends on the rates of the flow
angles makes them depend on themselves; as they enter linearly, one Newton step from zero is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, Protocol, runtime_checkable

import casadi as ca

from casid.errors import InputError, check_known, unknown
from casid.model.tables import Table

Aerodynamics = Callable[[Any], Mapping[str, Any]]
RATES = ("alphadot", "betadot")
# what a function of the aerodynamics may look at beside the regressors of `terms.VARIABLES`
FURTHER = ("airspeed", "qbar", "rho", "thrust")


@runtime_checkable
class Tabulated(Protocol):
    """Aerodynamics inside of which there are tables."""

    @property
    def tables(self) -> tuple[Table, ...]:
        """Those that are a part of a coefficient, over regressors."""
        ...

    def of_table(self, one: Table, s: Mapping[str, Any]) -> dict[str, Any]:
        """Coefficient -> by how much it grows with the values of one of `tables`, expressions in the quantities `s`."""
        ...


@runtime_checkable
class FileAerodynamics(Protocol):
    """Aerodynamics of another simulator's file. `casid.formats` reads and writes such files."""

    @property
    def format(self) -> str:
        """The key of [aerodynamics] that names the file: "jsbsim" or "daveml"."""
        ...

    @property
    def path(self) -> str:
        """The file."""
        ...

    @property
    def text(self) -> str:
        """Text of the file, with what it includes."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """List what of the file is left out, and what is held."""
        ...

    def section(self) -> dict[str, Any]:
        """Keys and values of [aerodynamics] from which these aerodynamics are read again."""
        ...

    def rewritten(self, text: str, terms: Mapping[str, Mapping[str, float]], effects: Sequence[Any]) -> str:
        """The `text` of the file with further terms, coefficient -> monomial -> value, and effects."""
        ...


def own_coefficients(
    aerodynamics: Aerodynamics, quantities: Mapping[str, Any], valid: tuple[str, ...]
) -> dict[str, Any]:
    """Coefficient -> what a function of the aerodynamics makes of the quantities. Raises InputError for a name that is
    not `valid`, or a quantity that is not there."""
    try:
        found = aerodynamics(SimpleNamespace(**quantities))
    except AttributeError as error:
        missing = error.name or ""
        raise unknown("quantity", missing, quantities, "aerodynamics") from None
    if not isinstance(found, Mapping):
        raise InputError(f"aerodynamics must return coefficients by name, {', '.join(valid)}; got {type(found)}")
    check_known("coefficient", found, valid, "aerodynamics")
    return {name: ca.SX(value) for name, value in found.items()}


def consistent(rates: ca.SX, symbols: ca.SX) -> ca.SX:
    """The rates z = r(z) for an r that is linear in z: (I - dr/dz)^-1 r(0), a and b of two rates by Cramer's rule."""
    at_zero = [ca.SX.zeros(2)]
    r = ca.substitute([rates], [symbols], at_zero)[0]
    slope = ca.substitute([ca.jacobian(rates, symbols)], [symbols], at_zero)[0]
    A = ca.SX.eye(2) - slope
    determinant = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    return ca.vertcat(A[1, 1] * r[0] - A[0, 1] * r[1], A[0, 0] * r[1] - A[1, 0] * r[0]) / determinant
