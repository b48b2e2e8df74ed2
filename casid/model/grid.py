"""Gridded look-up of one to three dimensions, as an expression that every algebra can evaluate: no branch, no search.

A piecewise-linear function is a sum over the intervals of its breakpoints: the value at the first of them, and the rise
over each interval times the share of it that has been passed. In more dimensions the value and the rises are look-ups
over the axes that remain. A cubic one is a sum of B-splines, by the recursion of Cox and de Boor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import make_interp_spline

from casid.errors import InputError, unknown

METHODS = ("linear", "spline")
OUTSIDE = ("hold", "linear")
_DEGREE = 3


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Values on a grid, between them `linear` or by a cubic `spline` through them.

    breakpoints  of each axis, ascending; two equal ones are a step between them (linear only)
    values       in the order of the last axis fastest
    outside      beyond the first and last breakpoint: "hold" the value there, or go on "linear"
    Raises InputError when the sizes do not fit, an axis is not ascending or too short, or a number is not finite.
    """

    breakpoints: tuple[tuple[float, ...], ...]
    values: tuple[float, ...]
    method: str = "linear"
    outside: str = "hold"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise unknown("method", str(self.method), METHODS)
        if self.outside not in OUTSIDE:
            raise unknown("outside", str(self.outside), OUTSIDE)
        if self.method == "spline" and self.outside == "linear":
            raise InputError('a spline is held outside its breakpoints; write outside = "hold", or method = "linear"')
        if not 1 <= len(self.breakpoints) <= 3:
            raise InputError(f"a table has one to three axes, got {len(self.breakpoints)}")
        least = _DEGREE + 1 if self.method == "spline" else 1
        for position, axis in enumerate(self.breakpoints, start=1):
            self._check_axis(position, axis, least)
        if len(self.values) != math.prod(self.shape):
            raise InputError(
                f"{' x '.join(map(str, self.shape))} breakpoints need {math.prod(self.shape)} values, "
                f"got {len(self.values)}"
            )
        if not all(map(math.isfinite, self.values)):
            raise InputError("a value of the table is not finite; give a number for each point of the grid")

    def _check_axis(self, position: int, axis: Sequence[float], least: int) -> None:
        if len(axis) < least:
            raise InputError(f"axis {position} has {len(axis)} breakpoints; a {self.method} table needs {least}")
        if not all(map(math.isfinite, axis)):
            raise InputError(f"axis {position}: a breakpoint is not finite")
        for low, high in zip(axis, axis[1:], strict=False):
            if high < low or (high == low and self.method == "spline"):
                raise InputError(f"axis {position}: breakpoints must ascend, got {low:g} before {high:g}")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of breakpoints of each axis."""
        return tuple(map(len, self.breakpoints))

    def at(self, *arguments: Any, values: Sequence[Any] | None = None) -> Any:
        """The look-up at one argument per axis: CasADi expressions or floats.

        values   expressions instead of those of the grid, in their order
        """
        axes = list(zip(arguments, self.breakpoints, strict=True))
        if values is not None:
            shares = [self._shares(x, axis) for x, axis in axes]
            return sum(math.prod(parts) * value for parts, value in zip(product(*shares), values, strict=True))
        if self.method == "linear":
            table = np.array(self.values).reshape(self.shape)
            return _over_intervals(table, [self._passed(x, axis) for x, axis in axes])
        return _over_bases(self._of_basis, [_b_splines(x, axis) for x, axis in axes])

    @cached_property
    def _of_basis(self) -> np.ndarray:
        """Coefficients in B-splines, one per grid point."""
        table = np.array(self.values).reshape(self.shape)
        for position, axis in enumerate(self.breakpoints):
            table = np.moveaxis(np.tensordot(_to_basis(axis), table, axes=(1, position)), 0, position)
        return table

    def _shares(self, x: Any, axis: Sequence[float]) -> list[Any]:
        """By how much the value at each breakpoint enters at x."""
        if self.method == "linear":
            passed = [1.0, *self._passed(x, axis), 0.0]
            return [before - after for before, after in zip(passed, passed[1:], strict=False)]
        basis = _b_splines(x, axis)
        return [sum(b * w for b, w in zip(basis, column, strict=True)) for column in _to_basis(axis).T]

    def _passed(self, x: Any, axis: Sequence[float]) -> list[Any]:
        """How much of each interval lies below x."""
        parts = []
        for i, (low, high) in enumerate(zip(axis, axis[1:], strict=False)):
            if high == low:
                parts.append(x > low)
                continue
            part = (x - low) * (1.0 / (high - low))
            if i > 0 or self.outside == "hold":
                part = ca.fmax(part, 0.0)
            if i < len(axis) - 2 or self.outside == "hold":
                part = ca.fmin(part, 1.0)
            parts.append(part)
        return parts


def _over_intervals(table: np.ndarray, passed: Sequence[Sequence[Any]]) -> Any:
    if not passed:
        return table[()]
    total = _over_intervals(table[0], passed[1:])
    for part, before, after in zip(passed[0], table, table[1:], strict=False):
        rise = after - before
        if np.any(rise):
            total = total + part * _over_intervals(rise, passed[1:])
    return total


def _over_bases(table: np.ndarray, bases: Sequence[Sequence[Any]]) -> Any:
    if not bases:
        return table[()]
    return sum(part * _over_bases(row, bases[1:]) for part, row in zip(bases[0], table, strict=True))


def _knots(axis: Sequence[float]) -> np.ndarray:
    """Of the cubic spline with continuous third derivative beside its ends ("not a knot")."""
    return np.r_[[axis[0]] * (_DEGREE + 1), axis[2:-2], [axis[-1]] * (_DEGREE + 1)]


def _to_basis(axis: Sequence[float]) -> np.ndarray:
    """(n, n) from values at the breakpoints to coefficients in B-splines."""
    return np.asarray(make_interp_spline(axis, np.eye(len(axis)), k=_DEGREE, t=_knots(axis)).c)


def _b_splines(x: Any, axis: Sequence[float]) -> list[Any]:
    """The B-splines at x, held within the breakpoints (Cox and de Boor)."""
    t = _knots(axis)
    x = ca.fmin(ca.fmax(x, axis[0]), axis[-1])
    last = len(axis) - 1  # of the intervals that are not empty, which has its right end too
    basis: list[Any] = []
    for i in range(len(t) - 1):
        inside = (x >= t[i]) * ((x <= t[i + 1]) if i == last else (x < t[i + 1]))
        basis.append(inside if t[i + 1] > t[i] else 0.0)
    for degree in range(1, _DEGREE + 1):
        raised = []
        for i in range(len(basis) - 1):
            left, right = t[i + degree] - t[i], t[i + degree + 1] - t[i + 1]
            part = (x - t[i]) * (1.0 / left) * basis[i] if left > 0.0 else 0.0
            raised.append(part + ((t[i + degree + 1] - x) * (1.0 / right) * basis[i + 1] if right > 0.0 else 0.0))
        basis = raised
    return basis
