"""Constraints on parameters and on the path, stated by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from casid.arguments import given, number, numbers_by_name
from casid.errors import EstimationError, InputError


@dataclass(frozen=True, kw_only=True)
class LinearConstraint:
    """lower <= sum of coefficient * parameter <= upper; an equality when both are the same."""

    coefficients: Mapping[str, float]
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class NonlinearConstraint:
    """lower <= function(parameters) <= upper; an equality when both are the same."""

    function: Callable[[Any], Any]
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class PathConstraint:
    """lower <= state or output `name` <= upper at every sample of every record. With a finite `price` the limits may be
    exceeded: each sample then adds price * excess to the cost."""

    name: str
    lower: float
    upper: float
    price: float = math.inf


Constraint = LinearConstraint | NonlinearConstraint | PathConstraint


def _limits(what: str, lower: float | None, upper: float | None) -> tuple[float, float]:
    low = -math.inf if lower is None or lower == -math.inf else number(lower, f"constraint on {what}: lower")
    high = math.inf if upper is None or upper == math.inf else number(upper, f"constraint on {what}: upper")
    if math.isinf(low) and math.isinf(high):
        raise EstimationError(f"constraint on {what}: neither lower nor upper is given")
    if not low <= high:
        raise EstimationError(f"constraint on {what}: lower {low:g} is above upper {high:g}")
    return low, high


def _name(value: Any, what: str, example: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"{what}: the name is {given(value)}; expected a text, like '{example}'")
    return value


def limit_parameter(name: str, *, lower: float | None = None, upper: float | None = None) -> LinearConstraint:
    """Bounds on one parameter of a problem.

    Parameters
    ----------
    name
        Parameter of the model. One that is estimated per record is bounded in every record.
    lower, upper
        Bounds in the parameter's unit, one or both; both the same fixes it.

    Returns
    -------
    LinearConstraint
        For `Problem(constraints=[...])`.

    Raises
    ------
    InputError
        For a name that is no text or a bound that is no number.
    EstimationError
        Where neither bound is given, or they contradict each other.

    Examples
    --------
    >>> import casid as cs
    >>> damping = cs.limit_parameter("Cm_q", upper=0.0)
    >>> damping.lower, damping.upper
    (-inf, 0.0)
    """
    low, high = _limits(f"'{_name(name, 'limit_parameter', 'Cm_q')}'", lower, upper)
    return LinearConstraint(coefficients={name: 1.0}, lower=low, upper=high)


def limit_combination(
    coefficients: Mapping[str, float], *, lower: float | None = None, upper: float | None = None
) -> LinearConstraint:
    """Limits on a linear combination of parameters, for example a ratio or a sum known from a wind tunnel.

    Parameters
    ----------
    coefficients
        Parameter -> its factor in the sum; at least one differs from zero.
    lower, upper
        Limits of the sum, one or both; both the same for an equality.

    Returns
    -------
    LinearConstraint
        For `Problem(constraints=[...])`.

    Raises
    ------
    InputError
        For what is no number by name, and when all factors are zero.
    EstimationError
        Where neither limit is given, or they contradict each other.

    Examples
    --------
    A wind tunnel found that Cm_q is at least twice as negative as Cm_alphadot:

    >>> import casid as cs
    >>> ratio = cs.limit_combination({"Cm_q": 1.0, "Cm_alphadot": -2.0}, upper=0.0)
    >>> ratio.coefficients
    {'Cm_q': 1.0, 'Cm_alphadot': -2.0}
    """
    table = numbers_by_name(coefficients, "limit_combination: coefficients")
    if not any(table.values()):
        raise InputError(
            "limit_combination: all coefficients are zero; write cs.limit_combination({'Cm_q': 1.0}, upper=0.0)"
        )
    low, high = _limits(" + ".join(f"{c:g} {n}" for n, c in table.items()), lower, upper)
    return LinearConstraint(coefficients=table, lower=low, upper=high)


def limit_function(
    function: Callable[[Any], Any], *, lower: float | None = None, upper: float | None = None
) -> NonlinearConstraint:
    """Limits on a nonlinear function of parameters.

    Parameters
    ----------
    function
        Takes a namespace of the model's parameters and returns one expression. Where it contains a per-record
        parameter, the limits hold in every record.
    lower, upper
        Limits of the expression; both the same for an equality.

    Returns
    -------
    NonlinearConstraint
        For `Problem(constraints=[...])`.

    Raises
    ------
    InputError
        For what is no function or no number.
    EstimationError
        Where neither limit is given, or they contradict each other.

    Examples
    --------
    The short period has a natural frequency of at most 3 rad/s:

    >>> import casid as cs
    >>> short_period = cs.limit_function(lambda s: s.Za * s.Mq - s.Ma, upper=9.0)
    >>> short_period.lower, short_period.upper
    (-inf, 9.0)
    """
    if not callable(function):
        raise InputError(
            f"limit_function: the function is {given(function)}; write cs.limit_function(lambda s: s.a * s.b)"
        )
    low, high = _limits("a function of parameters", lower, upper)
    return NonlinearConstraint(function=function, lower=low, upper=high)


def limit_trajectory(
    name: str, *, lower: float | None = None, upper: float | None = None, price: float | None = None
) -> PathConstraint:
    """Limits on a state or an output along the whole trajectory, at the samples.

    Parameters
    ----------
    name
        State or output of the model.
    lower, upper
        Limits, in its unit.
    price
        None: the limits hold. Otherwise they are soft: every sample beyond a limit adds `price` times the excess to the
        cost, which is half the sum of squared residuals in standard deviations. The limits still hold exactly where
        that costs less.

    Returns
    -------
    PathConstraint
        For `Problem(constraints=[...])`.

    Raises
    ------
    InputError
        For a name that is no text or a price that is not positive.
    EstimationError
        Where neither limit is given, or they contradict each other.

    Examples
    --------
    The angle of attack stays below 12 deg, and the limit is soft:

    >>> import math, casid as cs
    >>> limit = cs.limit_trajectory("alpha", upper=math.radians(12.0), price=100.0)
    >>> limit.name, limit.lower, limit.price
    ('alpha', -inf, 100.0)
    """
    low, high = _limits(f"limit_trajectory '{_name(name, 'limit_trajectory', 'alpha')}'", lower, upper)
    if price is not None:
        number(price, f"limit_trajectory '{name}': price", positive=True)
    return PathConstraint(name=name, lower=low, upper=high, price=math.inf if price is None else float(price))
