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
    effectiveness: float = number(
        0.05,
        "1-sigma of the effectiveness of a rotor for which the file states none",
        "measured: normal flights of one airframe scatter by 2 to 5 % (CrazyPAD)",
    )
    smallest: float = number(0.3, "smallest size of a state, in SI, whose initial value is taken as unknown")
    disturbed: float = number(0.03, "part of the weight at which the search for the size of disturbances begins")
    widest: float = number(3000.0, "factor by which a disturbance may be smaller than at the beginning of that search")
    unread: float = number(100.0, "the same where no reading has the disturbance, and by which any may be larger")
