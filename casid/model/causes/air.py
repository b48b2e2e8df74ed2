"""Causes in the air: it moves, steadily, in gusts or at random.

Its direction over the ground stays, whatever the aircraft does in it. A steady change is along the horizon: x where the
aircraft heads at the beginning of the record, y to the right of it, z down. A gust is along the body axis that it is
named after when it begins (as JSBSim's cosine gust is).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from casid.model import operators, station
from casid.model.effect import Effect, Event, Further, Series, Size, Values, cause, grid

_AXES = ("x", "y", "z")
_TO_THE_END = 1e3  # s: longer than any record
_ATTITUDE = ("phi", "theta", "turned")


def _blowing(direction: np.ndarray, wind: np.ndarray, known: Series) -> dict[str, np.ndarray]:
    """Station -> (N,) of a wind (N,) along a direction (3,) of the horizon, whose x is the heading at the first sample,
    by the attitude as far as it is known."""
    blows = np.flatnonzero(wind)
    phi, theta, psi = (known[name][blows] if name in known else np.zeros(len(blows)) for name in _ATTITUDE)
    north, east, down = direction
    ahead = np.cos(psi) * north + np.sin(psi) * east
    aside = np.cos(psi) * east - np.sin(psi) * north
    below = np.sin(theta) * ahead + np.cos(theta) * down
    parts = (
        np.cos(theta) * ahead - np.sin(theta) * down,
        np.cos(phi) * aside + np.sin(phi) * below,
        np.cos(phi) * below - np.sin(phi) * aside,
    )
    series = {station.wind(axis): np.zeros(len(wind), dtype=wind.dtype) for axis in _AXES}
    for axis, part in zip(_AXES, parts, strict=True):
        series[station.wind(axis)][blows] = part * wind[blows]
    return series


def _body_axis(axis: str, at: int, known: Series) -> np.ndarray:
    """(3,) direction over the horizon of a body axis at one sample."""
    angles = [float(known[name][at]) if name in known else 0.0 for name in ("turned", "theta", "phi")]
    return scipy.spatial.transform.Rotation.from_euler("ZYX", angles).as_matrix()[:, _AXES.index(axis)]


def _blow(axis: str, series: Callable, further: Further, size: Size) -> Effect:
    """A wind along an axis that begins at an onset."""
    enters = station.wind(axis)
    return Effect(enters=enters, kinematic=True, event=Event(), series=series, further=further, size=size)


@cause(
    targets=_AXES,
    unit="m/s2",
    title="{words} along {target}",
    quantity="rate of change of the wind from the onset on, for a duration; then it stays",
    sentence="The wind along {target} changes steadily, by {size}.",
)
def wind_shear(axis: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        direction = np.eye(3)[_AXES.index(axis)]
        wind = values["value"] * operators.ramp(t, values["onset"], values.get("duration", _TO_THE_END))
        return _blowing(direction, wind, known)

    further = Further(grid=grid(duration=(_TO_THE_END, 8.0, 3.0)), defaults={"duration": _TO_THE_END})
    return _blow(axis, series, further, Size(meaningful=0.05, limit=5.0))


@cause(
    targets=_AXES,
    unit="m/s",
    title="{words} along {target}",
    quantity="peak of the gust",
    sentence="A gust of {size} along {target} meets the aircraft.",
)
def gust(axis: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        wind = values["value"] * operators.one_minus_cosine(t, values["onset"], values["length"])
        begins = min(int(np.searchsorted(t, np.real(values["onset"]))), len(t) - 1)
        return _blowing(_body_axis(axis, begins, known), wind, known)

    return _blow(axis, series, Further(grid=grid(length=(0.8, 1.6, 3.2, 6.4))), Size(meaningful=0.5, limit=40.0))


@cause(
    targets=_AXES,
    optional=True,
    unit="m/s",
    quantity="r.m.s. velocity",
    sentence="The air is turbulent, with {size} r.m.s.; the model has calm air.",
)
def turbulence(target: str = "") -> Effect:
    return Effect(kinematic=True, linear=False, further=Further(grid=()), size=Size(meaningful=0.1, limit=20.0))
