"""JSBSim's properties in terms of what the signal path of casid knows.

Recorded surfaces stand for the control system: `fcs/left-aileron-pos-rad` is delta_a, the right one its negative. What
the file computes of these by static components alone (scales, gains, sums) is computed; all else that the control
system, engines and systems have is held.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import casadi as ca

from casid.errors import InputError
from casid.model.jsbsim.fcs import Components
from casid.model.jsbsim.functions import value_of
from casid.signals import DEGREE, FOOT, POUND_FORCE, SLUG

_TEMPERATURE_R, _SUTHERLAND_R, _BETA = 518.67, 198.72, 2.269690e-08
HELD = ("fcs/", "gear/", "systems/", "propulsion/", "external_reactions/", "ap/", "autopilot/", "simulation/")
_HYSTERESIS = "aero/stall-hyst-norm"


@dataclass(frozen=True, kw_only=True)
class Metrics:
    """Geometry of a file, feet and radians, by JSBSim's names of properties without `metrics/`."""

    values: Mapping[str, float]

    def __getitem__(self, name: str) -> float:
        return self.values[name]


Rule = Callable[[Any, Metrics], Any]  # (quantities of `Aircraft.aerodynamics`, metrics) -> expression


def _speed(s: Any) -> Any:
    return s.airspeed / FOOT


def _reynolds(s: Any, m: Metrics) -> Any:
    temperature = _TEMPERATURE_R * ca.fmax((s.rho / 1.225) ** 0.2349692, 216.65 / 288.15)
    viscosity = _BETA * temperature**1.5 / (_SUTHERLAND_R + temperature)
    return _speed(s) * m["cbarw-ft"] / viscosity * _density(s)


def _density(s: Any) -> Any:
    return s.rho / (SLUG / FOOT**3)


def _altitude(s: Any) -> Any:
    """Of the standard atmosphere at the recorded density [ft]."""
    return (1.0 - (s.rho / 1.225) ** (1.0 / 4.25588)) / 2.25577e-5 / FOOT


def _rate(name: str, length: str) -> Rule:
    return lambda s, m: getattr(s, name) * 2.0 * _speed(s) / m[length]


def _surface(name: str, factor: float = 1.0) -> Rule:
    return lambda s, m: factor * getattr(s, name)


KNOWN: Mapping[str, Rule] = MappingProxyType(
    {
        "aero/qbar-psf": lambda s, m: s.qbar / (POUND_FORCE / FOOT**2),
        "aero/qbar-area": lambda s, m: s.qbar / (POUND_FORCE / FOOT**2) * m["Sw-sqft"],
        "aero/alpha-rad": lambda s, m: s.alpha,
        "aero/alpha-deg": lambda s, m: s.alpha / DEGREE,
        "aero/beta-rad": lambda s, m: s.beta,
        "aero/beta-deg": lambda s, m: s.beta / DEGREE,
        "aero/mag-alpha-rad": lambda s, m: ca.fabs(s.alpha),
        "aero/mag-beta-rad": lambda s, m: ca.fabs(s.beta),
        "aero/mag-beta-deg": lambda s, m: ca.fabs(s.beta) / DEGREE,
        "aero/alpha-wing-rad": lambda s, m: s.alpha + m["iw-rad"],
        "aero/bi2vel": lambda s, m: m["bw-ft"] / (2.0 * _speed(s)),
        "aero/ci2vel": lambda s, m: m["cbarw-ft"] / (2.0 * _speed(s)),
        "aero/alphadot-rad_sec": _rate("alphadot", "cbarw-ft"),
        "aero/betadot-rad_sec": _rate("betadot", "bw-ft"),
        "aero/h_b-mac-ft": lambda s, m: _altitude(s) / m["bw-ft"],
        "aero/h_b-cg-ft": lambda s, m: _altitude(s) / m["bw-ft"],
        "aero/Re": _reynolds,
        **{f"velocities/{x}{kind}-rad_sec": _rate(x, "bw-ft") for x in "pr" for kind in ("-aero", "")},
        **{f"velocities/q{kind}-rad_sec": _rate("q", "cbarw-ft") for kind in ("-aero", "")},
        "velocities/vt-fps": lambda s, m: _speed(s),
        "velocities/mach": lambda s, m: s.mach,
        "velocities/ve-kts": lambda s, m: _speed(s) * ca.sqrt(s.rho / 1.225) * 0.592483801295896,
        "velocities/u-aero-fps": lambda s, m: _speed(s) * ca.cos(s.alpha) * ca.cos(s.beta),
        "velocities/v-aero-fps": lambda s, m: _speed(s) * ca.sin(s.beta),
        "velocities/w-aero-fps": lambda s, m: _speed(s) * ca.sin(s.alpha) * ca.cos(s.beta),
        "atmosphere/rho-slugs_ft3": lambda s, m: _density(s),
        "position/h-sl-ft": lambda s, m: _altitude(s),
        "fcs/elevator-pos-rad": _surface("delta_e"),
        "fcs/elevator-pos-deg": _surface("delta_e", 1.0 / DEGREE),
        "fcs/mag-elevator-pos-rad": lambda s, m: ca.fabs(s.delta_e),
        "fcs/left-aileron-pos-rad": _surface("delta_a"),
        "fcs/left-aileron-pos-deg": _surface("delta_a", 1.0 / DEGREE),
        "fcs/mag-left-aileron-pos-rad": lambda s, m: ca.fabs(s.delta_a),
        "fcs/right-aileron-pos-rad": _surface("delta_a", -1.0),
        "fcs/right-aileron-pos-deg": _surface("delta_a", -1.0 / DEGREE),
        "fcs/aileron-pos-rad": _surface("delta_a"),
        "fcs/effective-aileron-pos": _surface("delta_a"),
        "fcs/rudder-pos-rad": _surface("delta_r"),
        "fcs/rudder-pos-deg": _surface("delta_r", 1.0 / DEGREE),
        "fcs/mag-rudder-pos-rad": lambda s, m: ca.fabs(s.delta_r),
    }
)


RECORDED = frozenset(name for name in KNOWN if name.startswith("fcs/"))
_OF_SURFACES = re.compile(r"(elevator|aileron|rudder)[^/]*-pos")


class Properties:
    """Looks a property up: given by the user, of the motion, a function of the file, static, or held.

    `values` keep what each came to, by name; `held` those that are held, with their value.
    """

    def __init__(self, s: Any, metrics: Metrics, functions: Mapping[str, ET.Element], root: ET.Element) -> None:
        self._s, self._metrics, self._functions = s, metrics, functions
        self._components = Components(root, RECORDED)
        self.values: dict[str, Any] = {}
        self.held: dict[str, float] = {}
        self.given: dict[str, float] = {}
        self._open: set[str] = set()

    def __call__(self, name: str) -> Any:
        if name.startswith("-"):
            return -self(name[1:])
        if name not in self.values:
            if name in self._open:
                raise InputError(f"property '{name}' depends on itself; give its value: held = {{\"{name}\": 0.0}}")
            self._open.add(name)
            self.values[name] = self._found(name)
            self._open.remove(name)
        return self.values[name]

    def _found(self, name: str) -> Any:
        if name in self.given:
            return ca.SX(self.given[name])
        if name in KNOWN:
            return KNOWN[name](self._s, self._metrics)
        if name.startswith("metrics/") and name[8:] in self._metrics.values:
            return ca.SX(self._metrics[name[8:]])
        if name in self._functions:
            return value_of(self._functions[name], self)
        static = self._components.value(name, self, KNOWN.keys() | self.given.keys())
        if static is not None:
            return static
        if _OF_SURFACES.search(name) and self._components.is_written(name):
            raise InputError(
                f"property '{name}' is a surface that no static component makes of the recorded ones; hold it: "
                f'held = {{"{name}": 0.0}}'
            )
        if name.startswith(HELD) or name == _HYSTERESIS:
            self.held[name] = self._components.initial(name)
            return ca.SX(self.held[name])
        raise InputError(
            f"property '{name}' is not known without JSBSim; hold it: held = {{\"{name}\": 0.0}}, with its value"
        )
