"""Aerodynamic coefficients along the records of a fit, and the part of a time history that derivatives cannot
reproduce.
"""

from __future__ import annotations

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.model.terms import parse_term


def coefficient_series(fit: FlightFit) -> dict[str, np.ndarray]:
    """Coefficient -> (N, R) its value along the records, from the file's own aerodynamics, derivatives and fitted
    terms.
    """
    values, nothing = fit.derivatives, np.zeros(fit.batch.live.shape)
    series = {c: fit.regressors.get(f"given {c}", nothing) for c in fit.flight.coefficients}
    for coefficient, name, term in fit.flight.terms:
        if name in values and "dot" not in term:
            series[coefficient] = series[coefficient] + values[name] * parse_term(term).evaluate(fit.regressors)
    return series


def variation(fit: FlightFit) -> dict[str, float]:
    """Coefficient -> standard deviation of its value along the records."""
    return {c: float(np.std(s[fit.batch.live])) for c, s in coefficient_series(fit).items()}


def unlike_derivatives(
    fit: FlightFit, coefficient: str, series: np.ndarray, regressors: dict[str, np.ndarray] | None = None
) -> np.ndarray:
    """(N, R, ...) Residual of time histories of a coefficient after regression on its fitted terms.

    The terms are evaluated with the fit's `regressors`, or with the given ones.
    """
    live, regressors = fit.batch.live, fit.regressors if regressors is None else regressors
    present = [
        np.broadcast_to(parse_term(term).evaluate(regressors), live.shape)[live]
        for c, _, term in fit.flight.terms
        if c == coefficient and "dot" not in term
    ]
    basis = np.stack([np.ones(int(live.sum())), *present], axis=1)
    left = np.zeros(series.shape)
    left[live] = series[live] - basis @ np.linalg.lstsq(basis, series[live], rcond=None)[0]
    return left
