"""Model discrepancy: the small structural errors of a linear aircraft model, their sizes and correlations.

A coefficient may contain every low-order term that symmetry allows and the model lacks. Together these terms are a
function of the motion. Each orthogonal part of this function that the fitted terms do not contain has the same prior
1-sigma: a small part of the variation of the coefficient, times a scale that says how nonlinear the coefficient is
(Zellner's g-prior). The prior is therefore one of functions: it does not depend on the choice and order of the terms,
and a curve with a kink needs no large terms that cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from casid.diagnosis.evidence.coefficients import unlike_derivatives, variation
from casid.diagnosis.flight.evaluation import FlightFit
from casid.model.path import MOMENTS
from casid.model.terms import parse_term

_LONGITUDINAL = ("alpha", "q", "delta_e")
_LATERAL = ("beta", "p", "r", "delta_a", "delta_r")


@dataclass(frozen=True, eq=False, kw_only=True)
class SmallTerms:
    """The small terms for a fit.

    names    (coefficient, term) of each
    series   (N, R, n) their regressors
    factors  (n,) value of each that alone makes the small part of the variation of its coefficient
    alike    (n, n) correlations, within a coefficient, of the parts that fitted terms do not contain: the inverse of
             the prior covariance of the values, in units of `factors`, at a scale of one
    """

    names: tuple[tuple[str, str], ...]
    series: np.ndarray
    factors: np.ndarray
    alike: np.ndarray


def no_terms(fit: FlightFit) -> SmallTerms:
    """No small terms: the structure of the model is exact."""
    return SmallTerms(names=(), series=np.zeros((*fit.batch.live.shape, 0)), factors=np.zeros(0), alike=np.eye(0))


def small_terms(fit: FlightFit) -> SmallTerms:
    """All terms that symmetry allows and the model of the fit lacks."""
    criteria = fit.criteria.structure
    present = {(c, term) for c, _, term in fit.flight.terms}
    present |= {(a.effect.target, a.effect.regressor or "") for a in fit.attached}
    names: list[tuple[str, str]] = []
    series: list[np.ndarray] = []
    factors: list[np.ndarray] = []
    blocks: list[np.ndarray] = []
    for coefficient, size in variation(fit).items():
        if coefficient not in fit.flight.moved or size <= 0.0:
            continue
        allowed = [term for term in _symmetric_terms(coefficient) if (coefficient, term) not in present]
        along = [np.broadcast_to(parse_term(term).evaluate(fit.regressors), fit.batch.live.shape) for term in allowed]
        whole = np.stack(along, axis=2)
        left = unlike_derivatives(fit, coefficient, whole)[fit.batch.live]
        spread = np.std(left, axis=0)
        rests = np.array([criteria.resting ** parse_term(term).degree for term in allowed])
        rests = np.maximum(rests, criteria.rounding * np.abs(whole[fit.batch.live]).max(axis=0))
        varies = np.flatnonzero(spread > np.maximum(criteria.dependent * np.std(whole[fit.batch.live], axis=0), rests))
        unit = left[:, varies] / spread[varies]
        names += [(coefficient, allowed[i]) for i in varies]
        series.append(whole[..., varies])
        factors.append(criteria.small * size / spread[varies])
        ridge = criteria.ridge
        blocks.append((unit.T @ unit / len(unit) + ridge * np.eye(len(varies))) / (1.0 + ridge))
    if not names:
        return no_terms(fit)
    return SmallTerms(
        names=tuple(names),
        series=np.concatenate(series, axis=2),
        factors=np.concatenate(factors),
        alike=np.asarray(block_diag(*blocks)),
    )


def most_likely_scales(
    square: np.ndarray, match: np.ndarray, alike: np.ndarray, owners: Sequence[str], scales: Sequence[float]
) -> dict[str, float]:
    """Owner -> the scale with the largest marginal likelihood (empirical Bayes), by coordinate descent.

    Parameters
    ----------
    square, match
        (n, n), (n,) Normal equations of the small terms, all other parameters eliminated.
    alike
        (n, n) Their prior information at a scale of one.
    owners
        The coefficient of each term.
    scales
        The scales that are tried.
    """
    n, root = len(match), np.linalg.cholesky(alike)
    match = solve_triangular(root, match, lower=True)
    square = without_rounding(solve_triangular(root, solve_triangular(root, square, lower=True).T, lower=True))

    def deviance(of: dict[str, float]) -> float:
        scale = np.array([of[owner] for owner in owners])
        factor = np.linalg.cholesky(np.eye(n) + square * scale[:, None] * scale)
        pulled = solve_triangular(factor, match * scale, lower=True, check_finite=False)
        return 2.0 * float(np.sum(np.log(np.diag(factor)))) - float(pulled @ pulled)

    best = dict.fromkeys(owners, scales[0])
    lowest, settled = deviance(best), False
    while not settled:
        settled = True
        for owner in best:
            for scale in scales:
                if (found := deviance(best | {owner: scale})) < lowest:
                    lowest, best, settled = found, best | {owner: scale}, False
    return best


def without_rounding(square: np.ndarray) -> np.ndarray:
    """The Gram matrix without negative eigenvalues, which rounding causes for directions that nearly cancel."""
    if not len(square):
        return square
    values, vectors = np.linalg.eigh(0.5 * (square + square.T))
    return square if values[0] >= 0.0 else (vectors * np.maximum(values, 0.0)) @ vectors.T


def _symmetric_terms(coefficient: str) -> list[str]:
    """Names of the terms of a coefficient that the left-right symmetry of the aircraft allows.

    These are the linear terms of its plane, terms of second order, terms of third order in one variable, and the
    effects of Mach and of the rate of its flow angle. Longitudinal coefficients are even in the lateral variables,
    lateral ones odd.
    """
    lateral = coefficient == "CY" or (coefficient in MOMENTS and coefficient != "Cm")
    own = _LATERAL if lateral else _LONGITUDINAL
    if lateral:
        products = [("betadot",), *((a, b) for a in _LONGITUDINAL for b in _LATERAL)]
    else:
        products = [("alphadot",), ("mach",), ("alpha", "mach")]
        for group in (_LONGITUDINAL, _LATERAL):
            products += list(combinations_with_replacement(group, 2))
    cubes = [(v, v, v) for v in own] + [("alpha", "alpha", v) for v in own if lateral]
    return [parse_term("*".join(factors)).name for factors in [(v,) for v in own] + products + cubes]
