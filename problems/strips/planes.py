"""Geometry of the three aircraft, and the strips that they are made of. Body axes, from the centre of gravity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

SURFACES = ("delta_e", "delta_a", "delta_r")
_DEG = np.pi / 180.0
_SLENDER = 1.2  # lift per rad of a strip of fuselage ahead of the centre of gravity, on its own area


@dataclass(frozen=True, eq=False, kw_only=True)
class Strips:
    """One row for each strip.

    at, ahead, normal  (S, 3) quarter chord [m], direction of the chord, and the one along which a flow is a positive
                       angle of attack
    area, chord        (S,)
    slope, zero_lift   (S,) of the lift per rad, without a control; zero-lift drag is `drag`, drag by lift `induced`
    stall              (S,) angle of attack [rad] at which half of the flow has separated
    moment             (S,) coefficient about the quarter chord
    control            (S, 3) incidence per rad of the surfaces
    wing, tail         (S,) 1 for strips that shed downwash, and for those that meet it
    """

    at: np.ndarray
    ahead: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    chord: np.ndarray
    slope: np.ndarray
    incidence: np.ndarray
    drag: np.ndarray
    induced: np.ndarray
    stall: np.ndarray
    moment: np.ndarray
    control: np.ndarray
    wing: np.ndarray
    tail: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """An aircraft; SI units, positions from the centre of gravity.

    wing, tail     span, chord, x and z of the quarter chord, incidence [rad]; fin: height, chord, x, z
    dihedral       [rad];  camber  angle of zero lift, less than zero [rad];  stall [rad]
    body           area, x of the strips of fuselage; `flat_plate` area of drag
    propellers     y of each; none: a jet.  disc  diameter [m]
    thrust         at rest at sea level, and the speed [m/s] at which none is left
    servo          rate [1/s] at which surfaces follow their command
    noise          1-sigma of recorded channels, of thrust as a fraction;  steps  resolution of the recorder, alike
    size, unit_s   of test inputs: amplitude, duration
    """

    name: str
    mass: float
    inertia: tuple[float, float, float, float]
    wing: tuple[float, float, float, float, float]
    tail: tuple[float, float, float, float, float]
    fin: tuple[float, float, float, float]
    dihedral: float
    camber: float
    stall: float
    body: tuple[float, float]
    flat_plate: float
    propellers: tuple[float, ...]
    disc: float
    thrust: tuple[float, float]
    thrust_z: float
    V: float
    altitude: float
    servo: float
    noise: Mapping[str, float]
    steps: Mapping[str, float]
    size: Mapping[str, float]
    unit_s: float
    strips: Strips = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "strips", _strips(self))

    @property
    def area(self) -> float:
        return self.wing[0] * self.wing[1]

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3) inertia tensor."""
        Ixx, Iyy, Izz, Ixz = self.inertia
        return np.array([[Ixx, 0.0, -Ixz], [0.0, Iyy, 0.0], [-Ixz, 0.0, Izz]])


def _strips(plane: Plane) -> Strips:
    rows: list[dict[str, object]] = []

    def row(place, normal, area, chord, aspect, **other) -> None:
        slope = 2.0 * np.pi * aspect / (aspect + 2.0)
        standard = {"incidence": 0.0, "drag": 0.0085, "stall": 16.0 * _DEG, "moment": 0.0, "control": (0.0, 0.0, 0.0)}
        rows.append(
            {"at": place, "ahead": (1.0, 0.0, 0.0), "normal": normal, "area": area, "chord": chord, "slope": slope}
            | {"induced": 1.0 / (np.pi * aspect * 0.85), "wing": 0.0, "tail": 0.0, **standard, **other}
        )

    span, chord, x, z, incidence = plane.wing
    count, sin, cos = 6, np.sin(plane.dihedral), np.cos(plane.dihedral)
    for side in (-1.0, 1.0):
        for i in range(count):
            out = (i + 0.5) / count
            width, taper = span / 2.0 / count, 1.2 - 0.4 * out
            y = side * out * span / 2.0
            aileron = 0.42 * side if 0.6 < out < 0.95 else 0.0
            row(
                (x, y, z - abs(y) * sin / cos),
                (0.0, side * sin, cos),
                width * chord * taper,
                chord * taper,
                span / chord,
                incidence=incidence - plane.camber - 2.0 * _DEG * (out - 0.5),
                stall=plane.stall,
                moment=-0.04,
                control=(0.0, aileron, 0.0),
                wing=1.0,
            )
    span, chord, x, z, incidence = plane.tail
    for i in range(6):
        y = (i + 0.5) / 6.0 * span - span / 2.0
        row(
            (x, y, z),
            (0.0, 0.0, 1.0),
            span * chord / 6.0,
            chord,
            span / chord,
            incidence=incidence,
            control=(0.5, 0.0, 0.0),
            tail=1.0,
        )
    span, chord, x, z = plane.fin
    for i in range(3):
        row(
            (x, 0.0, z - (i + 0.5) / 3.0 * span),
            (0.0, 1.0, 0.0),
            span * chord / 3.0,
            chord,
            1.55 * span / chord,
            control=(0.0, 0.0, -0.55),
        )
    area, x = plane.body
    for normal in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)):
        row((x, 0.0, 0.0), normal, area, 1.0, 1.0, drag=0.5 * plane.flat_plate / area, stall=1.0, induced=0.3)
        rows[-1]["slope"] = _SLENDER
    return Strips(**{name: np.array([one[name] for one in rows]) for name in rows[0]})


_NOISE = {
    **dict.fromkeys(("alpha", "beta"), 0.12 * _DEG),
    **dict.fromkeys(("p", "q", "r"), 0.06 * _DEG),
    **dict.fromkeys(("phi", "theta"), 0.06 * _DEG),
    "psi": 0.15 * _DEG,
    **dict.fromkeys(("ax", "ay"), 0.03),
    "az": 0.06,
    **dict.fromkeys(SURFACES, 0.03 * _DEG),
    "thrust": 0.004,
    "altitude": 0.6,
}
_STEPS = {
    **dict.fromkeys(("alpha", "beta"), 0.05 * _DEG),
    **dict.fromkeys(("p", "q", "r"), 0.03 * _DEG),
    **dict.fromkeys(("phi", "theta", "psi"), 0.05 * _DEG),
    **dict.fromkeys(("ax", "ay", "az"), 0.02),
    **dict.fromkeys(SURFACES, 0.02 * _DEG),
    "thrust": 0.002,
    "altitude": 0.3,
}
TRAINER = Plane(
    name="strip trainer",
    mass=980.0,
    inertia=(1300.0, 1900.0, 2900.0, 60.0),
    wing=(10.4, 1.5, 0.02, -0.4, 1.5 * _DEG),
    tail=(3.2, 0.9, -4.5, -0.3, -1.5 * _DEG),
    fin=(1.5, 1.0, -4.7, -0.3),
    dihedral=4.0 * _DEG,
    camber=-2.5 * _DEG,
    stall=15.0 * _DEG,
    body=(1.4, 0.7),
    flat_plate=0.36,
    propellers=(0.0,),
    disc=1.9,
    thrust=(4600.0, 95.0),
    thrust_z=-0.05,
    V=54.0,
    altitude=1200.0,
    servo=18.0,
    noise=_NOISE | {"V": 0.25},
    steps=_STEPS | {"V": 0.1},
    size={"delta_e": 3.0 * _DEG, "delta_a": 7.0 * _DEG, "delta_r": 5.0 * _DEG, "throttle": 0.25},
    unit_s=0.55,
)
TWIN = Plane(
    name="strip twin",
    mass=4300.0,
    inertia=(15000.0, 17000.0, 30000.0, 900.0),
    wing=(15.0, 1.95, 0.05, 0.3, 1.5 * _DEG),
    tail=(5.2, 1.3, -6.9, -0.9, -1.5 * _DEG),
    fin=(2.5, 1.7, -6.8, -0.4),
    dihedral=5.5 * _DEG,
    camber=-2.5 * _DEG,
    stall=15.5 * _DEG,
    body=(3.2, 1.4),
    flat_plate=0.8,
    propellers=(-2.5, 2.5),
    disc=2.3,
    thrust=(17500.0, 170.0),
    thrust_z=0.15,
    V=88.0,
    altitude=2600.0,
    servo=22.0,
    noise=_NOISE | {"V": 0.3},
    steps=_STEPS | {"V": 0.2},
    size={"delta_e": 2.5 * _DEG, "delta_a": 6.0 * _DEG, "delta_r": 4.0 * _DEG, "throttle": 0.25},
    unit_s=0.6,
)
JET = Plane(
    name="strip jet",
    mass=4600.0,
    inertia=(8500.0, 22000.0, 29000.0, 1100.0),
    wing=(10.6, 2.05, 0.0, 0.3, 1.0 * _DEG),
    tail=(4.4, 1.15, -5.2, -0.2, -1.0 * _DEG),
    fin=(2.2, 1.6, -4.9, -0.5),
    dihedral=3.5 * _DEG,
    camber=-1.5 * _DEG,
    stall=14.0 * _DEG,
    body=(3.0, 1.6),
    flat_plate=0.5,
    propellers=(),
    disc=0.0,
    thrust=(22000.0, 900.0),
    thrust_z=0.0,
    V=155.0,
    altitude=5500.0,
    servo=25.0,
    noise=_NOISE | {"V": 0.3, **dict.fromkeys(("pdot", "qdot", "rdot"), 0.5 * _DEG)},
    steps=_STEPS | {"V": 0.2, **dict.fromkeys(("pdot", "qdot", "rdot"), 0.1 * _DEG)},
    size={"delta_e": 1.6 * _DEG, "delta_a": 3.5 * _DEG, "delta_r": 3.0 * _DEG, "throttle": 0.3},
    unit_s=0.6,
)
PLANES = (TRAINER, TWIN, JET)
