"""Static components of a JSBSim control system: what they make of recorded surfaces."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection
from typing import Any

import casadi as ca

from casid.errors import InputError
from casid.model.jsbsim.functions import value_of
from casid.model.jsbsim.source import number_of, part

_STATIC = ("aerosurface_scale", "pure_gain", "summer", "fcs_function")
_SECTIONS = ("flight_control", "autopilot", "system")


class Components:
    """The components of a file by the property that each writes, and the values that it sets at the start."""

    def __init__(self, root: ET.Element, recorded: Collection[str]) -> None:
        self._recorded = recorded
        self._writes: dict[str, ET.Element] = {}
        self._scales: dict[str, tuple[str, ET.Element]] = {}  # input -> what a scale makes of it
        self._initial: dict[str, float] = {}
        for section in (*_SECTIONS, "aerodynamics"):
            for node in root.findall(section):
                self._initial |= {
                    (p.text or "").strip(): number_of(p.get("value"), "property value")
                    for p in node.findall("property")
                    if p.get("value")
                }
                for component in node.iterfind("channel/*"):
                    for name in _outputs(component):
                        self._writes[name] = component
                    self._keep_scale(component)

    def _keep_scale(self, component: ET.Element) -> None:
        """A scale from whose recorded output its input can be had."""
        of = component.findall("input")
        if component.tag != "aerosurface_scale" or len(of) != 1 or component.find("zero_centered") is not None:
            return
        for made in component.findall("output"):
            if _name(made.text) in self._recorded:
                self._scales[_name(of[0].text)] = _name(made.text), component

    def is_written(self, name: str) -> bool:
        """Whether some component writes the property."""
        return name in self._writes

    def initial(self, name: str) -> float:
        """What the file sets a property to at the start; 0 where it says nothing."""
        return self._initial.get(name, 0.0)

    def value(self, name: str, look: Callable[[str], Any], known: Collection[str]) -> Any:
        """What a static component makes of recorded surfaces; None when it is no such, or of anything else."""
        if not self._from(name, known, set()):
            return None
        if name in self._scales:
            made, scale = self._scales[name]
            return _unscaled(scale, look(made))
        component = self._writes[name]
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
        """Whether it is computed from what is `known` alone, by static components."""
        bare = name.lstrip("-")
        if bare in known or bare in self._scales:
            return True
        component = self._writes.get(bare)
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
    node = component.find(tag)
    return default if node is None else number_of(node.text, tag)


def _clipped(component: ET.Element, value: Any) -> Any:
    limits = component.find("clipto")
    if limits is None:
        return value
    low, high = (number_of(part(limits, tag).text, tag) for tag in ("min", "max"))
    return ca.fmin(ca.fmax(value, low), high)


def _limits(component: ET.Element, tag: str) -> tuple[float, float]:
    node = component.find(tag)
    if node is None:
        return -1.0, 1.0
    return number_of(part(node, "min").text, "min"), number_of(part(node, "max").text, "max")


def _slopes(component: ET.Element) -> tuple[float, float]:
    """Of a scale about zero, below and above it."""
    (low, high), (bottom, top) = _limits(component, "domain"), _limits(component, "range")
    return (bottom / low if low else 0.0), (top / high if high else 0.0)


def _scaled(component: ET.Element, x: Any) -> Any:
    """From domain to range; about zero when it is not said otherwise."""
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
    up, down = y / above, y / below
    return up if above == below else ca.if_else((y > 0.0) if above > 0.0 else (y < 0.0), up, down)
