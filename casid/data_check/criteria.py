"""Criteria for faults of the data: every number with its unit, meaning and evidence.

What has no evidence of its own is known to one of four grades: `close`, `fair`, `rough` or `usual`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from casid.criterion import number


@dataclass(frozen=True, kw_only=True)
class DataCriteria:
    """Prior odds of faults, odds for a report and for a correction, and the scatter of healthy flights."""

    fault: float = number(
        -6.0,
        "log prior odds of one fault at one channel, and of one axis in another unit beside all of an instrument",
        "derived: one set of records in five has one, in one of some 80 ways",
        signed=True,
    )
    said: float = number(math.log(1000.0), "log posterior odds from which a fault is reported", "derived: 1000 to 1")
    close: float = number(
        0.03,
        "what healthy instruments leave: part of a variation by scale errors, lever arms and moving air, difference of "
        "airspeeds that are one, and what one recorder's clock gains on another's",
        "measured: in real flights",
    )
    fair: float = number(
        0.15,
        "1-sigma of what is known fairly, as a part of it: mean load factor of a test flight, airspeed and density "
        "over those of the trim, density over the standard one, lift in the trim over weight, slope of a flight path "
        "of unknown altitude and its change in a record; a part of its length for the place of an accelerometer; what "
        "flow angles add to each other and to an airspeed; minor derivatives, and what a linear model leaves at least, "
        "as parts of a coefficient's variation; factors within it are one",
        "measured: 0.08 to 0.25 before, each its own; 299 and 300 of 308 drawn faults right",
    )
    rough: float = number(
        0.35,
        "1-sigma of what is known roughly, as a part of it: a derivative of a file, the drag of its trim, and the "
        "point of its moments from the c.g. in lengths of pitching moments; and the smallest resolved slope over a "
        "flow angle, as a part of a force's variation",
        "measured: thrust is within 0.16 of the drag in ten flights, files are worse",
    )
    usual: float = number(
        0.8,
        "1-sigma of the logarithm of airspeed, density and thrust over what is usual, and of thrust over that of the "
        "trim",
        "derived: 20 to 500 m/s, and sea level to 16 km, are within two",
    )
    usual_v: float = number(100.0, "usual airspeed", unit="m/s")
    usual_rho: float = number(0.7, "usual density", unit="kg/m3")
    usual_thrust: float = number(0.1, "usual thrust over weight")
    usual_span: float = number(
        10.0, "length of lateral moments where no aircraft file has one, and distance of a vane ahead", unit="m"
    )
    angle: float = number(0.05, "1-sigma of a mean angle by biases and upwash", unit="rad")
    bias_rate: float = number(
        0.01, "1-sigma of what biases leave of a mean rate", "measured: 0.019 in a raw Twin Otter", unit="rad/s"
    )
    late: float = number(
        0.2,
        "1-sigma of the delay of one instrument against another",
        "measured: 0.02 in a Twin Otter, 0.5 in a Tu-144",
        unit="s",
    )
    slow: float = number(
        4.0,
        "window of what gravity and drag change, and time constant over which sideslip is integrated from the motion",
        "chosen: longer than a Dutch roll, shorter than what biases need to add up to a sideslip",
        unit="s",
    )
    outlier: float = number(
        0.05,
        "prior probability that one derivative of a coefficient is wrong by more than `rough`",
        "derived: one in five coefficients of four derivatives has one",
    )
    outlying: float = number(
        3.0,
        "1-sigma of such a derivative and of one without a stated uncertainty, as a part of it; and ratio of tried and "
        "predicted size of a nonlinear effect above which the prediction is not valid",
    )
    balance: float = number(
        0.05,
        "1-sigma of the pitching moment coefficient that a file leaves in trim",
        "measured: 0.06 at most in 13 files whose values are 10 to 30 % off, and in those of real flights",
    )
    level_bank: float = number(0.5, "bank up to which the climb angle is theta - alpha", unit="rad")
    smallest_deflection: float = number(
        0.004, "range of a surface below which it excites nothing", "chosen: 0.2 deg", unit="rad"
    )
    fewest: int = number(
        6,
        "samples of a window at least, of which as many are kept, and windows in a record",
    )
    steps: int = number(
        8,
        "iterations at most to the least errors of a lift curve, and to a delay and a drift between channels; and "
        "faults of one set of records",
        "measured: four and two settle them",
    )

    @property
    def quick(self) -> float:
        """Window [s] of rates of rotation."""
        return self.slow / 8.0

    @property
    def resolved(self) -> float:
        """Part of a window's samples that must be there, and of two sides of a relation that may be unlike where it
        tells of time: what is not known roughly."""
        return 1.0 - self.rough

    @property
    def impossible(self) -> float:
        """Log likelihood of a level at least: odds of rounding are impossible anyhow."""
        return math.log(np.finfo(float).eps)

    @property
    def own_scale(self) -> float:
        """Factor up to which a scale error or a stretched time is no question of units: an error that is usual of what
        is known roughly."""
        return 1.0 + self.rough

    @property
    def alone(self) -> float:
        """Log odds to the next explanation from which a fault is corrected: 100 to 1."""
        return 2.0 / 3.0 * self.said

    @property
    def against(self) -> float:
        """Log odds at which a record contradicts a fault, and from which a unit of the file is reported, as nothing is
        changed: 10 to 1."""
        return self.said / 3.0

    @property
    def most_told(self) -> float:
        """Largest log odds of a fault that are reported, 1e6 to 1: what healthy records do is not known better."""
        return 2.0 * self.said

    @property
    def sure(self) -> float:
        """Distance of a free derivative from the sign of the file [1-sigmas] at these odds."""
        return -float(ndtri(math.exp(-self.most_told)))
