"""Names, units and labels of the channels: the one place that knows "alpha is an angle in rad".

Body axes x forward, y right, z down. Angles are 3-2-1 Euler angles. ax ay az are specific forces at the
accelerometer (az about -9.81 in level flight).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import MappingProxyType

from casid.errors import InputError, nearest


@dataclass(frozen=True)
class Channel:
    """A measured quantity: `unit` is its SI unit, `label` how a person calls it,
    `scale` a typical size in flight, used to condition states and residuals."""

    name: str
    unit: str
    label: str
    scale: float


def _table(*rows: tuple[str, str, str, float]) -> MappingProxyType[str, Channel]:
    return MappingProxyType({row[0]: Channel(*row) for row in rows})


CHANNELS = _table(
    ("t", "s", "time", 1.0),
    ("V", "m/s", "true airspeed", 100.0),
    ("alpha", "rad", "angle of attack", 0.05),
    ("beta", "rad", "sideslip angle", 0.05),
    ("p", "rad/s", "roll rate", 0.2),
    ("q", "rad/s", "pitch rate", 0.1),
    ("r", "rad/s", "yaw rate", 0.1),
    ("phi", "rad", "bank angle", 0.3),
    ("theta", "rad", "pitch angle", 0.1),
    ("psi", "rad", "heading", 0.3),
    ("ax", "m/s2", "longitudinal specific force", 1.0),
    ("ay", "m/s2", "lateral specific force", 1.0),
    ("az", "m/s2", "vertical specific force", 5.0),
    ("pdot", "rad/s2", "roll acceleration", 0.5),
    ("qdot", "rad/s2", "pitch acceleration", 0.3),
    ("rdot", "rad/s2", "yaw acceleration", 0.2),
    ("delta_e", "rad", "elevator", 0.05),
    ("delta_a", "rad", "aileron", 0.05),
    ("delta_r", "rad", "rudder", 0.05),
    ("thrust", "N", "thrust", 1e4),
    ("altitude", "m", "altitude", 1000.0),
    ("rho", "kg/m3", "air density", 1.0),
    ("mach", "1", "Mach number", 0.5),
    ("qbar", "Pa", "dynamic pressure", 5000.0),
    ("v_north", "m/s", "velocity over ground, north", 100.0),
    ("v_east", "m/s", "velocity over ground, east", 100.0),
    ("v_down", "m/s", "velocity over ground, down", 5.0),
    ("wind_north", "m/s", "wind towards north", 5.0),
    ("wind_east", "m/s", "wind towards east", 5.0),
    ("north", "m", "position north", 1000.0),
    ("east", "m", "position east", 1000.0),
    ("throttle", "1", "throttle", 1.0),
    ("battery", "V", "battery voltage", 10.0),
    ("fx", "N", "external force along body x", 100.0),
    ("fy", "N", "external force along body y", 100.0),
    ("fz", "N", "external force along body z", 100.0),
    ("force_at_x", "m", "point of the external force, forward of the c.g.", 1.0),
    ("force_at_y", "m", "point of the external force, right of the c.g.", 1.0),
    ("force_at_z", "m", "point of the external force, below the c.g.", 1.0),
)
SURFACES = ("delta_e", "delta_a", "delta_r")
_ROTOR = re.compile(r"m\d{1,2}")
EXTERNAL_FORCE = ("fx", "fy", "fz")  # of a tether, a tow or a load, in body axes
FORCE_POINT = ("force_at_x", "force_at_y", "force_at_z")  # where it acts; at the c.g. where a record does not state it

# Beyond these [rad, rad/s] a value is no angle or rate of an aircraft in rad; in degrees it is an ordinary one.
RADIAN_LIMITS = MappingProxyType(
    dict.fromkeys(("alpha", "beta", "theta", *SURFACES), 1.6) | {"phi": 6.4, "psi": 12.6, "p": 15.0, "q": 6.4, "r": 6.4}
)

# Beyond these no aircraft flies: 50 g, seven times the fastest aeroplane's roll acceleration, the edge of the air. What
# is found there is a mark of a missing sample, such as -999 or 9999, or another unit.
FLIGHT_LIMITS = MappingProxyType(
    dict.fromkeys(("ax", "ay", "az"), 500.0)
    | dict.fromkeys(("pdot", "qdot", "rdot"), 500.0)
    | {"V": 3500.0, "altitude": 1e5, "rho": 10.0, "thrust": 1e8}
)

# Units outside SI in SI: rad in a degree, m in a foot, kg in a pound, a slug and a tonne, N in a pound, m/s2 in a g.
DEGREE = 0.017453292519943295
FOOT = 0.3048
POUND = 0.45359237
SLUG = 14.593902937206364
TONNE = 1000.0
POUND_FORCE = 4.4482216152605
GRAVITY = 9.80665
# unit -> (SI unit, factor): SI = factor * value
_UNITS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "µs": ("s", 1e-6),
    "ns": ("s", 1e-9),
    "min": ("s", 60.0),
    "rad": ("rad", 1.0),
    "deg": ("rad", DEGREE),
    "mrad": ("rad", 1e-3),
    "°": ("rad", DEGREE),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", DEGREE),
    "rad/s2": ("rad/s2", 1.0),
    "deg/s2": ("rad/s2", DEGREE),
    "m": ("m", 1.0),
    "ft": ("m", FOOT),
    "km": ("m", 1000.0),
    "m/s": ("m/s", 1.0),
    "kt": ("m/s", 1852.0 / 3600.0),
    "kts": ("m/s", 1852.0 / 3600.0),
    "knots": ("m/s", 1852.0 / 3600.0),
    "ft/s": ("m/s", FOOT),
    "km/h": ("m/s", 1 / 3.6),
    "mph": ("m/s", 0.44704),
    "fpm": ("m/s", FOOT / 60.0),
    "ft/min": ("m/s", FOOT / 60.0),
    "m/s2": ("m/s2", 1.0),
    "ft/s2": ("m/s2", FOOT),
    "g": ("m/s2", GRAVITY),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "lbf": ("N", POUND_FORCE),
    "lb": ("N", POUND_FORCE),
    "Pa": ("Pa", 1.0),
    "kPa": ("Pa", 1e3),
    "hPa": ("Pa", 1e2),
    "mbar": ("Pa", 1e2),
    "psf": ("Pa", 47.88025898),
    "kg/m3": ("kg/m3", 1.0),
    "slug/ft3": ("kg/m3", 515.3788184),
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "rpm": ("rad/s", 0.10471975511965977),
    "1": ("1", 1.0),
    "-": ("1", 1.0),
}

# units in other words
_WORDS = {
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("usec", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("degree", "degrees", "degs", "grad"), "deg"),
    **dict.fromkeys(("radian", "radians", "rads"), "rad"),
    **dict.fromkeys(("deg/sec", "degrees/s", "degrees/sec", "degps", "degpsec", "deg_sec", "dps", "°/s"), "deg/s"),
    **dict.fromkeys(("rad/sec", "radians/s", "radps", "rad_sec", "rps"), "rad/s"),
    **dict.fromkeys(("deg/sec2", "deg/s/s", "degpsec2", "°/s2"), "deg/s2"),
    **dict.fromkeys(("rad/sec2", "rad/s/s", "rad_sec2"), "rad/s2"),
    **dict.fromkeys(("feet", "foot"), "ft"),
    **dict.fromkeys(("meter", "meters", "metre", "metres", "mtr"), "m"),
    **dict.fromkeys(("m/sec", "mps"), "m/s"),
    **dict.fromkeys(("ft/sec", "fps"), "ft/s"),
    **dict.fromkeys(("m/sec2", "m/s/s", "mps2", "ms-2"), "m/s2"),
    **dict.fromkeys(("ft/sec2", "ft/s/s", "fps2", "fps_sec"), "ft/s2"),
    **dict.fromkeys(("knot", "kn"), "kt"),
    **dict.fromkeys(("kmh", "kph", "km/hr"), "km/h"),
    **dict.fromkeys(("g's", "gs", "gee"), "g"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("lbs", "lbf"), "lbf"),
    **dict.fromkeys(("slugs/ft3", "slugs_ft3"), "slug/ft3"),
}
# of quantities that no channel has; in a row of units they are units all the same
_OTHER_UNITS = frozenset(
    (
        "a",
        "amp",
        "amps",
        "ma",
        "w",
        "mw",
        "hz",
        "khz",
        "mhz",
        "%",
        "percent",
        "bar",
        "mbar",
        "psi",
        "inhg",
        "degc",
        "degf",
    )
    + ("c", "k", "kg", "lb", "nm", "n.m", "ft-lb", "inch", "in", "mm", "cm", "bool", "enum", "count", "counts", "raw")
    + ("string", "ident", "ratio", "norm", "norml", "part", "gal", "gals", "gph", "qt", "pph", "hh:mm", "hh:mm:ss")
    + ("yyy-mm-dd", "yyyy-mm-dd", "dd/mm/yyyy", "ddd:hh:mm:ss", "fsd", "mt", "°c", "none", "unitless", "dimensionless")
)

# how a unit is written behind a name, `alpha_deg`
_SUFFIXES = {
    **{
        unit: unit
        for unit in ("deg", "rad", "kt", "kts", "ft", "m", "g", "N", "kN", "lbf", "s", "ms", "us", "ns", "mV")
    },
    **{
        "dps": "deg/s",
        "deg_s": "deg/s",
        "rad_s": "rad/s",
        "rps": "rad/s",
        "radps": "rad/s",
        "degps": "deg/s",
        "deg_s2": "deg/s2",
        "rad_s2": "rad/s2",
    },
    **{"mps": "m/s", "m_s": "m/s", "fps": "ft/s", "mps2": "m/s2", "m_s2": "m/s2", "kmh": "km/h", "hPa": "hPa"},
}


def is_control(name: str) -> bool:
    """Tell whether a channel moves an aircraft: a surface, the command of one, or a rotor as logs call it, `m1`."""
    return name in SURFACES or name.removesuffix("_command") in SURFACES or bool(_ROTOR.fullmatch(name))


def with_suffix(name: str) -> tuple[str, str]:
    """Channel and unit of a name like `alpha_deg`; the name itself and "" where it is no such thing."""
    channel, _, _ = name.partition("_")
    for known in (name.rpartition("_")[0], "_".join(name.split("_")[:-2]), channel):
        suffix = name[len(known) + 1 :]
        suffix = suffix if known in CHANNELS else suffix.lower()  # ALPHA_DEG is nearly alpha_deg
        if (known in CHANNELS or known.lower() in CHANNELS) and suffix in _SUFFIXES:
            return known, _SUFFIXES[suffix]
    known, _, suffix = name.rpartition("_")
    return (known, _SUFFIXES[suffix]) if known.lower() in ("time", "timestamp") and suffix in _SUFFIXES else (name, "")


def _unit_key(unit: str) -> str:
    """A unit as the table has it, also of `m/s^2`, `m s-2`, `DEG`, `knots`; the text itself where it is none."""
    key = unit.strip().replace("^", "").replace("**", "").replace("²", "2").replace("³", "3")
    key = re.sub(r"[ ·]([a-z]+)-(?:1|(\d))", r"/\1\2", key)  # m s-1, as meteorologists write
    if key in _UNITS:
        return key
    lower = key.lower()
    lower = _WORDS.get(lower, lower)
    return next((known for known in _UNITS if known.lower() == lower), key)


def same_unit(one: str, other: str) -> bool | None:
    """Tell whether two texts are the same unit; None where one of them is none that casid knows."""
    keys = _unit_key(one), _unit_key(other)
    return _UNITS[keys[0]] == _UNITS[keys[1]] if all(key in _UNITS for key in keys) else None


def is_unit(text: str) -> bool:
    """Tell whether a text is a unit, also of quantities that no channel has."""
    first = text.lower().split()[:1]  # "ft msl", "deg C"
    return _unit_key(text) in _UNITS or bool(first) and (_unit_key(first[0]) in _UNITS or first[0] in _OTHER_UNITS)


def is_known(name: str) -> bool:
    """Tell whether a name is that of a channel or of the time."""
    return name in CHANNELS or name.lower() in ("time", "timestamp")


def si_factor(unit: str, channel: str, where: str = "") -> float:
    """Factor that converts `unit` to the SI unit of `channel`; InputError for a unit that is unknown or of another
    quantity."""
    key = _unit_key(unit)
    prefix = f"{where}: " if where else ""
    if key not in _UNITS:
        near = nearest(key, _UNITS)
        hint = f"did you mean '{near}'?" if near else f"known units: {', '.join(_UNITS)}"
        raise InputError(f"{prefix}unknown unit '{unit}' of channel '{channel}'; {hint}")
    si, factor = _UNITS[key]
    expected = CHANNELS[channel].unit if channel in CHANNELS else si
    if si != expected:
        raise InputError(f"{prefix}unit '{unit}' does not fit channel '{channel}', whose SI unit is {expected}")
    return factor


def for_a_person(unit: str) -> tuple[float, str]:
    """(factor, unit) in which a person reads a channel: degrees for radians, else SI."""
    return (1.0 / DEGREE, unit.replace("rad", "deg")) if unit.startswith("rad") else (1.0, unit)


def unit_of(channel: str) -> str:
    """SI unit of a channel; "" for one that casid does not know."""
    return CHANNELS[channel].unit if channel in CHANNELS else ""


def label_of(channel: str) -> str:
    """Return the label of a channel for a person; its own name when casid does not know it."""
    return CHANNELS[channel].label if channel in CHANNELS else channel


def scale_of(channel: str) -> float:
    """Typical size of a channel in flight, in SI; 1 for one that casid does not know."""
    return CHANNELS[channel].scale if channel in CHANNELS else 1.0
