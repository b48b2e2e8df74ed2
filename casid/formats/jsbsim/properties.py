"""Properties of a JSBSim file: states and inputs of the simulation, and what its control system computes from them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Mapping
from typing import Any

import casadi as ca

from casid.errors import InputError
from casid.formats.jsbsim.functions import value_of
from casid.formats.jsbsim.source import number_in, number_of, optional, part
from casid.signals import DEGREE, FOOT, POUND_FORCE, SLUG

_TEMPERATURE_R = 518.67
_SUTHERLAND_R = 198.72
_BETA = 2.269690e-08
HELD = ("fcs/", "gear/", "systems/", "propulsion/", "external_reactions/", "ap/", "autopilot/", "simulation/")
_HYSTERESIS = "aero/stall-hyst-norm"


Metrics = Mapping[str, float]  # geometry of a file, feet and radians, by JSBSim's properties without `metrics/`
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
    """Return the altitude of the standard atmosphere at the recorded density [ft]."""
    return (1.0 - (s.rho / 1.225) ** (1.0 / 4.25588)) / 2.25577e-5 / FOOT


def _rate(name: str, length: str) -> Rule:
    return lambda s, m: getattr(s, name) * 2.0 * _speed(s) / m[length]


def _surface(name: str, factor: float = 1.0) -> Rule:
    return lambda s, m: factor * getattr(s, name)


KNOWN: Mapping[str, Rule] = {
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


RECORDED = frozenset(name for name in KNOWN if name.startswith("fcs/"))
_OF_SURFACES = re.compile(r"(elevator|aileron|rudder)[^/]*-pos")


class Properties:
    """Looks a property up: given by the user, of the motion, a function of the file, static, or held.

    `values` keep what each came to, by name; `held` those that are held, with their value.
    """

    def __init__(self, s: Any, metrics: Metrics, functions: Mapping[str, ET.Element], root: ET.Element) -> None:
        self._s = s
        self._metrics = metrics
        self._functions = functions
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
        if name.startswith("metrics/") and name[8:] in self._metrics:
            return ca.SX(self._metrics[name[8:]])
        if name in self._functions:
            return value_of(self._functions[name], self)
        static = self._components.value(name, self, KNOWN.keys() | self.given.keys())
        if static is not None:
            return static
        if _OF_SURFACES.search(name) and name in self._components.writes:
            raise InputError(
                f"property '{name}' is a surface that no static component makes of the recorded ones; hold it: "
                f'held = {{"{name}": 0.0}}'
            )
        if name.startswith(HELD) or name == _HYSTERESIS:
            self.held[name] = self._components.initial.get(name, 0.0)
            return ca.SX(self.held[name])
        raise InputError(
            f"property '{name}' is not known without JSBSim; hold it: held = {{\"{name}\": 0.0}}, with its value"
        )


_STATIC = ("aerosurface_scale", "pure_gain", "summer", "fcs_function")
_SECTIONS = ("flight_control", "autopilot", "system")


class Components:
    """The components of a file, `writes` by the property that each writes, and `initial` values of properties that it
    sets at the start."""

    def __init__(self, root: ET.Element, recorded: Collection[str]) -> None:
        self._recorded = recorded
        self.writes: dict[str, ET.Element] = {}
        self._scales: dict[str, tuple[str, ET.Element]] = {}  # input -> what a scale makes of it
        self.initial: dict[str, float] = {}
        for section in (*_SECTIONS, "aerodynamics"):
            for node in root.findall(section):
                self.initial |= {
                    (p.text or "").strip(): number_of(p.get("value"), "property value")
                    for p in node.findall("property")
                    if p.get("value")
                }
                for component in node.iterfind("channel/*"):
                    for name in _outputs(component):
                        self.writes[name] = component
                    self._keep_scale(component)

    def _keep_scale(self, component: ET.Element) -> None:
        """A scale from whose recorded output its input can be had."""
        of = component.findall("input")
        if component.tag != "aerosurface_scale" or len(of) != 1 or component.find("zero_centered") is not None:
            return
        for made in component.findall("output"):
            if _name(made.text) in self._recorded:
                self._scales[_name(of[0].text)] = _name(made.text), component

    def value(self, name: str, look: Callable[[str], Any], known: Collection[str]) -> Any:
        """Return what a static component makes of recorded surfaces; None for any other component, or of anything
        else."""
        if not self._from(name, known, set()):
            return None
        if name in self._scales:
            made, scale = self._scales[name]
            return _unscaled(scale, look(made))
        component = self.writes[name]
        given = [look(_name(node.text)) for node in component.findall("input")]
        if component.tag == "fcs_function":
            return value_of(part(component, "function"), look)
        if component.tag == "summer":
            total = sum(given, ca.SX(0.0)) + _number(component, "bias", 0.0)
            return _clipped(component, total)
        gain = _number(component, "gain", 1.0)
        if component.tag == "pure_gain":
            return _clipped(component, gain * given[0])
        return _clipped(component, gain * _scaled(component, given[0]))

    def _from(self, name: str, known: Collection[str], seen: set[str]) -> bool:
        """Return True if it is computed from what is `known` alone, by static components."""
        bare = name.lstrip("-")
        if bare in known or bare in self._scales:
            return True
        component = self.writes.get(bare)
        if component is None or component.tag not in _STATIC or bare in seen:
            return False
        if component.tag == "fcs_function":
            needed = [_name(p.text) for p in component.iter() if p.tag in ("property", "p", "independentVar")]
        else:
            needed = [_name(node.text) for node in component.findall("input")]
        return bool(needed) and all(self._from(one, known, seen | {bare}) for one in needed)


def _outputs(component: ET.Element) -> list[str]:
    """Properties that a component writes: `<output>`, and the one of its own name."""
    found = [_name(node.text) for node in component.findall("output")]
    own = component.get("name", "").strip()
    return [*found, own if "/" in own else "fcs/" + own.lower().replace(" ", "-")]


def _name(text: str | None) -> str:
    return (text or "").strip()


def _number(component: ET.Element, tag: str, default: float) -> float:
    node = optional(component, tag)
    return default if node is None else number_in(node)


def _clipped(component: ET.Element, value: Any) -> Any:
    if component.find("clipto") is None:
        return value
    low, high = _limits(component, "clipto")
    return ca.fmin(ca.fmax(value, low), high)


def _limits(component: ET.Element, tag: str) -> tuple[float, float]:
    node = component.find(tag)
    if node is None:
        return -1.0, 1.0
    return number_in(part(node, "min")), number_in(part(node, "max"))


def _slopes(component: ET.Element) -> tuple[float, float]:
    """Return the slopes of a scale about zero, below and above it."""
    (low, high), (bottom, top) = _limits(component, "domain"), _limits(component, "range")
    return (bottom / low if low else 0.0), (top / high if high else 0.0)


def _scaled(component: ET.Element, x: Any) -> Any:
    """Scale from domain to range; about zero unless the file states otherwise."""
    centred = component.find("zero_centered")
    if centred is not None and _name(centred.text).lower() in ("0", "false"):
        (low, high), (bottom, top) = _limits(component, "domain"), _limits(component, "range")
        return bottom + (x - low) * ((top - bottom) / (high - low))
    below, above = _slopes(component)
    return above * x if above == below else ca.if_else(x > 0.0, above * x, below * x)


def _unscaled(component: ET.Element, y: Any) -> Any:
    """The input of a scale about zero that has made y."""
    gain, (below, above) = _number(component, "gain", 1.0), _slopes(component)
    if not (gain * below and gain * above):
        raise InputError(f'<aerosurface_scale name="{component.get("name", "")}"> makes nothing of its input')
    y = y / gain
    up = y / above
    down = y / below
    return up if above == below else ca.if_else((y > 0.0) if above > 0.0 else (y < 0.0), up, down)
