"""Handbook numbers of an aircraft file at a flight point, with the deviations that its parameters leave them.

Modes, static and manoeuvre margins, lift over drag, best glide and trim curves. Deviations are those of the delta
method with exact derivatives: std(F)^2 = F_p P F_p' for the covariance P of the parameters, the change of trim
included. Theil's coefficients of records are in `theil`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casid.above import ask_above
from casid.acceptance.eigenmodes import Eigenmode, by_plane, named
from casid.acceptance.glide import best_glide
from casid.acceptance.parameters import Known, Number, known_by_diagnosis, known_by_estimate, known_by_file
from casid.acceptance.steady import Implicit, SteadyFlight
from casid.arguments import number, require
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.estimation.fit import Fit
from casid.frames import Rows, brief
from casid.keeping import plain
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.dynamics import standard_density
from casid.native.threads import single_threaded
from casid.signals import label_of

LEVEL = ("alpha", "delta_e", "thrust")
_HEIGHTS = (-1e3, 2e4)  # m, of the standard atmosphere
_CURVE = 21  # speeds of the trim curves
# deg beyond the trim of the file: wing sections stall 8 to 12 deg above cruise (Abbott and von Doenhoff, 1959)
_LINEAR_DEG = 10.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Mode:
    """A mode of motion: its eigenvalue [rad/s] and what follows from it, `numbers` by name (`natural_frequency`,
    `damping_ratio`, `period`, `time_constant`, `time_to_half` or `time_to_double`)."""

    name: str
    eigenvalue: complex
    eigenvalue_std: tuple[float, float]
    participation: Mapping[str, float]
    numbers: Mapping[str, Number]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrimCurves:
    """Level flight at several speeds V (n,) [m/s]: alpha, delta_e [rad] and thrust [N], each (n,), and their 1-sigma.
    NaN where there is no steady flight."""

    V: np.ndarray
    values: Mapping[str, np.ndarray]
    std: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False, kw_only=True)
class Handbook:
    """Result of `modes`: eigenmodes, trim and performance of an aircraft.

    Attributes
    ----------
    aircraft
        Name of the aircraft.
    flight
        The flight point: V, rho, climb_angle, alpha, delta_e, thrust (SI, radians).
    modes
        Name -> Mode.
    numbers
        Name -> Number: the trim, lift and drag; static and manoeuvre margin, stick fixed, as parts of the length of
        pitching moments; the neutral point as a distance behind the centre of gravity [m]; the elevator by load factor
        in a pull-up [rad per g]; best glide.
    trim_curves
        Level flight over speed.
    notes
        What could not be had, or was left out, a sentence each.

    Examples
    --------
    >>> import casid as cs
    >>> handbook = cs.modes("casid/cli/demo/aircraft.toml")
    >>> list(handbook.modes)
    ['short period', 'phugoid', 'dutch roll', 'roll', 'spiral']
    >>> handbook.numbers["alpha"].unit
    'rad'
    """

    aircraft: str
    flight: Mapping[str, float]
    modes: Mapping[str, Mode]
    numbers: Mapping[str, Number]
    trim_curves: TrimCurves
    notes: tuple[str, ...]

    __repr__ = brief

    def plot(self) -> Any:
        """Eigenvalues with their 2-sigma ellipses and trim curves with their 2-sigma bands, a matplotlib figure."""
        return ask_above("Handbook.plot", self)

    def __str__(self) -> str:
        head = f"{self.aircraft}: V = {self.flight['V']:.4g} m/s, rho = {self.flight['rho']:.4g} kg/m3"
        return "\n".join([head, self.rows().text(), *(f"! {note}" for note in self.notes)])

    def rows(self) -> Rows:
        """Numbers of the modes and of the trim as rows."""
        rows = [(label, one.value, one.std, one.unit) for label, one in labelled(self)]
        return Rows(heads={"number": "", "value": ".5g", "std": ".3g", "unit": ""}, rows=rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and texts; a number that does not exist is None."""
        curves = self.trim_curves
        return {
            **plain(self, "aircraft flight numbers notes"),
            "modes": {
                name: {
                    "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                    **plain(mode, "participation"),
                    **plain(mode.numbers),
                }
                for name, mode in self.modes.items()
            },
            "trim_curves": {
                "V": curves.V.tolist(),
                **{n: plain({"value": y, "std": curves.std[n]}) for n, y in curves.values.items()},
            },
        }


def labelled(found: Handbook) -> list[tuple[str, Number]]:
    """(label, number) of all modes and numbers, in the order of the table."""
    of_modes = {f"{name}: {key}": one for name, mode in found.modes.items() for key, one in mode.numbers.items()}
    rest = {label_of(key): one for key, one in found.numbers.items()}
    return [(label.replace("_", " "), one) for label, one in (*of_modes.items(), *rest.items())]


@single_threaded()
def modes(
    aircraft: Aircraft | str | Path,
    *,
    V: float | None = None,
    altitude: float | None = None,
    rho: float | None = None,
    climb_angle: float = 0.0,
    fit: Fit | Diagnosis | None = None,
    speeds: Sequence[float] | None = None,
) -> Handbook:
    """Modes of motion, margins, lift over drag, best glide and trim curves of an aircraft, with their deviations.

    The aircraft flies straight and steadily at constant thrust, stick fixed, and is linearised there exactly. Effects
    of the file that are always in force (mass, centre of gravity, further terms) take part; what lies between a record
    and a surface or in an instrument changes none of these numbers.

    Parameters
    ----------
    aircraft
        The aircraft, or the name of its file.
    V, altitude, rho
        Airspeed [m/s]; altitude [m] (standard atmosphere) or density [kg/m3]; by default those of [trim].
    climb_angle
        Of the flight path [rad].
    fit
        An estimate of this aircraft's parameters: its values replace those of the file, and its corrected covariance
        that of the file (`relative_uncertainty`, and the deviations of effects). Or the diagnosis whose
        `extended_aircraft` this is, for the covariance of that.
    speeds
        Airspeeds of the trim curves [m/s]; by default 0.7 to 1.4 V.

    Returns
    -------
    Handbook
        Trim, natural modes, stability margins and performance at the flight point.

    Raises
    ------
    InputError
        For a flight point that the file does not state, or at which there is no steady flight.

    Examples
    --------
    >>> import casid as cs
    >>> demo = "casid/cli/demo/aircraft.toml"
    >>> found = cs.modes(demo)
    >>> list(found.modes)
    ['short period', 'phugoid', 'dutch roll', 'roll', 'spiral']
    """
    file = given_aircraft(aircraft, "modes")
    require(fit, (Fit, Diagnosis, type(None)), "modes: fit", "fit=cs.solve(...) or fit=cs.diagnose(...)")
    point = flight_point(file, V, altitude, rho) | {"climb_angle": number(climb_angle, "modes: climb_angle")}
    flight = SteadyFlight(file)
    if isinstance(fit, Diagnosis):
        known = known_by_diagnosis(flight, fit)
    elif fit is not None:
        known = known_by_estimate(flight, fit.values, fit.covariance_corrected)
    else:
        known = known_by_file(flight)
    return handbook(flight, known, point, _speeds(speeds, point["V"]))


def handbook(flight: SteadyFlight, known: Known, point: Mapping[str, float], speeds: np.ndarray) -> Handbook:
    """The handbook of a steady flight and what is known of its parameters; `point`: V, rho, climb_angle; (n,) `speeds`
    of the trim curves."""
    solved = flight.solve(LEVEL, point, known.values)
    n = len(flight.moving)
    along, units = flight.once(("handbook",), lambda: _matrix_and_numbers(flight))
    value, slope = along(*flight.at(LEVEL, solved), known.values)
    matrix, slopes = (part[: n * n].reshape((n, n, -1), order="F") for part in (value, slope))
    told, silent = by_plane(matrix[..., 0], slopes, flight.moving)
    static = zip(units.items(), value[n * n :], slope[n * n :], strict=True)
    numbers = {name: known.number(v, d, unit) for (name, unit), v, d in static}
    glide, without = best_glide(flight, known, solved)
    if not numbers["CD"].value > 0.0:
        del numbers["lift_over_drag"]
        without = (*without, "the drag of the file at this point is not positive: no lift over drag is given")
    numbers |= {name: known.number(*one) for name, one in glide.items()}
    return Handbook(
        aircraft=flight.aircraft.name,
        flight=solved.values,
        modes={name: _told(name, mode, known) for name, mode in named(told).items()},
        numbers=numbers,
        trim_curves=_curves(flight, known, point, speeds),
        notes=(*_notes(flight, silent, known), *_far_from_trim(flight, solved.values, known.values), *without),
    )


def usual_speeds(V: float) -> np.ndarray:
    """(n,) airspeeds of trim curves about one [m/s]."""
    return np.linspace(0.7, 1.4, _CURVE) * V


def _speeds(given: Sequence[float] | None, V: float) -> np.ndarray:
    """(n,) airspeeds [m/s]. Raises InputError for what is no list of positive numbers."""
    if given is None:
        return usual_speeds(V)
    if isinstance(given, (str, Mapping)) or not isinstance(given, Iterable):
        raise InputError("modes: speeds is no list of numbers; expected airspeeds in m/s, like [40.0, 50.0, 60.0]")
    return np.array([number(one, "modes: one of the speeds", positive=True) for one in given])


def flight_point(aircraft: Aircraft, V: float | None, altitude: float | None, rho: float | None) -> dict[str, float]:
    """V and rho as they were asked for, or as [trim] has them."""
    speed = aircraft.trim.get("V") if V is None else V
    if altitude is None and rho is None:
        rho = aircraft.trim.get("rho")
        altitude = aircraft.trim.get("altitude")
    if speed is None or (rho is None and altitude is None):
        raise InputError(f"modes: '{aircraft.name}' has no V, or neither altitude nor rho, under [trim]; give them")
    if rho is None and not _HEIGHTS[0] <= number(altitude, "modes: altitude") <= _HEIGHTS[1]:
        raise InputError(
            f"modes: altitude is {altitude:g} m; expected {_HEIGHTS[0]:g} to {_HEIGHTS[1]:g} m, or give rho"
        )
    density = float(standard_density(np.array(altitude))) if rho is None else number(rho, "modes: rho", positive=True)
    return {"V": number(speed, "modes: V", positive=True), "rho": density}


def _matrix_and_numbers(flight: SteadyFlight) -> tuple[Implicit, dict[str, str]]:
    """The system matrix, column by column, and the static numbers in steady flight, and the units of these."""
    m = flight.model
    index = [m.states.index(name) for name in flight.moving]
    matrix = flight.here(ca.jacobian(m.f, m.x)[index, index])
    numbers = _numbers(flight)
    expressions = (expression for expression, _ in numbers.values())
    return flight.along(LEVEL, ca.vertcat(ca.vec(matrix), *expressions)), {n: unit for n, (_, unit) in numbers.items()}


def _numbers(flight: SteadyFlight) -> dict[str, tuple[ca.SX, str]]:
    """Expressions of the static numbers and their units: lift and drag by the balance of forces, margins as how far
    the c.g. may move back until a change of lift makes no moment (Etkin and Reid, Dynamics of Flight, 3rd ed., 2.3 and
    3.1)."""
    s = flight.setting
    a = flight.aircraft
    W = flight.mass * a.gravity
    qS = 0.5 * s["rho"] * s["V"] ** 2 * a.area
    lift_by_alpha, moment_by_alpha = (flight.here(one) for one in flight.slopes("alpha"))
    lift_by_q, moment_by_q = (flight.here(one) for one in flight.slopes("q"))
    lift_by_e, moment_by_e = (flight.here(one) for one in flight.slopes("delta_e"))
    margin = -moment_by_alpha / lift_by_alpha
    q_per_g = a.gravity / s["V"]  # pitch rate of a pull-up by load factor
    # normal force by angle of attack and elevator, thrust included, in units of qS
    normal = lift_by_alpha + s["thrust"] * ca.cos(s["alpha"]) / qS
    needed = W / qS - lift_by_q * q_per_g
    alpha_per_g = needed / normal
    manoeuvre = -(moment_by_alpha * alpha_per_g + moment_by_q * q_per_g) * qS / W
    determinant = normal * moment_by_e - lift_by_e * moment_by_alpha
    elevator = (-normal * moment_by_q * q_per_g - moment_by_alpha * needed) / determinant
    return {
        "alpha": (s["alpha"], "rad"),
        "delta_e": (s["delta_e"], "rad"),
        "thrust": (s["thrust"], "N"),
        "CL": (flight.lift / qS, "1"),
        "CD": (flight.drag / qS, "1"),
        "lift_over_drag": (flight.lift / flight.drag, "1"),
        "static_margin": (margin, "1"),
        "neutral_point": (margin * a.moment_length_pitch, "m"),
        "manoeuvre_margin": (manoeuvre, "1"),
        "elevator_per_g": (elevator, "rad"),
    }


def _told(name: str, mode: Eigenmode, known: Known) -> Mode:
    return Mode(
        name=name,
        eigenvalue=mode.eigenvalue,
        eigenvalue_std=(known.std(np.real(mode.derivatives)), known.std(np.imag(mode.derivatives))),
        participation=mode.participation,
        numbers={key: known.number(*one) for key, one in mode.numbers().items()},
    )


def _curves(flight: SteadyFlight, known: Known, point: Mapping[str, float], V: np.ndarray) -> TrimCurves:
    values, std = ({name: np.full(len(V), np.nan) for name in LEVEL} for _ in range(2))
    along = flight.once(("curves",), lambda: flight.along(LEVEL, ca.vertcat(*(flight.setting[n] for n in LEVEL))))
    for k, speed in enumerate(V):
        try:
            solved = flight.solve(LEVEL, {**point, "V": float(speed)}, known.values)
        except InputError:
            continue
        found, slopes = along(*flight.at(LEVEL, solved), known.values)
        for i, name in enumerate(LEVEL):
            values[name][k], std[name][k] = found[i], known.std(slopes[i])
    return TrimCurves(V=V, values=values, std=std)


def _notes(flight: SteadyFlight, silent: Sequence[str], known: Known) -> list[str]:
    """List remarks on the flight: planes without aerodynamics, effects that were left out."""
    notes = [*known.notes, *(f"the file has no {plane} aerodynamics: no {plane} modes are given" for plane in silent)]
    if flight.left_out:
        names = ", ".join(sorted({e.kind for e in flight.left_out}))
        notes.append(f"effects of single records, or that set in at a time, are left out: {names}")
    return notes


def _far_from_trim(flight: SteadyFlight, solved: Mapping[str, float], p: np.ndarray) -> list[str]:
    """Warn where the angle of attack is one that derivatives about the trim of the file do not hold at."""
    trim = 0.0
    with suppress(InputError):
        at = flight_point(flight.aircraft, None, None, None) | {"climb_angle": 0.0}
        trim = flight.solve(LEVEL, at, p).values["alpha"]
    alpha = math.degrees(solved["alpha"])
    beyond = math.degrees(abs(solved["alpha"] - trim))
    if beyond <= _LINEAR_DEG:
        return []
    return [
        f"WARNING: steady flight at V = {solved['V']:.4g} m/s takes an angle of attack of {alpha:.1f} deg, "
        f"{beyond:.0f} deg from the trim of the file. Derivatives do not hold there: none of these numbers can be used"
    ]
