"""A simulation outside CasADi, a batched Python function of numbers, as the dynamics or the outputs of a `Model`.

It enters the expressions of a model as a call. Its first and second derivatives are central differences in steps scaled
by the size of each argument. Samples, segments and points of differences are evaluated in one call of the function
wherever one does not need the result of another; what CasADi evaluates by itself, in IPOPT and CVODES, is called point
by point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations, count
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import given, names, number
from casid.errors import InputError, check_known
from casid.native.tape import BATCHED

Function = Callable[[Mapping[str, np.ndarray]], Mapping[str, Any]]
# steps of least error
_FIRST = np.finfo(float).eps ** (1 / 3)
_SECOND = np.finfo(float).eps ** (1 / 4)
_NUMBERS = count()
_POINTS = 8  # more than a step of the motion looks at


def external_function(
    function: Function, takes: Sequence[str], gives: Sequence[str], sizes: Mapping[str, float] | None = None
) -> Callable[[Any], dict[str, Any]]:
    """Make any Python function of numbers the `dynamics` or the `output` of `define_model`.

    Parameters
    ----------
    function
        Takes {name: (N,) array} and returns {name: (N,) array}: N points at once, each by itself. It must be smooth in
        steps of 1e-5 of the sizes, and the same for the same arguments.
    takes
        Names of states, inputs, parameters and disturbances that it looks at.
    gives
        Names of what it returns, all states for dynamics.
    sizes
        Typical sizes of arguments, in SI, by which differences are scaled; 1 without. A larger value counts itself.

    Returns
    -------
    function of the symbols
        For `define_model(dynamics=..., output=...)`.

    Raises
    ------
    InputError
        For names twice and sizes that are none, and for a function that looks at another name than it takes or returns
        a result that is missing or of another length: it is called once, on two points of all arguments at their sizes.
        Later for the arguments at which the function raises an error.

    Notes
    -----
    Many points come in one call: all segments of multiple shooting at once, sample after sample, and the derivatives at
    all samples together. Single shooting and IPOPT call it for one point at a time, which is slower. Where the function
    raises an error, casid raises InputError with the values of its arguments; where it has no value it should return
    nan, and a step that leads there is not taken.

    First derivatives are good to about 1e-10 of the function's variation over a size, second ones to 1e-8. A function
    that numpy writes in one expression needs none of this: called with the symbols it gives expressions, exact and
    compiled. A model with an external function cannot be sent to other processes.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> def rates(point):
    ...     return {"x": (point["u"] - np.tanh(point["x"])) / point["T"]}
    >>> model = cs.define_model(
    ...     "outside", states=["x"], inputs=["u"], parameters={"T": 0.5}, outputs=["y"],
    ...     dynamics=cs.external_function(rates, takes=["x", "u", "T"], gives=["x"]), output=lambda s: {"y": s.x},
    ... )
    >>> t = 0.1 * np.arange(100)
    >>> rest = cs.Record(name="rest", t=t, channels={"u": np.full(100, 0.5)})
    >>> round(float(cs.simulate(model, rest, [0.0]).output("y")[-1]), 3)  # tends to artanh(0.5)
    0.549
    """
    if not callable(function):
        raise InputError(f"external_function: the function is {given(function)}; expected one of arrays by name")
    taken = names(takes, "external_function: takes")
    given_names = names(gives, "external_function: gives")
    if not taken or not given_names:
        raise InputError("external_function: takes and gives need one name at least")
    check_known("name", sizes or {}, taken, "external_function: sizes")
    scale = [
        number((sizes or {}).get(name, 1.0), f"external_function: size of '{name}'", positive=True) for name in taken
    ]
    batch = _Batch(function, taken, given_names, np.array(scale))
    batch.check()
    values = _Values(batch)
    _KEPT.append(values)

    def of_symbols(s: Any) -> dict[str, Any]:
        found = values(ca.vertcat(*(getattr(s, name) for name in taken)))
        return dict(zip(given_names, ca.vertsplit(found), strict=True))

    return of_symbols


_KEPT: list[Any] = []  # an expression in which a Python object is called does not keep it


class _Batch:
    """The function on points, and the points of its differences."""

    def __init__(self, function: Function, takes: tuple[str, ...], gives: tuple[str, ...], size: np.ndarray) -> None:
        self.function = function
        self.takes = takes
        self.gives = gives
        self.size = size
        self.number = next(_NUMBERS)

    def check(self) -> None:
        """Call the function before it is needed, on two points."""
        points = np.stack([self.size, self.size])
        try:
            self._called(points)
        except KeyError as error:
            if error.args and error.args[0] not in self.takes:
                raise InputError(
                    f"external_function: the function looks at {error}, which is not among what it takes: "
                    f"{', '.join(self.takes)}"
                ) from None
        except (ArithmeticError, ValueError):
            return  # it need not have a value there
        self.at(points)

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N, gives) of (N, takes)."""
        try:
            found = self._called(points)
        except InputError:
            raise
        except Exception as error:
            raise InputError(self._blamed(points, error)) from error
        if not isinstance(found, Mapping):
            raise InputError(f"external_function: the function returned {given(found)}; expected arrays by name")
        for name in self.gives:
            if name not in found:
                raise InputError(
                    f"external_function: the function returned no '{name}'; it gave {', '.join(map(str, found))}"
                )
        columns = [np.asarray(found[name], dtype=float) for name in self.gives]
        for name, column in zip(self.gives, columns, strict=True):
            if column.shape not in ((), (len(points),)):
                raise InputError(f"external_function: '{name}' has the shape {column.shape} for {len(points)} points")
        return np.stack([np.broadcast_to(column, len(points)) for column in columns], axis=1)

    def _called(self, points: np.ndarray) -> Mapping[str, Any]:
        with np.errstate(all="ignore"):  # a value that is none is found by what asked for it
            return self.function(dict(zip(self.takes, points.T.copy(), strict=True)))

    def _blamed(self, points: np.ndarray, error: Exception) -> str:
        """The error of the function, and the first of the points at which it raises one by itself."""
        for k in range(len(points)):
            try:
                self._called(points[k : k + 1])
            except Exception as own:
                values = ", ".join(f"{name} = {v:.6g}" for name, v in zip(self.takes, points[k], strict=True))
                return (
                    f"external_function: the function raised {type(own).__name__}: {own} at {values}; return nan where "
                    "it has no value, or bound what leads there"
                )
        return (
            f"external_function: the function raised {type(error).__name__}: {error} on {len(points)} points together, "
            "on none of them alone; expected a function of arrays"
        )

    def steps(self, x: np.ndarray, relative: float) -> np.ndarray:
        """(N, n) the step along each argument, as it is represented."""
        h = relative * np.maximum(np.abs(x), self.size)
        return (x + h) - x

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """(N, gives, takes) first derivatives at (N, takes), in one call of the function."""
        h = self.steps(x, _FIRST)
        moved = h[:, None] * np.eye(x.shape[1])  # (N, which, takes)
        ahead, behind = (
            self._around(x, np.concatenate([moved, -moved], axis=1)).reshape(len(x), 2, x.shape[1], -1).swapaxes(0, 1)
        )
        return ((ahead - behind) / (2.0 * h[..., None])).swapaxes(1, 2)

    def bends(self, x: np.ndarray) -> np.ndarray:
        """(N, gives, takes, takes) second derivatives at (N, takes), in one call of the function."""
        n = x.shape[1]
        h = self.steps(x, _SECOND)
        pairs = list(combinations(range(n), 2))
        one = np.eye(n)
        mixed = [s * one[i] + t * one[j] for i, j in pairs for s in (1, -1) for t in (1, -1)]
        y = self._around(x, h[:, None] * np.concatenate([np.zeros((1, n)), one, -one, np.reshape(mixed, (-1, n))]))
        found = np.zeros((len(x), len(self.gives), n, n))
        for i in range(n):
            found[:, :, i, i] = (y[:, 1 + i] - 2.0 * y[:, 0] + y[:, 1 + n + i]) / h[:, i, None] ** 2
        for k, (i, j) in enumerate(pairs):
            a, b, c, d = y[:, 1 + 2 * n + 4 * k :][:, :4].swapaxes(0, 1)
            found[:, :, i, j] = found[:, :, j, i] = (a - b - c + d) / (4.0 * h[:, i, None] * h[:, j, None])
        return found

    def _around(self, x: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """(N, M, gives) at points (N, takes) moved by (N, M, takes)."""
        points = x[:, None] + moved
        return self.at(points.reshape(-1, x.shape[1])).reshape(*moved.shape[:2], -1)


class _Values(ca.Callback):
    """A CasADi function of dense arguments whose values a `_Batch` has; `order` is how often it is differentiated."""

    def __init__(self, batch: _Batch, order: int = 0) -> None:
        ca.Callback.__init__(self)
        self.batch = batch
        self.order = order
        self.n, self.m = len(batch.takes), len(batch.gives)
        self.next: _Values | None = None  # CasADi does not keep what Python lets go
        self.ahead: ca.Function | None = None
        self.kept: dict[bytes, np.ndarray] = {}  # CasADi asks for a Jacobian once for each of its columns
        # CasADi takes two calls of equal arguments to functions of one name for one expression
        self.construct(f"outside_{batch.number}_{order}", {})
        if order == 0:
            BATCHED[self.name()] = self.batch.at

    def get_n_in(self) -> int:
        return 1 + self.order

    def get_n_out(self) -> int:
        return 2 if self.order == 2 else 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        if i == 0:
            return ca.Sparsity.dense(self.n, 1)
        # what it was differentiated at, of which nothing depends
        return ca.Sparsity(self.m, 1) if i == 1 else ca.Sparsity(self.m, self.n)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        if self.order < 2:
            return ca.Sparsity.dense(self.m, self.n if self.order else 1)
        return ca.Sparsity.dense(self.m * self.n, self.n) if i == 0 else ca.Sparsity(self.m * self.n, self.m)

    def eval(self, arguments: Sequence[ca.DM]) -> list[Any]:
        try:
            found = self.at(arguments[0].full().reshape(1, -1))[0]
        except InputError:
            # of an error CasADi makes a RuntimeError, or a failed step of IPOPT or CVODES: no value is such a step too
            found = np.full((self.m, *(self.n,) * self.order), np.nan)
        # rows of the Jacobian of a Jacobian column by column
        return [found] if self.order < 2 else [found.swapaxes(0, 1).reshape(-1, self.n), ca.DM(self.m * self.n, self.m)]

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N, gives), or (N, gives, takes ...) derivatives, of (N, takes)."""
        key = points.tobytes()
        found = self.kept.get(key)
        if found is None:
            found = (self.batch.at, self.batch.slopes, self.batch.bends)[self.order](points)
            self.kept = dict([*self.kept.items(), (key, found)][-_POINTS:])
        return found

    def has_jacobian(self) -> bool:
        return self.order < 2

    def get_jacobian(self, name: str, inames: list[str], onames: list[str], options: dict[str, Any]) -> ca.Function:
        return self._slopes()

    def has_forward(self, count: int) -> bool:
        return self.order == 0 and count == 1

    def get_forward(
        self, count: int, name: str, inames: list[str], onames: list[str], options: dict[str, Any]
    ) -> ca.Function:
        """(x, nothing, direction) -> derivative along it, which is what expressions are differentiated by."""
        x = ca.MX.sym("x", self.n)
        y = ca.MX.sym("y", ca.Sparsity(self.m, 1))
        along = ca.MX.sym("along", self.n)
        slopes = self._slopes()
        self.ahead = ca.Function(name, [x, y, along], [slopes(x, y) @ along], inames, onames, options)
        BATCHED[name] = lambda both: np.einsum("kij,kj->ki", slopes.at(both[:, : self.n]), both[:, self.n :])
        return self.ahead

    def _slopes(self) -> _Values:
        if self.next is None:
            self.next = _Values(self.batch, self.order + 1)
        return self.next
