"""The signal path of an aircraft, station by station, as CasADi expressions.

surface -> mass properties -> wind -> rotors -> air data -> coefficients -> forces and moments -> rigid body -> sensors

Every station is one function that reads and writes a `SignalPath`. An effect (see `effects`) is an extra piece at one
named station, applied after the station's own equations. Frames: body axes x forward, y right, z down, origin in the
centre of gravity; u v w are inertial velocity components in an air mass at rest, wind enters at its own station.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from casid.model import station
from casid.model.aerodynamics import RATES, consistent, own_coefficients
from casid.model.airframe import INERTIAS, POSITIONS, PRODUCTS, Airframe, unsymmetric_moment
from casid.model.measured_force import external_force
from casid.model.rotors import Rotor, effectiveness, thrust_of
from casid.model.terms import derivative_term, parse_term
from casid.model.vectors import accelerations_at, cross, minus
from casid.signals import SURFACES

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta")
# nothing depends on them but the heading of a velocity over ground: states of a model that is asked for them as outputs
INTEGRALS = ("psi", "altitude", "north", "east")
GROUND = ("v_north", "v_east", "v_down")  # velocity over ground, of a model that has the heading
EQUATIONS = ("u", "v", "w", "p", "q", "r")  # of motion, at which something unknown may enter beside rotors
INPUTS = ("delta_e", "delta_a", "delta_r", "thrust", "rho")
_STANDS = 1e-6  # thrust over that of hover below which a rotor stands: the root of none has no slope
_SLOWEST = 1e-3  # m/s: the least airspeed of a wing beside rotors, so that hover has flow angles
MOMENTS = ("Cl", "Cm", "Cn")


def input_names(aircraft: Airframe) -> tuple[str, ...]:
    """Inputs of a model: surfaces, thrust and density of a wing, and what drives the rotors."""
    return (*(INPUTS if aircraft.winged else ()), *(aircraft.rotors.inputs if aircraft.rotors else ()))


def disturbance_names(aircraft: Airframe) -> tuple[str, ...]:
    """Stations at which an unknown time history may enter: increments of coefficients (dCL ...), of surfaces and
    thrust (d_delta_e ..., d_thrust), of the input and the thrust of each rotor (d_m1, d_thrust_m1), and beside rotors
    of accelerations (f_u [m/s2], f_p [rad/s2] ...); velocity of the air in body axes [m/s], its rotation [rad/s]."""
    names = aircraft.rotors.names if aircraft.rotors else ()
    of_rotors = tuple(station.control(one) for name in names for one in (name, thrust_of(name)))
    of_rotors += tuple(map(station.equation, EQUATIONS)) if names else ()
    if not aircraft.winged:
        return (*of_rotors, *map(station.wind, "xyz"))
    increments = tuple(station.coefficient(name) for name in aircraft.coefficients)
    controls = (station.control(name) for name in (*SURFACES, "thrust"))
    return (*increments, *controls, *of_rotors, *station.MOVING_AIR)


@dataclass
class RotorSignal:
    """A rotor on the path: its input, thrust at rest [N] and torque per thrust [m] with the sign of its spin, position
    [m] and the axis of its thrust."""

    rotor: Rotor
    input: Any
    thrust: Any
    torque: Any
    position: list[Any]
    axis: list[Any]


@dataclass
class SignalPath:
    """Quantities known at a station: symbols of state, inputs, parameters and disturbances, and the quantities that the
    stations up to here have computed. Effects change these quantities; nothing else does. `turning` has the sign of the
    air's rotation by the gradient of its velocity, for axes about which it turns."""

    aircraft: Airframe
    state: Mapping[str, Any]
    inputs: Mapping[str, Any]
    parameter: Mapping[str, Any]
    disturbance: Mapping[str, Any]
    turning: Mapping[str, float] = field(default_factory=dict)
    surface: dict[str, Any] = field(default_factory=dict)
    mass: Any = 0.0
    inertia: dict[str, Any] = field(default_factory=dict)
    cg: list[Any] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    wind: list[Any] = field(default_factory=list)
    rotor: dict[str, RotorSignal] = field(default_factory=dict)
    drag: dict[str, Any] = field(default_factory=dict)
    inflow: Any = 0.0
    voltage_exponent: Any = 0.0
    air: dict[str, Any] = field(default_factory=dict)
    regressor: dict[str, Any] = field(default_factory=dict)
    rates: Any = None
    coefficient: dict[str, Any] = field(default_factory=dict)
    moment: list[Any] = field(default_factory=list)
    force: list[Any] = field(default_factory=list)
    sensor_position: dict[str, list[Any]] = field(default_factory=dict)
    output: dict[str, Any] = field(default_factory=dict)
    derivative: dict[str, Any] = field(default_factory=dict)

    def reads(self, channel: str, read: Callable[[Any], Any], true: Callable[[Any], Any]) -> None:
        """Let an instrument read something else than what is, as of `Readable`."""
        self.output[channel] = read(self.output[channel])


def surface_station(path: SignalPath) -> None:
    """Surface positions and thrust as they act on the aircraft."""
    for name in (*SURFACES, "thrust") if path.aircraft.winged else ():
        path.surface[name] = path.inputs[name] + path.disturbance[station.control(name)]


def mass_station(path: SignalPath) -> None:
    """Mass, inertia tensor, position of the true c.g. relative to the one in the aircraft file."""
    inertia = path.aircraft.inertia
    path.mass = path.aircraft.mass
    path.inertia = {name: getattr(inertia, name) for name in (*INERTIAS, *PRODUCTS)}


def wind_station(path: SignalPath) -> None:
    """Velocity of the air in body axes."""
    path.wind = [path.disturbance[station.wind(axis)] for axis in "xyz"]


def rotor_station(path: SignalPath) -> None:
    """Input, thrust at rest and torque per thrust of each rotor, and what acts on the airframe beside them."""
    rotors = path.aircraft.rotors
    if rotors is None:
        return
    path.rotor = {}
    for one in rotors.each:
        u = path.inputs[one.name] + path.disturbance[station.control(one.name)]
        path.rotor[one.name] = RotorSignal(
            rotor=one,
            input=u,
            thrust=path.parameter[effectiveness(one.name)] * one.static_thrust(u),
            torque=one.spin * one.torque,
            position=list(one.position),
            axis=list(one.axis),
        )
    path.drag = {axis: path.parameter.get(f"drag_{axis}", 0.0) for axis in "xyz"}
    path.inflow = path.parameter.get("inflow", 0.0)
    path.voltage_exponent = path.parameter.get("voltage_exponent", 0.0)


def rotor_loads(path: SignalPath) -> tuple[list[Any], list[Any]]:
    """Force [N] and moment [N m] of all rotors, in body axes about the reference point.

    Drag in proportion to velocity is that of the rotors, which their speeds make, and so is the loss of thrust with
    axial speed (P. Martin, E. Salaun, ICRA 2010, "The true role of accelerometer feedback in quadrotor control"): each
    rotor has its part at its hub, by the root of its thrust over that of hover.
    """
    rotors = path.aircraft.required_rotors
    rates = [path.state[name] for name in "pqr"]
    velocity = minus([path.state[name] for name in "uvw"], path.wind)
    hover = path.aircraft.mass * path.aircraft.gravity / len(rotors.each)
    force = [path.mass * path.disturbance[station.equation(name)] for name in "uvw"]
    moment = cross(path.cg, force)  # what enters an equation of force is in no other, wherever the c.g. is
    inflow = path.inflow
    pressure = 1.0
    if rotors.voltage is not None and not _is_zero(path.voltage_exponent):
        relative = path.inputs[rotors.voltage.channel] / rotors.voltage.reference
        pressure = ca.exp(path.voltage_exponent * ca.log(relative))
    for name, one in path.rotor.items():
        axis = one.axis
        thrust = one.thrust * pressure
        arm = minus(one.position, path.cg)
        hub = [v + w for v, w in zip(velocity, cross(rates, arm), strict=True)]
        speed = ca.sqrt(ca.fmax(one.rotor.static_thrust(one.input) / hover, _STANDS))  # over that of hover
        thrust = thrust + path.disturbance[station.control(thrust_of(name))]
        turning_back = [one.torque * thrust * a for a in axis]  # which axial speed hardly changes
        if not _is_zero(inflow):
            thrust = thrust - inflow * hover * speed * sum(a * v for a, v in zip(axis, hub, strict=True))
        along = [a * thrust for a in axis]
        if not all(map(_is_zero, path.drag.values())):
            part = speed / len(rotors.each)
            along = [a - path.drag[name] * part * v for a, name, v in zip(along, "xyz", hub, strict=True)]
        about = cross(one.position, along)
        spinning = [0.0, 0.0, 0.0]
        if one.rotor.speed and one.rotor.inertia:
            turning = [one.rotor.spin * one.rotor.inertia * a * one.input for a in axis]
            spinning = cross(turning, rates)  # less the rates x the angular momentum
        for i in range(3):
            force[i] = force[i] + along[i]
            moment[i] = moment[i] + about[i] - turning_back[i] + spinning[i]
    return force, moment


def _is_zero(value: Any) -> bool:
    return isinstance(value, float) and value == 0.0


# by the axis of the air's rotation that the gradient of its velocity makes: the state, that velocity as it was a part
# of the span behind; the axis of the velocity; and that part in units of span / pi
AIR_STATES: Mapping[str, tuple[str, int, float]] = MappingProxyType({"q": ("air_w", 2, 4.0), "r": ("air_v", 1, 3.0)})

TURNING: Mapping[str, float] = MappingProxyType({"q": -1.0, "r": 1.0})  # the signs of MIL-F-8785C, 3.7.5


def air_rotation(path: SignalPath) -> dict[str, Any]:
    """Rotation of the air [rad/s] about p, q, r: of its own, and what the gradient of its velocity along the path makes
    about the axes of `turning`. By MIL-F-8785C, 3.7.5: q = -s / (V + 4 b s / pi) w, r = s / (V + 3 b s / pi) v."""
    rotation = {axis: path.disturbance[station.rotation(axis)] for axis in "pqr"}
    speed = path.state["u"]
    span = 2.0 * path.aircraft.rate_length_lateral
    for axis, sign in path.turning.items():
        state, along, part = AIR_STATES[axis]
        rate = (path.wind[along] - path.state[state]) * np.pi * speed / (part * span)
        path.derivative[state] = rate
        rotation[axis] += sign * rate / speed
    return rotation


def air_data_station(path: SignalPath) -> None:
    """Airspeed, flow angles, dynamic pressure and the dimensionless regressors of the aerodynamic model."""
    state = path.state
    aircraft = path.aircraft
    if not aircraft.winged:
        return
    ua, va, wa = minus([state[name] for name in "uvw"], path.wind)
    if aircraft.rotors is not None:
        ua = ua + _SLOWEST
    V = ca.sqrt(ua**2 + va**2 + wa**2)
    alpha = ca.atan2(wa, ua)
    beta = ca.asin(va / V)
    path.air = {
        "u": ua,
        "v": va,
        "w": wa,
        "V": V,
        "alpha": alpha,
        "beta": beta,
        "qbar": 0.5 * path.inputs["rho"] * V**2,
    }
    lateral = aircraft.rate_length_lateral / V
    pitch = aircraft.rate_length_pitch / V
    rotation = air_rotation(path)
    V_trim = aircraft.trim.get("V")
    path.regressor = {
        "alpha": alpha,
        "beta": beta,
        "p": (state["p"] - rotation["p"]) * lateral,
        "q": (state["q"] - rotation["q"]) * pitch,
        "r": (state["r"] - rotation["r"]) * lateral,
        **{name: path.surface[name] for name in SURFACES},
        "mach": V / speed_of_sound(path.inputs["rho"]),
        "Tc": path.surface["thrust"] / (path.air["qbar"] * aircraft.area),
    }
    if V_trim:
        path.regressor["V"] = (V - V_trim) / V_trim


def speed_of_sound(rho: Any) -> Any:
    """Speed of sound [m/s] of the standard atmosphere up to 20 km as a function of density [kg/m3], of any algebra."""
    # relative to that at sea level
    temperature = (rho / 1.225) ** 0.2349692
    least = 216.65 / 288.15
    return 340.294 * (0.5 * (temperature + least + abs(temperature - least))) ** 0.5  # the larger of the two


def coefficient_station(path: SignalPath) -> None:
    """The six coefficients: derivatives and terms of the aircraft file on the regressors (paper eq. 8), its tables, and
    the user's own aerodynamics. What these make of the rates of the flow angles is in the symbols `path.rates`."""
    path.coefficient = {name: path.disturbance[station.coefficient(name)] for name in path.aircraft.coefficients}
    path.rates = ca.SX.sym("rate", len(RATES))
    for coefficient, value in given_coefficients(path.aircraft, quantities(path), path.parameter):
        path.coefficient[coefficient] += value
    for coefficient, name, term in aerodynamic_parameters(path.aircraft):
        if "alphadot" not in term and "betadot" not in term:
            path.coefficient[coefficient] += path.parameter[name] * evaluate(term, path)


def given_coefficients(
    aircraft: Airframe, quantities: Mapping[str, Any], parameters: Mapping[str, Any]
) -> list[tuple[str, Any]]:
    """(coefficient, value) of every table, and of the user's own aerodynamics; `parameters` hold the free knots."""
    rows = [(one.coefficient, one.at(quantities, parameters)) for one in aircraft.tables]
    if aircraft.aerodynamics is not None:
        rows += own_coefficients(aircraft.aerodynamics, quantities, aircraft.coefficients).items()
    return rows


def quantities(path: SignalPath) -> dict[str, Any]:
    """Return what tables and own aerodynamics may read: regressors, rates of the flow angles, and `FURTHER`."""
    further = {"airspeed": path.air["V"], "qbar": path.air["qbar"], "rho": path.inputs["rho"]}
    further |= {"thrust": path.surface["thrust"]}
    return path.regressor | dict(zip(RATES, ca.vertsplit(path.rates), strict=True)) | further


def given_series(path: SignalPath) -> dict[str, Any]:
    """Return the coefficients that the aircraft's tables and own aerodynamics give in steady flow, "given Cm", and
    their slopes in the surfaces, "given Cm_delta_e"; empty for an aircraft that has neither. `path` has come to its air
    data."""
    aircraft = path.aircraft
    if aircraft.aerodynamics is None and not aircraft.tables:
        return {}
    path.rates = ca.SX.zeros(len(RATES))
    path.parameter = {name: value for one in aircraft.tables for name, value in one.knots.items()}
    moved = {name: ca.SX.sym(name) for name in SURFACES}
    held = {name: path.surface[name] for name in SURFACES}
    path.regressor |= moved
    total: dict[str, Any] = {}
    for coefficient, value in given_coefficients(path.aircraft, quantities(path), path.parameter):
        total[coefficient] = total.get(coefficient, 0.0) + ca.SX(value)
    path.regressor |= held
    rows = {f"given {c}": value for c, value in total.items()}
    rows |= {f"given {c}_{name}": ca.jacobian(value, of) for c, value in total.items() for name, of in moved.items()}
    found = ca.substitute(list(rows.values()), list(moved.values()), [ca.SX(v) for v in held.values()])
    return {name: ca.densify(value) for name, value in zip(rows, found, strict=True)}


def settle_rates(path: SignalPath) -> None:
    """Put the rates of the flow angles, as all forces make them, where the coefficients depend on them."""
    whole = ca.vertcat(*path.coefficient.values())
    if not ca.depends_on(whole, path.rates):
        return
    rigid_body_station(path)
    unsteady_regressors(path)
    found = consistent(ca.vertcat(*(path.regressor[name] for name in RATES)), path.rates)
    for told in (path.coefficient, path.derivative, path.regressor):
        settled = ca.substitute([ca.SX(value) for value in told.values()], [path.rates], [found])
        told.update(zip(list(told), settled, strict=True))
    force_station(path)


def evaluate(term: str, path: SignalPath) -> Any:
    """A term (canonical text, "0" for the constant) on the regressors at this point of the path."""
    return parse_term(term).evaluate(path.regressor)


def aerodynamic_parameters(aircraft: Airframe) -> list[tuple[str, str, str]]:
    """(coefficient, parameter name, term) of every derivative and further term of the aircraft file."""
    rows = []
    for name in aircraft.derivatives:
        coefficient, term = derivative_term(name)
        rows.append((coefficient, name, term.name))
    for coefficient, terms in aircraft.terms.items():
        rows += [(coefficient, f"{coefficient}_{term}", term) for term in terms]
    return rows


def force_station(path: SignalPath) -> None:
    """Body-axes force and moment about the reference point, [N] and [N m], of air and thrust, of rotors, and of what
    else pulls."""
    loads = [external_force(path.inputs)]
    if path.aircraft.winged:
        loads.append(wing_loads(path))
    if path.aircraft.rotors is not None:
        loads.append(rotor_loads(path))
    path.force, path.moment = ([sum(parts) for parts in zip(*some, strict=True)] for some in zip(*loads, strict=True))


def wing_loads(path: SignalPath) -> tuple[list[Any], list[Any]]:
    """Aerodynamic force and moment about the reference point, with thrust along body x."""
    aircraft = path.aircraft
    C = path.coefficient
    air = path.air
    if aircraft.force_axes == "accelerations":
        force = [path.mass * C[name] for name in ("CX", "CY", "CZ")]
        return force, [path.inertia[axis] * C[name] for axis, name in zip(INERTIAS, MOMENTS, strict=False)]
    qS = air["qbar"] * aircraft.area
    if aircraft.force_axes == "wind":
        sa = ca.sin(air["alpha"])
        cos_a = ca.cos(air["alpha"])
        X = qS * (C["CL"] * sa - C["CD"] * cos_a)
        Z = -qS * (C["CL"] * cos_a + C["CD"] * sa)
    else:
        X = qS * C["CX"]
        Z = qS * C["CZ"]
    thrust = path.surface["thrust"]
    lateral = aircraft.moment_length_lateral
    pitch = aircraft.moment_length_pitch
    moment = [
        qS * lateral * C["Cl"],
        qS * pitch * C["Cm"] + aircraft.thrust_line_z * thrust,
        qS * lateral * C["Cn"],
    ]
    return [X + thrust, qS * C["CY"], Z], moment


def rigid_body_station(path: SignalPath) -> None:
    """Accelerations of the c.g. and the kinematics of the Euler angles; flat earth, constant mass."""
    s = path.state
    g = path.aircraft.gravity
    moments = minus(path.moment, cross(path.cg, path.force))
    ax, ay, az = (force / path.mass for force in path.force)
    sph, sth = (ca.sin(s[angle]) for angle in ("phi", "theta"))
    cph, cth = (ca.cos(s[angle]) for angle in ("phi", "theta"))
    p, q, r = rates = [s[name] for name in "pqr"]
    angular = dict(zip("pqr", _angular_acceleration(path, rates, moments), strict=True))
    if path.aircraft.rotors is not None:
        angular = {name: rate + path.disturbance[station.equation(name)] for name, rate in angular.items()}
    path.derivative |= {
        "u": ax - g * sth + r * s["v"] - q * s["w"],
        "v": ay + g * cth * sph - r * s["u"] + p * s["w"],
        "w": az + g * cth * cph + q * s["u"] - p * s["v"],
        **angular,
        "phi": p + ca.tan(s["theta"]) * (q * sph + r * cph),
        "theta": q * cph - r * sph,
        "psi": (q * sph + r * cph) / cth,
        "altitude": s["u"] * sth - s["v"] * sph * cth - s["w"] * cph * cth,
    }
    if "psi" in s:
        ground = velocity_over_ground(s)
        path.derivative |= {"north": ground["v_north"], "east": ground["v_east"]}


def velocity_over_ground(state: Mapping[str, Any]) -> dict[str, Any]:
    """v_north, v_east, v_down [m/s] of a state with a heading."""
    sph, sth, spsi = (ca.sin(state[angle]) for angle in ("phi", "theta", "psi"))
    cph, cth, cpsi = (ca.cos(state[angle]) for angle in ("phi", "theta", "psi"))
    across = state["v"] * sph + state["w"] * cph
    ahead = state["u"] * cth + across * sth
    aside = state["v"] * cph - state["w"] * sph
    return {
        "v_north": ahead * cpsi - aside * spsi,
        "v_east": ahead * spsi + aside * cpsi,
        "v_down": across * cth - state["u"] * sth,
    }


def _angular_acceleration(path: SignalPath, rates: Sequence[Any], moments: Sequence[Any]) -> tuple[Any, Any, Any]:
    """pdot, qdot, rdot by Euler's equations."""
    (p, q, r), (L, M, N) = rates, moments
    Ixx, Iyy, Izz, Ixz = (path.inertia[name] for name in INERTIAS)
    L = L - (Izz - Iyy) * q * r + Ixz * p * q
    N = N - (Iyy - Ixx) * p * q - Ixz * q * r
    determinant = Ixx * Izz - Ixz**2
    if all(_is_zero(path.inertia[name]) for name in PRODUCTS):
        pitch = (M - (Ixx - Izz) * p * r - Ixz * (p**2 - r**2)) / Iyy
        return (Izz * L + Ixz * N) / determinant, pitch, (Ixz * L + Ixx * N) / determinant
    xy = path.inertia["Ixy"]
    yz = path.inertia["Iyz"]
    turning = unsymmetric_moment(path.inertia, rates, (0.0, 0.0, 0.0))
    M = M - (Ixx - Izz) * p * r - Ixz * (p**2 - r**2) - turning[1]
    L = L - turning[0]
    N = N - turning[2]
    # pitch by what roll and yaw leave, these by what pitch makes
    a = xy * Izz + Ixz * yz
    b = yz * Ixx + Ixz * xy
    qdot = (M + (a * L + b * N) / determinant) / (Iyy - (a * xy + b * yz) / determinant)
    L = L + xy * qdot
    N = N + yz * qdot
    return (Izz * L + Ixz * N) / determinant, qdot, (Ixz * L + Ixx * N) / determinant


def sensor_station(path: SignalPath) -> None:
    """Compute the readings of instruments at their positions, relative to the c.g. of the aircraft file."""
    s = path.state
    d = path.derivative
    air = path.air
    rates = [s[name] for name in "pqr"]
    angular = [d[name] for name in "pqr"]

    def arm(name: str) -> list[Any]:
        return minus(path.sensor_position[name], path.cg)

    def airspeed_at(vane: str) -> list[Any]:
        u, v, w = (air[name] for name in "uvw")
        x, y, z = arm(vane)
        p, q, r = rates
        return [u + q * z - r * y, v + r * x - p * z, w + p * y - q * x]

    felt = [force / path.mass for force in path.force]
    path.output = {}
    if path.aircraft.winged:
        ua, _, wa = airspeed_at("alpha_vane")
        ub, vb, wb = airspeed_at("beta_vane")
        path.output |= {
            "V": air["V"],
            "alpha": ca.atan2(wa, ua),
            "beta": ca.asin(vb / ca.sqrt(ub**2 + vb**2 + wb**2)),
        }
    path.output |= {name: s[name] for name in ("p", "q", "r", "phi", "theta")}
    at_place = accelerations_at(arm("accelerometer"), felt, rates, angular)
    path.output |= dict(zip(("ax", "ay", "az"), at_place, strict=True))
    path.output |= dict(zip(("pdot", "qdot", "rdot"), angular, strict=True))
    path.output |= {name: s[name] for name in INTEGRALS if name in s}
    if "psi" in s:
        path.output |= velocity_over_ground(s)
    for name in path.output:
        if f"bias_{name}" in path.parameter:
            path.output[name] += path.parameter[f"bias_{name}"]


OUTPUTS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az", "pdot", "qdot", "rdot")


def unsteady_regressors(path: SignalPath) -> None:
    """alphadot and betadot made dimensionless like q and r, from the rigid body without the terms they multiply:
    explicit, exact to first order in those terms."""
    d = path.derivative
    air = path.air
    alphadot = (air["u"] * d["w"] - air["w"] * d["u"]) / (air["u"] ** 2 + air["w"] ** 2)
    betadot = (
        d["v"] - air["v"] * (air["u"] * d["u"] + air["v"] * d["v"] + air["w"] * d["w"]) / air["V"] ** 2
    ) / ca.sqrt(air["u"] ** 2 + air["w"] ** 2)
    path.regressor["alphadot"] = alphadot * path.aircraft.rate_length_pitch / air["V"]
    path.regressor["betadot"] = betadot * path.aircraft.rate_length_lateral / air["V"]


_UP_TO_THE_AIR: Mapping[str, Callable[[SignalPath], None]] = MappingProxyType(
    {
        "surface": surface_station,
        "mass": mass_station,
        "wind": wind_station,
        "rotors": rotor_station,
        "air data": air_data_station,
    }
)


def fly(path: SignalPath, effects: Mapping[str, list[Any]]) -> SignalPath:
    """Take the signal through all stations; `effects` gives, by station, functions that change the path there."""

    def apply(station: str) -> None:
        for change in effects.get(station, ()):
            change(path)

    path.sensor_position = {name: list(getattr(path.aircraft, name)) for name in POSITIONS}
    for name, compute in _UP_TO_THE_AIR.items():
        compute(path)
        apply(name)
    if path.aircraft.winged:
        _aerodynamic_forces(path, apply)
    else:
        force_station(path)
    apply("moments")
    rigid_body_station(path)
    sensor_station(path)
    apply("sensors")
    return path


def _aerodynamic_forces(path: SignalPath, apply: Callable[[str], None]) -> None:
    """Coefficients, and all forces and moments with them."""
    coefficient_station(path)
    unsteady = [row for row in aerodynamic_parameters(path.aircraft) if "alphadot" in row[2] or "betadot" in row[2]]
    force_station(path)
    rigid_body_station(path)
    unsteady_regressors(path)
    for coefficient, name, term in unsteady:
        path.coefficient[coefficient] += path.parameter[name] * evaluate(term, path)
    apply("coefficients")
    force_station(path)
    settle_rates(path)
