"""Causes in the air: it moves, steadily, in gusts or at random.

Its direction over the ground stays, whatever the aircraft does in it. A steady change is along the horizon: x where the
aircraft heads at the beginning of the record, y to the right of it, z down. A gust is along the body axis that it is
named after when it begins (as JSBSim's cosine gust is).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from casid.model import operators
from casid.model.effect import Effect, Series, Values, cause

_AXES = ("x", "y", "z")


def _to_body(t: np.ndarray, known: Series) -> np.ndarray:
    """(N, 3, 3) from the horizon at the first sample to the body axes, by the attitude as far as it is known."""
    phi, theta, psi = (known.get(name, 0.0 * t) for name in ("phi", "theta", "turned"))
    return Rotation.from_euler("ZYX", np.stack([psi, theta, phi], axis=1)).inv().as_matrix()


def _along(direction: np.ndarray, wind: np.ndarray) -> dict[str, np.ndarray]:
    """Station -> (N,) of a wind (N,) along body directions (N, 3)."""
    return {f"wind_{body}": share * wind for body, share in zip(_AXES, direction.T, strict=True)}


@cause(
    "wind_shear", targets=_AXES, unit="m/s2", title="{words} along {target}",
    quantity="rate of change of the wind from the onset on",
    sentence="The wind along {target} changes steadily, by {size}.",
)  # fmt: skip
def wind_shear(axis: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        direction = _to_body(t, known)[:, :, _AXES.index(axis)]
        return _along(direction, values["value"] * operators.ramp(t, values["onset"]))

    return Effect(
        kind="wind_shear", target=axis, enters=f"wind_{axis}", kinematic=True, timed=True, series=series,
        meaningful=0.05, limit=5.0,
    )  # fmt: skip


@cause(
    "gust", targets=_AXES, unit="m/s", title="{words} along {target}", quantity="peak of the gust",
    sentence="A gust of {size} along {target} meets the aircraft.",
)  # fmt: skip
def gust(axis: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        wind = values["value"] * operators.one_minus_cosine(t, values["onset"], values["length"])
        to_body = _to_body(t, known)
        begins = to_body[min(int(np.searchsorted(t, values["onset"])), len(t) - 1)]
        return _along(to_body @ begins[_AXES.index(axis)], wind)

    return Effect(
        kind="gust", target=axis, enters=f"wind_{axis}", kinematic=True, timed=True,
        grid=tuple({"length": v} for v in (0.8, 1.6, 3.2)), series=series, meaningful=0.5, limit=40.0,
    )  # fmt: skip


@cause(
    "turbulence", targets=_AXES, optional=True, unit="m/s", quantity="r.m.s. velocity",
    sentence="The air is turbulent, with {size} r.m.s.; the model has calm air.",
)  # fmt: skip
def turbulence(target: str = "") -> Effect:
    return Effect(kind="turbulence", target=target, kinematic=True, linear=False, grid=(), meaningful=0.1, limit=20.0)
