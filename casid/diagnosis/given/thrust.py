"""Records without thrust: a constant that balances the drag of the file stands for it, and what hangs on it is not
judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

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
    if "thrust" in aircraft.trim or all("thrust" in record for record in records):
        return list(records), ()
    why = "no channel thrust and none in [trim]"
    if axes == "lateral":
        found = [r if "thrust" in r else r.with_channels(thrust=np.zeros(len(r))) for r in records]
        return found, (NotJudged(what="asymmetric thrust", because=why),)
    found = [r if "thrust" in r else r.with_channels(thrust=_balance(aircraft, r)) for r in records]
    because = f"{why}: a constant that balances the drag of the file stands for it"
    return found, (NotJudged(what="thrust, its line, and the level of drag", because=because),)


def drag_level(aircraft: Aircraft) -> str:
    """The derivative that a constant thrust cannot be told from."""
    return "CD_0" if aircraft.force_axes == "wind" else "CX_0"


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
