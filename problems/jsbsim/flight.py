"""Flight records with a known hidden effect, flown by JSBSim: an independent simulator as source of test data.

    record = fly(Flight(aircraft="fokker50", manoeuvre="pitch_roll_yaw", seed=1,
                        fault=Fault(kind="actuator_lag", target="delta_e", size=0.1)))

Needs the optional package jsbsim. Everything random comes from the flight's seed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from casid.errors import InputError, unknown
from casid.records.record import Record
from problems.jsbsim.airframe import RATE_HZ, airframe
from problems.jsbsim.faults import Fault, edit_of, instrument_fault, schedule_of, sensor_position
from problems.jsbsim.fdm import Log, simulate
from problems.jsbsim.manoeuvres import CARDS, SURFACES, commands

_DEG = np.pi / 180.0
# 1-sigma of ordinary flight-test instruments; the thrust's is a fraction of its mean
NOISE: Mapping[str, float] = MappingProxyType(
    {
        "V": 0.3,
        "alpha": 0.15 * _DEG,
        "beta": 0.15 * _DEG,
        **dict.fromkeys(("p", "q", "r"), 0.05 * _DEG),
        **dict.fromkeys(("phi", "theta", "psi"), 0.05 * _DEG),
        "ax": 0.05,
        "ay": 0.05,
        "az": 0.08,
        **dict.fromkeys(("pdot", "qdot", "rdot"), 0.3 * _DEG),
        **dict.fromkeys(SURFACES, 0.03 * _DEG),
        "thrust": 0.005,
        "altitude": 0.5,
        "rho": 0.0,
    }
)


@dataclass(frozen=True, kw_only=True)
class Flight:
    """One record to be flown.

    aircraft     name of an airframe of `jsbsim_airframe.AIRFRAMES`
    manoeuvre    name of a card of `jsbsim_manoeuvres.CARDS`
    duration_s   [s], dt [s] sampling interval, a multiple of 1 / RATE_HZ
    speed_mps, altitude_m   trim point; None: the airframe's own
    fault        the hidden effect, None: healthy
    noise        1-sigma per channel, SI, thrust as a fraction of its mean; an empty table: no noise
    seed         of the noise, of the pilot's scatter and of the turbulence
    Raises InputError for an unknown name or a dt that does not fit.
    """

    aircraft: str
    manoeuvre: str
    duration_s: float = 28.0
    dt: float = 0.02
    speed_mps: float | None = None
    altitude_m: float | None = None
    fault: Fault | None = None
    noise: Mapping[str, float] = field(default_factory=lambda: NOISE)
    seed: int

    def __post_init__(self) -> None:
        airframe(self.aircraft)
        if self.manoeuvre not in CARDS:
            raise unknown("manoeuvre", self.manoeuvre, CARDS)
        ratio = self.dt * RATE_HZ
        if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
            raise InputError(f"dt must be a multiple of {1 / RATE_HZ} s, got {self.dt}")
        for name in self.noise:
            if name not in NOISE:
                raise unknown("channel", name, NOISE, "noise")


def fly(flight: Flight) -> Record:
    """The record of a flight: the channels of a flight record, at `dt`, with the flight's fault and noise.

    Surfaces are the commanded positions [rad]; accelerations are specific forces at the centre of gravity that the
    aircraft file knows. Raises InputError when jsbsim is missing or the aircraft cannot be trimmed.
    """
    return record_of(flight, log_of(flight))


def log_of(flight: Flight) -> Log:
    """The flight itself, at RATE_HZ, as JSBSim flew it: no instruments, no noise."""
    frame = airframe(flight.aircraft)
    frame = replace(
        frame,
        speed_mps=frame.speed_mps if flight.speed_mps is None else flight.speed_mps,
        altitude_m=frame.altitude_m if flight.altitude_m is None else flight.altitude_m,
    )
    t = np.arange(round(flight.duration_s * RATE_HZ) + 1) / RATE_HZ
    pilot = np.random.default_rng([flight.seed, 1])
    controls = commands(flight.manoeuvre, t, sizes=frame.sizes, units_s=frame.units_s, rng=pilot)
    return simulate(frame, edit_of(flight.fault), controls, schedule_of(flight.fault, frame, t, flight.seed))


def record_of(flight: Flight, log: Log) -> Record:
    """What the instruments of `flight` make of a `log`."""
    faults = () if flight.fault is None else (flight.fault,)
    return measured(log, faults, name=flight.manoeuvre, dt=flight.dt, noise=flight.noise, seed=flight.seed)


def measured(
    log: Log, faults: Sequence[Fault], *, name: str, dt: float, noise: Mapping[str, float], seed: int
) -> Record:
    """What instruments with `faults` make of a `log`; dt, noise and seed as in `Flight`."""
    channels = _readings(faults, log)
    for fault in faults:
        channels = instrument_fault(fault, log.t, channels)
    every = round(dt * RATE_HZ)
    rng = np.random.default_rng([seed, 2])
    sampled = {}
    for channel in NOISE:
        values = channels[channel][::every]
        sigma = noise.get(channel, 0.0) * (float(np.mean(values)) if channel == "thrust" else 1.0)
        sampled[channel] = values + sigma * rng.standard_normal(len(values))
    return Record(name=name, t=np.round(log.t[::every], 6), channels=sampled, source="JSBSim")


def _readings(faults: Sequence[Fault], log: Log) -> dict[str, np.ndarray]:
    """Readings at the true positions of the instruments, before faults of the instruments themselves."""
    c = dict(log.channels)
    velocity = np.stack([c["u"], c["v"], c["w"]], axis=1)
    omega = np.stack([c["p"], c["q"], c["r"]], axis=1)
    omega_dot = np.stack([c["pdot"], c["qdot"], c["rdot"]], axis=1)

    def position(instrument: str) -> np.ndarray:
        return sum((sensor_position(fault, instrument) for fault in faults), np.zeros(3))

    c["V"] = np.linalg.norm(velocity, axis=1)
    at_vane = velocity + np.cross(omega, position("alpha"))
    c["alpha"] = np.arctan2(at_vane[:, 2], at_vane[:, 0])
    at_vane = velocity + np.cross(omega, position("beta"))
    c["beta"] = np.arcsin(at_vane[:, 1] / np.linalg.norm(at_vane, axis=1))
    arm = np.broadcast_to(position("accelerometer"), omega.shape)
    lever = np.cross(omega_dot, arm) + np.cross(omega, np.cross(omega, arm))
    for column, name in enumerate(("ax", "ay", "az")):
        c[name] = c[name] + lever[:, column]
    return c
