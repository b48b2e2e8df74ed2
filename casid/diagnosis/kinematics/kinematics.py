"""Kinematics of instruments and moving air: the same model with forces and moments left free.

Every aerodynamic coefficient is a latent input. Angular rates, accelerations, attitudes and air data are then related
by kinematics alone (flight-path reconstruction). No derivative, actuator, mass or propulsion can explain what remains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from weakref import WeakKeyDictionary

import numpy as np

from casid.diagnosis.criteria import KinematicCriteria
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import with_aircraft
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.numerics import Extent
from casid.filtering.innovations import NoiseModel
from casid.model import station
from casid.model.airframe import AXES_COEFFICIENTS, Inertia

_RATES: Mapping[str, str] = MappingProxyType({"Cl": "p", "Cm": "q", "Cn": "r"})
_FORCES: Mapping[str, str] = MappingProxyType({"CX": "ax", "CY": "ay", "CZ": "az"})


_ALREADY: WeakKeyDictionary[Subject, Subject] = WeakKeyDictionary()  # keeps the models that were built


def without_aerodynamics(flight: Subject) -> Subject:
    """The flight of an aircraft with the accelerations that its accelerometers measure on average.

    They do not follow the airspeed: free coefficients would be smaller, and more probable, at a higher airspeed, and
    so prefer an airspeed that reads too low. The result is the same object for the same flight.
    """
    if flight not in _ALREADY:
        nothing = {"terms": {}, "tables": (), "aerodynamics": None, "effects": ()}
        sphere = Inertia(Ixx=1.0, Iyy=1.0, Izz=1.0, Ixz=0.0)  # an acceleration about one axis makes none about another
        free = {"force_axes": "accelerations", "derivatives": _constants(flight), "inertia": sphere}
        bare = replace(flight.aircraft, **nothing, **free)
        _ALREADY[flight] = with_aircraft(flight, bare)
    return _ALREADY[flight]


def _constants(flight: Subject) -> dict[str, float]:
    """Constant accelerations in body axes."""
    found = dict.fromkeys((f"{c}_0" for c in AXES_COEFFICIENTS["accelerations"]), 0.0)
    for coefficient, channel in _FORCES.items():
        if channel in flight.outputs:
            found[f"{coefficient}_0"] = float(np.nanmean(np.concatenate([one[channel] for one in flight.records])))
    return found


def free_forces(flight: Subject) -> dict[str, tuple[float, float]]:
    """Acceleration -> r.m.s. [m/s2] or [rad/s2] and time constant [s] of a Gauss-Markov disturbance that is as large as
    the motion.

    A larger disturbance of an angular acceleration would follow the noise of the rate, and the lever arm of an
    instrument would be estimated too small.
    """
    criteria = flight.criteria.kinematics
    sizes = dict.fromkeys(_FORCES, criteria.force)
    sizes |= {name: _angular_acceleration(flight, rate, criteria) for name, rate in _RATES.items()}
    return {station.coefficient(name): (size, criteria.time) for name, size in sizes.items()}


def typical_speed(flight: Subject) -> float:
    """Median true airspeed [m/s], or that of the trim."""
    V = np.concatenate([record["V"] for record in flight.records if "V" in record] or [np.array([np.nan])])
    return float(np.nanmedian(V)) if np.isfinite(V).any() else flight.aircraft.trim["V"]


def _angular_acceleration(flight: Subject, rate: str, criteria: KinematicCriteria) -> float:
    """1-sigma [rad/s2] of a free angular acceleration.

    It is computed from the increments of the measured rate over the correlation time, as for an integrated first-order
    Gauss-Markov process. The part that the noise of the rate adds to the increments is subtracted.
    """
    if rate not in flight.outputs:
        return criteria.unmeasured_moment
    squares = []
    lasts = []
    time = criteria.time
    for record in flight.records:
        there = np.isfinite(record[rate])
        t = record.t[there]
        values = record[rate][there]
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
    return max(flight.criteria.parts.twice * float(np.sqrt(max(variance, 0.0))), flight.sigma[rate] / time)


_CALM: Mapping[str, tuple[float, float]] = MappingProxyType({})


NEEDED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"full": ("ax", "ay", "az", "p", "q", "r"), "longitudinal": ("ax", "az", "q"), "lateral": ("ay", "p", "r")}
)


def available(flight: Subject) -> bool:
    """Return True if the records contain the accelerations and rates that are needed to leave the forces free."""
    return all(name in flight.outputs for name in NEEDED[flight.axes])


def reconstruct(
    flight: Subject,
    attached: Sequence[Attached] = (),
    moving: Mapping[str, tuple[float, float]] = _CALM,
    start: FlightFit | None = None,
    extent: Extent | tuple[float, ...] = "rough",
) -> FlightFit:
    """Flight-path reconstruction: trajectory and instrument errors with forces left free, in `moving` air (see
    `gusts`).
    """
    flight = without_aerodynamics(flight)
    noise = forceless_noise(flight, moving)
    return fit(flight, attached, noise, start, free="effects", extent=extent)


def forceless_noise(flight: Subject, moving: Mapping[str, tuple[float, float]] = _CALM) -> NoiseModel:
    """The noise model with forces left free, in `moving` air.

    It has no colour, because innovations with free forces contain more than noise of the readings.
    """
    return replace(flight.noise(free_forces(flight) | dict(moving)), colour={})


def with_offsets(reconstructed: FlightFit) -> FlightFit:
    """The reconstruction with small offsets of all instruments estimated too.

    It must not be used to judge instruments: a bias would share its evidence with the offset.
    """
    given = reconstructed
    return fit(given.flight, given.attached, given.noise, given, free="offsets", extent="rough")


def again(before: FlightFit, attached: Sequence[Attached]) -> FlightFit:
    """The reconstruction fitted again with other effects, in the same air."""
    return fit(before.flight, attached, before.noise, before, free="effects", extent="rough")


def with_causes(kinematic: Evidence, attached: Sequence[Attached]) -> Evidence:
    """Evidence of the kinematics with those of the `attached` effects that affect them."""
    return weigh(again(kinematic.fit, [one for one in attached if one.effect.kinematic]), discrepancy=False)
