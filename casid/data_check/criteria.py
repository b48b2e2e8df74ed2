"""Criteria for faults of the data: every number with its unit, meaning and evidence.

What has no evidence of its own is known to one of four grades: `close`, `fair`, `rough` or `usual`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
        "over those of the trim, lift in the trim over weight, slope of a flight path of unknown altitude; a part of "
        "its length for the place of an accelerometer; what flow angles add to each other and to an airspeed; minor "
        "derivatives as a part of their coefficient's variation; factors within it are one",
        "measured: 0.08 to 0.25 before, each its own; 299 and 300 of 308 drawn faults right",
    )
    rough: float = number(
        0.35,
        "1-sigma of what is known roughly, as a part of it: a derivative of a file, and the drag of its trim; and the "
        "smallest resolved slope over a flow angle, as a part of a force's variation",
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
    climb: float = number(20.0, "1-sigma of the change of the rate of climb in a record", unit="m/s")
    bias_rate: float = number(
        0.01, "1-sigma of what biases leave of a mean rate", "measured: 0.019 in a raw Twin Otter", unit="rad/s"
    )
    late: float = number(
        0.2,
        "1-sigma of the delay of one instrument against another",
        "measured: 0.02 in a Twin Otter, 0.5 in a Tu-144",
        unit="s",
    )
    sideslip_time: float = number(
        5.0,
        "time constant over which sideslip is integrated from the motion",
        "chosen: longer than a Dutch roll, shorter than what biases need to add up to a sideslip",
        unit="s",
    )
    atmosphere: float = number(
        0.08, "1-sigma of the logarithm of rho over the standard one", "derived: 25 K from the standard temperature"
    )
    outlier: float = number(
        0.05,
        "prior probability that one derivative of a coefficient is wrong by more than `rough`",
        "derived: one in five coefficients of four derivatives has one",
    )
    outlying: float = number(3.0, "1-sigma of such a derivative, as a part of it")
    balance: float = number(
        0.05,
        "1-sigma of the pitching moment coefficient that a file leaves in trim",
        "measured: 0.06 at most in 13 files whose values are 10 to 30 % off, and in those of real flights",
    )
    point: float = number(
        0.25,
        "1-sigma of the point of a file's moments from the c.g., in lengths of pitching moments",
        "derived: quarter chord and leading edge, nose and c.g. of usual files, are within two",
    )
    level_bank: float = number(0.5, "bank up to which the climb angle is theta - alpha", unit="rad")
    own_scale: float = number(1.25, "factor up to which a scale error or a stretched time is no question of units")
    smallest_deflection: float = number(
        0.004, "range of a surface below which it excites nothing", "chosen: 0.2 deg", unit="rad"
    )
    quick: float = number(0.5, "window of rates of rotation", unit="s")
    slow: float = number(4.0, "window of what gravity and drag change", unit="s")
    fewest: int = number(6, "samples of a window at least, of which as many are kept, and windows in a record")
    present: float = number(0.5, "part of a window's samples that must be there")
    least: float = number(0.1, "part of a coefficient's variation that a linear model leaves at least")
    faults: int = number(8, "faults of one set of records at most")
    impossible: float = number(
        -60.0, "log likelihood of a level at least: beyond, it is impossible anyhow", signed=True
    )
    steps: int = number(
        8,
        "iterations at most to the least errors of a lift curve, and to a delay and a drift between channels",
        "measured: four and two settle them",
    )
    telling: float = number(0.7, "what two sides of a relation have unlike, up to which it tells of time")

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
