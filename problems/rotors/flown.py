"""Multirotors flown by RotorPy with one hidden effect: its own simulator, aerodynamics and controller, in closed loop.

Nothing of casid makes the truth: an effect is a change of RotorPy's parameters, of what its instruments read, or of a
wire. The controller and the aircraft file know the parameters without it.
"""

from __future__ import annotations

import copy
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import casid as cs
from casid.errors import InputError
from problems.rotors.newton import OF_A_KIND

RATE_HZ = 100.0
DURATION_S = 20.0
RUN_IN_S = 1.0  # before the record, which begins in settled flight
VEHICLES = ("crazyflie_params", "hummingbird_params")
_FLIP = np.diag([1.0, -1.0, -1.0])  # forward-left-up and forward-right-down are one another's
NOISE = {"p": 0.006, "phi": 0.003, "ax": 0.05, "v_north": 0.02, "north": 0.01}  # 1-sigma, of all three of a kind


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A hidden effect: kind and target in the words of casid, its size, and RotorPy's parameters with it.

    Attributes
    ----------
    read
        What it changes of the record that was flown.
    at
        Time [s] from which the changed parameters hold.
    moved
        By how much the frame with its accelerometers lies beside its place by the file, RotorPy's axes [m].
    """

    kind: str
    target: str = ""
    term: str | None = None
    value: float = 0.0
    parameters: Callable[[dict[str, Any]], None] = lambda parameters: None
    read: Callable[[dict[str, np.ndarray]], None] = lambda channels: None
    at: float = 0.0
    moved: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Set:
    """One drawn set: what flew, its aircraft file, the record, and what was hidden (None: nothing)."""

    vehicle: str
    aircraft: cs.Aircraft
    record: cs.Record
    hidden: Hidden | None


def rotorpy(module: str) -> Any:
    """A module of RotorPy. Raises InputError where it is not installed."""
    try:
        return importlib.import_module(f"rotorpy.{module}")
    except ImportError:
        raise InputError("flights of multirotors need RotorPy: pip install casid[rotorpy]") from None


_SLOW_MOTORS = {"kp_att": 310.0, "kd_att": 57.0}  # gains of RotorPy's vehicle with a motor lag of 0.072 s
_NOT_IN_A_FILE = {"k_h": 0.0, "c_Dx": 0.0, "c_Dy": 0.0, "c_Dz": 0.0}  # translational lift, quadratic drag


def usual_parameters(vehicle: str, lag: float) -> dict[str, Any]:
    """RotorPy's parameters of a vehicle, with another motor lag [s] and without what no aircraft file can state."""
    own = copy.deepcopy(rotorpy(f"vehicles.{vehicle}").quad_params)
    return own | _SLOW_MOTORS | _NOT_IN_A_FILE | {"tau_m": lag, "motor_noise_std": 0.0}


def _hover_speed(parameters: Mapping[str, Any]) -> float:
    """Speed of the rotors in hover [rad/s]."""
    return float(np.sqrt(parameters["mass"] * 9.81 / parameters["num_rotors"] / parameters["k_eta"]))


def drag_at_hover(parameters: Mapping[str, Any]) -> float:
    """Drag of all rotors at the speed of hover, along x and along y [N s/m]."""
    return parameters["k_d"] * parameters["num_rotors"] * _hover_speed(parameters)


def aircraft_file(name: str, parameters: Mapping[str, Any]) -> cs.Aircraft:
    """The aircraft file of RotorPy's parameters; drag and inflow of the rotors are those at hover."""
    ratio = parameters["k_m"] / parameters["k_eta"]
    hover = _hover_speed(parameters)
    rotors = [
        cs.Rotor(
            name=f"m{i}",
            position=tuple(_FLIP @ np.asarray(place, dtype=float)),
            spin=-float(turn),
            thrust=(0.0, 0.0, parameters["k_eta"]),
            speed=True,
            torque=ratio,
            lag=parameters["tau_m"],
            std=0.03,
        )
        for i, (place, turn) in enumerate(
            zip(parameters["rotor_pos"].values(), parameters["rotor_directions"], strict=True), start=1
        )
    ]
    drag = (drag_at_hover(parameters), drag_at_hover(parameters), 0.0)
    inflow = parameters["k_z"] / parameters["k_eta"] / hover
    inertia = {axis: float(parameters[axis]) for axis in ("Ixx", "Iyy", "Izz")}
    return cs.Aircraft(
        name=name,
        mass=parameters["mass"],
        gravity=9.81,
        inertia=cs.Inertia(**inertia, Ixz=0.0),
        rotors=cs.Rotors(each=tuple(rotors), relative_uncertainty=0.1, drag=drag, inflow=inflow),
    )


class Figure:
    """A trajectory to be followed: sums of two sines along each axis, and a slow turn of the heading."""

    def __init__(self, rng: np.random.Generator, size: float) -> None:
        self.amplitude = size * rng.uniform(0.5, 1.0, (3, 2)) * np.array([[1.0], [1.0], [0.5]])
        self.omega = rng.uniform([0.6, 1.5], [1.2, 2.6], (3, 2))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (3, 2))
        self.yaw, self.yaw_omega = rng.uniform(0.3, 0.6), rng.uniform(0.5, 1.0)

    def update(self, t: float) -> dict[str, Any]:
        """What RotorPy's controllers want at a time."""
        angle, parts = self.omega * t + self.phase, {}
        for k, name in enumerate(("x", "x_dot", "x_ddot", "x_dddot", "x_ddddot")):
            parts[name] = np.sum(self.amplitude * self.omega**k * np.sin(angle + 0.5 * k * np.pi), axis=1)
        turn = self.yaw_omega * t
        return parts | {
            "yaw": self.yaw * np.sin(turn),
            "yaw_dot": self.yaw * self.yaw_omega * np.cos(turn),
            "yaw_ddot": 0.0,
        }


def fly(
    known: Mapping[str, Any], hidden: Hidden | None, seed: int, *, name: str, size: float, breeze: float
) -> cs.Record:
    """One closed-loop flight: the controller has the `known` parameters, the vehicle those with the hidden effect.

    size    of the trajectory [m];  breeze  r.m.s. of a fluctuating wind [m/s]
    """
    rng = np.random.default_rng(seed)
    true = copy.deepcopy(dict(known))
    if hidden is not None:
        hidden.parameters(true)
    late = hidden is not None and hidden.at > 0.0
    figure = Figure(rng, size)
    want = figure.update(-RUN_IN_S)
    state = {
        "x": want["x"],
        "v": want["x_dot"],
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(known["num_rotors"], _hover_speed(known)),
    }
    Multirotor = _vehicle(true.get("factors"))
    options = {"control_abstraction": "cmd_motor_speeds", "integrator_kwargs": {"method": "RK45", "rtol": 1e-5}}
    second = Multirotor(true, initial_state=state, **options)
    first = _vehicle(None)(dict(known), initial_state=state, **options) if late else second
    control = rotorpy("controllers.quadrotor_control").SE3Control(dict(known))
    steady, dt = rng.normal(0.0, breeze, 3), 1.0 / RATE_HZ
    rows: dict[str, list] = {n: [] for n in ("t", "command", "x", "v", "a", "R", "w", "wdot")}
    for k in range(-int(RUN_IN_S * RATE_HZ), int(DURATION_S * RATE_HZ)):
        t = k * dt
        craft = second if late and hidden is not None and t >= hidden.at else first
        command = np.clip(
            control.update(t, state, figure.update(t))["cmd_motor_speeds"],
            known["rotor_speed_min"],
            known["rotor_speed_max"],
        )
        steady = 0.98 * steady + np.sqrt(1.0 - 0.98**2) * rng.normal(0.0, breeze, 3)
        state["wind"] = steady
        acts = {"cmd_motor_speeds": command}
        now = craft.statedot(state, acts, dt)
        values = (
            t,
            command,
            state["x"],
            state["v"],
            now["vdot"],
            Rotation.from_quat(state["q"]).as_matrix(),
            state["w"],
            now["wdot"],
        )
        for column, value in zip(rows.values(), values if k >= 0 else (), strict=k >= 0):
            column.append(np.array(value))
        state = craft.step(state, acts, dt)
    channels = _read(rows, rng, hidden.moved if hidden is not None else (0.0, 0.0, 0.0))
    if hidden is not None:
        hidden.read(channels)
    rates = dict.fromkeys("pqr", "rad/s")
    return cs.Record.from_arrays(name=name, t=np.array(rows["t"]), channels=channels, units=rates)


def _vehicle(factors: Mapping[str, np.ndarray] | None) -> Any:
    """RotorPy's vehicle; with `factors` on thrust and torque of each rotor its wrench has what these add."""
    whole = rotorpy("vehicles.multirotor").Multirotor
    if factors is None:
        return whole

    class OfUnlikeRotors(whole):
        def compute_body_wrench(self, body_rates: Any, rotor_speeds: Any, body_airspeed_vector: Any) -> Any:
            force, moment = super().compute_body_wrench(body_rates, rotor_speeds, body_airspeed_vector)
            more = self.k_eta * rotor_speeds**2 * (factors["thrust"] - 1.0)
            along = np.stack([np.zeros_like(more), np.zeros_like(more), more], axis=1)
            moment = moment + np.cross(self.rotor_geometry, along).sum(axis=0)
            turned = factors["thrust"] * factors["torque"] - 1.0  # a blade that is short loses both
            moment[2] += float(np.sum(self.rotor_dir * self.k_m * rotor_speeds**2 * turned))
            return force + along.sum(axis=0), moment

    return OfUnlikeRotors


def _read(rows: Mapping[str, list], rng: np.random.Generator, moved: tuple[float, ...]) -> dict[str, np.ndarray]:
    """Channels of casid from RotorPy's states, with noise; `moved`: of the accelerometers from the centre of mass."""
    R = _FLIP @ np.stack(rows["R"]) @ _FLIP
    psi, theta, phi = Rotation.from_matrix(R).as_euler("ZYX").T
    position, velocity, rates = (np.stack(rows[n]) @ _FLIP for n in ("x", "v", "w"))
    force = np.einsum("kji,kj->ki", R, (np.stack(rows["a"]) + [0.0, 0.0, 9.81]) @ _FLIP)
    turning, arm = np.stack(rows["wdot"]) @ _FLIP, _FLIP @ np.asarray(moved)
    force = force + np.cross(turning, arm) + np.cross(rates, np.cross(rates, arm))
    columns = {"p": rates, "phi": np.stack([phi, theta, psi], axis=1), "ax": force, "v_north": velocity}
    columns["north"] = position * [1.0, 1.0, -1.0]
    channels = {f"m{i}": series for i, series in enumerate(np.stack(rows["command"]).T, start=1)}
    for first, values in columns.items():
        noisy = values + rng.normal(0.0, NOISE[first], values.shape)
        channels |= dict(zip(OF_A_KIND[first], noisy.T, strict=True))
    return channels
