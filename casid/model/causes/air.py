"""Causes in the air: it moves, steadily, in gusts or at random.

Gusts are short and along the axes of the body; a steady change goes on while the aircraft turns and banks, and is along
the horizon: x where the aircraft heads at the beginning of the record, y to the right of it, z down.
"""

from __future__ import annotations

import numpy as np

from casid.model import operators
from casid.model.effect import Effect, Series, Values, cause

_AXES = ("x", "y", "z")


@cause(
    "wind_shear", targets=_AXES, unit="m/s2", title="{words} along {target}",
    quantity="rate of change of the wind from the onset on",
    sentence="The wind along {target} changes steadily, by {size}.",
)  # fmt: skip
def wind_shear(axis: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        wind = values["value"] * operators.ramp(t, values["onset"])
        phi, theta, psi = (known.get(name, 0.0 * t) for name in ("phi", "theta", "turned"))
        ahead = (np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi) * np.sin(theta))
        aside = (0.0, np.cos(phi), -np.sin(phi))
        along_body = {
            "x": [np.cos(psi) * a - np.sin(psi) * b for a, b in zip(ahead, aside, strict=True)],
            "y": [np.sin(psi) * a + np.cos(psi) * b for a, b in zip(ahead, aside, strict=True)],
            "z": (-np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)),
        }[axis]
        return {f"wind_{body}": share * wind for body, share in zip(_AXES, along_body, strict=True)}

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
        return {f"wind_{axis}": values["value"] * operators.one_minus_cosine(t, values["onset"], values["length"])}

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
