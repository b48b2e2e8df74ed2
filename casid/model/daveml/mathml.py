"""The content MathML of a DAVE-ML calculation as an expression."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import casadi as ca

from casid.errors import InputError

Look = Callable[[str], Any]  # varID -> its expression

_ONE: dict[str, Callable[[Any], Any]] = {
    "minus": lambda x: -x,
    "plus": lambda x: x,
    "abs": ca.fabs,
    "exp": ca.exp,
    "ln": ca.log,
    "log": ca.log10,
    "root": ca.sqrt,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "arcsin": ca.asin,
    "arccos": ca.acos,
    "arctan": ca.atan,
    "floor": ca.floor,
    "ceiling": ca.ceil,
    "not": ca.logic_not,
}
_TWO: dict[str, Callable[[Any, Any], Any]] = {
    "minus": lambda a, b: a - b,
    "divide": lambda a, b: a / b,
    "power": lambda a, b: a**b,
    "lt": lambda a, b: a < b,
    "leq": lambda a, b: a <= b,
    "gt": lambda a, b: a > b,
    "geq": lambda a, b: a >= b,
    "eq": lambda a, b: a == b,
    "neq": lambda a, b: a != b,
}
_MANY: dict[str, Callable[[Sequence[Any]], Any]] = {
    "plus": lambda x: reduce(lambda a, b: a + b, x),
    "times": lambda x: reduce(lambda a, b: a * b, x),
    "min": lambda x: reduce(ca.fmin, x),
    "max": lambda x: reduce(ca.fmax, x),
    "and": lambda x: reduce(ca.logic_and, x),
    "or": lambda x: reduce(ca.logic_or, x),
}


def bare(node: ET.Element) -> str:
    """The tag without its namespace."""
    return node.tag.rsplit("}", 1)[-1]


def expression(node: ET.Element, look: Look) -> Any:
    """The value of a node, variables by `look`. Raises InputError for an operator that is not known."""
    tag, children = bare(node), list(node)
    if tag == "cn":
        return ca.SX(number(node.text, "cn"))
    if tag == "ci":
        return look((node.text or "").strip())
    if tag == "pi":
        return ca.SX(math.pi)
    if tag == "piecewise":
        return _piecewise(children, look)
    if tag == "math" or (tag == "apply" and len(children) == 1):
        return expression(children[0], look)
    if tag != "apply" or not children:
        raise InputError(f"<{tag}> is no MathML that casid reads")
    operator = bare(children[0])
    if operator == "csymbol":
        operator = (children[0].text or "").strip()
    given = [expression(child, look) for child in children[1:]]
    if operator in _ONE and len(given) == 1:
        return _ONE[operator](given[0])
    if operator in _TWO and len(given) == 2:
        return _TWO[operator](*given)
    if operator in ("atan2", "fmod") and len(given) == 2:
        return {"atan2": ca.atan2, "fmod": ca.fmod}[operator](*given)
    if operator in _MANY and given:
        return _MANY[operator](given)
    raise InputError(f"<{operator}> of {len(given)} arguments is no operator that casid reads")


def _piecewise(children: Sequence[ET.Element], look: Look) -> Any:
    value: Any = None
    for child in children:
        if bare(child) == "otherwise":
            value = expression(child[0], look)
    for child in reversed([c for c in children if bare(c) == "piece"]):
        then, condition = (expression(part, look) for part in child)
        value = then if value is None else ca.if_else(condition, then, value)
    if value is None:
        raise InputError("<piecewise> has no piece")
    return value


def number(text: str | None, where: str) -> float:
    """A number of the file. Raises InputError."""
    try:
        return float(text or "")
    except ValueError:
        raise InputError(f"<{where}> must be a number, got '{(text or '').strip()[:40]}'") from None
