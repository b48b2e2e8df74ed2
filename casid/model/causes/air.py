"""Causes in the air: it moves, steadily, in gusts or at random. Axes are those of the body."""

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
        return {f"wind_{axis}": values["value"] * operators.ramp(t, values["onset"])}

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
