"""The three nonlinear variants of the truth, with all sizes in one table.

The paper gives the forms and no sizes ("significant, cannot be estimated by the linear model"). Ours are relative to
the linear derivative C and to a typical excursion of its variable:

variant 1   C * x + SINE * |C| * period / (2 pi) * sin(2 pi x / period) on every force and moment derivative: the local
            slope varies by SINE about C
variant 2   on the moments, for the variables x of each: LINEAR * C x, SQUARE * |C| x^2 / X and, for every pair,
            PRODUCT * sqrt(|C1 C2| / (X1 X2)) * x1 x2, X the typical excursion
variant 3   variant 2 with every increment doubled

X covers the destabilised aircraft too, whose surfaces move two to six times as far. alpha and delta_e count from trim,
so that every variant flies the same trim. A product belongs half to each of its two variables when a term's
contribution is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from math import pi, sqrt
from types import MappingProxyType
from typing import Any

import casadi as ca

SINE, LINEAR, SQUARE, PRODUCT = 0.3, 0.1, 0.15, 0.1
# variable -> typical excursion X [rad, dimensionless rates] and, twice that, the period of variant 1
EXCURSION: Mapping[str, float] = MappingProxyType(
    {"alpha": 0.04, "beta": 0.10, "delta_e": 0.08, "delta_a": 0.15, "delta_r": 0.25, "p": 0.02, "q": 0.002, "r": 0.01}
)
_POLYNOMIAL = MappingProxyType(
    {
        "Cl": ("beta", "delta_a", "delta_r"),
        "Cm": ("alpha", "delta_e", "q"),
        "Cn": ("beta", "delta_a", "delta_r"),
    }
)
_SCALE = MappingProxyType({2: 1.0, 3: 2.0})


def increments(variant: int, x: Mapping[str, Any], derivatives: Mapping[str, float]) -> dict[str, Any]:
    """Derivative name -> what the nonlinear terms add to its linear contribution, as CasADi expressions.

    x   variable -> expression: flow angles and surfaces about trim, dimensionless rates. Variant 0 adds nothing.
    """
    if variant == 0:
        return {}
    return _sines(x, derivatives) if variant == 1 else _polynomials(_SCALE[variant], x, derivatives)


def _sines(x: Mapping[str, Any], derivatives: Mapping[str, float]) -> dict[str, Any]:
    found = {}
    for name, value in derivatives.items():
        variable = name.split("_", 1)[1]
        if variable != "0":
            period = 2.0 * EXCURSION[variable]
            found[name] = SINE * abs(value) * period / (2 * pi) * ca.sin(2 * pi * x[variable] / period)
    return found


def _polynomials(scale: float, x: Mapping[str, Any], derivatives: Mapping[str, float]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for coefficient, variables in _POLYNOMIAL.items():
        for v in variables:
            value = derivatives[f"{coefficient}_{v}"]
            nonlinear = SQUARE * abs(value) * x[v] ** 2 / EXCURSION[v]
            found[f"{coefficient}_{v}"] = scale * (LINEAR * value * x[v] + nonlinear)
        for v, w in combinations(variables, 2):
            size = sqrt(abs(derivatives[f"{coefficient}_{v}"] * derivatives[f"{coefficient}_{w}"]))
            product = scale * PRODUCT * size / sqrt(EXCURSION[v] * EXCURSION[w]) * x[v] * x[w]
            for name in (f"{coefficient}_{v}", f"{coefficient}_{w}"):
                found[name] += product / 2
    return found
