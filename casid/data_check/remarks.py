"""Remarks on data that are plausible channel by channel and do not fit each other: nothing is changed for them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from casid.data_check.criteria import DataCriteria
from casid.data_check.levels import thrust_over_drag, trimmed_density
from casid.data_check.reading import Read, smooth
from casid.data_check.response import Response
from casid.data_check.rotors import ground
from casid.model.aircraft import Aircraft
from casid.model.dynamics import standard_density
from casid.records.record import Record
from casid.signals import GRAVITY

_SEA_LEVEL = float(standard_density(np.array(0.0)))


def remarks(records: Sequence[Record], aircraft: Aircraft | None, criteria: DataCriteria) -> tuple[str, ...]:
    """Return what a person should look at, one sentence for each kind, with the records concerned."""
    said: dict[str, list[str]] = {}
    thrust: dict[str, tuple[float, float]] = {}
    for record in records:
        slow = Read(smooth(record, criteria.slow, criteria))
        found = thrust_over_drag(slow, aircraft, GRAVITY if aircraft is None else aircraft.gravity, criteria)
        thrust |= {} if found is None else {record.name: (math.log(max(found[0], 1e-3)), found[1])}
        quick = Read(smooth(record, criteria.quick, criteria))
        found = (*_density(slow, criteria), *_indicated(quick, criteria), *_pace(record))
        on_ground = ground(record, aircraft.rotors) if aircraft is not None and aircraft.rotors else ()
        for one in (*found, *on_ground):
            said.setdefault(one, []).append(record.name)
    one_by_one = (f"{', '.join(names)}: {one}" for one, names in said.items())
    return (*one_by_one, *_thrust(thrust), *_signs(records, aircraft, criteria))


def _signs(records: Sequence[Record], aircraft: Aircraft | None, by: DataCriteria) -> Iterator[str]:
    """Signs of a file that the motion of the records contradicts."""
    if aircraft is None:
        return
    reads = [Read(smooth(record, by.quick, by, trimmed_density(aircraft))) for record in records]
    for name, given, free, std in Response(aircraft, by).opposite(reads):
        yield f"{name} is {given:.3g} in the file, and {free:.2g} +- {std:.1g} in these records: is its sign right?"


def _mean(read: Read, name: str) -> float:
    at = read.known(name)
    return float(np.mean(read.value(name)[at])) if at.any() else math.nan


def _density(read: Read, by: DataCriteria) -> Iterator[str]:
    """Density beside altitude."""
    if not read.has("altitude") or "rho" not in read.recorded:
        return
    rho = _mean(read, "rho")
    altitude = _mean(read, "altitude")
    expected = float(standard_density(np.array(min(max(altitude, -1000.0), 19000.0))))
    if rho > 0.0 and abs(math.log(rho / expected)) > by.fair:
        yield f"rho is {rho:.3g} kg/m3 at {altitude:.0f} m, where air has about {expected:.3g}: is it of another place?"


def _indicated(read: Read, by: DataCriteria) -> Iterator[str]:
    """An airspeed that turns the flight path as an indicated airspeed would: V (q - alphadot) is the acceleration
    across the path, so that the regression of the one on the other is true over recorded airspeed."""
    if not read.has("V", "alpha", "q", "az", "phi", "theta", "altitude"):
        return
    ratio = math.sqrt(_SEA_LEVEL / float(standard_density(np.array(min(max(_mean(read, "altitude"), 0.0), 19000.0)))))
    alpha, beta, phi, theta = (read.value(name) for name in ("alpha", "beta", "phi", "theta"))
    x = read.value("ax") - GRAVITY * np.sin(theta)
    z = read.value("az") + GRAVITY * np.cos(phi) * np.cos(theta)
    turned = read.value("q") - np.tan(beta) * (read.value("p") * np.cos(alpha) + read.value("r") * np.sin(alpha))
    at = read.known("V", "alpha", "q", "az", "phi", "theta")
    if at.sum() < 2 * by.fewest:
        return
    across = ((np.sin(alpha) * x - np.cos(alpha) * z) / np.cos(beta))[at]
    columns = np.stack(
        [
            across,
            read.rate("q")[at],
            np.ones(int(at.sum())),
            np.linspace(-1.0, 1.0, int(at.sum())),
        ],
        axis=1,
    )
    scale = np.abs(columns).max(axis=0) + 1e-300
    inverse = np.linalg.pinv((columns / scale).T @ (columns / scale), hermitian=True)
    turning = (read.value("V") * (turned - read.rate("alpha")))[at]
    found = inverse @ (columns / scale).T @ turning
    left = turning - columns / scale @ found
    every = len(left) / max(read.independent * float(at.mean()), 1.0)
    factor = float(scale[0] / found[0])
    std = factor**2 * float(np.sqrt(np.var(left) * every * inverse[0, 0])) / float(scale[0])
    if ratio > 1.0 + 2.0 * by.close and abs(factor - ratio) < by.close and factor - 1.0 > max(3.0 * std, by.close):
        yield (
            f"the flight path turns as at {factor:.3g} times the recorded airspeed; true over indicated airspeed is "
            f"{ratio:.3g} at that altitude: is V indicated?"
        )


def _pace(record: Record) -> Iterator[str]:
    """A sampling rate that changes in flight."""
    steps = np.diff(record.t)
    parts = np.array([np.median(part) for part in np.array_split(steps, 8) if len(part)])
    if parts.max() > 1.5 * parts.min():
        yield (
            f"the sampling rate changes in flight, between {1.0 / parts.min():.3g} and {1.0 / parts.max():.3g} Hz: "
            "split the record there."
        )


def _thrust(found: Mapping[str, tuple[float, float]]) -> Iterator[str]:
    """Thrust beside the drag of the file: record -> logarithm of their ratio and its 1-sigma. One that is off is found
    where it is known best, and is that of all records with the same ratio."""
    off = {name: one for name, one in found.items() if abs(one[0]) > 2.0 * one[1]}
    if not off:
        return
    best = min(off.values(), key=lambda one: one[1])[0]
    names = [name for name, (ratio, sigma) in found.items() if name in off or abs(ratio - best) < sigma]
    yield (
        f"{', '.join(names)}: the thrust is {math.exp(best):.2g} times what the drag of the file and the energy ask "
        "for: of one engine only, or in another unit?"
    )
