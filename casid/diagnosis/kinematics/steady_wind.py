"""Steady wind from velocity over ground: what is left of it without the velocity through the air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.records.record import Record

GROUND = ("v_north", "v_east")


@dataclass(frozen=True, kw_only=True)
class SteadyWind:
    """Steady wind over all records, in the direction to which it blows.

    Attributes
    ----------
    north, east
        Velocity [m/s]; `north_std` and `east_std` their 1-sigmas, of the means of fifths of every record.
    varies
        r.m.s. [m/s] of what a constant wind leaves of the velocity over ground.
    """

    north: float
    east: float
    north_std: float
    east_std: float
    varies: float

    @property
    def sentence(self) -> str:
        """In words."""
        speed, towards = np.hypot(self.north, self.east), np.degrees(np.arctan2(self.east, self.north)) % 360.0
        return (
            f"Steady wind {speed:.2g} m/s towards {towards:.0f} deg: north {self.north:.3g} +- {self.north_std:.2g}, "
            f"east {self.east:.3g} +- {self.east_std:.2g} m/s; {self.varies:.2g} m/s r.m.s. are left."
        )

    def to_dict(self) -> dict[str, float]:
        """Numbers by name."""
        return dict(vars(self))


def steady_wind(records: Sequence[Record], found: FlightFit) -> SteadyWind | None:
    """Wind [m/s] that velocity over ground has beside the reconstructed velocity through the air; None where neither
    ground velocity nor heading and bank are known."""
    blocks, rest = [], []
    for j, record in enumerate(records):
        if not all(name in record for name in (*GROUND, "psi")):
            return None
        air = _through_the_air(record, found, j)
        wind = np.stack([record[name] for name in GROUND], axis=1) - air
        known = wind[np.isfinite(wind).all(axis=1)]
        if len(known) == 0:
            return None
        blocks += [part.mean(axis=0) for part in np.array_split(known, 5) if len(part)]
        rest.append(known)
    means, every = np.stack(blocks), np.concatenate(rest)
    north, east = (float(value) for value in every.mean(axis=0))
    north_std, east_std = (float(value) for value in means.std(axis=0, ddof=1) / np.sqrt(len(means)))
    varies = float(np.sqrt(np.mean(np.sum((every - every.mean(axis=0)) ** 2, axis=1))))
    return SteadyWind(north=north, east=east, north_std=north_std, east_std=east_std, varies=varies)


def _through_the_air(record: Record, found: FlightFit, j: int) -> np.ndarray:
    """(N, 2) velocity through the air towards north and east [m/s]; the rest is as recorded or zero."""
    states = found.model.states

    def series(name: str) -> np.ndarray:
        if name in states:
            return found.motion.X[: len(record), j, states.index(name)]
        return record[name] if name in record else np.zeros(len(record))

    u, v, w = (series(name) for name in "uvw")
    phi, theta, psi = (series(name) for name in ("phi", "theta", "psi"))
    ahead = np.cos(theta) * u + np.sin(theta) * (np.sin(phi) * v + np.cos(phi) * w)
    across = np.cos(phi) * v - np.sin(phi) * w
    return np.stack(
        [np.cos(psi) * ahead - np.sin(psi) * across, np.sin(psi) * ahead + np.cos(psi) * across],
        axis=1,
    )
