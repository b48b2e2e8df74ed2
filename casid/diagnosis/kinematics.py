"""What instruments and moving air alone must answer for: the same model with forces and moments left free.

With every aerodynamic coefficient an unknown input, rates, accelerations, attitude and air data are tied by kinematics
only (flight path reconstruction); no derivative, actuator, mass or propulsion can explain a misfit that is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.fit import Fit, fit
from casid.diagnosis.flight import Flight
from casid.diagnosis.hypothesis import Attached
from casid.model.path import MOMENTS, coefficient_names

KINDS = (
    "sensor_bias", "sensor_scale", "sensor_delay", "sensor_lag", "vane_position", "accelerometer_position",
    "gust", "wind_shear", "turbulence",
)  # fmt: skip
_FORCE_TIME, _FORCE_SIZE = 0.2, 4.0  # correlation time [s] and size [m/s2] of a free specific force
_MOMENT_TIME, _MOMENT_SIZE = 0.2, 1.0  # and of a free angular acceleration [rad/s2]
WIND = ("wind_x", "wind_y", "wind_z")
_SCALE_LENGTH = 300.0  # m, of turbulence at altitude
_TURBULENCE_GAIN, _LEAST_TURBULENCE = 150.0, 0.15
_ROTATIONS = (0.3, 1.0, 3.0)
_SIGMAS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)  # m/s


def available(flight: Flight) -> bool:
    """Whether the records hold accelerations and rates enough to free the forces."""
    needed = {"full": ("ax", "ay", "az", "p", "q", "r"), "longitudinal": ("ax", "az", "q"), "lateral": ("ay", "p", "r")}
    return all(name in flight.outputs for name in needed[flight.axes])


def free_forces(flight: Flight) -> dict[str, tuple[float, float]]:
    """Gauss-Markov disturbances of all coefficients, large against the motion."""
    aircraft = flight.aircraft
    record = flight.records[0]
    speed = float(np.nanmedian(record["V"])) if "V" in record else aircraft.trim.get("V", 100.0)
    qS = 0.5 * float(np.median(record["rho"])) * speed**2 * aircraft.area
    inertia = {"Cl": aircraft.inertia.Ixx, "Cm": aircraft.inertia.Iyy, "Cn": aircraft.inertia.Izz}
    lengths = {"Cm": aircraft.moment_length_pitch}
    free = {}
    for name in coefficient_names(aircraft.force_axes):
        if name in MOMENTS:
            size = _MOMENT_SIZE * inertia[name] / (qS * lengths.get(name, aircraft.moment_length_lateral))
            free[f"d{name}"] = (size, _MOMENT_TIME)
        else:
            free[f"d{name}"] = (_FORCE_SIZE * aircraft.mass / qS, _FORCE_TIME)
    return free


def gusts(flight: Flight, sigma: float, rotation: float = 0.0) -> dict[str, tuple[float, float]]:
    """Turbulence of r.m.s. velocity `sigma` [m/s] in three axes, as first-order Gauss-Markov processes.

    `rotation` scales the rolling, pitching and yawing of the air over the span (MIL-F-8785C, 3.7.5: sigma_p =
    1.9 sigma_w / sqrt(L b), break frequency 2.6 V / sqrt(L b)), 1 for an aircraft small against the eddies.
    """
    record = flight.records[0]
    speed = float(np.nanmedian(record["V"])) if "V" in record else flight.aircraft.trim.get("V", 100.0)
    processes = {name: (sigma, _SCALE_LENGTH / speed) for name in WIND}
    if rotation > 0.0:
        length = float(np.sqrt(_SCALE_LENGTH * 2.0 * flight.aircraft.rate_length_lateral))
        rolling = (rotation * 1.9 * sigma / length, length / (2.6 * speed))
        processes |= {"gust_p": rolling, "gust_q": rolling, "gust_r": rolling}
    return processes


def rotation_of_air(flight: Flight, attached: Sequence[Attached], sigma: float, start: Fit) -> tuple[float, Fit]:
    """(scale of the rotation of the air, fit with it), by maximum likelihood of the full model on a grid."""
    best = (0.0, fit(flight, attached, flight.noise(gusts(flight, sigma)), start))
    for rotation in _ROTATIONS:
        noise = flight.noise(gusts(flight, sigma, rotation))
        trial = fit(flight, attached, noise, best[1], iterations=6, tolerance=2.0)
        if trial.deviance > best[1].deviance:
            break
        best = (rotation, trial)
    return best


def reconstruct(flight: Flight, attached: Sequence[Attached] = (), sigma: float = 0.0, start: Fit | None = None) -> Fit:
    """Flight path reconstruction: trajectory and instrument effects, with forces free and turbulence `sigma`."""
    coloured = free_forces(flight) | (gusts(flight, sigma) if sigma > 0 else {})
    return fit(flight, attached, flight.noise(coloured), start, free="effects", iterations=5, tolerance=2.0)


@dataclass(frozen=True, kw_only=True)
class Turbulence:
    """r.m.s. gust velocity [m/s] by maximum likelihood of the kinematics, its 1-sigma, and the drop of the deviance
    against calm air."""

    sigma: float
    std: float
    gain: float
    records: tuple[str, ...]

    @property
    def named(self) -> bool:
        return self.gain > _TURBULENCE_GAIN and self.sigma > _LEAST_TURBULENCE


def turbulence(flight: Flight, calm: Fit) -> Turbulence:
    """Fit the r.m.s. velocity of turbulence, forces free, on a grid that is refined once around its best value."""
    deviance: dict[float, float] = {}
    fitted = calm
    for sigma in _SIGMAS:
        fitted = reconstruct(flight, calm.attached, sigma, fitted)
        deviance[sigma] = fitted.deviance
        if deviance[sigma] > min(deviance.values()) + 20.0:
            break
    best = min(deviance, key=lambda s: deviance[s])
    if deviance[best] > calm.deviance:
        return Turbulence(sigma=0.0, std=0.0, gain=0.0, records=flight.names)
    for sigma in (best / 2**0.5, best * 2**0.5):
        fitted = reconstruct(flight, calm.attached, sigma, fitted)
        deviance[sigma] = fitted.deviance
    best = min(deviance, key=lambda s: deviance[s])
    nearest = sorted(deviance, key=lambda s: abs(np.log(s / best)))[:3]
    curve = np.polyfit(np.log(nearest), [deviance[s] for s in nearest], 2)
    std = best * float(np.sqrt(1.0 / curve[0])) if curve[0] > 0 else best
    return Turbulence(sigma=best, std=std, gain=calm.deviance - deviance[best], records=flight.names)
