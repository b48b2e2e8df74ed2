"""Tables of aerodynamic coefficients over the regressors: `cs.table(...)`, and `[aerodynamics.tables]` of a file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import scipy

from casid.arguments import given, number, one_line, one_of, require, sequence
from casid.arguments import names as argument_names
from casid.errors import InputError, check_known, unknown
from casid.model.aircraft_file import check_keys, text
from casid.model.terms import COEFFICIENTS, VARIABLES, parse_term

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
        one_of(self.method, METHODS, "method")
        one_of(self.outside, OUTSIDE, "outside")
        axes = sequence(self.breakpoints, "breakpoints", "one list of numbers per axis")
        points = tuple(tuple(number(x, "a breakpoint") for x in sequence(axis, "an axis", "numbers")) for axis in axes)
        object.__setattr__(self, "breakpoints", points)
        values = tuple(number(x, "a value") for x in sequence(self.values, "values", "numbers"))
        object.__setattr__(self, "values", values)
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

    def _check_axis(self, position: int, axis: Sequence[float], least: int) -> None:
        if len(axis) < least:
            raise InputError(f"axis {position} has {len(axis)} breakpoints; a {self.method} table needs {least}")
        for low, high in zip(axis, axis[1:], strict=False):
            if high < low or (high == low and self.method == "spline"):
                raise InputError(f"axis {position}: breakpoints must ascend, got {low:g} before {high:g}")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of breakpoints of each axis."""
        return tuple(map(len, self.breakpoints))

    def at(self, *arguments: Any, values: Sequence[Any] | None = None) -> Any:
        """The look-up at one argument per axis, CasADi expressions or floats; `values` are expressions in place of the
        grid's own."""
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
        """Return the weight of the value at each breakpoint in the value at x."""
        if self.method == "linear":
            passed = [1.0, *self._passed(x, axis), 0.0]
            return [before - after for before, after in zip(passed, passed[1:], strict=False)]
        basis = _b_splines(x, axis)
        return [sum(b * w for b, w in zip(basis, column, strict=True)) for column in _to_basis(axis).T]

    def _passed(self, x: Any, axis: Sequence[float]) -> list[Any]:
        """Return the part of each interval that lies below x."""
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
    """Return the knots of the cubic spline with continuous third derivative beside its ends ("not a knot")."""
    return np.r_[[axis[0]] * (_DEGREE + 1), axis[2:-2], [axis[-1]] * (_DEGREE + 1)]


def _to_basis(axis: Sequence[float]) -> np.ndarray:
    """(n, n) from values at the breakpoints to coefficients in B-splines."""
    return np.asarray(scipy.interpolate.make_interp_spline(axis, np.eye(len(axis)), k=_DEGREE, t=_knots(axis)).c)


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
            left = t[i + degree] - t[i]
            right = t[i + degree + 1] - t[i + 1]
            part = (x - t[i]) * (1.0 / left) * basis[i] if left > 0.0 else 0.0
            raised.append(part + ((t[i + degree + 1] - x) * (1.0 / right) * basis[i + 1] if right > 0.0 else 0.0))
        basis = raised
    return basis


_KEYS = ("coefficient", "axes", "breakpoints", "values", "times", "method", "outside", "free")
_REQUIRED = ("coefficient", "axes", "breakpoints", "values")


@dataclass(frozen=True, kw_only=True)
class Table:
    """A look-up that is a part of an aerodynamic coefficient.

    Attributes
    ----------
    name
        What its knots are called, `Cm_static(2,1)`.
    coefficient
        Aerodynamic coefficient that the table is added to, such as `Cm`.
    axes
        Its one to three regressors: alpha, beta, delta_e, delta_a, delta_r [rad]; the dimensionless rates p, q, r,
        alphadot, betadot (rate times rate length over V); mach; V, the relative speed change (V - V_trim) / V_trim; Tc,
        thrust over dynamic pressure and reference area.
    grid
        Breakpoints, values, and how it runs between and beyond them.
    times
        Term that it is multiplied by, "q": a table of the derivative Cm_q; "0": by nothing.
    free
        Whether its values are parameters of the model; otherwise they are as they are.

    Examples
    --------
    >>> import casid as cs
    >>> pitch = cs.table("Cm", "alpha", [-0.1, 0.0, 0.1], [0.08, 0.0, -0.12])
    >>> pitch.coefficient, pitch.axes, pitch.free
    ('Cm', ('alpha',), False)
    """

    name: str
    coefficient: str
    axes: tuple[str, ...]
    grid: Grid
    times: str = "0"
    free: bool = False

    def __post_init__(self) -> None:
        where = f"table '{one_line(self.name, 'a table: name')}'"
        if one_line(self.coefficient, f"{where}: coefficient") not in COEFFICIENTS:
            raise unknown("coefficient", self.coefficient, COEFFICIENTS, where)
        require(self.grid, Grid, f"{where}: grid", "a cs.table(...) of breakpoints and values")
        require(self.free, bool, f"{where}: free", "free=True or free=False")
        object.__setattr__(self, "axes", argument_names(self.axes, f"{where}: axes"))
        check_known("axis", self.axes, VARIABLES, where)
        if len(set(self.axes)) != len(self.axes) or len(self.axes) != len(self.grid.shape):
            raise InputError(f"{where}: {len(self.grid.shape)} axes of breakpoints for the regressors {self.axes}")
        object.__setattr__(self, "times", parse_term(one_line(self.times, f"{where}: times"), where).name)

    @cached_property
    def knots(self) -> dict[str, float]:
        """Name of each value of a free table -> the value."""
        places = product(*map(range, self.grid.shape))
        names = (f"{self.name}({','.join(map(str, place))})" for place in places)
        return dict(zip(names, self.grid.values, strict=True))

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return parse_term(self.times).unit

    @property
    def dynamic(self) -> bool:
        """Return True if it depends on `alphadot` or `betadot`."""
        return any("dot" in name for name in (*self.axes, self.times))

    def at(self, regressors: Mapping[str, Any], parameters: Mapping[str, Any]) -> Any:
        """Its part of the coefficient; `parameters` hold the knots of a free table.

        Parameters
        ----------
        regressors
            Name -> symbol or number.
        parameters
            Name -> symbol or number.
        """
        for axis in self.axes:
            if axis not in regressors:
                raise InputError(f"table '{self.name}': no value for '{axis}'; give V in [trim]")
        values = [parameters[name] for name in self.knots] if self.free else None
        looked_up = self.grid.at(*(regressors[axis] for axis in self.axes), values=values)
        factor = parse_term(self.times)
        return looked_up * factor.evaluate(regressors) if factor.factors else looked_up

    def with_knots(self, values: Mapping[str, float]) -> Table:
        """A copy with the knots of these names replaced. A table that is not free is returned as it is."""
        if not self.free:
            return self
        given = tuple(float(values.get(name, value)) for name, value in self.knots.items())
        return replace(self, grid=replace(self.grid, values=given))

    def beyond(self, channels: Mapping[str, np.ndarray]) -> Iterator[str]:
        """Warnings about regressors that leave the range of the breakpoints.

        Parameters
        ----------
        channels
            Regressor -> values (N,).

        Yields
        ------
        Iterator
            One sentence for each regressor that leaves the table.
        """
        for axis, points in zip(self.axes, self.grid.breakpoints, strict=True):
            series = channels.get(axis)
            if series is None or not np.isfinite(series).any() or len(points) < 2:
                continue
            low = float(np.nanmin(series))
            high = float(np.nanmax(series))
            if low < points[0] or high > points[-1]:
                then = "the last value is held" if self.grid.outside == "hold" else "the last slope goes on"
                yield (
                    f"table {self.name}: {axis} runs from {low:.3g} to {high:.3g}, "
                    f"its breakpoints from {points[0]:.3g} to {points[-1]:.3g}: beyond them {then}"
                )


def table(
    coefficient: str,
    axes: Sequence[str] | str,
    breakpoints: Any,
    values: Any,
    *,
    name: str = "",
    times: str = "0",
    method: str = "linear",
    outside: str = "hold",
    free: bool = False,
) -> Table:
    """A gridded part of an aerodynamic coefficient, to be given to `Aircraft(tables=...)`.

    Parameters
    ----------
    coefficient : str
        The coefficient to which it is added, `"Cm"`.
    axes : str or list of str
        One to three regressors: alpha, beta, delta_e ... [rad], mach, Tc, p, q, r (dimensionless), see `terms`.
    breakpoints : list of float, or one such list per axis
        Ascending, in the unit of the regressor.
    values : array, shape (breakpoints of the first axis, of the second, ...)
        The coefficient there, or the derivative in `times`.
    name : str
        What it is called; without it, made of coefficient and axes.
    times : str
        A term by which it is multiplied, `"q"`; without it the table is of the coefficient itself.
    method : "linear" or "spline"
        A spline is cubic, with second derivatives, and needs four breakpoints per axis.
    outside : "hold" or "linear"
        What happens beyond the breakpoints.
    free : bool
        Whether its values are parameters that can be estimated, under the names of `Table.knots`.

    Returns
    -------
    Table
        To be given to `Aircraft(tables=...)`.

    Raises
    ------
    InputError
        When names, sizes or numbers do not fit.

    Examples
    --------
    >>> import casid as cs
    >>> pitch = cs.table("Cm", "alpha", [-0.1, 0.0, 0.1], [0.08, 0.0, -0.12])
    >>> pitch.coefficient, pitch.axes
    ('Cm', ('alpha',))
    """
    one_line(coefficient, "table: coefficient")
    names = (axes,) if isinstance(axes, str) else argument_names(axes, "table: axes")
    called = name or f"{coefficient}({', '.join(names)})" + (f"*{times}" if times != "0" else "")
    try:
        lists = sequence(breakpoints, "breakpoints", "a list of numbers, or one per axis")
        if lists and not isinstance(lists[0], (list, tuple, np.ndarray)):
            lists = (lists,)
        grid = Grid(breakpoints=lists, values=tuple(np.asarray(values, float).ravel()), method=method, outside=outside)
        if np.shape(values) != grid.shape:
            raise InputError(f"values of shape {np.shape(values)} on breakpoints of shape {grid.shape}")
    except InputError as error:
        raise InputError(f"table '{called}': {error}") from None
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"table '{called}': values must be lists of numbers of one length") from None
    return Table(name=called, coefficient=coefficient, axes=names, grid=grid, times=times, free=free)


def read_tables(tables: Mapping[str, Any]) -> tuple[Table, ...]:
    """The tables of `[aerodynamics.tables]`, by name. Raises InputError."""
    found = []
    for name, entry in tables.items():
        where = f"[aerodynamics.tables.{name}]"
        if not isinstance(entry, dict):
            raise InputError(f"{where} is {given(entry)}; expected a table with coefficient, axes, breakpoints, values")
        check_keys(entry, _KEYS, where, _REQUIRED)
        axes = entry["axes"] if isinstance(entry["axes"], list) else [entry["axes"]]
        options = {key: text(entry[key], f"{where}: {key}") for key in ("times", "method", "outside") if key in entry}
        if not isinstance(entry.get("free", False), bool):
            raise InputError(f"{where}: free is {given(entry['free'])}; expected true or false")
        if not isinstance(entry["breakpoints"], list):
            raise InputError(f"{where}: breakpoints must be a list of numbers, or one per axis")
        found.append(
            table(
                text(entry["coefficient"], f"{where}: coefficient"),
                [text(axis, f"{where}: axes") for axis in axes],
                entry["breakpoints"],
                entry["values"],
                name=name,
                free=entry.get("free", False),
                **options,
            )
        )
    return tuple(found)


def written_table(one: Table) -> dict[str, Any]:
    """The entry of a table in a file, from which `read_tables` makes an equal one."""
    entry: dict[str, Any] = {
        "coefficient": one.coefficient,
        "axes": one.axes,
        "breakpoints": one.grid.breakpoints,
        "values": np.reshape(one.grid.values, one.grid.shape).tolist(),
    }
    chosen = {"times": one.times, "method": one.grid.method, "outside": one.grid.outside, "free": one.free}
    usual = {"times": "0", "method": "linear", "outside": "hold", "free": False}
    return entry | {key: value for key, value in chosen.items() if value != usual[key]}
