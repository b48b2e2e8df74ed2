"""Checks of the levels of channels: gravity, lift against weight, the standard atmosphere, the trim of the file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import scipy

from casid.data_check.criteria import DataCriteria
from casid.data_check.reading import FEWEST_KNOWN, FORCES, Read
from casid.data_check.relations import RELATIONS, Relation
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.dynamics import standard_density
from casid.model.plausible import doubts
from casid.model.trim import trim as trim_of
from casid.signals import EXTERNAL_FORCE

_MEANS = ("phi", "theta", "V", "alpha", "beta")  # relations whose biases are small beside what they compare


def _normal(x: float, sigma: float, criteria: DataCriteria) -> float:
    return max(-0.5 * (x / sigma) ** 2, criteria.impossible) if math.isfinite(x) else criteria.impossible


def _ratio(value: float, expected: float, sigma: float, criteria: DataCriteria) -> float:
    """Log likelihood of a positive quantity that should be as expected."""
    return _normal(math.log(value / expected), sigma, criteria) if value > 0.0 < expected else criteria.impossible


def _mean(record: Read, name: str) -> float:
    at = record.known(name)
    return float(np.mean(record.value(name)[at])) if at.any() else 0.0


def _load_factor(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    """The mean vertical force equals the weight, apart from the change of the rate of climb."""
    phi = c.value("phi")
    theta = c.value("theta")
    at = c.known("az", "ax", "phi", "theta")
    up = np.cos(theta) * (c.value("ay") * np.sin(phi) + c.value("az") * np.cos(phi)) - c.value("ax") * np.sin(theta)
    sigma = math.hypot(criteria.fair, criteria.fair * criteria.usual_v / (g * c.duration))
    spread = math.log(sigma / criteria.fair)  # in another unit of time the record may be too short to tell
    return _ratio(-float(np.mean(up[at])) / g, 1.0, sigma, criteria) - spread if at.any() else 0.0


def _flight_path(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    """theta - alpha is the climb angle."""
    at = c.known("theta", "alpha", "phi") & (np.abs(c.value("phi")) < criteria.level_bank)
    if at.sum() < FEWEST_KNOWN:
        return 0.0
    path = float(np.mean((c.value("theta") - c.value("alpha"))[at]))
    if not c.has("altitude", "V"):
        return _normal(path, criteria.fair, criteria)
    climb = float(np.clip(_slope(c, "altitude") / max(_mean(c, "V"), 1.0), -1.0, 1.0))
    return _normal(path - math.asin(climb), criteria.angle, criteria)


def _slope(c: Read, name: str) -> float:
    at = c.known(name)
    return float(np.mean(c.rate(name)[at])) if at.any() else 0.0


def _lift(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    """rho V^2 S CL / 2 of the file carries what the accelerometer feels.

    The curve is known in the trim of the file, where it carries the weight; else from the constant of the file. Of the
    errors of its slope, the angle and the load factor the least are taken that make it so.
    """
    if aircraft is None:
        return 0.0
    zero, slope, sign = ("CL_0", "CL_alpha", 1.0) if aircraft.force_axes == "wind" else ("CZ_0", "CZ_alpha", -1.0)
    if not {zero, slope} <= aircraft.derivatives.keys():
        return 0.0
    known = sign * aircraft.derivatives[zero]
    spread = criteria.rough
    at = 0.0
    trim = aircraft.trim
    area = aircraft.area
    if {"V", "rho", "alpha"} <= trim.keys():
        known = _balanced(aircraft, trim["rho"], trim["V"], g)
        spread = criteria.fair
        at = trim["alpha"]
    wanted = (_mean(c, "fz") - _mean(c, "az") * aircraft.mass) / (
        0.5 * _mean(c, "rho") * _mean(c, "V") ** 2 * area or 1.0
    )
    curve = known, sign * aircraft.derivatives[slope], _mean(c, "alpha") - at
    return _least_errors(*curve, wanted, (spread, criteria.rough, criteria.angle, criteria.fair), criteria)


def _balanced(aircraft: Aircraft, rho: float, V: float, g: float) -> float:
    """Lift coefficient of level flight."""
    return aircraft.mass * g / (0.5 * rho * V**2 * aircraft.area)


def _least_errors(
    known: float, slope: float, angle: float, wanted: float, sigmas: tuple[float, ...], criteria: DataCriteria
) -> float:
    """Log likelihood of the smallest errors by which `known` and `slope` times `angle` are `wanted`; `sigmas` of the
    logarithms of `known` and `slope`, of the angle, and of the logarithm of `wanted`."""
    of_known, of_slope, of_angle, of_wanted = sigmas
    errors = np.zeros(4)
    largest = math.sqrt(-2.0 * criteria.impossible)
    for _ in range(criteria.steps):
        here = known * math.exp(of_known * errors[0])
        steep = slope * math.exp(of_slope * errors[1])
        there = wanted * math.exp(of_wanted * errors[3])
        turned = angle + of_angle * errors[2]
        off = here + steep * turned - there
        along = np.array([of_known * here, of_slope * steep * turned, of_angle * steep, -of_wanted * there])
        errors = along * (along @ errors - off) / max(along @ along, 1e-300)
        errors = np.clip(errors, -largest, largest)
    return max(-0.5 * float(errors @ errors), criteria.impossible)


def _trimmed(name: str, sigma: Callable[[DataCriteria], float]) -> Callable[..., float]:
    def level(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
        expected = aircraft.trim.get(name) if aircraft is not None else None
        return _ratio(_mean(c, name), expected, sigma(criteria), criteria) if expected else 0.0

    return level


def _needed_thrust(
    c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria, trimmed: Callable[[], _TrimDrag | None]
) -> float:
    """Log likelihood of the thrust beside what drag and energy ask for."""
    found = thrust_over_drag(c, aircraft, g, criteria, trimmed)
    return 0.0 if found is None else _ratio(found[0], 1.0, found[1], criteria)


def thrust_over_drag(
    c: Read,
    aircraft: Aircraft | None,
    g: float,
    criteria: DataCriteria,
    trimmed: Callable[[], _TrimDrag | None] | None = None,
) -> tuple[float, float] | None:
    """Thrust over what balances the drag in the file's trim and the growth of energy, T = D + m (dV/dt + g sin(gamma)),
    with the 1-sigma of its logarithm; None where that tells nothing: far from the trim's airspeed, or where energy does
    most."""
    if aircraft is None or not c.has("thrust", "V", "rho") or not (c.has("altitude") or c.has("theta", "alpha")):
        return None
    known = _drag_of_trim(aircraft) if trimmed is None else trimmed()
    if known is None:
        return None
    V = max(_mean(c, "V"), 1e-3)
    weight = aircraft.mass * g
    at = aircraft.trim["V"]
    drag = known.drag * _mean(c, "rho") * V**2 / (known.rho * at**2)
    measured = c.has("altitude")
    path = _slope(c, "altitude") / V if measured else _mean(c, "theta") - _mean(c, "alpha")
    needed = drag + aircraft.mass * _slope(c, "V") + weight * path - _mean(c, "fx")
    if needed < criteria.rough * drag:
        return None
    by_drag = math.hypot(criteria.rough, known.uncertainty, 2.0 * math.log(V / at)) * drag
    sigma = math.hypot(by_drag, 0.0 if measured else criteria.angle * weight) / needed
    return _mean(c, "thrust") / needed, sigma


@dataclass(frozen=True, kw_only=True)
class _TrimDrag:
    """Drag [N] in the trim of a file, at density `rho`, and its `uncertainty` besides that of a stated one."""

    drag: float
    rho: float
    uncertainty: float


def _drag_of_trim(aircraft: Aircraft) -> _TrimDrag | None:
    """The thrust that the trim of a file states, or else the drag of its aerodynamics there, which is as uncertain as
    its derivatives; None where the file has no trim point, or is itself in doubt."""
    trim = aircraft.trim
    density = trimmed_density(aircraft)
    if density is None or "V" not in trim:
        return None
    if "thrust" in trim:
        return _TrimDrag(drag=trim["thrust"], rho=density, uncertainty=0.0)
    if doubts(aircraft):
        return None
    try:
        level = trim_of(aircraft, V=trim["V"], rho=density)
    except InputError:  # an aircraft that does not fly level there gives no drag
        return None
    return _TrimDrag(drag=level.thrust, rho=density, uncertainty=aircraft.relative_uncertainty)


def trimmed_density(aircraft: Aircraft) -> float | None:
    """Density [kg/m3] of the trim of a file, where it gives one."""
    trim = aircraft.trim
    if "rho" in trim:
        return trim["rho"]
    return float(standard_density(np.array(trim["altitude"]))) if "altitude" in trim else None


def _usual_speed(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    return _ratio(_mean(c, "V"), criteria.usual_v, criteria.usual, criteria)


def _usual_density(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    return _ratio(_mean(c, "rho"), criteria.usual_rho, criteria.usual, criteria)


def _usual_thrust(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    """Thrust over weight, within the usual range."""
    thrust = _mean(c, "thrust")
    if aircraft is None or thrust <= 0.0:
        return 0.0
    return _ratio(thrust / (aircraft.mass * g), criteria.usual_thrust, criteria.usual, criteria)


def _atmosphere(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    """Density of the standard troposphere at the recorded altitude."""
    height = min(max(_mean(c, "altitude"), -1000.0), 19000.0)
    return _ratio(_mean(c, "rho"), float(standard_density(np.array(height))), criteria.fair, criteria)


def _slope_of(force: str, angle: str, beside: tuple[str, ...]) -> Callable[..., float]:
    """A force opposes its flow angle on any aircraft: side force opposes sideslip, and lift the angle of attack."""

    def level(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
        there = [name for name in beside if c.has(name)]
        at = c.known(force, angle, "V", *there)
        others = [c.value(name) for name in there]
        made = _made_by_air(c, force, aircraft)
        return 0.0 if made is None else _opposes(made, [c.value(angle), *others], at, c, criteria)

    return level


def _made_by_air(c: Read, force: str, aircraft: Aircraft | None) -> np.ndarray | None:
    """(N,) a specific force without that of a recorded external force; None where that takes an unknown mass."""
    if aircraft is not None:
        return c.made(force, aircraft.mass)
    return None if c.has(EXTERNAL_FORCE[FORCES.index(force)]) else c.value(force)


def _opposes(force: np.ndarray, regressors: list[np.ndarray], at: np.ndarray, c: Read, criteria: DataCriteria) -> float:
    """Log probability that the slope of a force over the first of its regressors is negative."""
    if at.sum() < FEWEST_KNOWN:
        return 0.0
    X = np.stack([*(one[at] for one in regressors), np.ones(int(at.sum()))], axis=1)
    X = X / np.maximum(np.abs(X).max(axis=0), 1e-300)
    y = force[at]
    inverse = np.linalg.pinv(X.T @ X, rcond=1e-10)
    found = inverse @ X.T @ y
    every = len(y) / max(c.independent * float(at.mean()), 1.0)
    scatter = max(float(np.var(y - X @ found)), criteria.rough**2 * float(np.var(y))) * every
    sigmas = -found[0] / math.sqrt(max(scatter * inverse[0, 0], 1e-300))
    return max(float(scipy.special.log_ndtr(sigmas)), criteria.impossible)


def _kinematic_sideslip(c: Read, aircraft: Aircraft | None, g: float, criteria: DataCriteria) -> float:
    """Side force opposes the sideslip that the motion makes, where no vane measures it: p sin(alpha) - r cos(alpha) +
    (ay + g sin(phi) cos(theta)) / V is integrated, and both sides high-passed, so that biases do not add up."""
    made = _made_by_air(c, "ay", aircraft)
    if c.has("beta") or made is None:
        return 0.0
    alpha = c.value("alpha")
    phi = c.value("phi")
    theta = c.value("theta")
    across = (c.value("ay") + g * np.sin(phi) * np.cos(theta)) / np.maximum(c.value("V"), 1.0)
    rate = c.value("p") * np.sin(alpha) - c.value("r") * np.cos(alpha) + across
    decay = math.exp(-c.step / criteria.slow)
    there = ["p", "r", *(["delta_r"] if c.has("delta_r") else [])]
    at = c.known("ay", "V", "phi", "theta", "alpha", *there)
    sideslip = np.asarray(scipy.signal.lfilter([c.step], [1.0, -decay], rate - rate[at].mean() if at.any() else rate))
    passed = [
        np.asarray(scipy.signal.lfilter([1.0, -1.0], [1.0, -decay], x - x[0])) for x in (made, *map(c.value, there))
    ]
    return _opposes(passed[0], [sideslip, *passed[1:]], at, c, criteria)


_LEVELS: tuple[tuple[tuple[str, ...], tuple[str, ...], Callable[..., float]], ...] = (
    (("az",), ("ax", "ay", "az", "phi", "theta", "t"), _load_factor),
    (("theta", "alpha"), ("theta", "alpha", "altitude", "V", "t"), _flight_path),
    (("alpha", "V", "rho", "az"), ("alpha", "V", "rho", "az"), _lift),
    (("V",), ("V",), _trimmed("V", lambda c: c.fair)),
    (("V",), ("V",), _usual_speed),
    (("rho",), ("rho",), _trimmed("rho", lambda c: c.fair)),
    (("thrust",), ("thrust",), _trimmed("thrust", lambda c: c.usual)),
    (("rho",), ("rho",), _usual_density),
    (("thrust",), ("thrust",), _usual_thrust),
    (("ay", "beta"), ("ay", "beta", "p", "r", "delta_r"), _slope_of("ay", "beta", ("p", "r", "delta_r"))),
    (("az", "alpha"), ("az", "alpha", "q", "delta_e"), _slope_of("az", "alpha", ("q", "delta_e"))),
    (("ay", "p", "r", "phi", "V"), ("V", "alpha", "beta", "p", "r", "phi", "theta", "ay", "t"), _kinematic_sideslip),
    (("rho", "altitude"), ("rho", "altitude"), _atmosphere),
)


def level_terms(
    aircraft: Aircraft | None, gravity: float, criteria: DataCriteria
) -> Iterator[tuple[frozenset[str], Callable[[Read], float]]]:
    """(channels that enter, log likelihood in a record) of every level."""

    def term(needs: tuple[str, ...], level: Callable[..., float]) -> Callable[[Read], float]:
        return lambda c: level(c, aircraft, gravity, criteria) if c.has(*needs) else 0.0

    @cache
    def trimmed() -> _TrimDrag | None:
        return None if aircraft is None else _drag_of_trim(aircraft)

    weighed = aircraft is not None and not doubts(aircraft)
    balance = partial(_needed_thrust, trimmed=trimmed)
    yield frozenset(("thrust", "V", "rho", "altitude", "theta", "alpha", "t")), term(("thrust", "V", "rho"), balance)
    for needs, uses, level in _LEVELS:
        if weighed or level is not _usual_thrust:
            yield frozenset(uses), term(needs, level)
    for relation in RELATIONS:
        if relation.name in _MEANS:
            yield frozenset((*relation.uses, "t")), _of_means(relation, gravity, criteria)


def _of_means(relation: Relation, gravity: float, criteria: DataCriteria) -> Callable[[Read], float]:
    """The means of both sides differ by biases only; large ones are rare, and not excluded (Student-t, 3)."""
    sigma = criteria.angle * gravity if relation.name == "V" else criteria.bias_rate

    def term(c: Read) -> float:
        if not c.has(*relation.needs):
            return 0.0
        at = c.known(*relation.uses)
        if at.sum() < FEWEST_KNOWN:
            return 0.0
        left, right = relation.sides(c, gravity)
        off = float(np.mean(left[at] - right[at]))
        return -2.0 * math.log1p((off / sigma) ** 2 / 3.0) if math.isfinite(off) else criteria.impossible

    return term
