"""Constraints on parameters and on the path, stated by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from casid.errors import EstimationError


@dataclass(frozen=True, kw_only=True)
class LinearConstraint:
    """lower <= sum of coefficient * parameter <= upper; an equality when both are the same."""

    coefficients: Mapping[str, float]
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class PathConstraint:
    """lower <= state or output `name` <= upper at every sample of every record."""

    name: str
    lower: float
    upper: float


Constraint = LinearConstraint | PathConstraint


def _limits(what: str, lower: float | None, upper: float | None) -> tuple[float, float]:
    low, high = -math.inf if lower is None else float(lower), math.inf if upper is None else float(upper)
    if math.isinf(low) and math.isinf(high):
        raise EstimationError(f"constraint on {what}: neither lower nor upper is given")
    if not low <= high:
        raise EstimationError(f"constraint on {what}: lower {low:g} is above upper {high:g}")
    return low, high


def parameter(name: str, *, lower: float | None = None, upper: float | None = None) -> LinearConstraint:
    """Bounds on one parameter; lower == upper fixes it. A per-record parameter is bounded in every record."""
    low, high = _limits(f"'{name}'", lower, upper)
    return LinearConstraint(coefficients={name: 1.0}, lower=low, upper=high)


def linear(
    coefficients: Mapping[str, float], *, lower: float | None = None, upper: float | None = None
) -> LinearConstraint:
    """Limits on a linear combination of parameters, for example a ratio or a sum known from a wind tunnel."""
    low, high = _limits(" + ".join(f"{c:g} {n}" for n, c in coefficients.items()), lower, upper)
    return LinearConstraint(coefficients=dict(coefficients), lower=low, upper=high)


def path(name: str, *, lower: float | None = None, upper: float | None = None) -> PathConstraint:
    """Limits on a state or an output along the whole trajectory, at the samples."""
    low, high = _limits(f"path '{name}'", lower, upper)
    return PathConstraint(name=name, lower=low, upper=high)
