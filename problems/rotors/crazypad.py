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
from casid.diagnosis.flight.rotorcraft import first_fit, rotorcraft
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


def with_decks(aircraft: cs.Aircraft) -> cs.Aircraft:
    """The Crazyflie of Foerster 2015 with the inertia of its decks, and with its motor lag of 0.06 s."""
    rotors = aircraft.required_rotors
    each = tuple(replace(one, lag=0.06) for one in rotors.each)
    inertia = cs.Inertia(Ixx=2.6e-5, Iyy=2.8e-5, Izz=4.5e-5, Ixz=0.0)
    return replace(aircraft, inertia=inertia, rotors=replace(rotors, each=each))


def effectiveness_in(aircraft: cs.Aircraft, log: Sequence[cs.Record]) -> list[float]:
    """Effectiveness of each rotor by the flights of one log, fitted alone."""
    found = first_fit(rotorcraft(aircraft, log, Criteria())[0])
    return [found[effectiveness(name)] for name in aircraft.required_rotors.names]


def airframe(aircraft: cs.Aircraft, normal: Sequence[Sequence[float]]) -> cs.Aircraft:
    """The aircraft file with what normal flights of one airframe say of its rotors (`effectiveness_in` each log).

    Their mean is the effectiveness of a rotor; how far the next log may be from it, by the scatter of these few, is its
    standard deviation, and not less than that of any rotor on average.
    """
    assert aircraft.rotors is not None
    values = np.array(normal)
    scatter = values.std(axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / len(values))
    std = np.maximum(scatter, np.sqrt(np.mean(scatter**2)))
    each = [
        replace(one, effectiveness=float(m), std=float(s))
        for one, m, s in zip(aircraft.rotors.each, values.mean(axis=0), std, strict=True)
    ]
    return replace(aircraft, rotors=replace(aircraft.rotors, each=tuple(each)))
