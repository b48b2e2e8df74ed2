"""Rotors: input -> delay, lag -> thrust and reaction torque -> force and moment at a position, beside the surfaces.

The motion does not act on a rotor's speed, so that delay and lag are exact operators on the recorded inputs (`acting`)
and no states. Nothing here divides by airspeed: hover is an ordinary state.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from casid.arguments import given, number, require, sequence
from casid.errors import InputError, unknown
from casid.model import operators
from casid.model.aircraft_file import check_keys, numbered, numbers, subtable, text
from casid.records.record import Record
from casid.signals import CHANNELS

ALL = "rotors"  # target of an effect that all rotors share
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
_UP = (0.0, 0.0, -1.0)


def command(name: str) -> str:
    """Channel of a record that keeps what a rotor was commanded, beside what `acting` made of it."""
    return f"{name} command"


def lag_of(name: str) -> str:
    """Channel of a record that keeps the time constant [s] of a rotor of the file."""
    return f"{name} lag"


def delay_of(name: str) -> str:
    """Channel of a record that keeps the delay [s] of a rotor of the file."""
    return f"{name} delay"


# state of a velocity -> channel of a record that keeps what the rotors add to its rate by the file [m/s2]
SPECIFIC_THRUST = {state: f"thrust per mass along {axis}" for state, axis in zip("uvw", "xyz", strict=True)}


def thrust_of(name: str) -> str:
    """Name of a rotor's thrust [N], as a control to which a disturbance may add."""
    return f"thrust_{name}"


@dataclass(frozen=True, kw_only=True)
class Voltage:
    """Thrust follows (battery / reference)^exponent.

    Attributes
    ----------
    channel
        Input channel of the battery's voltage [V].
    exponent
        0: the battery does not matter; 1 where a motor's command is a duty cycle, and thrust linear in it.
    reference
        Voltage [V] for which the thrust is given.

    Examples
    --------
    >>> import casid as cs
    >>> cs.Voltage(reference=4.0).exponent
    1.0
    """

    channel: str = "battery"
    exponent: float = 1.0
    reference: float

    def __post_init__(self) -> None:
        _channel_name(self.channel, "[rotors] voltage: channel")
        object.__setattr__(self, "exponent", number(self.exponent, "[rotors] voltage: exponent"))
        object.__setattr__(self, "reference", number(self.reference, "[rotors] voltage: reference", positive=True))


@dataclass(frozen=True, kw_only=True)
class Rotor:
    """One rotor.

    Attributes
    ----------
    name
        Its input channel.
    position
        (x, y, z) of the hub from the centre of gravity of the file [m], body axes.
    axis
        Direction of its thrust, of any length.
    spin
        1 or -1: sign of its reaction torque on the airframe about z (down), for a rotor that thrusts upwards.
    thrust
        Polynomial of the input [N], lowest power first; (0, 0, k) for k times the square of a speed.
    torque
        Reaction torque per thrust [N m/N].
    lag, delay
        Time constant and dead time between input and thrust [s].
    effectiveness
        Factor on the thrust.
    std
        1-sigma of `effectiveness`; 0: not stated.
    inertia
        Polar inertia of what spins [kg m2]; its gyroscopic moment is taken into account where the input is a speed.
    speed
        Whether the input is a speed [rad/s].

    Raises
    ------
    InputError
        For what no rotor can be.

    Examples
    --------
    >>> import casid as cs
    >>> rotor = cs.Rotor(name="m1", position=(0.1, 0.1, 0.0), spin=1, thrust=(0.0, 0.0, 2e-8), torque=0.006)
    >>> round(rotor.static_thrust(2000.0), 3)
    0.08
    """

    name: str
    position: tuple[float, ...]
    axis: tuple[float, ...] = _UP
    spin: float
    thrust: tuple[float, ...]
    torque: float = 0.0
    lag: float = 0.0
    delay: float = 0.0
    effectiveness: float = 1.0
    std: float = 0.0
    inertia: float = 0.0
    speed: bool = False

    def __post_init__(self) -> None:
        _channel_name(self.name, "[[rotors.each]] name")
        where = f"rotor '{self.name}'"
        axis = numbers(self.axis, f"{where}: axis", 3)
        length = math.sqrt(sum(x * x for x in axis))
        if not length > 0.0:
            raise InputError(f"{where}: axis is {list(axis)}; expected a direction like [0, 0, -1]")
        thrust = numbers(self.thrust, f"{where}: thrust")
        if not any(thrust[1:]):
            raise InputError(f"{where}: thrust is {list(thrust)}; expected a polynomial that depends on the input")
        spin = number(self.spin, f"{where}: spin")
        if spin not in (1, -1):
            raise InputError(f"{where}: spin is {given(self.spin)}; expected 1 or -1, the sign of its torque about z")
        values: dict[str, Any] = {"axis": tuple(x / length for x in axis), "thrust": thrust, "spin": spin}
        values["position"] = numbers(self.position, f"{where}: position", 3)
        values["effectiveness"] = number(self.effectiveness, f"{where}: effectiveness", positive=True)
        values["speed"] = require(self.speed, bool, f"{where}: speed", "speed=True or speed=False")
        values["torque"] = number(self.torque, f"{where}: torque")
        for name in ("lag", "delay", "std", "inertia"):
            values[name] = number(getattr(self, name), f"{where}: {name}", least=0.0)
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def curve(self) -> np.polynomial.Polynomial:
        """Thrust [N] by the input, `effectiveness` included."""
        return np.polynomial.Polynomial(self.thrust) * self.effectiveness

    def static_thrust(self, u: Any) -> Any:
        """Thrust [N] at rest and at the reference voltage of an input, without `effectiveness`."""
        total = 0.0 * u
        for factor in reversed(self.thrust):
            total = total * u + factor
        return total

    def input_for(self, thrust: float) -> float:
        """The smallest positive input that gives a thrust [N] at rest.

        Parameters
        ----------
        thrust
            In N, `effectiveness` included.

        Raises
        ------
        InputError
            Where no input does.
        """
        shifted = np.array(self.thrust) - np.eye(len(self.thrust))[0] * thrust / self.effectiveness
        roots = np.roots(shifted[::-1])
        real = [float(r.real) for r in roots if abs(r.imag) < 1e-9 * max(abs(r), 1e-300) and r.real >= 0.0]
        if not real:
            raise InputError(f"rotor '{self.name}': no input gives a thrust of {thrust:.4g} N")
        return min(real)

    @property
    def moment_arm(self) -> tuple[float, ...]:
        """Moment about the centre of gravity per thrust by its position, position x axis [m]."""
        return tuple(float(x) for x in np.cross(self.position, self.axis))


@dataclass(frozen=True, kw_only=True)
class Rotors:
    """The rotors of an aircraft, and what the air makes of them.

    Attributes
    ----------
    each
        The rotors.
    relative_uncertainty
        A-priori 1-sigma of the effectiveness of each rotor, as a fraction; 0: not stated.
    inflow
        Part of the thrust of hover lost for each m/s along the thrust, 1/(m/s); of another speed in proportion to it.
    drag
        Drag along x, y, z per velocity [N s/m], of all rotors in hover. Each has its part at its hub, by its speed.
    voltage
        Influence of the battery; None: the thrust does not depend on it.

    Raises
    ------
    InputError
        For two rotors of one name, and for impossible values.

    Examples
    --------
    >>> import casid as cs
    >>> arms = {"m1": (1, 1, 1), "m2": (-1, 1, -1), "m3": (-1, -1, 1), "m4": (1, -1, -1)}
    >>> rotors = cs.Rotors(each=[
    ...     cs.Rotor(name=name, position=(0.1 * x, 0.1 * y, 0.0), spin=s, thrust=(0.0, 0.0, 2e-8), torque=0.006)
    ...     for name, (x, y, s) in arms.items()
    ... ])
    >>> rotors.names
    ('m1', 'm2', 'm3', 'm4')
    """

    each: tuple[Rotor, ...]
    relative_uncertainty: float = 0.0
    inflow: float = 0.0
    drag: tuple[float, ...] = (0.0, 0.0, 0.0)
    voltage: Voltage | None = None

    def __post_init__(self) -> None:
        each = sequence(self.each, "rotors: each", "a list of cs.Rotor(...)")
        for one in each:
            require(one, Rotor, "rotors: one", "cs.Rotor(...)")
        if not each:
            raise InputError("rotors: there is none; add a [[rotors.each]] table for each")
        if self.voltage is not None:
            require(self.voltage, Voltage, "rotors: voltage", "cs.Voltage(...), or None")
        taken = [one.name for one in each] + ([self.voltage.channel] if self.voltage else [])
        for name in taken:
            if taken.count(name) > 1:
                raise InputError(f"rotors: '{name}' stands twice; give each rotor an input channel of its own")
        share = number(self.relative_uncertainty, "[rotors] relative_uncertainty", least=0.0)
        for name, value in (
            ("each", each),
            ("relative_uncertainty", share),
            ("inflow", number(self.inflow, "[rotors] inflow")),
            ("drag", numbers(self.drag, "[rotors] drag", 3)),
        ):
            object.__setattr__(self, name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rotors, their input channels."""
        return tuple(one.name for one in self.each)

    @property
    def inputs(self) -> tuple[str, ...]:
        """All input channels: of the rotors, and of the battery where it matters."""
        return (*self.names, *((self.voltage.channel,) if self.voltage else ()))

    def of(self, target: str) -> tuple[Rotor, ...]:
        """The rotors that the target of an effect names: one, or all by "rotors".

        Raises
        ------
        InputError
            For a rotor that there is not.
        """
        if target == ALL:
            return self.each
        found = tuple(one for one in self.each if one.name == target)
        if not found:
            raise unknown("rotor", target, (*self.names, ALL))
        return found


def hover_thrusts(rotors: Rotors, weight: float) -> dict[str, float]:
    """Rotor -> its thrust [N] in hover: what carries the weight without a rolling or pitching moment, of more than
    three rotors with the least sum of squares; 0 of one that only pushes."""
    balance = np.array([(-one.axis[2], *one.moment_arm[:2]) for one in rotors.each]).T
    found = np.linalg.pinv(balance) @ np.array([weight, 0.0, 0.0])
    return dict(zip(rotors.names, map(float, found), strict=True))


def about_hover(thrust: Any, hover: float, unit: float, slope: float = 0.0, curvature: float = 0.0) -> Any:
    """A thrust [N], a number or a polynomial in the input, with another slope and curvature about that of hover; a
    curvature of 1 adds `unit` where the thrust is `unit` above it."""
    above = thrust - hover
    return thrust + slope * above + (curvature / unit) * above * above


def effectiveness(name: str) -> str:
    """Name of the parameter that multiplies the thrust of a rotor."""
    return f"effectiveness_{name}"


def parameters_of(rotors: Rotors) -> dict[str, tuple[float, float]]:
    """Name of each parameter of a model -> its value and a-priori 1-sigma, 0 where none is stated. Reaction torques are
    as in the file: what quick commands do to the yaw rate is mostly the inertia of the rotors."""
    share = rotors.relative_uncertainty
    found = {effectiveness(one.name): (one.effectiveness, one.std or share * one.effectiveness) for one in rotors.each}
    for axis, value in zip("xyz", rotors.drag, strict=True):
        if value:
            found[f"drag_{axis}"] = value, share * abs(value)
    if rotors.inflow:
        found["inflow"] = rotors.inflow, share * abs(rotors.inflow)
    if rotors.voltage and rotors.voltage.exponent:
        found["voltage_exponent"] = rotors.voltage.exponent, share * abs(rotors.voltage.exponent)
    return found


def with_values(rotors: Rotors, values: Mapping[str, float], std: Mapping[str, float]) -> Rotors:
    """The same rotors with other values of `parameters_of`, and their standard deviations."""
    each = tuple(
        replace(
            one,
            effectiveness=values.get(effectiveness(one.name), one.effectiveness),
            std=std.get(effectiveness(one.name), one.std),
        )
        for one in rotors.each
    )
    drag = tuple(values.get(f"drag_{axis}", value) for axis, value in zip("xyz", rotors.drag, strict=True))
    voltage = rotors.voltage
    if voltage is not None:
        voltage = replace(voltage, exponent=values.get("voltage_exponent", voltage.exponent))
    return replace(rotors, each=each, drag=drag, inflow=values.get("inflow", rotors.inflow), voltage=voltage)


def changed(rotors: Rotors, target: str, change: Callable[[Rotor], Mapping[str, Any]]) -> Rotors:
    """The rotors with other numbers of those that the target of an effect names; `change` gives them."""
    named = [one.name for one in rotors.of(target)]
    return replace(rotors, each=tuple(replace(o, **change(o)) if o.name in named else o for o in rotors.each))


def unit_of_parameter(name: str) -> str:
    """SI unit of one of `parameters_of`."""
    units = {"effectiveness": "1", "drag": "N s/m", "inflow": "s/m", "voltage": "1"}
    return units[name.partition("_")[0]]


def acting(rotor: Rotor, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """(N,) the input behind the rotor's delay and lag."""
    behind = operators.delay(t, u, rotor.delay) if rotor.delay else u
    return operators.lag(t, behind, rotor.lag) if rotor.lag else behind


def acting_inputs(rotors: Rotors, mass: float, record: Record) -> dict[str, np.ndarray]:
    """Inputs of the rotors behind their delays and lags, and what was commanded under `command`, as a record is asked
    for them once and once more. Raises InputError for an input that the record lacks."""
    found: dict[str, np.ndarray] = {}
    for name in rotors.inputs:
        if name not in record:
            raise InputError(f"record '{record.name}': input channel '{name}' is missing; its rotors are driven by it")
    for one in rotors.each:
        commanded = record[command(one.name)] if command(one.name) in record else record[one.name]
        found |= {command(one.name): commanded, one.name: acting(one, record.t, commanded)}
        found |= {lag_of(one.name): np.full(len(record), one.lag), delay_of(one.name): np.full(len(record), one.delay)}
        found[thrust_of(one.name)] = one.effectiveness * one.static_thrust(found[one.name])
    for i, name in enumerate(SPECIFIC_THRUST.values()):
        along = [(one.axis[i] / mass) * found[thrust_of(one.name)] for one in rotors.each]
        found[name] = np.sum(along, axis=0)
    return found


def _channel_name(name: Any, what: str) -> None:
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise InputError(f"{what} is {given(name)}; expected a name of letters, digits and underscores")
    if name in CHANNELS and name not in ("battery",):
        raise InputError(f"{what}: '{name}' is the channel of the {CHANNELS[name].label}; give the input another name")


_SHARED = ("thrust", "torque", "lag", "delay", "inertia")
_OF_ALL = ("relative_uncertainty", "inflow", "drag", "voltage")
_OWN = ("name", "position", "axis", "spin", "effectiveness", "std")


def read_rotors(table: Mapping[str, Any]) -> Rotors | None:
    """The rotors of the section [rotors] of an aircraft file; None where it has none. Raises InputError."""
    if not table:
        return None
    check_keys(table, (*_SHARED, *_OF_ALL, "each"), "[rotors]", ("each",))
    shared = {name: table[name] for name in _SHARED if name in table}
    found = []
    for where, one in numbered(table["each"], "rotors.each"):
        check_keys(one, (*_OWN, *_SHARED), where, ("name", "position", "spin"))
        own = {**shared, **one}
        if "thrust" not in own:
            raise InputError(f"{where}: 'thrust' is missing; add it there or under [rotors]")
        own["name"] = text(own["name"], f"{where}: name")
        found.append(Rotor(**own | _thrust(own["thrust"], where)))
    more = {name: table[name] for name in _OF_ALL if name in table and name != "voltage"}
    return Rotors(each=tuple(found), voltage=_voltage(table), **more)


def _thrust(value: Any, where: str) -> dict[str, Any]:
    """Polynomial of a thrust, and whether its input is a speed."""
    if not isinstance(value, dict):
        return {"thrust": numbers(value, f"{where}: thrust")}
    check_keys(value, ("coefficient",), f"{where}: thrust", ("coefficient",))
    return {"thrust": (0.0, 0.0, number(value["coefficient"], f"{where}: thrust", positive=True)), "speed": True}


def _voltage(table: Mapping[str, Any]) -> Voltage | None:
    if "voltage" not in table:
        return None
    one = subtable(table, "voltage", "[rotors]")
    check_keys(one, ("channel", "exponent", "reference"), "[rotors] voltage", ("reference",))
    return Voltage(**one)


def written_rotors(rotors: Rotors) -> Iterator[tuple[str, dict[str, Any]]]:
    """(header, table) of the sections of an aircraft file; what all rotors share is written once."""
    each = [_written(one) for one in rotors.each]
    shared = {name: each[0].get(name) for name in _SHARED if all(one.get(name) == each[0].get(name) for one in each)}
    general: dict[str, Any] = {name: value for name, value in shared.items() if value is not None}
    general |= {n: getattr(rotors, n) for n in ("relative_uncertainty", "inflow") if getattr(rotors, n)}
    general |= {"drag": rotors.drag} if any(rotors.drag) else {}
    general |= {"voltage": asdict(rotors.voltage)} if rotors.voltage else {}
    yield "[rotors]", general
    for one in each:
        yield "[[rotors.each]]", {name: value for name, value in one.items() if name not in general}


def _written(one: Rotor) -> dict[str, Any]:
    table: dict[str, Any] = {"name": one.name, "position": one.position, "axis": one.axis, "spin": one.spin}
    if one.axis == _UP:
        del table["axis"]
    table["thrust"] = {"coefficient": one.thrust[2]} if one.speed else one.thrust
    table |= {name: getattr(one, name) for name in ("torque", "lag", "delay", "inertia", "std") if getattr(one, name)}
    return table | ({"effectiveness": one.effectiveness} if one.effectiveness != 1.0 else {})
