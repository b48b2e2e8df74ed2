"""Aircraft of JSBSim as blind aircraft: the hidden effect is made in JSBSim, or in the chain of instruments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from casid.records.record import Record
from problems.blind.case import Hidden
from problems.blind.outside import Law, Outside
from problems.jsbsim.airframe import FT, RATE_HZ, Airframe
from problems.jsbsim.edit import Edit
from problems.jsbsim.faults import Fault, edit_of, schedule_of
from problems.jsbsim.fdm import Follower, Log, simulate, steady_flight
from problems.jsbsim.fleet import fleet_airframe
from problems.jsbsim.flight import measured

# r.m.s. velocity [ft/s] of JSBSim's MIL-F-8785C turbulence by severity, over the altitude [ft] (its figure 7)
_ALTITUDES = (500.0, 1750.0, 3750.0, 7500.0, 15000.0, 25000.0, 35000.0)
_SEVERITIES: Mapping[int, tuple[float, ...]] = {
    1: (3.2, 2.2, 1.5, 0.0, 0.0, 0.0, 0.0),
    2: (4.2, 3.6, 3.3, 1.6, 0.0, 0.0, 0.0),
    3: (6.6, 6.9, 7.4, 6.7, 4.6, 2.7, 0.4),
    4: (8.6, 9.6, 10.6, 10.1, 8.0, 6.6, 5.0),
}


def fly(
    frame: Airframe,
    name: str,
    deviations: Mapping[str, np.ndarray],
    hidden: Sequence[Hidden] = (),
    outside: Outside | None = None,
    seed: int = 0,
) -> tuple[Log, Record]:
    """One record at RATE_HZ, without noise.

    deviations  of the controls from trim, (N,) each at RATE_HZ
    outside     acts in this record beside `hidden`;  seed  of the turbulence
    Raises InputError when the aircraft does not settle or leaves the air data's range.
    """
    t = np.arange(len(deviations["delta_e"])) / RATE_HZ
    faults = [fault_of(one, name, frame) for one in hidden if name in one.records]
    edit = merged([edit_of(fault) for fault in faults])
    schedule = dict[str, np.ndarray]()
    for fault in faults:
        schedule |= schedule_of(fault, frame, t, seed)
    follower = None
    if outside is not None:
        law = outside.law(1.0 / RATE_HZ)
        touched = tuple(law(0.0, dict.fromkeys(("alpha", "beta", "p", "q", "r", "ay"), 0.0) | {"V": outside.V}))
        edit = replace(edit, increments=touched)
        follower = _follower(outside.law(1.0 / RATE_HZ))
    log = simulate(frame, edit, deviations, schedule, follower, steady_flight(frame.model, fleet_airframe))
    return log, measured(log, faults, name=name, dt=1.0 / RATE_HZ, noise={}, seed=seed)


def _follower(law: Law) -> Follower:
    return lambda t, now: {f"flight/increment-{name}": value for name, value in law(t, now).items()}


def fault_of(hidden: Hidden, record: str, frame: Airframe) -> Fault:
    """The fault in one record."""
    onset = hidden.onset_s[record] if hidden.onset_s else None
    size, term, target = hidden.value, hidden.term, hidden.target
    if hidden.kind == "configuration_change":
        first = next(iter(frame.configuration_steps.values()))
        return Fault(kind=hidden.kind, target=target, size=size / first, onset_s=onset)
    if hidden.kind == "turbulence":
        size = float(severity(size, frame.altitude_m))
    further = hidden.parameters
    return Fault(
        kind=hidden.kind,
        target=target,
        term=term,
        size=size,
        onset_s=onset,
        duration_s=further.get("length", further.get("duration")),
        frequency_hz=further.get("frequency_hz", 4.0),
        damping=further.get("damping", 0.03),
    )


def severity(sigma: float, altitude_m: float) -> int:
    """JSBSim's severity whose r.m.s. velocity at an altitude is nearest to `sigma` [m/s], but not nothing."""
    found = {s: FT * float(np.interp(altitude_m / FT, _ALTITUDES, row)) for s, row in _SEVERITIES.items()}
    felt = {s: rms for s, rms in found.items() if rms > 0.3}
    return min(felt, key=lambda s: abs(felt[s] - sigma))


def merged(edits: Sequence[Edit]) -> Edit:
    """Several changes of an aircraft file as one; they must not want the same thing."""
    null, taken = Edit(), dict[str, Any]()
    for edit in edits:
        for name, value in edit.__dict__.items():
            if value != getattr(null, name):
                if name in taken:
                    raise ValueError(f"two changes of '{name}' in one aircraft")
                taken[name] = value
    return replace(null, **taken)
