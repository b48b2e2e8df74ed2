"""A number of the aircraft file beside what was fitted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from casid.diagnosis.given.flight_values import FlightValue


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A derivative, term or effect of the aircraft file in `unit`: its value there (0 where the file has none), fitted
    with the structure of the file, and in the extended model; `*_std` 1-sigma (Cramer-Rao). `flight` is what the
    records say of it by themselves, with honest deviation."""

    name: str
    unit: str
    a_priori: float
    refitted: float
    refitted_std: float
    extended: float
    extended_std: float
    flight: FlightValue

    @property
    def change(self) -> float:
        """What the extension moved it by, in 1-sigmas of both."""
        return (self.extended - self.refitted) / math.hypot(self.refitted_std, self.extended_std)

    def to_dict(self) -> dict[str, Any]:
        return {
            "unit": self.unit,
            "a_priori": self.a_priori,
            "refitted": {"value": self.refitted, "std": self.refitted_std},
            "extended": {"value": self.extended, "std": self.extended_std},
            "flight": {"value": self.flight.value, "std": self.flight.std, "told": self.flight.determined},
        }
