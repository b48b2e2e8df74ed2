"""Aerodynamic tables: values at breakpoints, straight lines between them and beyond the last ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

_DEG = np.pi / 180.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """A table over one or two variables.

    axes     variable -> breakpoints, ascending; angles in degrees
    values   one number per breakpoint, or a row per breakpoint of the first variable
    factor   variable that multiplies the table, such as a dimensionless rate; None: nothing does
    """

    axes: Mapping[str, Sequence[float]]
    values: Sequence[float] | Sequence[Sequence[float]]
    factor: str | None = None

    def __post_init__(self) -> None:
        points = {name: np.asarray(axis, dtype=float) for name, axis in self.axes.items()}
        values = np.asarray(self.values, dtype=float)
        if values.shape != tuple(len(axis) for axis in points.values()):
            raise ValueError(f"table of {values.shape} over axes of {[len(axis) for axis in points.values()]}")
        object.__setattr__(self, "axes", points)
        object.__setattr__(self, "values", values)

    def at(self, now: Mapping[str, np.ndarray]) -> np.ndarray:
        """(n,) look-up at variables (n,) each: angles [rad], Mach number, dimensionless rates."""
        places = [_place(np.asarray(axis), _in_axis_unit(name, now[name])) for name, axis in self.axes.items()]
        values = np.asarray(self.values)
        if len(places) == 1:
            (i, x) = places[0]
            found = (1.0 - x) * values[i] + x * values[i + 1]
        else:
            (i, x), (j, y) = places
            found = (1.0 - x) * ((1.0 - y) * values[i, j] + y * values[i, j + 1])
            found += x * ((1.0 - y) * values[i + 1, j] + y * values[i + 1, j + 1])
        return found if self.factor is None else found * now[self.factor]


def _in_axis_unit(name: str, x: np.ndarray) -> np.ndarray:
    return x if name == "mach" else x / _DEG


def _place(axis: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interval of a value and its fraction of that interval, below 0 or above 1 beyond the ends."""
    i = axis[1:-1].searchsorted(x, side="right")
    return i, (x - axis[i]) / (axis[i + 1] - axis[i])
