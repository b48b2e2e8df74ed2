"""What decides about faults of the data: every number with its unit, meaning and evidence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


def _number(value: float, unit: str, meaning: str, evidence: str) -> Any:
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "evidence": evidence})


@dataclass(frozen=True, kw_only=True)
class DataCriteria:
    """Prior odds of faults, odds from which one is said and corrected, and how far healthy flight strays."""

    fault: float = _number(
        -6.0, "1", "log prior odds of one fault at one channel", "one column map in five is wrong in one of 80 ways"
    )
    file_sign: float = _number(
        -6.0,
        "1",
        "log prior odds of a derivative with the wrong sign in the aircraft file",
        "as of the record: nothing tells which of the two is the more careful",
    )
    said: float = _number(7.0, "1", "log posterior odds from which a fault is said", "1000 to 1")
    alone: float = _number(
        4.6, "1", "log odds to the next explanation from which it is corrected", "100 to 1; else both are told"
    )
    against: float = _number(
        -3.0, "1", "log likelihood ratio below which a record contradicts a fault", "20 to 1 that it is healthy"
    )
    load_factor: float = _number(
        0.15, "1", "1-sigma of the mean vertical load factor, as a logarithm", "0.03 in 12 real flights of 20 s"
    )
    climb: float = _number(
        20.0, "m/s", "1-sigma of the change of the rate of climb in a record", "a push-over to a pull-up at 100 m/s"
    )
    path_known: float = _number(0.05, "rad", "1-sigma of theta - alpha against the climb", "vane and attitude biases")
    path_unknown: float = _number(0.15, "rad", "the same where no altitude is recorded", "climb angles of transports")
    trim_speed: float = _number(0.3, "1", "1-sigma of log V over the trim's V", "a test point in the same envelope")
    trim_density: float = _number(0.25, "1", "1-sigma of log rho over the trim's", "2 km of altitude")
    trim_thrust: float = _number(1.0, "1", "1-sigma of log thrust over the trim's", "idle to climb power")
    atmosphere: float = _number(0.08, "1", "1-sigma of log rho over the standard one", "ISA +- 25 K")
    lift: float = _number(0.3, "1", "1-sigma of a file's lift curve, as a part", "10 to 30 % of a-priori values")
    derivative: float = _number(
        0.35, "1", "1-sigma of a file's derivative, as a part of it", "10 to 30 % of a-priori values, some twice"
    )
    usual_speed: float = _number(0.8, "1", "1-sigma of log V about 100 m/s", "20 to 500 m/s are 2 sigma")
    slope: float = _number(
        0.3, "1", "part of a force's variation that its slope over a flow angle is told against at least", "lags, gusts"
    )
    bias_rate: float = _number(
        0.01, "rad/s", "1-sigma of what the biases leave of a mean rate", "raw Twin Otter: 0.019"
    )
    bias_force: float = _number(
        0.5, "m/s2", "1-sigma of what the biases leave of a mean acceleration", "raw Twin Otter: 1.1"
    )


CRITERIA = DataCriteria()
