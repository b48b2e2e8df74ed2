"""A CasADi function that calls Python functions of many points, on many points at once.

CasADi calls a Python function point by point. A `Tape` runs through the instructions of the function once, each of them
on arrays of all points, and gives a Python function of `BATCHED` all its points in one call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from casid.native.emitter import ARITHMETIC, BY_LANE, LIBRARY, LIBRARY_OF_TWO, UnknownOperationError

# name of a CasADi function -> its results (N, nonzeros of all) of arguments (N, nonzeros of all)
BATCHED: dict[str, Callable[[np.ndarray], np.ndarray]] = {}

_OPERATIONS: dict[int, Callable[..., Any]] = {
    **{op: on_arrays for op, (_, on_arrays) in (ARITHMETIC | BY_LANE).items()},
    **{op: getattr(np, name) for op, name in (LIBRARY | LIBRARY_OF_TWO).items()},
}


class Tape:
    """The instructions of a CasADi function of expressions (SX), whose arguments are columns and whose results are
    dense. Raises UnknownOperationError for an instruction that it cannot do.

    Arguments and results of the methods are those of the mapped CasADi function, in numpy's order, see `PointBatch`.
    """

    def __init__(self, function: ca.Function) -> None:
        self._rows = [function.size1_in(i) for i in range(function.n_in())]
        self._shapes = [function.size_out(i) for i in range(function.n_out())]
        self._room, nodes = function.sz_w(), function.instructions_sx()
        self._steps = [
            (
                function.instruction_id(k),
                function.instruction_output(k),
                function.instruction_input(k),
                _operation(function, nodes, k),
            )
            for k in range(function.n_instructions())
        ]

    def mapped(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Results (N columns, rows) of arguments (N, rows)."""
        count = next(np.size(a) // rows for a, rows in zip(arguments, self._rows, strict=True) if rows)
        found = self._run([np.reshape(a, (count, rows)) for a, rows in zip(arguments, self._rows, strict=True)])
        return [r.reshape(count * columns, rows) for r, (rows, columns) in zip(found, self._shapes, strict=True)]

    def accumulated(self, start: np.ndarray, *arguments: np.ndarray) -> list[np.ndarray]:
        """[(K, L, n)] of a start (K, n), which each of L calls replaces by its result, and arguments (K, L, rows)."""
        state = start
        rest = list(zip(arguments, self._rows[1:], strict=True))
        length = next(np.size(a) // (len(start) * rows) for a, rows in rest if rows)
        along = [np.reshape(a, (len(start), length, rows)) for a, rows in rest]
        states = np.empty((len(start), length, start.shape[1]))
        for k in range(length):
            state = states[:, k] = self._run([state, *(a[:, k] for a in along)])[0]
        return [states]

    def _run(self, arguments: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Each result (N, nonzeros) of each argument (N, rows)."""
        count = len(arguments[0])
        results = [np.empty((count, rows * columns)) for rows, columns in self._shapes]
        given = [a.T for a in arguments]
        w = [np.zeros(count)] * self._room
        with np.errstate(all="ignore"):  # what is no number is found in the results, as with compiled code
            for kind, to, of, what in self._steps:
                if kind == ca.OP_INPUT:
                    w[to[0]] = given[of[0]][of[1]]
                elif kind == ca.OP_OUTPUT:
                    results[to[0]][:, to[1]] = w[of[0]]
                elif kind == ca.OP_CALL:
                    points = np.empty((count, len(of)))
                    for column, i in enumerate(of):
                        points[:, column] = w[i]
                    values = what(points)
                    for i, value in zip(to, values.T, strict=True):
                        if i >= 0:  # a result that nothing looks at has no place
                            w[i] = value
                else:
                    w[to[0]] = what(*(w[i] for i in of))
        return results


def _operation(function: ca.Function, nodes: Any, k: int) -> Callable[..., Any]:
    """Return the action of instruction k on arrays; nothing where it reads an argument or writes a result."""
    kind = function.instruction_id(k)
    if kind in (ca.OP_INPUT, ca.OP_OUTPUT):
        return _OPERATIONS[ca.OP_ASSIGN]
    if kind == ca.OP_CONST:
        value = function.instruction_constant(k)
        return lambda: value
    if kind == ca.OP_CALL:
        name = nodes[k].which_function().name()
        if name in BATCHED:
            return BATCHED[name]
    elif kind in _OPERATIONS:
        return _OPERATIONS[kind]
    raise UnknownOperationError(f"instruction {k} of {function}")
