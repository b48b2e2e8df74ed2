"""Records without thrust: a constant that balances the drag of the file stands for it, and what hangs on it is not
judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from casid.diagnosis.data.criteria import DataCriteria
from casid.diagnosis.given.contradicted import Contradiction
from casid.diagnosis.given.not_judged import NotJudged
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model, flight_inputs
from casid.model.system import Model
from casid.records.record import Record


def with_thrust(aircraft: Aircraft, records: Sequence[Record], axes: str) -> tuple[list[Record], tuple[NotJudged, ...]]:
    """The records with a thrust where neither they nor [trim] have one, and what that leaves open.

    Of longitudinal motion the thrust is, record by record, the constant that balances drag and acceleration on average;
    lateral motion has nothing of it.
    """
    if all("thrust" in record for record in records):
        return list(records), ()
    throttled = () if axes == "lateral" else _throttled(records)
    if "thrust" in aircraft.trim:
        return list(records), throttled
    why = "no channel thrust and none in [trim]"
    if axes == "lateral":
        found = [r if "thrust" in r else r.with_channels(thrust=np.zeros(len(r))) for r in records]
        return found, (NotJudged(what="asymmetric thrust", because=why),)
    found = [r if "thrust" in r else r.with_channels(thrust=_balance(aircraft, r)) for r in records]
    because = f"{why}: a constant that balances the drag of the file stands for it"
    return found, (NotJudged(what="thrust, its line, and the level of drag", because=because), *throttled)


def _throttled(records: Sequence[Record]) -> tuple[NotJudged, ...]:
    """What a throttle that moves leaves open where the thrust is not recorded."""
    without = [r for r in records if "thrust" not in r and "throttle" in r]
    if not any(
        np.isfinite(r["throttle"]).any() and np.nanmax(r["throttle"]) > np.nanmin(r["throttle"]) for r in without
    ):
        return ()
    because = "the throttle moves, and throttle is no thrust: the thrust is taken as constant"
    return (NotJudged(what="the motion along x that the engine makes, in airspeed, ax and drag", because=because),)


def drag_level(aircraft: Aircraft) -> str:
    """The derivative that a constant thrust cannot be told from."""
    return "CD_0" if aircraft.force_axes == "wind" else "CX_0"


def or_thrust(aircraft: Aircraft, one: Contradiction, records: Sequence[Record], by: DataCriteria) -> Contradiction:
    """A contradicted level of drag with its alternative: a steady thrust that is recorded too low or too high acts as
    the level of drag does. Other contradictions stay as they are."""
    steady = [
        r for r in records if "thrust" in r and np.ptp(r["thrust"]) < by.steady_thrust * abs(np.mean(r["thrust"]))
    ]
    pressures = [_pressure(record) for record in steady]
    if one.parameter != drag_level(aircraft) or not steady or len(steady) < len(records) or None in pressures:
        return one
    sign = 1.0 if one.parameter == "CD_0" else -1.0
    less = sign * (one.given - one.flight) * aircraft.area * float(np.mean([p for p in pressures if p is not None]))
    recorded = float(np.mean([np.mean(record["thrust"]) for record in steady]))
    if recorded <= 0.0 or recorded + less <= 0.0:
        return one
    percent = 100.0 * (recorded / (recorded + less) - 1.0)
    way = "low" if percent < 0.0 else "high"
    other = (
        f"or else the recorded thrust is {abs(percent):.0f} % too {way}: a steady thrust does not tell the two apart"
    )
    return replace(one, sentence=f"{one.sentence.removesuffix('.')}; {other}.")


def _pressure(record: Record) -> float | None:
    """Mean dynamic pressure [Pa]; None where airspeed or density is not recorded."""
    if "V" not in record or "rho" not in record:
        return None
    return 0.5 * float(np.nanmean(record["rho"]) * np.nanmean(record["V"]) ** 2)


def _balance(aircraft: Aircraft, record: Record) -> np.ndarray:
    """(N,) constant thrust [N] that the longitudinal specific force takes beside the drag of the file; the force from
    the path of flight where no accelerometer measures it."""
    unpowered = flight_inputs(aircraft, record.with_channels(thrust=np.zeros(len(record))), "longitudinal")
    model = aircraft_model(aircraft, axes="longitudinal", outputs=("ax",), effects=())
    X, U = model.guess(unpowered), unpowered.matrix(model.inputs)
    ax = ca.Function("ax", [model.x, model.u], [ca.substitute(model.h, ca.vertcat(model.p, model.w), _known(model))])
    dragged = ax.map(len(record))(X.T, U.T).full()[0]
    state = dict(zip(model.states, X.T, strict=True))
    measured = record["ax"] if "ax" in record else _along_the_path(aircraft, unpowered, state)
    return np.full(len(record), aircraft.mass * float(np.nanmean(measured - dragged)))


def _known(model: Model) -> ca.DM:
    return ca.vertcat(model.nominal_vector(), np.zeros(len(model.disturbances)))


def _along_the_path(aircraft: Aircraft, record: Record, state: Mapping[str, np.ndarray]) -> np.ndarray:
    """(N,) longitudinal specific force [m/s2] of the measured motion."""
    u, w, q, theta = (state[name] for name in ("u", "w", "q", "theta"))
    return np.gradient(u, record.t) + q * w - record["r"] * record["v"] + aircraft.gravity * np.sin(theta)
