"""Criteria for faults of the data: every number with its unit, meaning and evidence."""

from __future__ import annotations

from dataclasses import dataclass

from casid.criterion import number


@dataclass(frozen=True, kw_only=True)
class DataCriteria:
    """Prior odds of faults, odds for a report and for a correction, and the scatter of healthy flights."""

    fault: float = number(
        -6.0,
        "log prior odds of one fault at one channel",
        "derived: one set of records in five has one, in one of some 80 ways",
        signed=True,
    )
    apart: float = number(
        -5.0,
        "log prior odds of one axis of an instrument in another unit, or without gravity, beside all of its axes in "
        "another unit",
        "measured: all axes against one gain -0.4 at least where all are, one against all 7.9 where one is",
        signed=True,
    )
    said: float = number(7.0, "log posterior odds from which a fault is reported", "derived: 1000 to 1")
    most_told: float = number(
        13.8,
        "largest log odds of a fault that are reported",
        "derived: 1e6 to 1; what healthy records do is not known better",
    )
    alone: float = number(4.6, "log odds to the next explanation from which it is corrected", "derived: 100 to 1")
    against: float = number(
        3.0,
        "log odds at which a record contradicts a fault, and from which a unit of the file is reported, as nothing is "
        "changed",
        "derived: 20 to 1; measured: units reach -1.4 at most in real flights that are well",
    )
    load_factor: float = number(0.15, "1-sigma of the logarithm of the mean load factor of a test flight")
    unknown_attitude: float = number(
        0.3, "1-sigma of the same beside that, where no attitude is recorded", "derived: banks of 40 deg"
    )
    sideslip_time: float = number(
        5.0,
        "time constant over which sideslip is integrated from the motion",
        "chosen: longer than a Dutch roll, shorter than what biases need to add up to a sideslip",
        unit="s",
    )
    climb: float = number(20.0, "1-sigma of the change of the rate of climb in a record", unit="m/s")
    path_known: float = number(0.05, "1-sigma of theta - alpha against the climb, by biases", unit="rad")
    path_unknown: float = number(0.15, "1-sigma of the angle of climb where no altitude is recorded", unit="rad")
    trim: float = number(
        0.2,
        "1-sigma of the logarithm of V, and of rho, over that of the trim",
        "derived: one set of derivatives holds no farther; 2 km are 0.2",
    )
    trim_thrust: float = number(1.0, "1-sigma of the logarithm of thrust over that of the trim")
    trim_drag: float = number(
        0.3,
        "1-sigma of the drag of a file's trim, as a part of it; needed thrust below it does not judge a level",
        "measured: thrust is within 0.16 of it in eight simulated and two real flights; files are worse",
    )
    steady_thrust: float = number(
        0.1, "range of a thrust, over its mean, below which its scale is not separated from drag", "chosen"
    )
    path_by_altitude: float = number(0.005, "1-sigma of the angle of climb by the altitude", "chosen", unit="rad")
    atmosphere: float = number(
        0.08, "1-sigma of the logarithm of rho over the standard one", "derived: 25 K from the standard temperature"
    )
    trim_lift: float = number(
        0.1, "1-sigma of the logarithm of lift in the file's trim over weight", "chosen: fuel, thrust, tail"
    )
    angle: float = number(0.02, "1-sigma of the mean of a flow angle, by bias and upwash", unit="rad")
    derivative: float = number(
        0.35, "1-sigma of a file's derivative, as a part of it, and of the logarithm of lift and of its slope"
    )
    outlier: float = number(
        0.05,
        "prior probability that one derivative of a coefficient is wrong by more than `derivative`",
        "derived: one in five coefficients of four derivatives has one",
    )
    outlying: float = number(3.0, "1-sigma of such a derivative, as a part of it", "chosen")
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
    sure: float = number(
        5.0, "distance of a free derivative from the sign of the file", "derived: 1 in 3 million", unit="sigma"
    )
    minor: float = number(
        0.2,
        "1-sigma of a derivative beside that, as the part of its coefficient's variation that it makes, for units",
        "measured: 0.21 r.m.s. of minor ones in seven real flights; CZ_q of one is off by a factor of 2",
    )
    usual: float = number(
        0.8,
        "1-sigma of the logarithm of V over `usual_v`, and of rho over `usual_rho`",
        "derived: 20 to 500 m/s, and sea level to 16 km, are within two",
    )
    usual_rho: float = number(0.7, "density that `usual` is about", unit="kg/m3")
    usual_thrust: float = number(1.5, "1-sigma of the logarithm of thrust over weight, over a tenth")
    usual_thrust_ratio: float = number(0.1, "thrust over weight that `usual_thrust` is about")
    slope: float = number(0.3, "smallest resolved slope over a flow angle, as a part of a force's variation")
    bias_rate: float = number(
        0.01, "1-sigma of what biases leave of a mean rate", "measured: 0.019 in a raw Twin Otter", unit="rad/s"
    )
    bias_force: float = number(
        0.5, "1-sigma of what biases leave of a mean acceleration", "measured: 1.1 in a raw Twin Otter", unit="m/s2"
    )
    level_bank: float = number(0.5, "bank up to which the climb angle is theta - alpha", unit="rad")
    usual_v: float = number(100.0, "airspeed that `usual` is about", unit="m/s")
    accelerometer: float = number(
        0.15,
        "1-sigma of an accelerometer's distance from the c.g. along each axis, over the length of lateral moments",
        "derived: nose and tail, half a span away, are at three",
    )
    usual_span: float = number(10.0, "length of lateral moments where no aircraft file has one", "chosen", unit="m")
    vane_ahead: float = number(8.0, "1-sigma of the place of a vane ahead of the c.g.", unit="m")
    vane_across: float = number(2.0, "1-sigma of the place of a vane across", unit="m")
    upwash: float = number(0.1, "1-sigma of a flow angle's error by the other flow angle, as a part of that")
    static_port: float = number(0.2, "1-sigma of an airspeed's relative error by the angle of attack", unit="1/rad")
    late: float = number(
        0.2,
        "1-sigma of the delay of one instrument against another",
        "measured: 0.02 in a Twin Otter, 0.5 in a Tu-144",
        unit="s",
    )
    drift: float = number(
        0.01,
        "1-sigma of what one recorder's clock gains on another's",
        "chosen: it is then reported as a drift, and not as a unit",
        unit="s/s",
    )
    close: float = number(
        0.03,
        "part of a variation that scale errors, lever arms and moving air may leave, and airspeeds that are one "
        "differ by",
        "measured: in real flights",
    )
    own_scale: float = number(1.25, "factor up to which a scale error or a stretched time is no question of units")
    smallest_deflection: float = number(
        0.004, "range of a surface below which it excites nothing", "chosen: 0.2 deg", unit="rad"
    )
    quick: float = number(0.5, "window of rates of rotation", unit="s")
    slow: float = number(4.0, "window of what gravity and drag change", unit="s")
    fewest: int = number(6, "samples of a window at least, of which as many are kept, and windows in a record")
    present: float = number(0.5, "part of a window's samples that must be there")
    smallest: float = number(0.2, "part of a file's derivative by a surface that is there at least, with its sign")
    least: float = number(0.1, "part of a coefficient's variation that a linear model leaves at least")
    faults: int = number(8, "faults of one set of records at most")
    impossible: float = number(
        -60.0, "log likelihood of a level at least: beyond, it is impossible anyhow", signed=True
    )
    one_factor: float = number(0.1, "difference of logarithms up to which two factors are one")
    time_steps: int = number(3, "iterations to a delay and a drift between channels", "measured: two settle them")
    error_steps: int = number(12, "iterations to the least errors of a lift curve", "measured: four settle it")
    telling: float = number(0.7, "what two sides of a relation have unlike, up to which it tells of time")
