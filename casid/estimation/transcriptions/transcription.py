"""How the trajectory is represented: one simulation, many short ones, or polynomials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from casid.errors import EstimationError


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
    Raises EstimationError for an interval below one sample or an intensity that is not positive.
    """

    interval: int = 25
    process_noise: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if self.interval < 1:
            raise EstimationError(f"MultipleShooting: interval is {self.interval} samples; expected at least 1")
        for name, intensity in (self.process_noise or {}).items():
            if not intensity > 0:
                raise EstimationError(f"MultipleShooting: process noise of '{name}' is {intensity}; expected > 0")


@dataclass(frozen=True, kw_only=True)
class Collocation:
    """Polynomials of `degree` over each sample interval that satisfy the state equations at Gauss-Radau points."""

    degree: int = 3

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= 9:
            raise EstimationError(f"Collocation: degree is {self.degree}; expected 1 to 9")


Transcription = SingleShooting | MultipleShooting | Collocation
