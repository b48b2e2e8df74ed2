"""How the trajectory is represented: one simulation, many short ones, or polynomials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from casid.arguments import number, numbers_by_name, whole
from casid.errors import InputError


@dataclass(frozen=True, kw_only=True)
class SingleShooting:
    """One simulation per record from its initial state."""


@dataclass(frozen=True, kw_only=True)
class MultipleShooting:
    """Simulations over `interval` samples each, tied by defects: the state at the end of one minus the next start.

    process_noise   None: defects vanish at the solution. Otherwise name -> intensity, the standard deviation of the
                    integrated noise after one second [unit * sqrt(s) of the quantity it drives]: a state name is noise
                    on that state equation, a disturbance name of the model enters through df/dw. Defects then are
                    random with the covariance that this noise gains over the interval, and are paid for in the cost.
    Raises InputError for an interval below one sample or an intensity that is not positive.
    """

    interval: int = 25
    process_noise: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        whole(self.interval, "MultipleShooting: interval (samples)")
        for name, intensity in numbers_by_name(self.process_noise or {}, "MultipleShooting: process_noise").items():
            number(intensity, f"MultipleShooting: process noise of '{name}'", positive=True)


@dataclass(frozen=True, kw_only=True)
class Collocation:
    """Polynomials of `degree` over each sample interval that satisfy the state equations at Gauss-Radau points."""

    degree: int = 3

    def __post_init__(self) -> None:
        if whole(self.degree, "Collocation: degree") > 9:
            raise InputError(f"Collocation: degree is {self.degree}; expected 1 to 9")


Transcription = SingleShooting | MultipleShooting | Collocation
