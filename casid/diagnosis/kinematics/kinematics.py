"""Kinematics of instruments and moving air: the same model with forces and moments left free.

Every aerodynamic coefficient is a latent input. Angular rates, accelerations, attitudes and air data are then related
by kinematics alone (flight-path reconstruction). No derivative, actuator, mass or propulsion can explain what remains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from weakref import WeakKeyDictionary

import numpy as np

from casid.diagnosis.criteria import Criteria, KinematicCriteria
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.missing_input import moving_air
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, relaxed
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.filtering.innovations import NoiseModel
from casid.model import station
from casid.model.path import MOMENTS, TURNING, coefficient_names
from casid.model.usual_derivatives import USUAL_DERIVATIVES
from casid.native.processors import side_by_side
from casid.records.record import Record

_RATES: Mapping[str, str] = MappingProxyType({"Cl": "p", "Cm": "q", "Cn": "r"})
_FORCES: Mapping[str, str] = MappingProxyType({"CX": "ax", "CY": "ay", "CZ": "az"})


_ALREADY: WeakKeyDictionary[Flight, Flight] = WeakKeyDictionary()  # keeps the models that were built


def without_aerodynamics(flight: Flight) -> Flight:
    """The flight of an aircraft with constant coefficients in body axes.

    The forces are those that the accelerometers measure on average, and the moments balance the thrust. The result is
    the same object for the same flight.
    """
    if flight not in _ALREADY:
        nothing = {"terms": {}, "tables": (), "aerodynamics": None, "effects": ()}
        bare = replace(flight.aircraft, force_axes="body", derivatives=_constants(flight), **nothing)
        _ALREADY[flight] = replace(flight, aircraft=bare, _models={}, _functions={}, _regressors={})
    return _ALREADY[flight]


def _constants(flight: Flight) -> dict[str, float]:
    """Constant coefficients in body axes."""
    aircraft, found = flight.aircraft, dict.fromkeys((f"{c}_0" for c in coefficient_names("body")), 0.0)
    pressure = np.concatenate([0.5 * record["rho"] * _airspeed(flight, record) ** 2 for record in flight.records])
    qS, thrust = pressure * aircraft.area, np.concatenate([record["thrust"] for record in flight.records])
    for coefficient, channel in _FORCES.items():
        if channel in flight.outputs:
            force = aircraft.mass * np.concatenate([record[channel] for record in flight.records])
            force = force - thrust if channel == "ax" else force
            found[f"{coefficient}_0"] = float(np.nanmean(force / qS))
    arm = aircraft.thrust_line_z / aircraft.moment_length_pitch
    return found | {"Cm_0": -float(np.nanmean(arm * thrust / qS))}


def _airspeed(flight: Flight, record: Record) -> np.ndarray:
    """(N,) True airspeed [m/s]; the typical speed if it is not measured."""
    return record["V"] if "V" in record else np.full(len(record), typical_speed(flight))


def free_forces(flight: Flight) -> dict[str, tuple[float, float]]:
    """Coefficient -> r.m.s. and time constant [s] of a Gauss-Markov disturbance that is as large as the motion.

    A larger disturbance of an angular acceleration would follow the noise of the rate, and the lever arm of an
    instrument would be estimated too small.
    """
    aircraft, criteria = flight.aircraft, flight.criteria.kinematics
    rho = float(np.median(np.concatenate([record["rho"] for record in flight.records])))
    qS = 0.5 * rho * typical_speed(flight) ** 2 * aircraft.area
    inertia = {"Cl": aircraft.inertia.Ixx, "Cm": aircraft.inertia.Iyy, "Cn": aircraft.inertia.Izz}
    lengths = {"Cm": aircraft.moment_length_pitch}
    free = {}
    for name in coefficient_names(aircraft.force_axes):
        if name in MOMENTS:
            size = _angular_acceleration(flight, _RATES[name], criteria) * inertia[name]
            size /= qS * lengths.get(name, aircraft.moment_length_lateral)
            free[station.coefficient(name)] = (size, criteria.time)
        else:
            free[station.coefficient(name)] = (criteria.force * aircraft.mass / qS, criteria.time)
    return free


def typical_speed(flight: Flight) -> float:
    """Median true airspeed [m/s], or that of the trim."""
    V = np.concatenate([record["V"] for record in flight.records if "V" in record] or [np.array([np.nan])])
    return float(np.nanmedian(V)) if np.isfinite(V).any() else flight.aircraft.trim["V"]


def _angular_acceleration(flight: Flight, rate: str, criteria: KinematicCriteria) -> float:
    """1-sigma [rad/s2] of a free angular acceleration.

    It is computed from the increments of the measured rate over the correlation time, as for an integrated first-order
    Gauss-Markov process. The part that the noise of the rate adds to the increments is subtracted.
    """
    if rate not in flight.outputs:
        return criteria.unmeasured_moment
    squares, lasts, time = [], [], criteria.time
    for record in flight.records:
        there = np.isfinite(record[rate])
        t, values = record.t[there], record[rate][there]
        lag = max(1, round(time / float(np.median(np.diff(t))))) if len(t) > 1 else 1
        if len(t) <= lag:
            continue
        squares.append((values[lag:] - values[:-lag]) ** 2)
        lasts.append(float(np.median(t[lag:] - t[:-lag])))
    if not lasts:
        return criteria.unmeasured_moment
    x = float(np.mean(lasts)) / time
    increments = float(np.mean(np.concatenate(squares))) - 2.0 * flight.sigma[rate] ** 2
    variance = increments / (2.0 * time**2 * (x - 1.0 + np.exp(-x)))
    return max(criteria.peak * float(np.sqrt(max(variance, 0.0))), criteria.smallest_moment)


WIND = ("wind_x", "wind_y", "wind_z")
# moment due to the air's own rotation -> the derivative that causes it
_DAMPING: Mapping[str, str] = MappingProxyType({"dCl": "Cl_p", "dCm": "Cm_q", "dCn": "Cn_r"})
_ROLLING, _TURNED = ("dCl",), ("q", "r")
_NO_MOMENTS: Mapping[str, float] = MappingProxyType({})
_CALM: Mapping[str, tuple[float, float]] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class Turbulence:
    """Turbulence, estimated from the kinematics by maximum likelihood.

    Attributes
    ----------
    sigma
        r.m.s. velocity [m/s].
    std
        Its standard deviation [m/s].
    gain
        Likelihood-ratio statistic against calm air. Both models include small offsets of all instruments, which
        turbulence imitates.
    records
        Names of the records.
    length
        Scale length [m].
    beyond_one_axis
        Part of the statistic that moving air along a single axis does not reach. Air is turbulent along all axes; a
        drifting vane imitates motion along one.
    as_histories
        Sum of the statistics of slow latent inputs of the air. They follow nearly all of turbulence. They are too slow
        for coloured noise, which a Gauss-Markov process can follow.
    criteria
        The thresholds.
    """

    sigma: float
    std: float
    gain: float
    records: tuple[str, ...]
    length: float
    beyond_one_axis: float = 0.0
    as_histories: float = 0.0
    criteria: Criteria = Criteria()

    @property
    def named(self) -> bool:
        """Whether the air is turbulent."""
        return self.sigma > self.criteria.size.turbulent and self.along_all_axes and self.slow

    @property
    def along_all_axes(self) -> bool:
        """Whether the statistic is large enough, and no single axis explains it."""
        least = self.criteria.verdict.missing
        one_is_not_enough = self.beyond_one_axis > max(least, self.criteria.turbulence.other_axes * self.gain)
        return self.gain > least and one_is_not_enough

    @property
    def slow(self) -> bool:
        """Whether slow latent inputs of the air explain most of the statistic."""
        return self.as_histories > self.criteria.turbulence.slow * self.gain


# axes -> channels that are needed to leave the forces free
NEEDED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"full": ("ax", "ay", "az", "p", "q", "r"), "longitudinal": ("ax", "az", "q"), "lateral": ("ay", "p", "r")}
)


def still_air(flight: Flight) -> Turbulence:
    """The result for calm air."""
    return _in_air(flight, 0.0, 0.0, 0.0)


def _in_air(flight: Flight, sigma: float, std: float, gain: float, beyond_one_axis: float = 0.0) -> Turbulence:
    """A result with the default scale length."""
    criteria = flight.criteria
    return Turbulence(
        sigma=sigma,
        std=std,
        gain=gain,
        records=flight.names,
        length=criteria.turbulence.scale_length,
        beyond_one_axis=beyond_one_axis,
        criteria=criteria,
    )


def available(flight: Flight) -> bool:
    """Whether the records contain the accelerations and rates that are needed to leave the forces free."""
    return all(name in flight.outputs for name in NEEDED[flight.axes])


def gusts(
    flight: Flight,
    sigma: float,
    moments: Mapping[str, float] = _NO_MOMENTS,
    length: float | None = None,
    axes: Sequence[str] = WIND,
) -> dict[str, tuple[float, float]]:
    """Turbulence as first-order Gauss-Markov processes.

    The air also rotates over the span of the aircraft. For an aircraft that is small against the eddies, MIL-F-8785C,
    3.7.5 has sigma_p = 1.9 sigma_w / sqrt(L b) and the break frequency 2.6 V / sqrt(L b). The damping derivative of the
    aircraft file converts this rotation to a moment. A fitted damping would grow without reason, since a larger one
    explains more.

    Parameters
    ----------
    flight
        The flight.
    sigma
        r.m.s. velocity [m/s].
    moments
        Scale of the moment due to the air's own rotation, for some of dCl, dCm and dCn; 1 for the roll rate above.
    length
        Scale length [m]; by default that of the criteria.
    axes
        Axes along which the air moves.

    Returns
    -------
    dict
        Port -> r.m.s. and time constant [s].
    """
    aircraft, speed, criteria = flight.aircraft, typical_speed(flight), flight.criteria.turbulence
    length = criteria.scale_length if length is None else length
    processes = {name: (sigma, length / speed) for name in axes}
    mean = float(np.sqrt(length * 2.0 * aircraft.rate_length_lateral))
    for moment, scale in moments.items():
        derivative = _DAMPING[moment]
        arm = aircraft.rate_length_pitch if moment == "dCm" else aircraft.rate_length_lateral
        damping = abs(aircraft.derivatives.get(derivative, 0.0)) or USUAL_DERIVATIVES[derivative]
        processes[moment] = (scale * 1.9 * sigma / mean * damping * arm / speed, mean / (2.6 * speed))
    return processes


def in_turbulence(flight: Flight, turbulent: Turbulence, start: FlightFit) -> FlightFit:
    """The fit of the full model in turbulence.

    The air is uniform over the aircraft, or turns with the gradient of its velocity, whichever explains more. The signs
    of its pitch and yaw rates due to that gradient, which differ between simulators, and the size of its own roll rate
    are estimated by maximum likelihood on a grid. Its own pitch and yaw rates are added if they explain more than the
    approximate model of turbulence leaves.
    """

    scales, signs = flight.criteria.numerics.turbulence.rolling, dict(TURNING)

    def turned_about(*axes: str) -> Mapping[str, float]:
        """The rotation of the air with the opposite sign about some axes."""
        return {axis: -sign if axis in axes else sign for axis, sign in signs.items()}

    def at(moments: Sequence[str], scale: float, start: FlightFit, turning: Mapping[str, float]) -> FlightFit:
        noise = flight.noise(gusts(flight, turbulent.sigma, dict.fromkeys(moments, scale), turbulent.length))
        air = start.flight if start.flight.turning == turning else flight.turned_by_air(turning)
        return fit(air, start.attached, noise, start, tolerance=2.0)

    def larger(moments: Sequence[str], least: FlightFit) -> FlightFit:
        best = least
        for trial in side_by_side(lambda scale: at(moments, scale, least, least.flight.turning), scales[1:]):
            if trial.deviance > best.deviance:
                break
            best = trial
        return best

    best = at(_ROLLING, scales[0], start, signs)
    forms = (({}, ()), *((turned_about(axis), _ROLLING) for axis in _TURNED))
    uniform, *others = side_by_side(lambda form: at(form[1], scales[0], best, form[0]), forms)
    turned = [axis for axis, other in zip(_TURNED, others, strict=True) if other.deviance < best.deviance]
    if len(turned) > 1:
        best = at(_ROLLING, scales[0], best, turned_about(*turned))
    best = larger(_ROLLING, min(best, *others, key=lambda one: one.deviance))
    if uniform.deviance < best.deviance:
        return relaxed(uniform)
    besides = larger(tuple(_DAMPING), at(tuple(_DAMPING), scales[0], best, best.flight.turning))
    return relaxed(
        besides if best.deviance - besides.deviance > flight.criteria.naming.approximate * turbulent.gain else best
    )


def in_other_air(fitted: FlightFit) -> FlightFit:
    """The same turbulence in the other form: uniform over the aircraft, or with its gradients.

    Records tell the forms apart by the derivatives that each of them would need; a file does not know either.
    """
    flight, sigma = fitted.flight, max(fitted.noise.coloured[axis][0] for axis in WIND if axis in fitted.noise.coloured)
    length = typical_speed(flight) * max(tau for axis, (_, tau) in fitted.noise.coloured.items() if axis in WIND)
    turning, moments = ({}, {}) if flight.turning else (TURNING, dict.fromkeys(_ROLLING, 1.0))
    moving = {
        name: one for name, one in gusts(flight, sigma, moments, length).items() if name in fitted.model.disturbances
    }
    noise = replace(fitted.noise, coloured=moving)
    return fit(flight.turned_by_air(turning), fitted.attached, noise, fitted, tolerance=2.0)


def reconstruct(
    flight: Flight,
    attached: Sequence[Attached] = (),
    moving: Mapping[str, tuple[float, float]] = _CALM,
    start: FlightFit | None = None,
    iterations: int = 5,
) -> FlightFit:
    """Flight-path reconstruction: trajectory and instrument errors with forces left free, in `moving` air (see
    `gusts`).
    """
    flight = without_aerodynamics(flight)
    noise = forceless_noise(flight, moving)
    return fit(flight, attached, noise, start, free="effects", iterations=iterations, tolerance=2.0)


def forceless_noise(flight: Flight, moving: Mapping[str, tuple[float, float]] = _CALM) -> NoiseModel:
    """The noise model with forces left free, in `moving` air.

    It has no colour, because innovations with free forces contain more than noise of the readings.
    """
    return replace(flight.noise(free_forces(flight) | dict(moving)), colour={})


def with_offsets(reconstructed: FlightFit) -> FlightFit:
    """The reconstruction with small offsets of all instruments estimated too.

    It must not be used to judge instruments: a bias would share its evidence with the offset.
    """
    given = reconstructed
    return fit(given.flight, given.attached, given.noise, given, free="offsets", iterations=2, tolerance=2.0)


def again(before: FlightFit, attached: Sequence[Attached]) -> FlightFit:
    """The reconstruction fitted again with other effects, in the same air."""
    return fit(before.flight, attached, before.noise, before, free="effects", iterations=5, tolerance=2.0)


def with_causes(kinematic: Evidence, attached: Sequence[Attached]) -> Evidence:
    """Evidence of the kinematics with those of the `attached` effects that affect them."""
    return weigh(again(kinematic.fit, [one for one in attached if one.effect.kinematic]), discrepancy=False)


def turbulence(flight: Flight, calm: FlightFit) -> Turbulence:
    """Estimate r.m.s. velocity and scale length of turbulence with forces left free.

    The velocity is first found on a grid. Length and velocity are then refined with parabolas through the deviance.
    """
    criteria, numerics = flight.criteria.turbulence, flight.criteria.numerics.turbulence
    velocities, unknown, worse = numerics.velocities, criteria.scale_length, flight.criteria.significance.search
    begin = velocities[len(velocities) // 2]

    def at(sigma: float, length: float, start: FlightFit, axes: Sequence[str] = WIND, iterations: int = 2) -> FlightFit:
        moving = gusts(flight, sigma, length=length, axes=axes)
        return reconstruct(flight, calm.attached, moving, start, iterations).lighter()

    def best_along(sigmas: Sequence[float]) -> tuple[FlightFit, float]:
        """The best of the first fit and of further velocities, one after the other until one is clearly worse."""
        last = best = first
        best_sigma = begin
        for sigma in sigmas:
            last = at(sigma, unknown, last)
            if last.deviance < best.deviance:
                best, best_sigma = last, sigma
            if last.deviance > best.deviance + worse:
                break
        return best, best_sigma

    calm.forget()  # its deviance and its motion are needed
    first = at(begin, unknown, calm)
    faster = [sigma for sigma in velocities if sigma > begin]
    slower = [sigma for sigma in reversed(velocities) if sigma < begin]
    ends = side_by_side(best_along, (faster, slower))
    found, best = min(ends, key=lambda end: end[0].deviance)
    gain = max(calm.deviance - found.deviance, 0.0)
    if gain < flight.criteria.verdict.missing:
        return _in_air(flight, best if gain > 0.0 else 0.0, best, gain)
    axes = [axis for axis in WIND if axis in found.model.disturbances]
    along = sorted(side_by_side(lambda axis: at(best, unknown, found, (axis,)), axes), key=lambda one: one.deviance)
    still, moving, *others = side_by_side(lambda one: with_offsets(one).lighter(), [calm, found, *along[:1]])
    beyond = others[0].deviance - moving.deviance
    judged = _in_air(flight, best, best, still.deviance - moving.deviance, beyond)
    if not judged.along_all_axes:
        return judged
    others += side_by_side(lambda one: with_offsets(one).lighter(), along[1:])
    judged = replace(
        judged,
        beyond_one_axis=min(one.deviance for one in others) - moving.deviance,
        as_histories=sum(one.gain for one in moving_air(weigh(still, discrepancy=False))),
    )
    if not (judged.along_all_axes and judged.slow):
        return judged
    # From here on, motion and velocity of the air are accurate enough for a linearisation, and no step is needed.
    # The records determine the strength of the process at short times, sigma^2 / length.
    factors = np.array([1.0 / numerics.length_ratio, 1.0, numerics.length_ratio])
    by_length = side_by_side(lambda f: at(best * f**0.5, f * unknown, found, iterations=1).deviance, factors.tolist())
    factor, spread = _lowest(factors, by_length, numerics.beyond)
    length, middle = factor * unknown, best * factor**0.5
    sigmas = middle * (velocities[1] / velocities[0]) ** np.array([-0.5, 0.0, 0.5])
    by_velocity = side_by_side(lambda s: at(s, length, found, iterations=1).deviance, sigmas.tolist())
    sigma, narrow = _lowest(sigmas, by_velocity, numerics.beyond)
    std = sigma * float(np.sqrt(narrow**2 + 0.25 * spread**2 + criteria.spectrum**2))
    return replace(judged, sigma=sigma, std=std, length=length)


def _lowest(points: np.ndarray, deviance: Sequence[float], beyond: float) -> tuple[float, float]:
    """Minimum of a parabola through three points over the logarithm.

    Parameters
    ----------
    points
        The three points, equally spaced in the logarithm.
    deviance
        Deviance at each.
    beyond
        Largest distance of the minimum from the middle point, in steps.

    Returns
    -------
    minimum
        Position of the minimum; the best of the three points if the parabola opens downwards.
    std
        Standard deviation of its logarithm; one step if the parabola opens downwards.
    """
    x, step = np.log(points), float(np.log(points[1] / points[0]))
    bend, slope, _ = np.polyfit(x - x[1], deviance, 2)
    if bend <= 0.0:
        return float(points[int(np.argmin(deviance))]), step
    return float(np.exp(x[1] + np.clip(-slope / (2.0 * bend), -beyond * step, beyond * step))), float(bend**-0.5)
