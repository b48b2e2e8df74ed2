"""A fit with small structural errors of its aerodynamics marginalised: what screening and naming judge by.

No linear aircraft model is exact. Every low-order term that symmetry allows and the model lacks may be present with a
prior 1-sigma of `SMALL` of the variation of its coefficient, or more: how bent this aircraft is, is estimated from the
data (the prior with the largest marginal likelihood: empirical Bayes). What such small terms can explain is no evidence
for any other cause; a term well beyond what is usual on this aircraft still shows.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import get_blas_funcs

from casid.diagnosis.fit import Fit, scaled_inverse
from casid.estimation.processors import share_out
from casid.model.path import MOMENTS, aerodynamic_parameters, coefficient_names
from casid.model.terms import parse_term

SMALL = 0.0025
_RATIOS = (1.0, 2.0, 4.0, 8.0, 16.0)  # to it, that the estimated prior may have
_SURE = 3.0  # times its spread that a value must be from zero
_KNOWN = 0.005  # of a value: what samples leave open between them, and another simulator does otherwise
_STRETCH, _OWN = 5.0, 0.7  # s; and the largest part of a slot's information that a stretch counts for
_LONGITUDINAL = ("alpha", "q", "delta_e")
_LATERAL = ("beta", "p", "r", "delta_a", "delta_r")


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """A fit seen through the nuisance of small terms.

    by_record   for each record (samples, k) whitened sensitivities of the fitted slots and of the small `terms`
    covariance  (k, k) of their joint posterior; `newton` (k,) posterior mean, zero for converged slots
    deviance    -2 log marginal likelihood up to a constant of the data: small terms integrated out
    terms       (coefficient, term) of the small terms, after the slots in `columns`, in units of `factors`
    """

    fit: Fit
    by_record: tuple[np.ndarray, ...]
    covariance: np.ndarray
    newton: np.ndarray
    deviance: float
    terms: tuple[tuple[str, str], ...]
    factors: np.ndarray

    @property
    def samples(self) -> int:
        return int(self.fit.linear.seen.sum())


def weigh(fit: Fit, discrepancy: bool = True) -> Evidence:
    """Evidence of a fit; without `discrepancy` the model structure is taken as exact."""
    terms, series, sigma = _small_terms(fit) if discrepancy else ([], np.zeros((*fit.batch.live.shape, 0)), np.zeros(0))
    stations = [fit.model.disturbances.index(f"d{coefficient}") for coefficient, _ in terms]
    small = fit.filter.whiten_histories(stations, series * sigma) if terms else None
    k, by_record = len(fit.slots), []
    for r in range(len(fit.batch.names)):
        slots = fit.columns[:, r].reshape(fit.white[:, r].size, k)
        by_record.append(np.hstack([slots, small[:, r].reshape(len(slots), -1)]) if small is not None else slots)
    gram = sum(gram_of(flat) for flat in by_record) + np.zeros((k + len(terms),) * 2)
    slope = sum(flat.T @ fit.white[:, r].reshape(-1) for r, flat in enumerate(by_record)) + np.zeros(k + len(terms))
    ratio, deviance, covariance, newton = min(
        (_posterior(fit, gram, slope, ratio) for ratio in (_RATIOS if terms else _RATIOS[:1])), key=lambda p: p[1]
    )
    for flat in by_record:
        flat[:, k:] *= ratio
    return Evidence(
        fit=fit,
        by_record=tuple(by_record),
        covariance=covariance,
        newton=newton,
        deviance=deviance,
        terms=tuple(terms),
        factors=ratio * sigma,
    )


def _posterior(
    fit: Fit, gram: np.ndarray, slope: np.ndarray, ratio: float
) -> tuple[float, float, np.ndarray, np.ndarray]:
    """(ratio, deviance, covariance, newton) with small terms of `ratio` times their smallest prior 1-sigma."""
    k, scale = len(fit.slots), np.ones(len(slope))
    scale[k:] = ratio
    information, gradient = gram * scale[:, None] * scale, slope * scale
    information[range(k), range(k)] += fit.prior_weight
    information[range(k, len(scale)), range(k, len(scale))] += 1.0
    gradient[:k] -= fit.prior_pull
    covariance = scaled_inverse(information)
    newton = covariance @ gradient
    deviance = fit.deviance - float(gradient @ newton)
    if len(scale) > k:
        by_slots = information[k:, :k] @ scaled_inverse(information[:k, :k]) @ information[:k, k:] if k else 0.0
        deviance += float(np.linalg.slogdet(information[k:, k:] - by_slots)[1])
    return ratio, deviance, covariance, newton


def deviation(evidence: Evidence, name: str) -> float:
    """Honest 1-sigma of a fitted slot: its `spread`, where small terms of the structure would move the value to, and
    `_KNOWN`, for no value is known better."""
    index = [slot.name for slot in evidence.fit.slots].index(name)
    return float(np.linalg.norm([spread(evidence, name), evidence.newton[index], _KNOWN * evidence.fit[name]]))


def is_sure(evidence: Evidence, name: str) -> bool:
    """Whether no stretch of record contradicts a value, and small terms of the structure could not replace it; a value
    that is not fitted itself is taken as sure."""
    index = next((i for i, slot in enumerate(evidence.fit.slots) if slot.name == name), None)
    if index is None:
        return True
    return abs(evidence.fit[name]) > max(_SURE * spread(evidence, name), abs(float(evidence.newton[index])))


def spread(evidence: Evidence, name: str) -> float:
    """1-sigma of a fitted slot with small terms of the structure allowed for, or how far stretches of record pull it
    apart, if that is more."""
    index = [slot.name for slot in evidence.fit.slots].index(name)
    return max(float(np.sqrt(evidence.covariance[index, index])), scatter(evidence, index))


def scatter(evidence: Evidence, index: int) -> float:
    """1-sigma of a fitted slot from how far stretches of `_STRETCH` pull it apart, whatever makes them disagree.

    The sandwich covariance with stretches as clusters, each weighed up by what it determines of the slot itself (the
    jackknife's: Bell and McCaffrey 2002): without error of the model it is the posterior 1-sigma on average; what is
    left of the aircraft's real structure makes it larger.
    """
    direction, pulls, shares = evidence.covariance[index], [], []
    samples = max(1, round(_STRETCH / float(np.median(evidence.fit.batch.dt))))
    for r, flat in enumerate(evidence.by_record):
        along = (flat @ direction).reshape(evidence.fit.white.shape[0], -1)
        left = evidence.fit.white[:, r] - (flat @ evidence.newton).reshape(along.shape)
        first = np.arange(0, len(along), samples)
        pulls.append(np.add.reduceat((along * left).sum(axis=1), first))
        shares.append(np.add.reduceat((along**2).sum(axis=1), first))
    share = np.concatenate(shares)
    own = np.minimum(share / max(float(share.sum()), 1e-300), _OWN)
    return float(np.linalg.norm(np.concatenate(pulls) / (1.0 - own)))


def gram_of(columns: np.ndarray) -> np.ndarray:
    """columns' columns, at half the cost of the product."""
    if not columns.shape[1]:
        return np.zeros((0, 0))
    (syrk,) = get_blas_funcs(("syrk",), (columns,))
    half = syrk(1.0, columns.T)
    return half + np.triu(half, 1).T


def cross_of(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """left' right, for many columns on the right."""
    found = np.empty((left.shape[1], right.shape[1]))

    def run(first: int, last: int) -> None:
        np.matmul(left.T, right[:, first:last], out=found[:, first:last])

    share_out(right.shape[1], run)
    return found


def coefficient_series(fit: Fit) -> dict[str, np.ndarray]:
    """coefficient -> (N, R) its value along the records, by the fitted derivatives and terms."""
    values = fit.derivatives
    series = {c: np.zeros(fit.batch.live.shape) for c in coefficient_names(fit.flight.aircraft.force_axes)}
    for coefficient, name, term in aerodynamic_parameters(fit.flight.aircraft):
        if name in values and "dot" not in term:
            series[coefficient] = series[coefficient] + values[name] * parse_term(term).evaluate(fit.known)
    return series


def variation(fit: Fit) -> dict[str, float]:
    """Standard deviation of every coefficient along the records."""
    return {c: float(np.std(s[fit.batch.live])) for c, s in coefficient_series(fit).items()}


def unlike_derivatives(fit: Fit, coefficient: str, series: np.ndarray) -> np.ndarray:
    """(N, R, ...) what is left of time histories of a coefficient after regression on its fitted terms."""
    live = fit.batch.live
    present = [
        np.broadcast_to(parse_term(term).evaluate(fit.known), live.shape)[live]
        for c, _, term in aerodynamic_parameters(fit.flight.aircraft)
        if c == coefficient and "dot" not in term
    ]
    basis = np.stack([np.ones(int(live.sum())), *present], axis=1)
    left = np.zeros(series.shape)
    left[live] = series[live] - basis @ np.linalg.lstsq(basis, series[live], rcond=None)[0]
    return left


def _small_terms(fit: Fit) -> tuple[list[tuple[str, str]], np.ndarray, np.ndarray]:
    """Terms that symmetry allows, their series (N, R, n) and the factor that makes each `SMALL`."""
    aircraft = fit.flight.aircraft
    attached = {(a.effect.target, a.effect.term) for a in fit.attached}
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)} | attached
    size = variation(fit)
    terms: list[tuple[str, str]] = []
    series: list[np.ndarray] = []
    factors: list[float] = []
    for coefficient in coefficient_names(aircraft.force_axes):
        if f"d{coefficient}" not in _moved(fit) or size[coefficient] <= 0.0:
            continue
        allowed = [term for term in _symmetric_terms(coefficient) if (coefficient, term) not in present]
        along = [np.broadcast_to(parse_term(term).evaluate(fit.known), fit.batch.live.shape) for term in allowed]
        left = unlike_derivatives(fit, coefficient, np.stack(along, axis=2))
        spread = np.std(left[fit.batch.live], axis=0)
        for term, values, own in zip(allowed, along, spread, strict=True):
            if own > 1e-12:
                terms.append((coefficient, term))
                series.append(values)
                factors.append(SMALL * size[coefficient] / float(own))
    if not terms:
        return [], np.zeros((*fit.batch.live.shape, 0)), np.zeros(0)
    return terms, np.stack(series, axis=2), np.array(factors)


def _moved(fit: Fit) -> set[str]:
    letters = {"full": "LDXZYlmn", "longitudinal": "LDXZm", "lateral": "Yln"}[fit.flight.axes]
    return {f"d{c}" for c in coefficient_names(fit.flight.aircraft.force_axes) if c[1] in letters}


def _symmetric_terms(coefficient: str) -> list[str]:
    """Second order, and third order in one variable, as left-right symmetry of the aircraft allows; the linear terms of
    the own plane. Longitudinal coefficients are even, lateral ones odd in the lateral variables."""
    lateral = coefficient == "CY" or (coefficient in MOMENTS and coefficient != "Cm")
    own = _LATERAL if lateral else _LONGITUDINAL
    products = [(a, b) for a in _LONGITUDINAL for b in _LATERAL] if lateral else []
    if not lateral:
        for group in (_LONGITUDINAL, _LATERAL):
            products += list(combinations_with_replacement(group, 2))
    cubes = [(v, v, v) for v in own] + [("alpha", "alpha", v) for v in own if lateral]
    return [parse_term("*".join(factors)).name for factors in [(v,) for v in own] + products + cubes]
