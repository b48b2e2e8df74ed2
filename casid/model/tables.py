"""Tables of aerodynamic coefficients over the regressors: `cs.table(...)`, and `[aerodynamics.tables]` of a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from casid.arguments import an, given, number
from casid.arguments import names as argument_names
from casid.errors import InputError, unknown
from casid.model.aircraft_file import check_keys, text
from casid.model.grid import Grid
from casid.model.terms import COEFFICIENTS, VARIABLES, parse_term

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
        To which it is added, `Cm`.
    axes
        Regressors that it is over, one to three of `terms.VARIABLES`, in the units that these have there.
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
        where = f"table '{self.name}'"
        if self.coefficient not in COEFFICIENTS:
            raise unknown("coefficient", self.coefficient, COEFFICIENTS, where)
        for axis in self.axes:
            if axis not in VARIABLES:
                raise unknown("axis", axis, VARIABLES, where)
        if len(set(self.axes)) != len(self.axes) or len(self.axes) != len(self.grid.shape):
            raise InputError(f"{where}: {len(self.grid.shape)} axes of breakpoints for the regressors {self.axes}")
        object.__setattr__(self, "times", parse_term(self.times, where).name)

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
        """Whether it looks at rates of the flow angles."""
        return any("dot" in name for name in (*self.axes, self.times))

    def at(self, regressors: Mapping[str, Any], parameters: Mapping[str, Any]) -> Any:
        """Its part of the coefficient; `parameters` hold the knots of a free table."""
        for axis in self.axes:
            if axis not in regressors:
                raise InputError(f"table '{self.name}': no value for '{axis}'; give V in [trim]")
        values = [parameters[name] for name in self.knots] if self.free else None
        looked_up = self.grid.at(*(regressors[axis] for axis in self.axes), values=values)
        factor = parse_term(self.times)
        return looked_up * factor.evaluate(regressors) if factor.factors else looked_up

    def with_knots(self, values: Mapping[str, float]) -> Table:
        """The table with values replaced by name, where there is one."""
        if not self.free:
            return self
        given = tuple(float(values.get(name, value)) for name, value in self.knots.items())
        return table(
            self.coefficient,
            self.axes,
            self.grid.breakpoints,
            np.reshape(given, self.grid.shape),
            name=self.name,
            times=self.times,
            method=self.grid.method,
            outside=self.grid.outside,
            free=True,
        )

    def beyond(self, channels: Mapping[str, np.ndarray]) -> Iterator[str]:
        """What is to be said of regressors that leave the breakpoints."""
        for axis, points in zip(self.axes, self.grid.breakpoints, strict=True):
            series = channels.get(axis)
            if series is None or not np.isfinite(series).any() or len(points) < 2:
                continue
            low, high = float(np.nanmin(series)), float(np.nanmax(series))
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
    for what, value in (("coefficient", coefficient), ("name", name), ("times", times)):
        an(value, str, f"table: {what}", "a text, like 'Cm'")
    an(free, bool, "table: free", "free=True or free=False")
    names = (axes,) if isinstance(axes, str) else argument_names(axes, "table: axes")
    called = name or f"{coefficient}({', '.join(names)})" + (f"*{times}" if times != "0" else "")
    lists = [breakpoints] if breakpoints and not isinstance(breakpoints[0], (list, tuple, np.ndarray)) else breakpoints
    try:
        grid = Grid(
            breakpoints=tuple(tuple(number(x, "a breakpoint") for x in axis) for axis in lists),
            values=tuple(number(x, "a value") for x in np.asarray(values, dtype=float).ravel()),
            method=method,
            outside=outside,
        )
        if np.shape(values) != grid.shape:
            raise InputError(f"values of shape {np.shape(values)} on breakpoints of shape {grid.shape}")
    except InputError as error:
        raise InputError(f"table '{called}': {error}") from None
    except (TypeError, ValueError):
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
