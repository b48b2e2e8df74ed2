"""Vectors of three numbers or expressions in body axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Vector product."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def minus(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Difference."""
    return [x - y for x, y in zip(a, b, strict=True)]


def accelerations_at(
    arm: Sequence[Any], accelerations: Sequence[Any], rates: Sequence[Any], angular: Sequence[Any]
) -> list[Any]:
    """Accelerations at the end of an arm of a rigid body that turns with `rates` p, q, r, whose derivatives are
    `angular`."""
    x, y, z = arm
    ax, ay, az = accelerations
    p, q, r = rates
    pdot, qdot, rdot = angular
    return [
        ax - (q**2 + r**2) * x + (p * q - rdot) * y + (p * r + qdot) * z,
        ay + (p * q + rdot) * x - (p**2 + r**2) * y + (q * r - pdot) * z,
        az + (p * r - qdot) * x + (q * r + pdot) * y - (p**2 + q**2) * z,
    ]
