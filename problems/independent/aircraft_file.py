"""What an engineer would know of the aircraft: mass properties, trim, and derivatives that are not exact.

Derivatives are a least-squares fit of the tables around the trim point, each then changed by a percentage within OFF.
What straight lines and parabolas leave of the tables remains as an error of structure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from problems.independent.planes import Plane

OFF = (0.1, 0.25)
UNCERTAINTY = 0.3  # stated in the file
# coefficient -> terms, as lists of factors
_LATERAL = ((), ("beta",), ("p",), ("r",), ("delta_a",), ("delta_r",))
_PITCH = ((), ("alpha",), ("q",), ("delta_e",))
STRUCTURE: Mapping[str, Sequence[tuple[str, ...]]] = {
    "CL": _PITCH,
    "CD": ((), ("alpha",), ("delta_e",), ("alpha", "alpha"), ("beta", "beta"), ("delta_e", "delta_e")),
    "CY": _LATERAL,
    "Cl": _LATERAL,
    "Cm": _PITCH,
    "Cn": _LATERAL,
}


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Coefficient -> term -> value, and coefficient -> r.m.s. that the terms leave, of its standard deviation."""

    values: Mapping[str, Mapping[tuple[str, ...], float]]
    left: Mapping[str, float]


def fitted(plane: Plane, points: Mapping[str, np.ndarray]) -> Fit:
    """Least squares of STRUCTURE on the tables at points (n,): alpha, beta, mach, dimensionless p, q, r, surfaces."""
    exact = plane.coefficients(points)
    values, left = {}, {}
    for name, terms in STRUCTURE.items():
        A = np.stack([column(points, term) for term in terms], axis=1)
        scale = np.maximum(np.abs(A).max(axis=0), 1e-12)
        found = np.linalg.lstsq(A / scale, exact[name], rcond=None)[0] / scale
        values[name] = dict(zip(terms, found.tolist(), strict=True))
        left[name] = float(np.std(exact[name] - A @ found) / np.std(exact[name]))
    return Fit(values=values, left=left)


def column(points: Mapping[str, np.ndarray], term: tuple[str, ...]) -> np.ndarray:
    """(n,) the product of a term's factors; ones for the constant."""
    return np.prod([np.ones_like(points["alpha"]), *(points[name] for name in term)], axis=0)


def guessed(fit: Fit, rng: np.random.Generator) -> dict[str, dict[tuple[str, ...], float]]:
    """The values, each off by a fraction within OFF, up or down, with three digits."""
    return {
        name: {
            term: float(f"{value * (1.0 + rng.choice((-1.0, 1.0)) * rng.uniform(*OFF)):.3g}")
            for term, value in terms.items()
            if not term or abs(value) > 1e-9
        }
        for name, terms in fit.values.items()
    }
