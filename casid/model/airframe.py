"""Give the signal path and the causes the numbers of an aircraft, whatever file they came from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.arguments import number
from casid.errors import InputError
from casid.model.aerodynamics import Aerodynamics
from casid.model.rotors import Rotors
from casid.model.tables import Table

AXES_COEFFICIENTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "wind": ("CL", "CD", "CY", "Cl", "Cm", "Cn"),
        "body": ("CX", "CZ", "CY", "Cl", "Cm", "Cn"),
        "accelerations": ("CX", "CZ", "CY", "Cl", "Cm", "Cn"),
    }
)
INERTIAS = ("Ixx", "Iyy", "Izz", "Ixz")
PRODUCTS = ("Ixy", "Iyz")  # of an aircraft that is not symmetric
POSITIONS = ("accelerometer", "alpha_vane", "beta_vane")  # of instruments
_ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Inertia tensor [[Ixx, -Ixy, -Ixz], [-Ixy, Iyy, -Iyz], [-Ixz, -Iyz, Izz]] in body axes.

    Attributes
    ----------
    Ixx, Iyy, Izz
        Moments of inertia [kg m2].
    Ixz, Ixy, Iyz
        Products of inertia [kg m2]; Ixy and Iyz are zero for a symmetric aircraft.

    Raises
    ------
    InputError
        If the tensor is not positive definite.

    Examples
    --------
    >>> import casid as cs
    >>> inertia = cs.Inertia(Ixx=200e3, Iyy=330e3, Izz=480e3, Ixz=13e3)
    >>> inertia.symmetric
    True
    """

    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float
    Ixy: float = 0.0
    Iyz: float = 0.0

    def __post_init__(self) -> None:
        for name in (*INERTIAS, *PRODUCTS):
            diagonal = name not in ("Ixz", *PRODUCTS)
            value = number(getattr(self, name), f"inertia: '{name}'", positive=diagonal)
            object.__setattr__(self, name, value)
        limit = math.sqrt(self.Ixx) * math.sqrt(self.Izz)
        if abs(self.Ixz) >= limit:
            raise InputError(
                f"inertia: the tensor is not positive definite, 'Ixz' must stay within +-sqrt(Ixx Izz) = {limit:.5g}, "
                f"got {self.Ixz:.5g}"
            )
        if not self.symmetric and np.linalg.eigvalsh(self.tensor)[0] <= 0.0:
            raise InputError("inertia: the tensor is not positive definite; make 'Ixy' and 'Iyz' smaller")

    @property
    def symmetric(self) -> bool:
        """Return True if the plane x-z is one of symmetry."""
        return self.Ixy == 0.0 and self.Iyz == 0.0

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3) [kg m2] in body axes."""
        return np.array(
            [
                [self.Ixx, -self.Ixy, -self.Ixz],
                [-self.Ixy, self.Iyy, -self.Iyz],
                [-self.Ixz, -self.Iyz, self.Izz],
            ]
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """List a principal moment that exceeds the sum of the other two, which no rigid body has. Empty when all is
        well."""
        mean = (self.Ixx + self.Izz) / 2
        spread = math.hypot((self.Ixx - self.Izz) / 2, self.Ixz)
        principal = sorted((mean - spread, mean + spread, self.Iyy))
        if not self.symmetric:
            principal = [float(one) for one in np.linalg.eigvalsh(self.tensor)]
        if principal[2] <= (principal[0] + principal[1]) * (1.0 + 1e-12):
            return ()
        a, b, c = principal
        return (f"inertia: no rigid body has principal moments {a:.4g}, {b:.4g}, {c:.4g}: one exceeds the other two",)


def unsymmetric_moment(inertia: Mapping[str, Any], rates: Sequence[Any], accelerations: Sequence[Any]) -> list[Any]:
    """Return what Ixy and Iyz add to the moments L, M, N that turn an aircraft with `rates` p, q, r and their
    derivatives."""
    (p, q, r), (pdot, qdot, rdot) = rates, accelerations
    xy = inertia["Ixy"]
    yz = inertia["Iyz"]
    return [
        xy * (p * r - qdot) + yz * (r**2 - q**2),
        -xy * (pdot + q * r) + yz * (p * q - rdot),
        xy * (q**2 - p**2) - yz * (qdot + p * r),
    ]


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """The numbers of an aircraft as `Aircraft`, which checks them, documents them: what effects know of it."""

    name: str
    mass: float
    inertia: Inertia
    gravity: float = 9.80665
    area: float = math.nan
    moment_length_lateral: float = math.nan
    moment_length_pitch: float = math.nan
    rate_length_lateral: float = math.nan
    rate_length_pitch: float = math.nan
    thrust_line_z: float = 0.0
    engine_y: tuple[float, ...] = ()
    accelerometer: tuple[float, ...] = _ORIGIN
    alpha_vane: tuple[float, ...] = _ORIGIN
    beta_vane: tuple[float, ...] = _ORIGIN
    noise: Mapping[str, float] = field(default_factory=dict)
    trim: Mapping[str, float] = field(default_factory=dict)
    force_axes: str = "wind"
    relative_uncertainty: float = 0.0
    derivatives: Mapping[str, float] = field(default_factory=dict)
    terms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    std: Mapping[str, float] = field(default_factory=dict)
    aerodynamics: Aerodynamics | None = None
    rotors: Rotors | None = None

    @property
    def winged(self) -> bool:
        """Return True if the aircraft has aerodynamics."""
        return bool(self.derivatives or self.terms or self.tables or self.aerodynamics)

    @property
    def required_rotors(self) -> Rotors:
        """The rotors. Raises InputError for an aircraft without any."""
        if self.rotors is None:
            raise InputError(f"aircraft '{self.name}' has no rotors; give them as 'rotors'")
        return self.rotors

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The six coefficients of the force axes."""
        return AXES_COEFFICIENTS[self.force_axes]
