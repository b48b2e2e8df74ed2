"""Operators of the functions in files of others: those that several formats call alike, and their evaluation."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import casadi as ca

# of one argument, and of any number of them
ONE = {name: getattr(ca, name) for name in ("exp", "sin", "cos", "tan", "floor")}
ONE |= {"abs": ca.fabs, "ln": ca.log, "not": ca.logic_not}
REDUCED = {"min": ca.fmin, "max": ca.fmax, "and": ca.logic_and, "or": ca.logic_or}
COMPARISONS = (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne)


@dataclass(frozen=True, kw_only=True)
class Operators:
    """Operators of a format by name: of one argument, of two, and those that reduce any number of arguments."""

    one: Mapping[str, Callable[[Any], Any]]
    two: Mapping[str, Callable[[Any, Any], Any]]
    reduced: Mapping[str, Callable[[Any, Any], Any]]

    def __call__(self, name: str, given: Sequence[Any]) -> Any:
        """Return the value of an operator; None where there is none of this name for so many arguments."""
        if name in self.one and len(given) == 1:
            return self.one[name](given[0])
        if name in self.two and len(given) == 2:
            return self.two[name](*given)
        return reduce(self.reduced[name], given) if name in self.reduced and given else None
