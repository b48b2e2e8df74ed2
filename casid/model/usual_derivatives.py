"""Estimate how large the derivatives of an aircraft are, where its file does not give them.

Per rad; rates are p b/2V, q c/2V and r b/2V.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from casid.model.airframe import AXES_COEFFICIENTS, Airframe
from casid.model.terms import derivative_term

# Coefficient -> regressor -> 1-sigma about zero. 95 % of the aircraft that come with JSBSim are within 1.96 of it, at a
# lift coefficient of 0.4; computed by `python -m problems.jsbsim.derivative_sizes`.
_USUAL = {
    "CL": {"0": 0.32, "alpha": 3.6, "q": 16, "delta_e": 0.44},
    "CD": {"0": 0.056, "alpha": 0.38, "q": 0.97, "delta_e": 0.041},
    "CX": {"0": 0.065, "alpha": 0.44, "q": 0.57, "delta_e": 0.028},
    "CZ": {"0": 0.32, "alpha": 3.5, "q": 16, "delta_e": 0.44},
    "CY": {"beta": 0.76, "p": 0.096, "r": 0.29, "delta_a": 0.18, "delta_r": 0.23},
    "Cl": {"beta": 0.075, "p": 0.26, "r": 0.11, "delta_a": 0.13, "delta_r": 0.021},
    "Cm": {"0": 0.062, "alpha": 1.2, "q": 24, "delta_e": 0.79},
    "Cn": {"beta": 0.25, "p": 0.091, "r": 0.69, "delta_a": 0.021, "delta_r": 0.15},
}
USUAL_DERIVATIVES: Mapping[str, float] = MappingProxyType(
    {f"{coefficient}_{regressor}": size for coefficient, row in _USUAL.items() for regressor, size in row.items()}
)

# Smallest size of a derivative that differs notably from zero, per unit of its regressor.
NOTABLE_DERIVATIVES: Mapping[str, float] = MappingProxyType(
    {"CL": 0.3, "CD": 0.05, "CX": 0.05, "CZ": 0.3, "CY": 0.1, "Cl": 0.02, "Cm": 0.1, "Cn": 0.02}
)


def missing_derivatives(aircraft: Airframe) -> dict[str, float]:
    """Derivatives that other aircraft have and this file does not, with their value by it: zero.

    A file without one says that it is zero, and is re-estimated like one that states so. Nothing is missing where a
    table or aerodynamics of the user may have it.
    """
    if not aircraft.winged or aircraft.aerodynamics is not None:
        return {}
    tabulated = {table.coefficient for table in aircraft.tables}
    found = {}
    for name in USUAL_DERIVATIVES:
        coefficient, term = derivative_term(name)
        ours = coefficient in AXES_COEFFICIENTS[aircraft.force_axes] and coefficient not in tabulated
        if ours and term.factors and name not in aircraft.derivatives:
            found[name] = 0.0
    return found
