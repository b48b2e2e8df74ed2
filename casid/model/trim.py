"""Steady straight flight of an aircraft model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np
import scipy

from casid.arguments import number
from casid.errors import InputError
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.dynamics import aircraft_model, standard_density


@dataclass(frozen=True, kw_only=True)
class Trim:
    """State and controls of unaccelerated flight, SI and radians.

    Attributes
    ----------
    V
        Airspeed [m/s].
    alpha, theta
        Angle of attack and pitch attitude [rad].
    delta_e
        Elevator [rad].
    thrust
        Of all engines [N].
    rho
        Density of the air [kg/m3].
    phi
        Bank angle [rad]; an aircraft with rotors may need one.
    rotors
        Rotor or battery channel -> its input.

    Examples
    --------
    >>> import casid as cs
    >>> level = cs.trim("casid/cli/demo/aircraft.toml", V=95.0, rho=0.957)
    >>> round(level.alpha - level.theta, 9)
    0.0
    """

    V: float
    alpha: float
    theta: float
    delta_e: float
    thrust: float
    rho: float
    phi: float = 0.0
    rotors: Mapping[str, float] = field(default_factory=dict)

    @property
    def state(self) -> np.ndarray:
        """(8,) state vector u v w p q r phi theta."""
        climb = self.theta - self.alpha
        u, _, down = self.V * np.array([np.cos(self.alpha), 0.0, np.sin(self.alpha)])
        if self.phi:  # the path of flight lies in the vertical plane of the heading
            ahead = self.V * np.cos(climb)
            below = -self.V * np.sin(climb)
            across = ahead * np.sin(self.theta) + below * np.cos(self.theta)
            return np.array(
                [u, across * np.sin(self.phi), across * np.cos(self.phi), 0, 0, 0, self.phi, self.theta], dtype=float
            )
        return np.array([u, 0, down, 0, 0, 0, 0, self.theta], dtype=float)

    @property
    def inputs(self) -> dict[str, float]:
        """Input of an aircraft model -> its value."""
        fixed = {"delta_e": self.delta_e, "delta_a": 0.0, "delta_r": 0.0, "thrust": self.thrust, "rho": self.rho}
        return fixed | dict(self.rotors)


def trim(
    aircraft: Aircraft | str | Path,
    *,
    V: float,
    altitude: float | None = None,
    rho: float | None = None,
    thrust: float | None = None,
    climb_angle: float = 0.0,
    values: dict[str, float] | None = None,
) -> Trim:
    """Solve udot = wdot = qdot = 0 for alpha, delta_e and one of thrust or density.

    Given density (or altitude, standard atmosphere), thrust is found; given thrust, density is. An aircraft with rotors
    is balanced in all axes by their inputs, bank and pitch angle, with surfaces at rest and `thrust` as given (or 0):
    V = 0 is hover.

    Parameters
    ----------
    aircraft
        The aircraft, or the name of its file; its effects are left out.
    V
        Airspeed [m/s].
    altitude
        Geometric altitude [m], -1000 to 20000; it gives the density of the standard atmosphere (ISO 2533).
    rho
        Density of the air [kg/m3]; it wins over `altitude`.
    thrust
        Of all engines [N].
    climb_angle
        Angle of the flight path [rad], positive in a climb.
    values
        Parameters by name, put over those of the aircraft file.

    Returns
    -------
    Trim
        Airspeed, angle of attack, pitch attitude, elevator, thrust and density; `state` and `inputs` feed `simulate`.

    Raises
    ------
    InputError
        When density and thrust are both given or both missing, and when there is no trim.

    Examples
    --------
    >>> import casid as cs
    >>> level = cs.trim("casid/cli/demo/aircraft.toml", V=95.0, rho=0.957)
    >>> round(level.thrust, -2), round(level.alpha, 2)
    (10400.0, -0.02)
    """
    aircraft = given_aircraft(aircraft, "trim")
    number(V, "trim: V", least=0.0, positive=aircraft.rotors is None)
    for what, value in (("altitude", altitude), ("rho", rho), ("thrust", thrust), ("climb_angle", climb_angle)):
        if value is not None:
            number(value, f"trim: {what}", positive=what == "rho")
    if aircraft.rotors is not None:
        if rho is None:
            rho = float(standard_density(np.array(altitude or 0.0)))
        return _balanced_by_rotors(aircraft, V, climb_angle, rho, thrust or 0.0, values)
    if (rho is None and altitude is None) == (thrust is None):
        raise InputError("trim: give either a density (rho or altitude) or a thrust, the other is solved for")
    if rho is None and altitude is not None:
        if not -1e3 <= altitude <= 2e4:
            raise InputError(f"trim: altitude is {altitude:g} m; expected -1000 to 20000 m, or give rho")
        rho = float(standard_density(np.array(altitude)))
    model = aircraft_model(aircraft, effects=())
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    p = model.nominal_vector(values)
    calm = np.zeros(len(model.disturbances))
    weight = aircraft.mass * aircraft.gravity

    def point(z: np.ndarray) -> Trim:
        return Trim(
            V=V,
            alpha=float(z[0]),
            theta=float(z[0]) + climb_angle,
            delta_e=float(z[1]),
            thrust=float(z[2] * 0.1 * weight if thrust is None else thrust),
            rho=float(z[2] if rho is None else rho),
        )

    def imbalance(z: np.ndarray) -> np.ndarray:
        at = point(z)
        inputs = [at.inputs[name] for name in model.inputs]
        derivative = f(at.state, inputs, p, calm).full()[:, 0]
        return derivative[[model.states.index(s) for s in ("u", "w", "q")]]

    solution = scipy.optimize.root(imbalance, np.array([0.05, 0.0, 1.0]), tol=1e-13)
    if np.abs(imbalance(solution.x)).max() > 1e-8:
        raise InputError(f"trim: '{aircraft.name}' has no steady flight at V = {V:g} m/s ({solution.message})")
    return point(solution.x)


def _balanced_by_rotors(
    aircraft: Aircraft, V: float, climb: float, rho: float, thrust: float, values: dict[str, float] | None
) -> Trim:
    """Steady flight by Newton's method from hover with equal thrusts; of more than four rotors with the least change of
    these."""
    rotors = aircraft.required_rotors
    model = aircraft_model(aircraft, effects=())
    z = ca.SX.sym("z", len(rotors.each) + 2)  # thrusts over weight, bank, pitch
    weight = aircraft.mass * aircraft.gravity
    phi = z[-2]
    theta = z[-1]
    ahead = V * math.cos(climb)
    below = -V * math.sin(climb)
    across = ahead * ca.sin(theta) + below * ca.cos(theta)
    state = ca.vertcat(
        ahead * ca.cos(theta) - below * ca.sin(theta), across * ca.sin(phi), across * ca.cos(phi), 0, 0, 0, phi, theta
    )
    at_rest = {one.name: one.input_for(weight / len(rotors.each)) for one in rotors.each}
    battery = {rotors.voltage.channel: rotors.voltage.reference} if rotors.voltage else {}
    given = {"thrust": thrust, "rho": rho} | battery
    given |= {name: u * (1.0 + z[i]) for i, (name, u) in enumerate(at_rest.items())}
    inputs = [ca.SX(given.get(name, 0.0)) for name in model.inputs]
    p = model.nominal_vector(values)
    calm = np.zeros(len(model.disturbances))
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])(state, ca.vertcat(*inputs), p, calm)
    left = f[[model.states.index(name) for name in "uvwpqr"]]
    at = ca.Function("at", [z], [left, ca.jacobian(left, z)])
    point = np.zeros(z.shape[0])
    for _ in range(50):
        found, slope = (part.full() for part in at(point))
        step = np.linalg.lstsq(slope, -found[:, 0], rcond=None)[0]
        point = point + step
        if np.abs(step).max() < 1e-13:
            break
    if not np.abs(at(point)[0].full()).max() < 1e-8:
        raise InputError(f"trim: the rotors of '{aircraft.name}' do not balance it at V = {V:g} m/s")
    drive = {name: u * (1.0 + float(point[i])) for i, (name, u) in enumerate(at_rest.items())} | battery
    bank = float(point[-2])
    pitch = float(point[-1])
    return Trim(V=V, alpha=pitch - climb, theta=pitch, delta_e=0.0, thrust=thrust, rho=rho, phi=bank, rotors=drive)
