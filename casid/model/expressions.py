"""Check the expressions that a user's functions give for a model, and find where a value is not a number."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import given
from casid.errors import InputError, check_known, unknown

Vectors = Mapping[str, tuple[ca.SX, Sequence[str]]]  # letter -> the vector and the names of its rows
_LONGEST = 80  # letters of an expression in a message


class Symbols:
    """The namespace that a user's functions take: `s.alpha` is a symbol; InputError names the nearest one."""

    _where: str

    def __init__(self, where: str, symbols: Mapping[str, ca.SX]) -> None:
        self.__dict__.update(symbols, _where=where)

    def __getattr__(self, name: str) -> ca.SX:
        if name.startswith("__"):
            raise AttributeError(name)
        raise unknown("symbol", name, [n for n in vars(self) if n != "_where"], self._where)


def expressions(
    function: Callable[[Any], Mapping[str, Any]], space: Symbols, names: Sequence[str], what: str, where: str
) -> ca.SX:
    """Column of the expressions that `function`, called `what` in messages, returns by name, in the order of `names`.
    Raises InputError for what is not a table of one expression for each name, and for an expression with a number that
    is none."""
    return column(evaluated(function, space, f"{where}: {what}"), names, what, where)


def evaluated(function: Callable[[Any], Any], space: Symbols, what: str, of: str = "symbols") -> Any:
    """What a user's function makes of symbols. Raises InputError for what is no function, and for one that asks whether
    something about a symbol is true."""
    if not callable(function):
        raise InputError(f"{what} is {given(function)}; expected a function of the {of}, like lambda s: ...")
    with warnings.catch_warnings():
        # CasADi announces that numpy functions of its symbols may give something else one day; they are symbols still
        warnings.filterwarnings("ignore", message=r"\s*casadi", category=FutureWarning)
        try:
            return function(space)
        except RuntimeError as error:
            if "truth value" not in str(error):
                raise
            raise InputError(
                f"{what} asks whether something about a symbol is true; write both cases, "
                "np.where(s.x > 0, a, b), in place of if, and, or, max"
            ) from None


def column(found: Any, names: Sequence[str], what: str, where: str) -> ca.SX:
    """Column of expressions by name, in the order of `names`. Raises InputError as `expressions` does."""
    if not isinstance(found, Mapping):
        like = ", ".join(f"'{name}': ..." for name in names[:3])
        raise InputError(f"{where}: {what} returned {given(found)}; expected a table by name, {{{like}}}")
    check_known(f"name in {what}", found, names, where)
    lacking = [name for name in names if name not in found]
    if lacking:
        raise InputError(f"{where}: {what} returned no expression for {', '.join(lacking)}")
    rows = [_expression(found[name], f"{where}: {what}: '{name}'") for name in names]
    return ca.vertcat(*rows) if rows else ca.SX(0, 1)


def _expression(value: Any, what: str) -> ca.SX:
    try:
        symbol = ca.SX(value)
    except (NotImplementedError, TypeError, ValueError):
        raise InputError(f"{what} is {given(value)}; expected an expression of the symbols, or a number") from None
    if symbol.shape != (1, 1):
        raise InputError(f"{what} has the shape {symbol.shape}; expected one expression")
    if any(np.isnan(constant) for constant in _constants(symbol)):
        raise InputError(
            f"{what} has nan in it; functions of Python's math module take numbers only: use numpy's or casadi's, "
            "np.sin(s.alpha)"
        )
    return symbol


def _constants(expression: ca.SX) -> Iterator[float]:
    function = ca.Function("constants", [], [expression], {"allow_free": True})
    for k in range(function.n_instructions()):
        if function.instruction_id(k) == ca.OP_CONST:
            yield function.instruction_constant(k)


def check_symbols(expression: ca.SX, vectors: Vectors, where: str) -> None:
    """Raise InputError when an expression depends on a symbol that is none of the model's."""
    function = ca.Function("free", [vector for vector, _ in vectors.values()], [expression], {"allow_free": True})
    strange = [str(symbol) for symbol in function.free_sx()]
    if strange:
        raise InputError(
            f"{where}: depends on {', '.join(strange)}, no symbol of this model; take all from its namespace"
        )


def origin(expression: ca.SX, vectors: Vectors, values: Mapping[str, np.ndarray]) -> str:
    """Return where a scalar expression gets a value that is not a number, "sqrt(alpha) of alpha = -0.1", at `values` by
    vector; "" if none."""
    named = [ca.vertcat(*[ca.SX.sym(n) for n in names]) if names else ca.SX(0, 1) for _, names in vectors.values()]
    symbols = [vector for vector, _ in vectors.values()]
    numbers = [np.asarray(values[letter], dtype=float) for letter in vectors]
    at = ca.substitute([expression], symbols, named)[0]

    def value(of: ca.SX) -> float:
        return float(ca.Function("value", named, [of])(*numbers))

    if np.isfinite(value(at)):
        return ""
    for _ in range(ca.n_nodes(at)):  # no way down through an expression is longer
        whole = at.dep(0) if at.is_output() else at  # a result of a function is computed from its arguments
        parts = [whole.dep(k) for k in range(whole.n_dep())]
        bad = [part for part in parts if not np.isfinite(value(part))]
        if not bad:
            break
        at = bad[0]
    of = " and ".join(f"{_short(part)} = {value(part):.4g}" for part in parts if not part.is_constant())
    return f"{_short(at)} is {value(at):g}" + (f" where {of}" if of else "")


def _short(expression: ca.SX) -> str:
    text = str(expression)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."
