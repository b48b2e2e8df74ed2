"""Turbulence: whether the air moves, how strongly and over which length, with forces left free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import moving_air
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, relaxed
from casid.diagnosis.flight.hypothesis import acting_noise
from casid.diagnosis.flight.noise import is_far
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.kinematics.kinematics import reconstruct, typical_speed, with_offsets
from casid.filtering.innovations import NoiseModel
from casid.filtering.kalman import kalman_filter, residual_about
from casid.filtering.noise_levels import Levels, most_likely_levels
from casid.model.path import TURNING
from casid.model.usual_derivatives import USUAL_DERIVATIVES
from casid.native.processors import side_by_side

WIND = ("wind_x", "wind_y", "wind_z")
# moment due to the air's own rotation -> the derivative that causes it
_DAMPING: Mapping[str, str] = MappingProxyType({"dCl": "Cl_p", "dCm": "Cm_q", "dCn": "Cn_r"})
_ROLLING = ("dCl",)
_TURNED = ("q", "r")
_NO_MOMENTS: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class Turbulence:
    """Turbulence, estimated from the kinematics by maximum likelihood."""

    sigma: float  # r.m.s. velocity [m/s].
    std: float  # its standard deviation [m/s]
    # likelihood-ratio statistic against calm air. Both models include small offsets of all instruments, which
    # turbulence imitates.
    gain: float
    records: tuple[str, ...]  # names of the records
    length: float  # scale length [m]
    # part of the statistic that moving air along a single axis does not reach. Air is turbulent along all axes; a
    # drifting vane imitates motion along one.
    beyond_one_axis: float = 0.0
    # sum of the statistics of slow latent inputs of the air. They follow nearly all of turbulence. They are too slow
    # for coloured noise, which a Gauss-Markov process can follow.
    as_histories: float = 0.0
    criteria: Criteria = Criteria()  # the thresholds

    @property
    def named(self) -> bool:
        """Return True if the air is turbulent."""
        return self.sigma > self.criteria.size.turbulent and self.along_all_axes and self.slow

    @property
    def along_all_axes(self) -> bool:
        """Return True if the statistic is large enough, and no single axis explains it."""
        least = self.criteria.missing
        one_is_not_enough = self.beyond_one_axis > max(least, self.criteria.parts.tenth * self.gain)
        return self.gain > least and one_is_not_enough

    @property
    def slow(self) -> bool:
        """Return True if slow latent inputs of the air explain most of the statistic."""
        return self.as_histories > self.criteria.parts.most * self.gain


# axes -> channels that are needed to leave the forces free
def still_air(flight: Subject) -> Turbulence:
    """The result for calm air."""
    return _in_air(flight, 0.0, 0.0, 0.0)


def _in_air(flight: Subject, sigma: float, std: float, gain: float, beyond_one_axis: float = 0.0) -> Turbulence:
    """A result with the default scale length."""
    criteria = flight.criteria
    return Turbulence(
        sigma=sigma,
        std=std,
        gain=gain,
        records=flight.names,
        length=criteria.kinematics.scale_length,
        beyond_one_axis=beyond_one_axis,
        criteria=criteria,
    )


def gusts(
    flight: Subject,
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

    sigma    r.m.s. velocity [m/s].
    moments  scale of the moment due to the air's own rotation, for some of dCl, dCm and dCn; 1 for the roll rate above
    length   scale length [m]; by default that of the criteria
    axes     axes along which the air moves
    dict     port -> r.m.s. and time constant [s].
    """
    aircraft = flight.aircraft
    speed = typical_speed(flight)
    length = flight.criteria.kinematics.scale_length if length is None else length
    processes = {name: (sigma, length / speed) for name in axes}
    mean = float(np.sqrt(length * 2.0 * aircraft.rate_length_lateral))
    for moment, scale in moments.items():
        derivative = _DAMPING[moment]
        arm = aircraft.rate_length_pitch if moment == "dCm" else aircraft.rate_length_lateral
        damping = abs(aircraft.derivatives.get(derivative, 0.0)) or USUAL_DERIVATIVES[derivative]
        processes[moment] = (scale * 1.9 * sigma / mean * damping * arm / speed, mean / (2.6 * speed))
    return processes


def in_turbulence(flight: Subject, turbulent: Turbulence, start: FlightFit) -> FlightFit:
    """The fit of the full model in turbulence, of the form that explains most, under its most likely noise."""
    return relaxed(_under_its_noise(_in_likeliest_form(flight, turbulent, start)))


def _under_its_noise(fitted: FlightFit) -> FlightFit:
    """The fit under its most likely noise."""
    noise = _likeliest_noise(fitted)
    fitted = fitted.lighter(filtered=noise == fitted.noise)  # the arrays of one model are enough to hold
    return fit(fitted.flight, fitted.attached, noise, fitted, extent="rough")


def _likeliest_noise(fitted: FlightFit) -> NoiseModel:
    """The most likely noise of what the air moves, and velocity of the air, the same along all axes.

    What the air does above the band of the motion is in the noise that was measured there, which is too large. With a
    wrong share of the two the prediction errors are not white, and a derivative by which the air acts is biased.
    """
    noise = fitted.held
    linear = fitted.linear
    dt = float(np.median(fitted.batch.dt))
    at = [fitted.model.disturbances.index(name) for name in noise.coloured]
    moved = np.any(linear.Dw[..., at] != 0.0, axis=(0, 1, 3))
    readings = [name for name, one in zip(fitted.model.outputs, moved, strict=True) if one]
    velocities = {name: sigma for name, (sigma, _) in noise.coloured.items()}
    alone = [(name,) for name in readings]
    bounds = {
        name: (fitted.criteria.parts.half * noise.measurement[name], noise.measurement[name]) for name in readings
    }

    def under(levels: Levels, noise: NoiseModel) -> NoiseModel:
        measurement = {name: levels.get(name, sigma) for name, sigma in noise.measurement.items()}
        coloured = {name: (levels[name], tau) for name, (_, tau) in noise.coloured.items()}
        return replace(noise, measurement=measurement, coloured=coloured)

    def deviance(levels: Levels) -> float:
        acting = acting_noise(under(levels, noise), fitted.attached, dt)
        about = residual_about(linear, acting, fitted.motion.about[1], fitted.errors)
        try:
            kalman = kalman_filter(linear, acting)
        except np.linalg.LinAlgError:
            return np.inf
        return float(np.sum(kalman.whiten(*about) ** 2) + np.sum(kalman.log_determinant))

    found = most_likely_levels(
        {name: noise.measurement[name] for name in readings} | velocities,
        bounds | dict.fromkeys(velocities, (0.0, np.inf)),
        deviance,
        [[name for name in velocities if name in WIND], *((name,) for name in velocities if name not in WIND), *alone],
        fitted.criteria.parts.steps[-1:],
        fitted.criteria.numerics.naming.trials,
        fitted.criteria.numerics.fit.rough[1],
    )
    return under(found, fitted.noise)


def _in_likeliest_form(flight: Subject, turbulent: Turbulence, start: FlightFit) -> FlightFit:
    """The fit in the form of turbulence that explains most, under the filter of that form's first point.

    The air is uniform over the aircraft, or turns with the gradient of its velocity, whichever explains more. The signs
    of its pitch and yaw rates due to that gradient, which differ between simulators, and the size of its own roll rate
    are estimated by maximum likelihood on a grid. Its own pitch and yaw rates are added if they explain more than the
    approximate model of turbulence leaves.
    """

    third = flight.criteria.parts.third
    scales = (third, 1.0, 1.0 / third)  # of the air's roll rate in MIL-F-8785C
    signs = dict(TURNING)
    far = False

    def turned_about(*axes: str) -> Mapping[str, float]:
        """The rotation of the air with the opposite sign about some axes."""
        return {axis: -sign if axis in axes else sign for axis, sign in signs.items()}

    def other(moments: Sequence[str], scale: float, start: FlightFit, turning: Mapping[str, float]) -> FlightFit:
        """The fit in another form of turbulence; `start` itself if it does not come below that."""
        noise = flight.noise(gusts(flight, turbulent.sigma, dict.fromkeys(moments, scale), turbulent.length))
        flown = start.flight
        air = flown if flown.turning == turning else flight.changed(turning=turning)
        to_beat = start.deviance if start.noise.coloured else np.inf
        found = fit(air, start.attached, noise, start, extent="rough", give_up=to_beat, far=far)
        is_first = not start.noise.coloured  # the other rotations of the air are compared under its filter
        return found.lighter(filtered=is_first) if found.deviance < to_beat else start

    def larger(moments: Sequence[str], best: FlightFit) -> FlightFit:
        for scale in scales[1:]:  # one after the other: the first is mostly worse, and ends it
            found = other(moments, scale, best, best.flight.turning)
            if found is best:
                break
            best = found
        return best

    first = other(_ROLLING, scales[0], start, signs)
    if is_far(first, flight.criteria.significance.chance):
        # the predicted motion may depart from far away, and the forms be compared where no fit has ended
        ahead = first.lighter(filtered=False)
        far = True
        first = other(_ROLLING, scales[0], start, signs)
        if ahead.deviance < first.deviance:
            first = ahead
            far = False
    forms = (({}, ()), *((turned_about(axis), _ROLLING) for axis in _TURNED))
    uniform, *others = side_by_side(lambda form: other(form[1], scales[0], first, form[0]), forms)
    turned = [axis for axis, one in zip(_TURNED, others, strict=True) if one is not first]
    if len(turned) > 1:
        others.append(other(_ROLLING, scales[0], first, turned_about(*turned)))
    best = larger(_ROLLING, min(others, key=lambda one: one.deviance))
    if uniform.deviance < best.deviance:
        return uniform
    besides = other(tuple(_DAMPING), scales[0], best, best.flight.turning)
    if besides is not best:
        besides = larger(tuple(_DAMPING), besides)
    more = best.deviance - besides.deviance
    return besides if more > flight.criteria.naming.approximate * turbulent.gain else best


def in_other_air(fitted: FlightFit) -> FlightFit:
    """The same turbulence in the other form: uniform over the aircraft, or with its gradients.

    Records separate the forms by the derivatives that each of them would need; a file does not know either.
    """
    flight = fitted.flight
    wind = {n: one for n, one in fitted.noise.coloured.items() if n in WIND}
    sigma = max(velocity for velocity, _ in wind.values())
    length = typical_speed(flight) * max(tau for _, tau in wind.values())
    turning = {} if flight.turning else TURNING
    moments: dict[str, float] = {} if flight.turning else dict.fromkeys(_ROLLING, 1.0)
    turned = gusts(flight, sigma, moments, length, axes=())
    moving = {name: one for name, one in turned.items() if name in fitted.model.disturbances}
    noise = replace(fitted.noise, coloured=wind | moving)
    return fit(flight.changed(turning=turning), fitted.attached, noise, fitted, extent="rough")


def turbulence(flight: Subject, calm: FlightFit) -> Turbulence:
    """Estimate r.m.s. velocity and scale length of turbulence with forces left free.

    The velocity is first found on a grid. Length and velocity are then refined with parabolas through the deviance.
    """
    velocities = flight.criteria.size.velocities
    unknown = flight.criteria.kinematics.scale_length
    worse = flight.criteria.significance.search
    begin = velocities[len(velocities) // 2]

    no_step = (1, flight.criteria.numerics.fit.rough[1])

    def at(sigma: float, length: float, start: FlightFit, axes: Sequence[str] = WIND, step: bool = True) -> FlightFit:
        moving = gusts(flight, sigma, length=length, axes=axes)
        return reconstruct(flight, calm.attached, moving, start, "rough" if step else no_step).lighter()

    def best_along(sigmas: Sequence[float]) -> tuple[FlightFit, float]:
        """The best of the first fit and of further velocities, one after the other until one is clearly worse."""
        last = best = first
        best_sigma = begin
        for sigma in sigmas:
            last = at(sigma, unknown, last)
            if last.deviance < best.deviance:
                best = last
                best_sigma = sigma
            if last.deviance > best.deviance + worse:
                break
        return best, best_sigma

    first = at(begin, unknown, calm)
    faster = [sigma for sigma in velocities if sigma > begin]
    slower = [sigma for sigma in reversed(velocities) if sigma < begin]
    ends = side_by_side(best_along, (faster, slower))
    found, best = min(ends, key=lambda end: end[0].deviance)
    gain = max(calm.deviance - found.deviance, 0.0)
    if gain < flight.criteria.missing:
        return _in_air(flight, best if gain > 0.0 else 0.0, best, gain)
    axes = [axis for axis in WIND if axis in found.model.disturbances]
    along = sorted(side_by_side(lambda axis: at(best, unknown, found, (axis,)), axes), key=lambda one: one.deviance)
    still = with_offsets(calm).lighter()
    moving, *others = side_by_side(lambda one: with_offsets(one).deviance, [found, *along[:1]])
    judged = _in_air(flight, best, best, still.deviance - moving, others[0] - moving)
    if not judged.along_all_axes:
        return judged
    others += side_by_side(lambda one: with_offsets(one).deviance, along[1:])
    judged = replace(
        judged,
        beyond_one_axis=min(others) - moving,
        as_histories=sum(one.gain for one in moving_air(weigh(still, discrepancy=False))),
    )
    if not (judged.along_all_axes and judged.slow):
        return judged
    # From here on, motion and velocity of the air are accurate enough for a linearisation, and no step is needed.
    # The records determine the strength of the process at short times, sigma^2 / length.
    factors = (velocities[1] / velocities[0]) ** np.array([-1.0, 0.0, 1.0])
    by_length = side_by_side(lambda f: at(best * f**0.5, f * unknown, found, step=False).deviance, factors.tolist())
    factor, spread = _lowest(factors, by_length, flight.criteria.parts.clearly)
    length = factor * unknown
    middle = best * factor**0.5
    sigmas = middle * (velocities[1] / velocities[0]) ** np.array([-0.5, 0.0, 0.5])
    by_velocity = side_by_side(lambda s: at(s, length, found, step=False).deviance, sigmas.tolist())
    sigma, narrow = _lowest(sigmas, by_velocity, flight.criteria.parts.clearly)
    std = sigma * float(np.sqrt(narrow**2 + 0.25 * spread**2 + flight.criteria.parts.tenth**2))
    return replace(judged, sigma=sigma, std=std, length=length)


def _lowest(points: np.ndarray, deviance: Sequence[float], beyond: float) -> tuple[float, float]:
    """Minimum of a parabola through three points over the logarithm.

    points    the three points, equally spaced in the logarithm
    deviance  deviance at each
    beyond    largest distance of the minimum from the middle point, in steps
    minimum   position of the minimum; the best of the three points if the parabola opens downwards
    std       standard deviation of its logarithm; one step if the parabola opens downwards
    """
    x = np.log(points)
    step = float(np.log(points[1] / points[0]))
    bend, slope, _ = np.polyfit(x - x[1], deviance, 2)
    if bend <= 0.0:
        return float(points[int(np.argmin(deviance))]), step
    return float(np.exp(x[1] + np.clip(-slope / (2.0 * bend), -beyond * step, beyond * step))), float(bend**-0.5)
