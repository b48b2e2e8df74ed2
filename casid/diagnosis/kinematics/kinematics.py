"""What instruments and moving air alone must answer for: the same model with forces and moments left free.

With every aerodynamic coefficient an unknown input, rates, accelerations, attitude and air data are tied by kinematics
only (flight path reconstruction); no derivative, actuator, mass or propulsion can explain a misfit that is left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from casid.diagnosis.criteria import TurbulenceCriteria
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.missing_input import moving_air
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, relaxed
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics.forces import free_forces, typical_speed, without_aerodynamics
from casid.filtering.innovations import NoiseModel
from casid.native.processors import side_by_side

WIND = ("wind_x", "wind_y", "wind_z")
# moment that the air's own rotation makes: the derivative by which it does
_DAMPING: Mapping[str, str] = MappingProxyType({"dCl": "Cl_p", "dCm": "Cm_q", "dCn": "Cn_r"})
_ROLLING, _TURNED = ("dCl",), ("q", "r")
_NO_MOMENTS: Mapping[str, float] = MappingProxyType({})
_CALM: Mapping[str, tuple[float, float]] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class Turbulence:
    """Turbulent air: r.m.s. velocity [m/s], its 1-sigma, and scale length [m] by maximum likelihood of the kinematics.

    gain             drop of the deviance against calm air, beside small offsets of all instruments, which moving air
                     imitates all at once
    beyond_one_axis  how much of it one axis of moving air alone does not reach: air is turbulent along all axes, a
                     drifting vane moves one
    as_histories     what unknown time histories of moving air gain together; they are too slow for coloured noise, to
                     which a process is quick enough, and follow nearly all of turbulence
    criteria         by which it is named
    """

    sigma: float
    std: float
    gain: float
    records: tuple[str, ...]
    length: float
    beyond_one_axis: float = 0.0
    as_histories: float = 0.0
    criteria: TurbulenceCriteria = TurbulenceCriteria()

    @property
    def named(self) -> bool:
        return self.sigma > self.criteria.smallest and self.along_all_axes and self.slow

    @property
    def along_all_axes(self) -> bool:
        least = self.criteria.gain
        one_is_not_enough = self.beyond_one_axis > max(least, self.criteria.other_axes * self.gain)
        return self.gain > least and one_is_not_enough

    @property
    def slow(self) -> bool:
        return self.as_histories > self.criteria.slow * self.gain


# axes -> channels without which the forces cannot be free
NEEDED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"full": ("ax", "ay", "az", "p", "q", "r"), "longitudinal": ("ax", "az", "q"), "lateral": ("ay", "p", "r")}
)


def still_air(flight: Flight) -> Turbulence:
    """None of it."""
    return _in_air(flight, 0.0, 0.0, 0.0)


def _in_air(flight: Flight, sigma: float, std: float, gain: float, beyond_one_axis: float = 0.0) -> Turbulence:
    """Of a scale length that nothing is known of."""
    criteria = flight.criteria.turbulence
    return Turbulence(
        sigma=sigma,
        std=std,
        gain=gain,
        records=flight.names,
        length=criteria.scale_length,
        beyond_one_axis=beyond_one_axis,
        criteria=criteria,
    )


def available(flight: Flight) -> bool:
    """Whether the records hold accelerations and rates enough to free the forces."""
    return all(name in flight.outputs for name in NEEDED[flight.axes])


def gusts(
    flight: Flight,
    sigma: float,
    moments: Mapping[str, float] = _NO_MOMENTS,
    length: float | None = None,
    axes: Sequence[str] = WIND,
) -> dict[str, tuple[float, float]]:
    """Turbulence of r.m.s. velocity `sigma` [m/s] and scale `length` [m], by default that of the criteria, along
    `axes`, as first-order Gauss-Markov processes.

    `moments` has for some of dCl, dCm and dCn the scale of the moment that the air's own rotation about it makes. It is
    1 for the rolling over the span of an aircraft that is small against the eddies (MIL-F-8785C, 3.7.5: sigma_p =
    1.9 sigma_w / sqrt(L b), break frequency 2.6 V / sqrt(L b)). The damping of the aircraft file makes a moment of the
    rotation. A fitted damping would grow, since a larger one explains more.
    """
    aircraft, speed, criteria = flight.aircraft, typical_speed(flight), flight.criteria.turbulence
    length = criteria.scale_length if length is None else length
    typical = {"Cl_p": criteria.roll_damping, "Cm_q": criteria.pitch_damping, "Cn_r": criteria.yaw_damping}
    processes = {name: (sigma, length / speed) for name in axes}
    mean = float(np.sqrt(length * 2.0 * aircraft.rate_length_lateral))
    for moment, scale in moments.items():
        derivative = _DAMPING[moment]
        arm = aircraft.rate_length_pitch if moment == "dCm" else aircraft.rate_length_lateral
        damping = abs(aircraft.derivatives.get(derivative, 0.0)) or typical[derivative]
        processes[moment] = (scale * 1.9 * sigma / mean * damping * arm / speed, mean / (2.6 * speed))
    return processes


def in_turbulence(flight: Flight, turbulent: Turbulence, start: FlightFit) -> FlightFit:
    """The fit of the full model in turbulence. The sense of the air's pitching and yawing by the gradient of its
    velocity, about which simulators do not agree, and the size of its own rolling are by maximum likelihood on a grid.
    So is what turns the aircraft besides, where that explains more than a rough model of moving air leaves."""

    numerics = flight.criteria.numerics.turbulence
    scales, signs = numerics.rolling, dict(zip(_TURNED, numerics.turning, strict=True))

    def turned_about(*axes: str) -> Mapping[str, float]:
        """The air's rotation with the other sign about some axes."""
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
    others = side_by_side(lambda axis: at(_ROLLING, scales[0], best, turned_about(axis)), _TURNED)
    turned = [axis for axis, other in zip(_TURNED, others, strict=True) if other.deviance < best.deviance]
    if len(turned) > 1:
        best = at(_ROLLING, scales[0], best, turned_about(*turned))
    best = larger(_ROLLING, min(best, *others, key=lambda one: one.deviance))
    besides = larger(tuple(_DAMPING), at(tuple(_DAMPING), scales[0], best, best.flight.turning))
    return relaxed(besides if best.deviance - besides.deviance > turbulent.criteria.left * turbulent.gain else best)


def reconstruct(
    flight: Flight,
    attached: Sequence[Attached] = (),
    moving: Mapping[str, tuple[float, float]] = _CALM,
    start: FlightFit | None = None,
    iterations: int = 5,
) -> FlightFit:
    """Flight path reconstruction: trajectory and instrument effects, with forces free, in `moving` air (`gusts`)."""
    flight = without_aerodynamics(flight)
    noise = forceless_noise(flight, moving)
    return fit(flight, attached, noise, start, free="effects", iterations=iterations, tolerance=2.0)


def forceless_noise(flight: Flight, moving: Mapping[str, tuple[float, float]] = _CALM) -> NoiseModel:
    """Noise with forces free, in `moving` air. Without colour: what is news to a filter whose forces are free is more
    than noise of its readings."""
    return replace(flight.noise(free_forces(flight) | dict(moving)), colour={})


def with_offsets(reconstructed: FlightFit) -> FlightFit:
    """The same with small offsets of all instruments fitted too. Not for judging instruments: a bias would share its
    evidence with the offset."""
    given = reconstructed
    return fit(given.flight, given.attached, given.noise, given, free="offsets", iterations=2, tolerance=2.0)


def again(before: FlightFit, attached: Sequence[Attached]) -> FlightFit:
    """A reconstruction with other effects, in the same air, their values fitted anew."""
    return fit(before.flight, attached, before.noise, before, free="effects", iterations=5, tolerance=2.0)


def with_causes(kinematic: Evidence, attached: Sequence[Attached]) -> Evidence:
    """Evidence of the kinematics with the kinematic ones of `attached` effects in them."""
    return weigh(again(kinematic.fit, [one for one in attached if one.effect.kinematic]), discrepancy=False)


def turbulence(flight: Flight, calm: FlightFit) -> Turbulence:
    """Fit r.m.s. velocity and scale length of turbulence, forces free: the velocity on a grid, then length and velocity
    by parabolas through the deviance."""
    criteria, numerics = flight.criteria.turbulence, flight.criteria.numerics.turbulence
    begin, unknown = numerics.first_velocity, criteria.scale_length

    def at(sigma: float, length: float, start: FlightFit, axes: Sequence[str] = WIND, iterations: int = 2) -> FlightFit:
        return reconstruct(flight, calm.attached, gusts(flight, sigma, length=length, axes=axes), start, iterations)

    def best_along(sigmas: Sequence[float]) -> tuple[FlightFit, float]:
        """The best of the first fit and of one velocity after the other, until one is clearly worse."""
        last = best = first
        best_sigma = begin
        for sigma in sigmas:
            last = at(sigma, unknown, last)
            if last.deviance < best.deviance:
                best, best_sigma = last, sigma
            if last.deviance > best.deviance + numerics.worse:
                break
        return best, best_sigma

    first = at(begin, unknown, calm)
    faster = [sigma for sigma in numerics.velocities if sigma > begin]
    slower = [sigma for sigma in reversed(numerics.velocities) if sigma < begin]
    ends = side_by_side(best_along, (faster, slower))
    found, best = min(ends, key=lambda end: end[0].deviance)
    gain = max(calm.deviance - found.deviance, 0.0)
    if gain < criteria.gain:
        return _in_air(flight, best if gain > 0.0 else 0.0, best, gain)
    axes = [axis for axis in WIND if axis in found.model.disturbances]
    along = sorted(side_by_side(lambda axis: at(best, unknown, found, (axis,)), axes), key=lambda one: one.deviance)
    still, moving, *others = side_by_side(with_offsets, [calm, found, *along[:1]])
    beyond = others[0].deviance - moving.deviance
    judged = _in_air(flight, best, best, still.deviance - moving.deviance, beyond)
    if not judged.along_all_axes:
        return judged
    others += side_by_side(with_offsets, along[1:])
    judged = replace(
        judged,
        beyond_one_axis=min(one.deviance for one in others) - moving.deviance,
        as_histories=sum(one.gain for one in moving_air(weigh(still, discrepancy=False))),
    )
    if not (judged.along_all_axes and judged.slow):
        return judged
    # from here on the motion and the histories of the air are good enough to linearise about: no step is needed.
    # What the records feel is the strength of the process at short times, sigma^2 / length
    factors = np.array([1.0 / numerics.length_ratio, 1.0, numerics.length_ratio])
    by_length = side_by_side(lambda f: at(best * f**0.5, f * unknown, found, iterations=1).deviance, factors.tolist())
    factor, spread = _lowest(factors, by_length, numerics.beyond)
    length, middle = factor * unknown, best * factor**0.5
    sigmas = middle * np.array([numerics.velocity_ratio**-0.5, 1.0, numerics.velocity_ratio**0.5])
    by_velocity = side_by_side(lambda s: at(s, length, found, iterations=1).deviance, sigmas.tolist())
    sigma, narrow = _lowest(sigmas, by_velocity, numerics.beyond)
    std = sigma * float(np.sqrt(narrow**2 + 0.25 * spread**2 + criteria.spectrum**2))
    return replace(judged, sigma=sigma, std=std, length=length)


def _lowest(points: np.ndarray, deviance: Sequence[float], beyond: float) -> tuple[float, float]:
    """Where a parabola through three points over the logarithm is lowest, no further than `beyond` steps away, and
    1-sigma of the logarithm; the lowest point itself, and a step, when the parabola opens downwards."""
    x, step = np.log(points), float(np.log(points[1] / points[0]))
    bend, slope, _ = np.polyfit(x - x[1], deviance, 2)
    if bend <= 0.0:
        return float(points[int(np.argmin(deviance))]), step
    return float(np.exp(x[1] + np.clip(-slope / (2.0 * bend), -beyond * step, beyond * step))), float(bend**-0.5)
