"""What the signal path and the causes read of an aircraft: its numbers, whatever file they came from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from casid.errors import InputError
from casid.model.aerodynamics import Aerodynamics
from casid.model.aircraft_file import number
from casid.model.tables import Table

INERTIAS = ("Ixx", "Iyy", "Izz", "Ixz")


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Inertia tensor [kg m2]: [[Ixx, 0, -Ixz], [0, Iyy, 0], [-Ixz, 0, Izz]]. InputError unless positive definite."""

    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float

    def __post_init__(self) -> None:
        for name in INERTIAS:
            value = number(getattr(self, name), f"inertia: '{name}'", positive=name != "Ixz")
            object.__setattr__(self, name, value)
        limit = math.sqrt(self.Ixx) * math.sqrt(self.Izz)
        if abs(self.Ixz) >= limit:
            raise InputError(
                f"inertia: the tensor is not positive definite, 'Ixz' must stay within +-sqrt(Ixx Izz) = {limit:.5g}, "
                f"got {self.Ixz:.5g}"
            )

    @property
    def notes(self) -> tuple[str, ...]:
        """What no rigid body can have: a principal moment above the sum of the other two. Empty when all is well."""
        mean, spread = (self.Ixx + self.Izz) / 2, math.hypot((self.Ixx - self.Izz) / 2, self.Ixz)
        principal = sorted((mean - spread, mean + spread, self.Iyy))
        if principal[2] <= (principal[0] + principal[1]) * (1.0 + 1e-12):
            return ()
        a, b, c = principal
        return (f"inertia: no rigid body has principal moments {a:.4g}, {b:.4g}, {c:.4g}: one exceeds the other two",)


class Airframe(Protocol):
    """The numbers of an aircraft, as `Aircraft` documents them, in SI and body axes from the centre of gravity."""

    @property
    def mass(self) -> float: ...
    @property
    def inertia(self) -> Inertia: ...
    @property
    def gravity(self) -> float: ...
    @property
    def area(self) -> float: ...
    @property
    def moment_length_lateral(self) -> float: ...
    @property
    def moment_length_pitch(self) -> float: ...
    @property
    def rate_length_lateral(self) -> float: ...
    @property
    def rate_length_pitch(self) -> float: ...
    @property
    def thrust_line_z(self) -> float: ...
    @property
    def accelerometer(self) -> tuple[float, ...]: ...
    @property
    def alpha_vane(self) -> tuple[float, ...]: ...
    @property
    def beta_vane(self) -> tuple[float, ...]: ...
    @property
    def noise(self) -> Mapping[str, float]: ...
    @property
    def trim(self) -> Mapping[str, float]: ...
    @property
    def force_axes(self) -> str: ...
    @property
    def derivatives(self) -> Mapping[str, float]: ...
    @property
    def terms(self) -> Mapping[str, Mapping[str, float]]: ...
    @property
    def tables(self) -> tuple[Table, ...]: ...
    @property
    def aerodynamics(self) -> Aerodynamics | None: ...
