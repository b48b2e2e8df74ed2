"""Axes other than x forward, y right, z down and north, east, down: one hypothesis over all channels of a frame.

A frame is named by the directions of its axes: FLU is forward, left, up; ENU is east, north, up. Rates of rotation
follow the axes as vectors do, and with the other sign in a left-handed frame. Attitude and flow angles may be given in
the same frame, or in the usual one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import permutations, product

from casid.data_check.reading import FORCES, Reading
from casid.data_check.response import Alternative

_RATES = ("p", "q", "r")
_TURNING = ("pdot", "qdot", "rdot")


@dataclass(frozen=True, kw_only=True)
class _Body:
    """A body frame: along usual axis i it has its own axis `along[i]`, with a sign; `attitude` and `air` are the signs
    of phi and theta, and of alpha and beta, in it."""

    name: str
    along: tuple[int, int, int] = (0, 1, 2)
    signs: tuple[float, float, float]
    rotation: float = 1.0  # sign of rotations
    attitude: tuple[float, float] | None = None
    air: tuple[float, float] | None = None


_FLU = _Body(name="FLU", signs=(1.0, -1.0, -1.0), attitude=(1.0, -1.0), air=(-1.0, -1.0))
_LEFT_HANDED = (
    _Body(name="FRU", signs=(1.0, 1.0, -1.0), rotation=-1.0, attitude=(-1.0, -1.0), air=(-1.0, 1.0)),
    _Body(name="FRU", signs=(1.0, 1.0, -1.0), air=(-1.0, 1.0)),
)


def _turned() -> Iterator[_Body]:
    """The 24 right-handed frames along the usual axes, the usual one first."""
    for along, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        (i, j, k), (x, y, z) = along, signs
        odd = sum((i > j, i > k, j > k)) % 2
        if math.prod(signs) == (-1.0) ** odd:
            own = {
                column: letters[sign < 0.0]
                for column, sign, letters in zip(along, signs, ("FB", "RL", "DU"), strict=True)
            }
            yield _Body(name="".join(own[n] for n in range(3)), along=(i, j, k), signs=(x, y, z))


_BODIES = (*(_FLU if one.name == _FLU.name else one for one in _turned()), *_LEFT_HANDED)
_FORCE_SIGNS = {"": 1.0, "forces reversed": -1.0}
ACCELERATION = "acceleration without gravity"


def frames(channels: Iterable[str]) -> Iterator[Alternative]:
    """All frames that records with these channels may have, each once; none that changes a single channel but the
    heading, which is a sign or a unit of that channel."""
    there = frozenset(channels)
    had = list[Reading]()
    for body in _BODIES:
        follows = product((True, False) if body.attitude else (False,), (True, False) if body.air else (False,))
        usual = body.name in ("FRD", "FLU")
        headings = (1.0, -1.0) if usual or body.attitude else (1.0,)
        for (attitude, air), heading, force in product(
            follows, headings, (*_FORCE_SIGNS, ACCELERATION) if usual else ("",)
        ):
            reading = _reading(body, attitude, air, heading, force, there)
            if reading is None or reading in had or reading.channels <= {"psi"} and body.name != "FRD":
                continue
            if len(reading.channels) < 2 and reading.channels != {"psi"}:
                continue
            had.append(reading)
            inertial = body.name != "FRD" or force
            earth = {(True, -1.0): " in NWU", (False, -1.0): " in ENU"}.get((attitude, heading), "")
            term = ", ".join(part for part in (body.name + earth, force) if part) if inertial else "ENU"
            yield Alternative(kind="axes", target="body" if inertial else "earth", reading=reading, term=term)


def _reading(
    body: _Body, attitude: bool, air: bool, heading: float, force: str, there: frozenset[str]
) -> Reading | None:
    """Return how records in a frame are read; None where they lack a channel that this needs."""
    if force == ACCELERATION and not there >= {"phi", "theta", "az"}:
        return None
    factor = dict[str, float]()
    source = dict[str, str]()
    for triad, sign in ((_RATES, body.rotation), (_TURNING, body.rotation), (FORCES, _FORCE_SIGNS.get(force, 1.0))):
        for i, name in enumerate(triad):
            column = triad[body.along[i]]
            if (name in there) != (column in there):
                return None
            factor[name] = sign * body.signs[i]
            source[name] = column
    angles = dict[str, float]()
    if attitude and body.attitude:
        angles |= dict(zip(("phi", "theta"), body.attitude, strict=True))
    if air and body.air:
        angles |= dict(zip(("alpha", "beta"), body.air, strict=True))
    turned = "psi" in there and heading < 0.0
    factor |= angles | {"psi": heading}
    return Reading(
        factor={name: value for name, value in factor.items() if name in there and value != 1.0},
        source={name: column for name, column in source.items() if name in there and name != column},
        offset={"psi": 0.5 * math.pi} if turned and not attitude else {},
        gravity=force != ACCELERATION,
    )
