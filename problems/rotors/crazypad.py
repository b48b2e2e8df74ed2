"""CrazyPAD as records of casid: flights of a Crazyflie 2.1 with known damage (Data 2024, 9, 79; README of the data).

Its earth axes are x forward, y left, z up, with yaw to the left; its controller logs have the commands of the mixer in
the place of the four motors. Records are the part of a flight at more than 0.3 m, where the ground does not act.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import casid as cs
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.systems.plant import as_flight, first_fit
from casid.diagnosis.systems.rotorcraft import rotorcraft
from casid.model.causes import inertia, rotor_lag
from casid.model.effect import Effect
from casid.model.rotors import effectiveness

_LEAST_ALTITUDE = 0.3  # m
_SETTLED_S = 0.5  # after passing it
_LEAST_SAMPLES = 200
GRAVITY = 9.80665


def columns(path: Path) -> dict[str, np.ndarray]:
    """Column name -> (N,) numbers of a compressed CSV file."""
    with gzip.open(path, "rt", encoding="utf-8") as lines:
        rows = list(csv.reader(lines))
    table = np.array(rows[1:], dtype=float)
    return {name: table[:, i] for i, name in enumerate(rows[0])}


def flights(path: Path) -> list[cs.Record]:
    """The flights in a log of either kind, from take-off to landing: it lands and starts again."""
    c = columns(path)
    channels = {"north": c["x_m"], "east": -c["y_m"], "altitude": c["z_m"]}
    if "m1" in c:
        channels |= {f"m{i}": c[f"m{i}"] for i in range(1, 5)}
        channels |= {"battery": 1e-3 * c["battery_mV"]}
        channels |= {"v_north": c["vx_m_s"], "v_east": -c["vy_m_s"], "v_down": -c["vz_m_s"]}
        channels |= {"phi": np.radians(c["roll_deg"]), "psi": -np.radians(c["yaw_deg"])}
    else:
        T, a, b, y = c["cmd_thrust"], 0.5 * c["cmd_roll"], 0.5 * c["cmd_pitch"], c["cmd_yaw"]
        mixed = {"m1": T - a + b + y, "m2": T - a - b - y, "m3": T + a - b + y, "m4": T + a + b - y}
        channels |= {name: np.clip(value, 0.0, 65535.0) for name, value in mixed.items()}
        channels |= {"p": c["p_rad_s"], "q": c["q_rad_s"], "r": -c["r_rad_s"], "az": -GRAVITY * c["accelz_g"]}
    name, t, aloft = path.name.removesuffix(".csv.gz"), c["t_s"], c["z_m"] > _LEAST_ALTITUDE
    edges = np.flatnonzero(np.diff(np.concatenate([[False], aloft, [False]]).astype(int))).reshape(-1, 2)
    found = []
    for first, last in edges:
        kept = (t > t[first] + _SETTLED_S) & (t < t[last - 1] - _SETTLED_S)
        if kept.sum() >= _LEAST_SAMPLES:
            part = {one: values[kept] for one, values in channels.items()}
            found.append(cs.Record(name=f"{name}, flight {len(found) + 1}", t=t[kept], channels=part))
    return found


def airframe(aircraft: cs.Aircraft, normal: Sequence[Sequence[cs.Record]]) -> cs.Aircraft:
    """The aircraft file with what normal flights of one airframe say of it, each log fitted alone.

    Logs with rates give the lag of the rotors and the moments of inertia; then all give the effectiveness of each
    rotor. How far the next log may be from their mean, by the scatter of these few, is its standard deviation, and not
    less than that of any rotor on average.
    """
    assert aircraft.rotors is not None
    free = {"lag": rotor_lag("rotors"), **{name: inertia(name) for name in ("Ixx", "Iyy", "Izz")}}
    rows = [_fitted(aircraft, one, [*free.values()]) for one in normal if "p" in one[0]]
    if rows:
        mean = dict(zip(free, np.median([[row[e.name] for e in free.values()] for row in rows], axis=0), strict=True))
        lags = [replace(one, lag=max(one.lag + mean["lag"], 0.0)) for one in aircraft.rotors.each]
        own = {name: getattr(aircraft.inertia, name) + mean[name] for name in free if name != "lag"}
        aircraft = replace(
            aircraft,
            inertia=replace(aircraft.inertia, **own),
            rotors=replace(aircraft.rotors, each=tuple(lags)),
        )
    assert aircraft.rotors is not None
    found = [_fitted(aircraft, one, []) for one in normal]
    values = np.array([[row[effectiveness(name)] for name in aircraft.rotors.names] for row in found])
    scatter = values.std(axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / len(values))
    std = np.maximum(scatter, np.sqrt(np.mean(scatter**2)))
    each = [
        replace(one, effectiveness=float(m), std=float(s))
        for one, m, s in zip(aircraft.rotors.each, values.mean(axis=0), std, strict=True)
    ]
    return replace(aircraft, rotors=replace(aircraft.rotors, each=tuple(each)))


def _fitted(aircraft: cs.Aircraft, flown: Sequence[cs.Record], effects: Sequence[Effect]) -> dict[str, float]:
    """Name -> value of what is fitted to the flights of one log, with `effects` beside the numbers of the rotors."""
    plant = rotorcraft(aircraft, flown, Criteria())
    found = first_fit(plant)
    if effects:
        begun = [Attached(effect=one, values={"value": 0.0 if one.linear else 0.03}) for one in effects]
        found = fit(as_flight(plant), begun, plant.noise(), found, iterations=30)
    return {slot.name: found[slot.name] for slot in found.slots}
