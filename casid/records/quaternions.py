"""Attitude of quaternion columns: which four columns are one, in which order, and from which axes to which.

The order is what their names say, w x y z, or else what agrees with the rates of rotation: of a turn from body to earth
axes, p q r are the vector part of twice its conjugate times its derivative.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.records.series import unwrapped

_LETTERED = re.compile(r"(?P<base>.*?)[_.\[(]?(?P<part>[wxyz])[\])]?", re.IGNORECASE)
_NUMBERED = re.compile(r"(?P<base>.*?)[_.\[(]?(?P<part>[0-4])[\])]?")
_CALLED = re.compile(
    r"(.*[^a-z])?(q|quat|quaternion|orientation|att|attitude|rot|rotation|att_?q)([_.\[].*)?", re.IGNORECASE
)
_NORM = 0.01  # by which the length of a unit quaternion may differ from 1
_MOST = 0.9  # of the samples that must be unit quaternions
_AGREES = 0.3  # rms of the difference of rates over the sum of their rms, from which they are the same
_CLEARLY = 0.5  # of the difference of the next best
RATES = ("p", "q", "r")
ANGLES = ("phi", "theta", "psi")


@dataclass(frozen=True, kw_only=True)
class Way:
    """Reading of four columns as a quaternion w x y z from body to earth axes."""

    order: tuple[int, int, int, int]  # of the columns: where w x y z stand
    conjugate: bool  # whether they are the turn from earth to body axes
    words: str

    def of(self, columns: np.ndarray) -> np.ndarray:
        """Return (N, 4) unit quaternions w x y z from body to earth axes of (N, 4) columns."""
        return columns[:, self.order] * ([1.0, -1.0, -1.0, -1.0] if self.conjugate else 1.0)


_FIRST = (0, 1, 2, 3)
_LAST = (3, 0, 1, 2)
_WAYS = tuple(
    Way(order=order, conjugate=conjugate, words=f"{said}, from {turn} axes")
    for order, said in ((_FIRST, "w x y z"), (_LAST, "x y z w"))
    for conjugate, turn in ((False, "body to earth"), (True, "earth to body"))
)


def euler_angles(quaternion: np.ndarray) -> np.ndarray:
    """Return (N, 3) 3-2-1 Euler angles phi, theta, psi [rad] of (N, 4) unit quaternions w, x, y, z from body to earth
    axes."""
    w, x, y, z = quaternion.T
    phi = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    theta = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    psi = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.stack([phi, theta, unwrapped(psi)], axis=1)


def body_rates(t: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Return (N, 3) rates p q r [rad/s] of (N, 4) unit quaternions w x y z from body to earth axes."""
    there = np.isfinite(quaternion).all(axis=1)
    signs = np.ones(len(quaternion))
    dots = np.sum(quaternion[there][1:] * quaternion[there][:-1], axis=1)
    signs[there] = np.cumprod(np.append(1.0, np.where(dots < 0.0, -1.0, 1.0)))  # q and -q are one attitude
    smooth = quaternion * signs[:, np.newaxis]
    w, x, y, z = smooth.T
    dw, dx, dy, dz = np.gradient(smooth, t, axis=0).T
    p = 2.0 * (w * dx - x * dw - y * dz + z * dy)
    q = 2.0 * (w * dy - y * dw - z * dx + x * dz)
    r = 2.0 * (w * dz - z * dw - x * dy + y * dx)
    return np.stack([p, q, r], axis=1)


def quaternions_in(channels: Mapping[str, np.ndarray]) -> list[tuple[str, ...]]:
    """Return the columns that are unit quaternions, four each: called so, numbered from 0 or 1 or with the letters w x
    y z, which stand in this order here."""
    found = list[tuple[str, ...]]()
    for pattern, orders in ((_LETTERED, ("wxyz",)), (_NUMBERED, ("0123", "1234"))):
        groups = dict[str, dict[str, str]]()
        for name in channels:
            match = pattern.fullmatch(name)
            if match and _CALLED.fullmatch(match["base"]):
                groups.setdefault(match["base"], {})[match["part"].lower()] = name
        for parts in groups.values():
            order = next((one for one in orders if set(one) <= parts.keys()), "")
            names = tuple(parts[part] for part in order)
            if names and _are_units(np.stack([channels[name] for name in names], axis=1)):
                found.append(names)
    return found


def _are_units(columns: np.ndarray) -> bool:
    there = np.isfinite(columns).all(axis=1)
    return bool(there.any()) and np.mean(np.abs(np.linalg.norm(columns[there], axis=1) - 1.0) < _NORM) > _MOST


def with_attitude(t: np.ndarray, channels: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str, str]:
    """Return channels with the attitude of their quaternion, where they have one and no angles, how it was read, and a
    remark. A quaternion whose order nobody states is read where the rates tell it."""
    found = quaternions_in(channels)
    if not found or set(ANGLES) & set(channels):
        return dict(channels), "", ""
    if len(found) > 1:
        several = " and ".join(", ".join(names) for names in found)
        return dict(channels), "", f"{several} are quaternions; attitude is of none of them, as nobody says of which"
    names = found[0]
    columns = np.stack([channels[name] for name in names], axis=1)
    columns = np.where(np.abs(np.linalg.norm(columns, axis=1, keepdims=True) - 1.0) < _NORM, columns, np.nan)
    lettered = names[0].rstrip("])")[-1:].lower() == "w"
    way, why = _way(t, columns, channels, _WAYS[:2] if lettered else _WAYS)
    listed = ", ".join(names)
    if way is None:
        return dict(channels), "", f"{listed} are a quaternion: {why}"
    how = f"{listed}, a quaternion {way.words}: {why}"
    angles = euler_angles(way.of(columns))
    added = {name: angles[:, i] for i, name in enumerate(ANGLES)}
    return {**channels, **added}, how, f"phi, theta and psi are of {how}"


def _way(
    t: np.ndarray, columns: np.ndarray, channels: Mapping[str, np.ndarray], ways: Sequence[Way]
) -> tuple[Way | None, str]:
    """The way in which columns are read, and the reason; None where it cannot be told."""
    stated = len(ways) == 2
    ask = "say which is which: --map q_w=COLUMN --map q_x=COLUMN --map q_y=COLUMN --map q_z=COLUMN"
    if not all(name in channels for name in RATES):
        return (ways[0], "its names say so, and no rates contradict") if stated else (None, f"without p, q, r {ask}")
    rates = np.stack([channels[name] for name in RATES], axis=1)
    errors = [_difference(body_rates(t, way.of(columns)), rates) for way in ways]
    best, *others = np.argsort(errors)
    if errors[best] < _AGREES and errors[best] < _CLEARLY * errors[others[0]]:
        return ways[best], "its rates are p, q, r"
    if stated and not np.isfinite(errors).all():
        return ways[0], "its names say so"
    return None, f"in no order do its rates agree with p, q, r, so that it is left as it is; {ask}"


def _difference(one: np.ndarray, other: np.ndarray) -> float:
    """Root mean square of the difference over the sum of both; infinite where nothing moves."""
    there = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    sizes = [float(np.sqrt(np.mean(np.square(values[there])))) if there.any() else 0.0 for values in (one, other)]
    if not sum(sizes):
        return np.inf
    return float(np.sqrt(np.mean(np.square(one[there] - other[there])))) / sum(sizes)
