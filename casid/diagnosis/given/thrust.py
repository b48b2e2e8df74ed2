"""Records without thrust: a constant or a time history that balances the drag of the file replaces it, and everything
that depends on thrust is not judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.diagnosis.data.criteria import DataCriteria
from casid.diagnosis.given.contradicted import Contradiction
from casid.diagnosis.given.not_judged import NotJudged
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model, flight_inputs
from casid.model.system import Model
from casid.model.terms import derivative_term
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Powered:
    """Records that have a thrust.

    records  with a replacement for a thrust that was not recorded;  lost  what that leaves open
    unknown  the replaced thrust, and the coefficient that is as unknown as its history
    """

    records: tuple[Record, ...]
    lost: tuple[NotJudged, ...] = ()
    unknown: tuple[str, ...] = ()


def with_thrust(aircraft: Aircraft, records: Sequence[Record], axes: str, nodes: float) -> Powered:
    """The records with a thrust where neither they nor [trim] have one.

    For longitudinal motion the thrust of each record balances drag and acceleration: a constant, or a history with a
    node every `nodes` seconds if the record requires one. A moving throttle does not give the thrust, and the thrust of
    [trim] does not apply to such a record. Lateral motion does not depend on it.
    """
    trimmed = "thrust" in aircraft.trim
    bare = [r for r in records if "thrust" not in r and not (trimmed and (axes == "lateral" or not _throttled(r)))]
    if not bare:
        return Powered(records=tuple(records))
    why = "no channel thrust" if trimmed else "no channel thrust and none in [trim]"
    stands = {r.name: np.zeros(len(r)) if axes == "lateral" else _balance(aircraft, r, nodes) for r in bare}
    found = tuple(r.with_channels(thrust=stands[r.name]) if r.name in stands else r for r in records)
    if axes == "lateral":
        lost, unknown = NotJudged(what="asymmetric thrust", because=why), ("thrust",)
    elif any(np.ptp(series) > 0.0 for series in stands.values()):
        because = f"{why}: a time history that balances the drag of the file stands for it"
        lost = NotJudged(what="thrust, its line, and drag", because=because)
        unknown = ("thrust", derivative_term(drag_level(aircraft))[0])
    else:
        because = f"{why}: a constant that balances the drag of the file stands for it"
        lost, unknown = NotJudged(what="thrust, its line, and the level of drag", because=because), ("thrust",)
    return Powered(records=found, lost=(lost,), unknown=unknown)


def _throttled(record: Record) -> bool:
    """Whether a throttle moves in a record."""
    throttle = record["throttle"] if "throttle" in record else np.zeros(1)
    return bool(np.isfinite(throttle).any()) and float(np.nanmax(throttle)) > float(np.nanmin(throttle))


def drag_level(aircraft: Aircraft) -> str:
    """The derivative that cannot be separated from a constant thrust."""
    return "CD_0" if aircraft.force_axes == "wind" else "CX_0"


def or_thrust(aircraft: Aircraft, one: Contradiction, records: Sequence[Record], by: DataCriteria) -> Contradiction:
    """A contradicted level of drag with its alternative: a wrong scale of a steady thrust has the same effect. Other
    contradictions stay as they are.
    """
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


def _balance(aircraft: Aircraft, record: Record, nodes: float) -> np.ndarray:
    """(N,) thrust [N] that the longitudinal specific force takes beside the drag of the file; the force is that of the
    path of flight where no accelerometer measures it.

    Beside the history, the drag of the file may be wrong along angle of attack, pitch rate and elevator. A history is
    demanded where the Bayesian information criterion prefers it to a constant, with as many samples as the correlation
    of what the history leaves is worth.
    """
    unpowered = flight_inputs(aircraft, record.with_channels(thrust=np.zeros(len(record))), "longitudinal")
    model = aircraft_model(aircraft, axes="longitudinal", outputs=("ax",), effects=())
    X, U = model.guess(unpowered), unpowered.matrix(model.inputs)
    ax = ca.Function("ax", [model.x, model.u], [ca.substitute(model.h, ca.vertcat(model.p, model.w), _known(model))])
    dragged = ax.map(len(record))(X.T, U.T).full()[0]
    state, acting = dict(zip(model.states, X.T, strict=True)), dict(zip(model.inputs, U.T, strict=True))
    measured = record["ax"] if "ax" in record else _along_the_path(aircraft, unpowered, state)
    needed = aircraft.mass * (measured - dragged)
    level = np.full(len(record), float(np.nanmean(needed)))
    alpha, pressure = np.arctan2(state["w"], state["u"]), state["u"] ** 2 + state["w"] ** 2
    wrong = pressure * np.stack([alpha, alpha**2, state["q"], acting["delta_e"]])
    history = _history(record.t, needed, wrong, nodes)
    return level if history is None else level + history


def _history(t: np.ndarray, needed: np.ndarray, wrong: np.ndarray, nodes: float) -> np.ndarray | None:
    """(N,) history about its mean that `needed` requires in addition to `wrong` terms (terms, N); None if a constant is
    enough.
    """
    known = np.isfinite(needed)
    grid = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / nodes) + 1))
    hats = np.stack([np.interp(t, grid, one) for one in np.eye(len(grid))], axis=1)
    spread = np.maximum(np.ptp(wrong, axis=1), 1e-300)
    errors = ((wrong - wrong.mean(axis=1, keepdims=True)) / spread[:, None]).T
    constant, free = np.column_stack([np.ones(len(t)), errors]), np.column_stack([hats, errors])
    if known.sum() <= free.shape[1]:
        return None
    by_constant, by_history = (np.linalg.lstsq(A[known], needed[known], rcond=None)[0] for A in (constant, free))
    left = needed[known] - free[known] @ by_history
    before, after = (float(np.mean(x**2)) for x in (needed[known] - constant[known] @ by_constant, left))
    alike = max(float(np.mean(left[1:] * left[:-1])) / max(after, 1e-300), 0.0)
    samples = known.sum() * (1.0 - alike) / (1.0 + alike)
    if samples * np.log(before / max(after, 1e-300)) < (len(grid) - 1) * np.log(max(samples, 1.0)):
        return None
    history = hats @ np.linalg.lstsq(hats[known], needed[known], rcond=None)[0]
    return history - float(np.mean(history[known]))


def _known(model: Model) -> ca.DM:
    return ca.vertcat(model.nominal_vector(), np.zeros(len(model.disturbances)))


def _along_the_path(aircraft: Aircraft, record: Record, state: Mapping[str, np.ndarray]) -> np.ndarray:
    """(N,) longitudinal specific force [m/s2] of the measured motion."""
    u, w, q, theta = (state[name] for name in ("u", "w", "q", "theta"))
    return np.gradient(u, record.t) + q * w - record["r"] * record["v"] + aircraft.gravity * np.sin(theta)
