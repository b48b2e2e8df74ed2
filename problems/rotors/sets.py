"""Drawn sets of RotorPy flights, each with one hidden effect, none, or one that the catalogue does not have.

`scripts/blind.py --sets rotors` flies and diagnoses them (`problems.blind.rotors`).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from problems.rotors.flown import VEHICLES, Hidden, Set, aircraft_file, drag_at_hover, fly, usual_parameters

ONE, CLEAN = 24, 6
BREEZE = 0.4  # m/s, r.m.s. of each axis
_LAGS = (0.005, 0.03)  # s, of the file
_SIZE = {"crazyflie_params": 0.8, "hummingbird_params": 1.6}  # m, of the trajectory

Parameters = dict[str, Any]
Change = Callable[[Parameters], None]


def weaker(i: int, **factors: float) -> Change:
    """Factors on thrust and torque of one rotor: RotorPy has one of each for all, so that its class is extended."""

    def change(parameters: Parameters) -> None:
        own = parameters.setdefault(
            "factors", {name: np.ones(parameters["num_rotors"]) for name in ("thrust", "torque")}
        )
        for name, factor in factors.items():
            own[name][i] *= factor

    return change


def _scaled(factors: Mapping[str, float]) -> Change:
    def change(parameters: Parameters) -> None:
        for name, factor in factors.items():
            parameters[name] = parameters[name] * factor

    return change


def _moved(offset: np.ndarray, only: str | None = None) -> Change:
    """Hubs moved against the centre of mass, all or one; RotorPy's axes."""

    def change(parameters: Parameters) -> None:
        places = copy.deepcopy(parameters["rotor_pos"])
        for name in places:
            places[name] = np.asarray(places[name], dtype=float) + (offset if only in (None, name) else 0.0)
        parameters["rotor_pos"] = places

    return change


def _set(name: str, value: Any) -> Change:
    return lambda parameters: parameters.__setitem__(name, value)


@dataclass(frozen=True)
class _Scene:
    rng: np.random.Generator
    known: Parameters

    @property
    def arm(self) -> float:
        return float(np.hypot(*np.asarray(self.known["rotor_pos"]["r1"])[:2]))

    def either(self, low: float, high: float) -> float:
        """A size between two, of either sign."""
        return float(self.rng.choice([-1.0, 1.0]) * self.rng.uniform(low, high))

    def rotor(self) -> int:
        return int(self.rng.integers(self.known["num_rotors"]))


def _effectiveness(s: _Scene) -> Hidden:
    i, value = s.rotor(), -float(s.rng.uniform(0.15, 0.35))
    return Hidden(kind="rotor_effectiveness", target=f"m{i + 1}", value=value, parameters=weaker(i, thrust=1.0 + value))


def _all_effectiveness(s: _Scene) -> Hidden:
    value = -float(s.rng.uniform(0.12, 0.25))
    factors = {"k_eta": 1.0 + value, "k_m": 1.0 + value}
    return Hidden(kind="rotor_effectiveness", target="rotors", value=value, parameters=_scaled(factors))


def _lag(s: _Scene) -> Hidden:
    true = 0.072 if s.known["tau_m"] < 0.01 else float(s.rng.uniform(0.07, 0.1))
    return Hidden(kind="rotor_lag", target="rotors", value=true - s.known["tau_m"], parameters=_set("tau_m", true))


def _mass(s: _Scene) -> Hidden:
    value = float(s.rng.uniform(0.12, 0.25)) * s.known["mass"]
    return Hidden(kind="mass", value=value, parameters=_set("mass", s.known["mass"] + value))


def _cg(s: _Scene) -> Hidden:
    axis, value = int(s.rng.integers(2)), s.either(0.1, 0.2) * s.arm
    offset = np.zeros(3)
    offset[axis] = -value if axis == 0 else value  # y is to the left there
    change = _moved(offset)  # and with the hubs the whole frame, its accelerometers too
    return Hidden(kind="cg_offset", target="xy"[axis], value=value, parameters=change, moved=tuple(offset))


def _inertia(s: _Scene) -> Hidden:
    axis = str(s.rng.choice(["Ixx", "Iyy"]))
    value = float(s.rng.uniform(0.3, 0.6)) * s.known[axis]
    return Hidden(kind="inertia", target=axis, value=value, parameters=_set(axis, s.known[axis] + value))


def _drag(s: _Scene) -> Hidden:
    """The drag of the rotors, along x as well as along y."""
    factor = float(s.rng.uniform(3.0, 6.0))
    value = (factor - 1.0) * drag_at_hover(s.known)
    return Hidden(kind="body_drag", target="x", value=value, parameters=_scaled({"k_d": factor}))


def _swap(s: _Scene) -> Hidden:
    i, j = sorted(s.rng.choice(s.known["num_rotors"], 2, replace=False).tolist())
    a, b = f"m{i + 1}", f"m{j + 1}"

    def change(channels: dict[str, np.ndarray]) -> None:
        channels[a], channels[b] = channels[b], channels[a]

    return Hidden(kind="rotor_swap", target=f"{a}+{b}", value=1.0, read=change)


def _bias(s: _Scene) -> Hidden:
    channel, size = [("p", 0.02), ("q", 0.02), ("phi", 0.03), ("az", 0.8)][int(s.rng.integers(4))]
    value = s.either(1.0, 2.0) * size

    def change(channels: dict[str, np.ndarray]) -> None:
        channels[channel] = channels[channel] + value

    return Hidden(kind="sensor_bias", target=channel, value=value, read=change)


def _breaks(s: _Scene) -> Hidden:
    i, value = s.rotor(), -float(s.rng.uniform(0.2, 0.35))
    at = float(s.rng.uniform(5.0, 10.0))
    change = weaker(i, thrust=1.0 + value)
    return Hidden(kind="effectiveness_change", target=f"m{i + 1}", value=value, parameters=change, at=at)


def _torque(s: _Scene) -> Hidden:
    i, value = s.rotor(), s.either(0.3, 0.5)
    return Hidden(kind="rotor_torque", target=f"m{i + 1}", value=value, parameters=weaker(i, torque=1.0 + value))


def _position(s: _Scene) -> Hidden:
    i, axis = s.rotor(), int(s.rng.integers(2))
    value = s.either(0.2, 0.35) * s.arm
    offset = np.zeros(3)
    offset[axis] = value if axis == 0 else -value
    change = _moved(offset, f"r{i + 1}")
    return Hidden(kind="rotor_position", target=f"m{i + 1}", term="xy"[axis], value=value, parameters=change)


_KINDS = (
    _effectiveness,
    _lag,
    _mass,
    _cg,
    _inertia,
    _drag,
    _swap,
    _bias,
    _breaks,
    _torque,
    _position,
    _all_effectiveness,
)
BEYOND: Mapping[str, Change] = MappingProxyType(
    {
        "flapping": lambda p: p.__setitem__("k_flap", p["k_d"] * 0.05),
        "translational_lift": lambda p: p.__setitem__("k_h", 0.004 * p["mass"] * 9.81),
        "quadratic_drag": lambda p: p.update(c_Dx=0.03 * p["mass"], c_Dy=0.03 * p["mass"], c_Dz=0.05 * p["mass"]),
        "product_of_inertia": lambda p: p.__setitem__("Ixy", 0.35 * p["Ixx"]),
    }
)
CASES = (*(f"one-{k}" for k in range(1, ONE + 1)), *(f"clean-{k}" for k in range(1, CLEAN + 1)), *BEYOND)


def fly_set(case: str, seed: int) -> Set:
    """The set of a case and a seed: the same ones give the same numbers."""
    k = CASES.index(case)
    rng, vehicle = np.random.default_rng([seed, k]), VEHICLES[k % 2]
    known = usual_parameters(vehicle, _LAGS[0] if k in (1, 13) else float(rng.choice(_LAGS)))
    hidden = None
    if k < ONE:
        hidden = _KINDS[k % len(_KINDS)](_Scene(rng, known))
    elif case in BEYOND:
        hidden = Hidden(kind=case, parameters=BEYOND[case])
    record = fly(known, hidden, int(rng.integers(2**31)), name="m1", size=_SIZE[vehicle], breeze=BREEZE)
    return Set(vehicle=vehicle, aircraft=aircraft_file(vehicle, known), record=record, hidden=hidden)
