"""The two aircraft: a light single and a small jet. Invented numbers, see the package.

Lift and drag are in stability axes, the side force is along body y. Moments are about the reference point, which is the
centre of gravity of the healthy aircraft, and are divided by the whole span or the chord. The rates p and r are made
dimensionless with half the span, q with half the chord, over the airspeed. A positive elevator lowers the nose, a
positive aileron rolls to the left, a positive rudder yaws to the left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from problems.independent.tables import Table


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """An aircraft; SI units.

    inertia       Ixx, Iyy, Izz, Ixz about the centre of gravity
    thrust_z      of the thrust line below the centre of gravity;  engine_y  of the engines
    thrust        largest thrust at sea level over Mach number;  spool_s  time constant of the engine
    servo         natural frequency [rad/s] and damping ratio of the actuators
    altitude, V   of the trim point
    noise         1-sigma of each recorded channel; of the thrust as a fraction. A channel without one is not recorded
    size          of the inputs: surfaces [rad], throttle as a fraction of the trim setting
    unit_s        duration of the shortest step of an input
    tail_arm      from the wing to the tail [m]
    """

    name: str
    mass: float
    inertia: tuple[float, float, float, float]
    area: float
    span: float
    chord: float
    thrust_z: float
    engine_y: tuple[float, ...]
    thrust: Table
    spool_s: float
    servo: tuple[float, float]
    altitude: float
    V: float
    tables: Mapping[str, Sequence[Table]]
    noise: Mapping[str, float]
    size: Mapping[str, float]
    unit_s: Mapping[str, float]
    tail_arm: float

    def coefficients(self, now: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """CL CD CY Cl Cm Cn, (n,) each, by the tables at variables (n,) each."""
        return {name: sum((table.at(now) for table in tables), np.zeros(1)) for name, tables in self.tables.items()}

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3) inertia tensor."""
        Ixx, Iyy, Izz, Ixz = self.inertia
        return np.array([[Ixx, 0.0, -Ixz], [0.0, Iyy, 0.0], [-Ixz, 0.0, Izz]])


def _over(axis: str, points: Sequence[float], values: Sequence[float], factor: str | None = None) -> Table:
    return Table(axes={axis: points}, values=values, factor=factor)


def _odd(axis: str, points: Sequence[float], values: Sequence[float]) -> Table:
    """A table that is given on the positive side, odd in its variable."""
    both = [-x for x in reversed(points)] + [0.0, *points]
    return _over(axis, both, [-y for y in reversed(values)] + [0.0, *values])


def _even(axis: str, points: Sequence[float], values: Sequence[float]) -> Table:
    """The same, even in its variable and zero in the middle."""
    both = [-x for x in reversed(points)] + [0.0, *points]
    return _over(axis, both, [*reversed(values), 0.0, *values])


def _odd_over_alpha(axis: str, points: Sequence[float], rows: Mapping[float, Sequence[float]]) -> Table:
    """A table odd in its variable, with a row for each angle of attack [deg]."""
    both = [-x for x in reversed(points)] + [0.0, *points]
    whole = [[-y for y in reversed(row)] + [0.0, *row] for row in rows.values()]
    return Table(axes={"alpha": list(rows), axis: both}, values=whole)


_DEG = np.pi / 180.0
_WIDE = (-8, -6, -4, -2, 0, 2, 4, 6, 8, 10, 12, 14, 16)
_LIGHT_TABLES = {
    "CL": (
        _over("alpha", _WIDE, (-0.36, -0.2, -0.035, 0.135, 0.31, 0.485, 0.66, 0.83, 0.99, 1.13, 1.25, 1.33, 1.36)),
        _odd("delta_e", (5, 10, 20), (0.037, 0.071, 0.12)),
        _over("alpha", (-4, 4, 12), (3.8, 4.0, 4.1), "q"),
    ),
    "CD": (
        _over(
            "alpha",
            _WIDE,
            (0.04, 0.033, 0.029, 0.0298, 0.0335, 0.0402, 0.0505, 0.0655, 0.0865, 0.112, 0.145, 0.185, 0.23),
        ),
        _even("beta", (5, 10, 15, 20), (0.0019, 0.0076, 0.017, 0.03)),
        _even("delta_e", (5, 10, 20), (0.0009, 0.0036, 0.013)),
    ),
    "CY": (
        _odd("beta", (5, 10, 15, 20), (-0.031, -0.0615, -0.091, -0.118)),
        _over("alpha", (-4, 4, 12), (-0.03, -0.05, -0.08), "p"),
        _over("alpha", (-4, 4, 12), (0.22, 0.21, 0.19), "r"),
        _odd("delta_r", (5, 10, 20), (0.0166, 0.033, 0.062)),
    ),
    "Cl": (
        _odd_over_alpha(
            "beta",
            (5, 10, 20),
            {-4: (-0.0068, -0.0135, -0.026), 4: (-0.0079, -0.0156, -0.0295), 12: (-0.0092, -0.018, -0.033)},
        ),
        _over("alpha", (-4, 4, 8, 12, 16), (-0.465, -0.47, -0.465, -0.44, -0.35), "p"),
        _over("alpha", (-4, 0, 4, 8, 12), (0.06, 0.082, 0.105, 0.13, 0.155), "r"),
        _odd("delta_a", (5, 10, 20), (-0.0149, -0.0293, -0.053)),
        _odd("delta_r", (5, 10, 20), (0.001, 0.002, 0.0037)),
    ),
    "Cm": (
        _over(
            "alpha",
            _WIDE,
            (0.137, 0.108, 0.079, 0.0497, 0.02, -0.01, -0.0405, -0.072, -0.106, -0.144, -0.187, -0.235, -0.29),
        ),
        _odd_over_alpha(
            "delta_e",
            (5, 10, 20),
            {-4: (-0.1045, -0.203, -0.37), 4: (-0.104, -0.202, -0.365), 12: (-0.099, -0.191, -0.34)},
        ),
        _over("alpha", (-4, 4, 12), (-12.1, -12.5, -13.2), "q"),
    ),
    "Cn": (
        _odd_over_alpha(
            "beta",
            (5, 10, 20),
            {-4: (0.0058, 0.0117, 0.0225), 4: (0.0057, 0.0114, 0.022), 12: (0.0052, 0.0105, 0.0205)},
        ),
        _over("alpha", (-4, 0, 4, 8, 12), (-0.021, -0.028, -0.036, -0.045, -0.056), "p"),
        _over("alpha", (-4, 4, 12), (-0.098, -0.1, -0.106), "r"),
        _odd_over_alpha(
            "delta_a",
            (5, 10, 20),
            {-4: (0.0003, 0.0006, 0.0013), 4: (0.0006, 0.0012, 0.0025), 12: (0.001, 0.0021, 0.0044)},
        ),
        _odd("delta_r", (5, 10, 20), (-0.0058, -0.0114, -0.021)),
    ),
}
_JET_ALPHA = (-4, -2, 0, 2, 4, 6, 8, 10, 12)
_MACH = (0.3, 0.5, 0.65, 0.8)


def _alpha_mach(*rows: Sequence[float]) -> Table:
    """A row for each Mach number."""
    return Table(axes={"mach": _MACH, "alpha": _JET_ALPHA}, values=rows)


_JET_TABLES = {
    "CL": (
        _alpha_mach(
            (-0.178, -0.005, 0.168, 0.341, 0.514, 0.684, 0.845, 0.98, 1.065),
            (-0.19, -0.005, 0.18, 0.366, 0.552, 0.734, 0.9, 1.03, 1.1),
            (-0.208, -0.008, 0.192, 0.392, 0.59, 0.778, 0.93, 1.02, 1.06),
            (-0.236, -0.012, 0.212, 0.435, 0.645, 0.81, 0.9, 0.94, 0.96),
        ),
        Table(
            axes={"mach": (0.3, 0.8), "delta_e": (-15, -8, -4, 0, 4, 8, 15)},
            values=((-0.115, -0.065, -0.033, 0, 0.033, 0.064, 0.11), (-0.13, -0.074, -0.038, 0, 0.038, 0.073, 0.12)),
        ),
        _over("mach", _MACH, (4.6, 4.8, 5.1, 5.6), "q"),
    ),
    "CD": (
        _alpha_mach(
            (0.0235, 0.0208, 0.0212, 0.0252, 0.0333, 0.0463, 0.0655, 0.0925, 0.13),
            (0.0238, 0.0208, 0.0213, 0.0257, 0.0346, 0.049, 0.0705, 0.101, 0.143),
            (0.0248, 0.0212, 0.0218, 0.0271, 0.038, 0.0565, 0.085, 0.126, 0.18),
            (0.0305, 0.0255, 0.0268, 0.0355, 0.0545, 0.087, 0.135, 0.195, 0.26),
        ),
        _even("beta", (4, 8, 12), (0.0014, 0.0057, 0.013)),
        _even("delta_e", (4, 8, 15), (0.0006, 0.0025, 0.009)),
    ),
    "CY": (
        _odd("beta", (4, 8, 12), (-0.0525, -0.104, -0.152)),
        _over("alpha", (-4, 0, 4, 8, 12), (0.04, 0.01, -0.03, -0.08, -0.14), "p"),
        _over("mach", _MACH, (0.4, 0.41, 0.43, 0.46), "r"),
        _odd("delta_r", (5, 10, 20), (0.0166, 0.0328, 0.061)),
    ),
    "Cl": (
        _odd_over_alpha(
            "beta",
            (4, 8, 12),
            {-4: (-0.0056, -0.0111, -0.0162), 2: (-0.0069, -0.0136, -0.02), 8: (-0.0086, -0.0168, -0.0243)},
        ),
        _over("alpha", (-4, 2, 6, 10, 14), (-0.415, -0.42, -0.415, -0.38, -0.3), "p"),
        _over("alpha", (-4, 0, 4, 8), (0.06, 0.095, 0.135, 0.18), "r"),
        Table(
            axes={"mach": (0.3, 0.8), "delta_a": (-20, -10, -5, 0, 5, 10, 20)},
            values=(
                (0.045, 0.0245, 0.0125, 0, -0.0125, -0.0245, -0.045),
                (0.041, 0.0226, 0.0115, 0, -0.0115, -0.0226, -0.041),
            ),
        ),
        _odd("delta_r", (5, 10, 20), (0.0017, 0.0033, 0.006)),
    ),
    "Cm": (
        _alpha_mach(
            (0.116, 0.08, 0.044, 0.0075, -0.0295, -0.067, -0.107, -0.153, -0.208),
            (0.122, 0.084, 0.046, 0.007, -0.0325, -0.073, -0.116, -0.164, -0.222),
            (0.131, 0.09, 0.049, 0.0065, -0.037, -0.082, -0.129, -0.18, -0.24),
            (0.146, 0.1, 0.053, 0.004, -0.047, -0.1, -0.157, -0.219, -0.289),
        ),
        Table(
            axes={"mach": (0.3, 0.8), "delta_e": (-15, -8, -4, 0, 4, 8, 15)},
            values=((0.33, 0.184, 0.0935, 0, -0.0935, -0.183, -0.32), (0.345, 0.193, 0.0985, 0, -0.0985, -0.19, -0.33)),
        ),
        _over("mach", _MACH, (-16.8, -17.6, -18.7, -20.5), "q"),
    ),
    "Cn": (
        _odd_over_alpha(
            "beta",
            (4, 8, 12),
            {-4: (0.0098, 0.0196, 0.029), 2: (0.0097, 0.0193, 0.0285), 8: (0.0091, 0.018, 0.0265)},
        ),
        _over("alpha", (-4, 0, 4, 8, 12), (0.005, -0.013, -0.034, -0.058, -0.085), "p"),
        _over("mach", _MACH, (-0.165, -0.17, -0.178, -0.19), "r"),
        _odd_over_alpha(
            "delta_a",
            (5, 10, 20),
            {-4: (-0.0001, -0.0002, -0.0004), 4: (0.0004, 0.0009, 0.002), 12: (0.001, 0.0021, 0.0045)},
        ),
        _odd("delta_r", (5, 10, 20), (-0.0079, -0.0156, -0.029)),
    ),
}

LIGHT = Plane(
    name="light single",
    mass=1080.0,
    inertia=(1250.0, 1750.0, 2650.0, 60.0),
    area=16.0,
    span=10.9,
    chord=1.48,
    thrust_z=-0.08,
    engine_y=(0.0,),
    thrust=_over("mach", (0.0, 0.1, 0.15, 0.2, 0.25), (3400.0, 2900.0, 2500.0, 2050.0, 1600.0)),
    spool_s=0.4,
    servo=(28.0, 0.8),
    altitude=1500.0,
    V=55.0,
    tables=MappingProxyType(_LIGHT_TABLES),
    # a light recorder: no angular accelerations
    noise=MappingProxyType(
        {
            "V": 0.25,
            **dict.fromkeys(("alpha", "beta"), 0.15 * _DEG),
            **dict.fromkeys(("p", "q", "r"), 0.08 * _DEG),
            **dict.fromkeys(("phi", "theta"), 0.08 * _DEG),
            "psi": 0.2 * _DEG,
            **dict.fromkeys(("ax", "ay"), 0.04),
            "az": 0.08,
            **dict.fromkeys(("delta_e", "delta_a", "delta_r"), 0.03 * _DEG),
            "thrust": 0.005,
            "altitude": 0.8,
        }
    ),
    size=MappingProxyType({"delta_e": 2.5 * _DEG, "delta_a": 5.0 * _DEG, "delta_r": 5.0 * _DEG, "throttle": 0.25}),
    unit_s=MappingProxyType({"delta_e": 0.5, "delta_a": 0.8, "delta_r": 0.9, "throttle": 5.0}),
    tail_arm=4.6,
)
JET = Plane(
    name="small jet",
    mass=7000.0,
    inertia=(18000.0, 38000.0, 54000.0, 2500.0),
    area=24.5,
    span=13.2,
    chord=2.0,
    thrust_z=-0.25,
    engine_y=(-1.4, 1.4),
    thrust=_over("mach", (0.0, 0.3, 0.5, 0.7, 0.8), (28000.0, 25500.0, 24500.0, 24000.0, 23800.0)),
    spool_s=1.0,
    servo=(35.0, 0.75),
    altitude=7000.0,
    V=165.0,
    tables=MappingProxyType(_JET_TABLES),
    noise=MappingProxyType(
        {
            "V": 0.3,
            **dict.fromkeys(("alpha", "beta"), 0.1 * _DEG),
            **dict.fromkeys(("p", "q", "r"), 0.05 * _DEG),
            **dict.fromkeys(("phi", "theta", "psi"), 0.05 * _DEG),
            **dict.fromkeys(("ax", "ay"), 0.03),
            "az": 0.06,
            **dict.fromkeys(("pdot", "qdot", "rdot"), 0.4 * _DEG),
            **dict.fromkeys(("delta_e", "delta_a", "delta_r"), 0.02 * _DEG),
            "thrust": 0.005,
            "altitude": 1.0,
        }
    ),
    size=MappingProxyType({"delta_e": 1.8 * _DEG, "delta_a": 3.5 * _DEG, "delta_r": 3.0 * _DEG, "throttle": 0.3}),
    unit_s=MappingProxyType({"delta_e": 0.55, "delta_a": 0.9, "delta_r": 0.9, "throttle": 6.0}),
    tail_arm=6.2,
)
PLANES: Mapping[str, Plane] = MappingProxyType({plane.name: plane for plane in (LIGHT, JET)})
