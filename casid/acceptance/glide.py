"""Best glide: the steady flight without thrust whose path is flattest, and its deviations.

At the optimum the slope of the climb angle by airspeed vanishes. With multipliers l of the equations of steady flight
R(z, V, p) = 0 this is R_z' l = (d climb_angle / dz), R_V' l = 0: further equations, solved together with R, so that the
implicit function theorem gives the deviations of the best speed, too.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy

from casid.acceptance.parameters import Known
from casid.acceptance.steady import SETTINGS, Equations, Implicit, Solved, SteadyFlight
from casid.errors import InputError

GLIDE = ("alpha", "delta_e", "climb_angle")
_HELD = tuple(name for name in SETTINGS if name not in GLIDE)
_RANGE = (0.4, 2.5)  # of the speed of the flight point: where the best glide is looked for
_UNITS = {"best_glide_speed": "m/s", "best_glide_ratio": "1", "best_glide_sink_rate": "m/s"}
_SMALL = 1e-6  # residual that counts as none
_EDGE = 0.01  # of a speed: an optimum nearer to the end of the range is none

Quantities = dict[str, tuple[float, np.ndarray, str]]


def best_glide(flight: SteadyFlight, known: Known, level: Solved) -> tuple[Quantities, tuple[str, ...]]:
    """Name -> value, derivatives by the parameters and unit; and a remark where there is none."""
    try:
        V, at = _search(flight, known, level)
    except InputError as error:
        return {}, (f"no best glide: {error}",)
    flattest = flight.once(("glide",), lambda: _Flattest(flight))
    z, held = flight.at(GLIDE, at)
    # multipliers of a glide that need not be the flattest
    slope = flight.equations(GLIDE).function(z, held, known.values)[1].full()
    start = np.r_[z, V, np.linalg.solve(slope.T, flattest.towards)]
    held = [value for name, value in zip(_HELD, held, strict=True) if name != "V"]
    found = flattest.equations.root(start, held, known.values, tol=1e-12)
    if np.abs(found.fun).max() < _SMALL:
        return _named(*flattest.quantities(found.x, held, known.values)), ()
    # at the corner of a table, where the slope jumps, the optimum stays: the values are those of a glide at its speed
    along = flight.once(("glide at a speed",), lambda: flight.along(GLIDE, _told(flight)))
    value, slope = along(*flight.at(GLIDE, at), known.values)
    slope[0] = np.nan
    return _named(value, slope), ("the best glide is at a corner of a table: its speed has no deviation",)


def _told(flight: SteadyFlight) -> ca.SX:
    """Speed, glide ratio and rate of descent."""
    V = flight.setting["V"]
    climb = flight.setting["climb_angle"]
    return ca.vertcat(V, -1.0 / ca.tan(climb), -V * ca.sin(climb))


def _named(value: np.ndarray, slope: np.ndarray) -> Quantities:
    return {n: (float(v), d, unit) for (n, unit), v, d in zip(_UNITS.items(), value, slope, strict=True)}


class _Flattest:
    """The equations of the flattest glide."""

    def __init__(self, flight: SteadyFlight) -> None:
        equations = flight.equations(GLIDE)
        z = equations.unknown
        R = equations.residual
        V = flight.setting["V"]
        m = ca.SX.sym("multiplier", z.shape[0])
        climb = GLIDE.index("climb_angle")
        self.towards = np.eye(z.shape[0])[climb]  # (unknowns,) derivative of the climb angle by them
        self.equations = Equations(
            unknown=ca.vertcat(z, V, m),
            residual=ca.vertcat(R, ca.jacobian(R, z).T @ m - self.towards, ca.jacobian(R, V).T @ m),
            held=ca.vertcat(*(flight.setting[name] for name in _HELD if name != "V")),
            p=flight.p,
        )
        (told,) = ca.substitute([_told(flight)], [flight.setting["climb_angle"]], [z[climb]])
        self.quantities = Implicit(self.equations, told)


def _search(flight: SteadyFlight, known: Known, level: Solved) -> tuple[float, Solved]:
    """Speed and flight of the flattest glide. Raises InputError where there is none within the range."""
    base = level.values

    def glide(V: float) -> Solved:
        return flight.solve(GLIDE, {"V": V, "rho": base["rho"], "thrust": 0.0}, known.values)

    def steepness(V: float) -> float:
        try:
            return -glide(V).values["climb_angle"]
        except InputError:
            return np.pi

    low, high = (share * base["V"] for share in _RANGE)
    found = scipy.optimize.minimize_scalar(
        steepness, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * base["V"]}
    )
    V = float(found.x)
    if not 0.0 < found.fun < 1.0 or min(V - low, high - V) < _EDGE * base["V"]:
        raise InputError(f"none between {low:.3g} and {high:.3g} m/s; look at the drag of the file")
    return V, glide(V)
