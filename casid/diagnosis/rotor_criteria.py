"""Numbers of a diagnosis that hold for aircraft with rotors alone."""

from __future__ import annotations

from dataclasses import dataclass

from casid.criterion import number


@dataclass(frozen=True, kw_only=True)
class RotorCriteria:
    """Records of aircraft with rotors: their rate, their noise and what is usual of a rotor."""

    rate: float = number(
        30.0,
        "rate to which records are averaged; what is faster in the log of a command is aliased",
        "derived: rotors answer within 0.03 to 0.1 s",
        unit="Hz",
    )
    smallest: float = number(0.3, "smallest size of a state, in SI, whose initial value is taken as unknown")
