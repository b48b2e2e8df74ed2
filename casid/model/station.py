"""Stations of the signal path where a time history that the model does not know may enter, and what they are called.

A model knows a station by a key, the name of one of its disturbances; of a reading, by a key of the same kind.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from casid.errors import unknown

StationKind = Literal["control", "wind", "rotation", "reading", "equation", "coefficient"]
# the longer prefix first: "d_delta_e" is a control, "dCm" a coefficient
_PREFIX: dict[StationKind, str] = {
    "control": "d_",
    "wind": "wind_",
    "rotation": "gust_",
    "reading": "reading_",
    "equation": "f_",
    "coefficient": "d",
}


@dataclass(frozen=True)
class Station:
    """One such place."""

    # what the history adds to: a surface or thrust, the velocity of the air along a body axis [m/s], its rotation about
    # one [rad/s], what an instrument reads, or a coefficient
    kind: StationKind
    name: str  # of the surface ("delta_e", "thrust"), axis ("x"), rate ("p"), channel ("alpha") or coefficient ("Cm")

    @property
    def key(self) -> str:
        """Name of the disturbance: "d_delta_e", "wind_x", "gust_p", "reading_alpha", "dCm"."""
        return _PREFIX[self.kind] + self.name

    @property
    def words(self) -> str:
        """Name in a sentence: "Cm", "the reading of theta", "moving air along z"."""
        before = {"wind": "moving air along ", "rotation": "rotation of the air about ", "reading": "the reading of "}
        return before.get(self.kind, "") + self.name

    @classmethod
    def at(cls, key: str) -> Station:
        """The station of a key. Raises InputError for what is none."""
        for kind, prefix in _PREFIX.items():
            if key.startswith(prefix) and len(key) > len(prefix):
                return cls(kind, key.removeprefix(prefix))
        raise unknown("station", key, [prefix + "..." for prefix in _PREFIX.values()])


def control(name: str) -> str:
    """Key of what is added to a surface or to thrust."""
    return Station("control", name).key


def coefficient(name: str) -> str:
    """Key of what is added to a coefficient."""
    return Station("coefficient", name).key


def equation(state: str) -> str:
    """Key of what is added to the equation of a state."""
    return Station("equation", state).key


def wind(axis: str) -> str:
    """Key of the velocity of the air along a body axis."""
    return Station("wind", axis).key


def rotation(rate: str) -> str:
    """Key of the rotation of the air about the axis of a rate."""
    return Station("rotation", rate).key


def reading(channel: str) -> str:
    """Key of what is added to a reading."""
    return Station("reading", channel).key


def stuck(channel: str) -> str:
    """Key of the part of its motion that a reading loses: 0 none of it, 1 all."""
    return f"stuck_{channel}"


def as_read(channel: str) -> str:
    """Name under which effects find a channel as it was measured."""
    return f"read {channel}"


MOVING_AIR = (*map(wind, "xyz"), *map(rotation, "pqr"))
