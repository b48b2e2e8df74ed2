"""Steady straight flight as equations, and how its quantities change with the parameters of the aircraft file.

The unknowns z of a steady flight solve R(z, p) = 0. By the implicit function theorem dz/dp = -R_z^-1 R_p, so that a
quantity F(z, p) has the exact derivative F_p - F_z R_z^-1 R_p. All Jacobians are those of CasADi.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy

from casid.errors import InputError
from casid.model import station
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.path import INTEGRALS, STATES
from casid.model.system import Model

SETTINGS = ("V", "rho", "climb_angle", "alpha", "delta_e", "thrust")
_BALANCED = ("u", "w", "q")
_START = {"alpha": 0.05, "climb_angle": 0.0, "delta_e": 0.0, "thrust": 0.1}  # thrust in units of weight
_SMALL = 1e-8  # m/s2, rad/s2: imbalance that counts as none


@dataclass(frozen=True, eq=False, kw_only=True)
class Solved:
    """A steady flight: `values` of all SETTINGS, and (unknowns,) `z` of its equations."""

    values: Mapping[str, float]
    z: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """Unknowns, residuals, what is held and the parameters, as CasADi symbols and expressions."""

    unknown: ca.SX
    residual: ca.SX
    held: ca.SX
    p: ca.SX

    @cached_property
    def function(self) -> ca.Function:
        """(unknown, held, p) -> residual and its Jacobian by the unknowns."""
        slope = ca.jacobian(self.residual, self.unknown)
        return ca.Function("steady", [self.unknown, self.held, self.p], [self.residual, slope])

    def root(
        self, start: np.ndarray, held: Sequence[float], p: np.ndarray, tol: float
    ) -> scipy.optimize.OptimizeResult:
        """Solve for the unknowns; `fun` of the result is the residual that is left."""
        return scipy.optimize.root(
            lambda z: self.function(z, held, p)[0].full()[:, 0],
            start,
            jac=lambda z: self.function(z, held, p)[1].full(),
            tol=tol,
        )


class SteadyFlight:
    """An aircraft in steady straight flight, as expressions of airspeed, density, climb angle, angle of attack,
    elevator, thrust and the parameters p of its file.

    Effects of the file that are always in force take part; those of single records, and those with an onset, do not.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        always = tuple(e for e in aircraft.effects if not e.records and not e.onset_s)
        self.left_out = tuple(e for e in aircraft.effects if e not in always)
        self.aircraft = replace(aircraft, effects=always)
        model = aircraft_model(self.aircraft)
        self.model: Model = model
        self.moving = tuple(name for name in model.states if name not in INTEGRALS)
        self.further = tuple(name for name in self.moving if name not in STATES)
        self.setting = {name: ca.SX.sym(name) for name in SETTINGS}
        self.p: ca.SX = model.p  # (parameters,) symbols of the model's parameters
        self.mass: ca.SX = aircraft.mass + self._parameter("mass")  # with the effect on it, if there is one [kg]
        self._further = ca.SX.sym("further", len(self.further))
        self._at = self._point()
        index = [model.states.index(name) for name in (*_BALANCED, *self.further)]
        self._made: dict[tuple, Any] = {}
        self.accelerations = model.f[index]
        self.imbalance = self.here(self.accelerations)

    def _parameter(self, name: str) -> ca.SX:
        """A parameter of the model; zero where it has none of this name."""
        names = self.model.parameters
        return self.p[names.index(name)] if name in names else ca.SX(0.0)

    def _point(self) -> tuple[ca.SX, ca.SX]:
        """States and inputs of the model in steady flight."""
        s = self.setting
        zero = dict.fromkeys(self.model.states, 0.0)
        theta = s["alpha"] + s["climb_angle"]
        state = zero | {"u": s["V"] * ca.cos(s["alpha"]), "w": s["V"] * ca.sin(s["alpha"]), "theta": theta}
        state |= dict(zip(self.further, ca.vertsplit(self._further), strict=True))
        inputs = dict.fromkeys(self.model.inputs, 0.0) | {n: s[n] for n in ("delta_e", "thrust", "rho")}
        return ca.vertcat(*(state[n] for n in self.model.states)), ca.vertcat(*(inputs[n] for n in self.model.inputs))

    def here(self, expression: ca.SX) -> ca.SX:
        """An expression of the model's symbols, in steady flight and calm air."""
        m = self.model
        x, u = self._at
        return ca.substitute([expression], [m.x, m.u, m.w], [x, u, ca.SX.zeros(m.w.shape)])[0]

    def equations(self, unknown: Sequence[str]) -> Equations:
        """Steady flight with three of the SETTINGS unknown, the others held."""
        return self.once(("equations", *unknown), lambda: self._equations(unknown))

    def _equations(self, unknown: Sequence[str]) -> Equations:
        z = ca.SX.sym("z", len(unknown) + len(self.further))
        residual = ca.substitute([self.imbalance], *self._unknown_in(z, unknown))[0]
        held = ca.vertcat(*(self.setting[name] for name in SETTINGS if name not in unknown))
        return Equations(unknown=z, residual=residual, held=held, p=self.p)

    def once(self, key: tuple, make: Callable[[], Any]) -> Any:
        """Make something once for this aircraft, such as a compiled expression, and return it."""
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def solve(self, unknown: Sequence[str], held: Mapping[str, float], p: np.ndarray) -> Solved:
        """The steady flight with these settings held. Raises InputError when there is none."""
        values = [held[name] for name in SETTINGS if name not in unknown]
        start = np.array([_START[name] for name in unknown] + [0.0] * len(self.further))
        found = self.equations(unknown).root(start, values, p, tol=1e-13)
        if not np.abs(found.fun).max() < _SMALL:
            at = ", ".join(f"{name} = {value:.4g}" for name, value in held.items())
            raise InputError(f"'{self.aircraft.name}' has no steady flight at {at} ({' '.join(found.message.split())})")
        weight = self.aircraft.mass * self.aircraft.gravity
        scaled = {n: float(v) * (weight if n == "thrust" else 1.0) for n, v in zip(unknown, found.x, strict=False)}
        return Solved(values={name: scaled.get(name, held.get(name, 0.0)) for name in SETTINGS}, z=found.x)

    def along(self, unknown: Sequence[str], quantities: ca.SX) -> Implicit:
        """Expressions of SETTINGS and p as functions of p along steady flights with the same settings held."""
        equations = self.equations(unknown)
        (F,) = ca.substitute([quantities], *self._unknown_in(equations.unknown, unknown))
        return Implicit(equations, F)

    def at(self, unknown: Sequence[str], solved: Solved) -> tuple[np.ndarray, list[float]]:
        """Return the point at which `along` is evaluated: unknowns and what is held."""
        return solved.z, [solved.values[name] for name in SETTINGS if name not in unknown]

    def _unknown_in(self, z: ca.SX, unknown: Sequence[str]) -> tuple[list[ca.SX], list[ca.SX]]:
        """Symbols of the unknowns, and what they are by z."""
        weight = self.aircraft.mass * self.aircraft.gravity
        scaled = [z[i] * (weight if name == "thrust" else 1.0) for i, name in enumerate(unknown)]
        return [*(self.setting[name] for name in unknown), self._further], [*scaled, z[len(unknown) :]]

    @property
    def lift(self) -> ca.SX:
        """Lift in steady flight [N]."""
        s = self.setting
        weight = self.mass * self.aircraft.gravity
        return weight * ca.cos(s["climb_angle"]) - s["thrust"] * ca.sin(s["alpha"])

    @property
    def drag(self) -> ca.SX:
        """Drag in steady flight [N]."""
        s = self.setting
        weight = self.mass * self.aircraft.gravity
        return s["thrust"] * ca.cos(s["alpha"]) - weight * ca.sin(s["climb_angle"])

    def body_axes(self) -> ca.SX:
        """(2, 2) CX and CZ by a unit of lift and drag (wind axes) or of CX and CZ (body axes)."""
        if self.aircraft.force_axes == "body":
            return ca.SX.eye(2)
        sine = ca.sin(self.setting["alpha"])
        cosine = ca.cos(self.setting["alpha"])
        return ca.vertcat(ca.horzcat(sine, -cosine), ca.horzcat(-cosine, -sine))

    def by(self, name: str) -> ca.SX:
        """(3 + further,) derivatives of the balanced accelerations by an input, a state or a disturbance of the model,
        or by "alpha" (of the air, airspeed and attitude held)."""
        m = self.model
        s = self.setting
        if name == "alpha":
            return s["V"] * (self.by("w") * ca.cos(s["alpha"]) - self.by("u") * ca.sin(s["alpha"]))
        names = (*m.states, *m.inputs, *m.disturbances)
        symbol = ca.vertcat(m.x, m.u, m.w)[names.index(name)]
        return self.here(ca.jacobian(self.accelerations, symbol))

    def slopes(self, name: str) -> tuple[ca.SX, ca.SX]:
        """Derivatives of lift and pitching moment coefficient (true c.g., thrust included) by alpha, q [rad/s] or an
        input.

        Increments of the force coefficients hold the accelerations, so that the rate of the angle of attack is zero.
        Their own moment about a shifted centre of gravity is taken off again.
        """
        s = self.setting
        a = self.aircraft
        forces = ("CL", "CD") if self.aircraft.force_axes == "wind" else ("CX", "CZ")
        change = self.by(name)
        own = ca.horzcat(*(self.by(station.coefficient(c)) for c in forces))
        held = -ca.solve(own[:2, :], change[:2])
        moment = (change[2] + ca.mtimes(own[2, :], held)) / self.by(station.coefficient("Cm"))[2]
        along = ca.mtimes(self.body_axes(), held)
        x, z = (self._parameter(f"cg_offset({axis})") for axis in "xz")
        moment -= (x * along[1] - z * along[0]) / a.moment_length_pitch
        force = -held
        if name == "q":
            per_unit = 0.5 * s["rho"] * s["V"] ** 2 * a.area / self.mass
            turning = ca.vertcat(-s["V"] * ca.sin(s["alpha"]), s["V"] * ca.cos(s["alpha"]))
            force -= ca.solve(self.body_axes(), turning) / per_unit
        wind = forces[0] == "CL"
        lift = force[0] if wind else force[0] * ca.sin(s["alpha"]) - force[1] * ca.cos(s["alpha"])
        if name == "alpha":  # what turns with the body is the drag, and no lift
            lift -= self.drag / (0.5 * s["rho"] * s["V"] ** 2 * a.area)
        return lift, moment


class Implicit:
    """Quantities F(z, p) of unknowns that solve R(z, p) = 0, with their derivatives by p."""

    def __init__(self, equations: Equations, quantities: ca.SX) -> None:
        z = equations.unknown
        p = equations.p
        slopes = [ca.jacobian(e, by) for e in (quantities, equations.residual) for by in (z, p)]
        self._parts = ca.Function("implicit", [z, equations.held, p], [quantities, *slopes])

    def __call__(self, z: np.ndarray, held: Sequence[float], p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (n,) and exact derivatives (n, parameters), at unknowns that solve the equations."""
        value, F_z, F_p, R_z, R_p = (np.asarray(part.full()) for part in self._parts(z, held, p))
        return value[:, 0], F_p - F_z @ np.linalg.solve(R_z, R_p)
