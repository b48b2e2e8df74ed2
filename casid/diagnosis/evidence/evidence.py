"""Evidence: a fit with model discrepancy integrated out, which screening and acceptance use.

No linear aircraft model is exact. Each coefficient may contain `small_terms`, and the data determine how nonlinear each
coefficient is. What these terms can explain is no evidence for a cause. A term much larger than usual on this aircraft
is still found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from casid.diagnosis import comparisons as ask
from casid.diagnosis.comparisons import Gate
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.evaluation import FlightFit, Gram, scaled_inverse
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings
from casid.filtering.kernel import SAMPLES, WHOLE
from casid.model import station
from casid.model.path import MOMENTS
from casid.model.terms import parse_term


def coefficient_series(fit: FlightFit) -> dict[str, np.ndarray]:
    """Coefficient -> (N, R) its value along the records, from the file's own aerodynamics, derivatives and fitted
    terms.
    """
    values = fit.derivatives
    nothing = np.zeros(fit.batch.live.shape)
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
    live = fit.batch.live
    regressors = fit.regressors if regressors is None else regressors
    present = [
        np.broadcast_to(parse_term(term).evaluate(regressors), live.shape)[live]
        for c, _, term in fit.flight.terms
        if c == coefficient and "dot" not in term
    ]
    basis = np.stack([np.ones(int(live.sum())), *present], axis=1)
    left = np.zeros(series.shape)
    left[live] = series[live] - basis @ np.linalg.lstsq(basis, series[live], rcond=None)[0]
    return left


_LONGITUDINAL = ("alpha", "q", "delta_e")
_LATERAL = ("beta", "p", "r", "delta_a", "delta_r")


@dataclass(frozen=True, eq=False, kw_only=True)
class SmallTerms:
    """The small terms for a fit."""

    names: tuple[tuple[str, str], ...]  # (coefficient, term) of each
    factors: np.ndarray  # (n,) value of each that alone makes the small part of the variation of its coefficient
    series: np.ndarray  # (N, R, n) time histories of the terms at these values
    # (n, n) correlations, within a coefficient, of the parts that fitted terms do not contain: the inverse of the prior
    # covariance of the values, in units of `factors`, at a scale of one
    alike: np.ndarray


def no_terms(fit: FlightFit) -> SmallTerms:
    """No small terms: the structure of the model is exact."""
    nothing = np.zeros((*fit.batch.live.shape, 0))
    return SmallTerms(names=(), factors=np.zeros(0), series=nothing, alike=np.eye(0))


def small_terms(fit: FlightFit) -> SmallTerms:
    """All terms that symmetry allows and the model of the fit lacks."""
    prior = fit.criteria.structure.small
    rounding = fit.criteria.numerics.rounding
    present = {(c, term) for c, _, term in fit.flight.terms}
    present |= {(a.effect.target, a.effect.regressor or "") for a in fit.attached}
    names: list[tuple[str, str]] = []
    factors: list[np.ndarray] = []
    series: list[np.ndarray] = []
    blocks: list[np.ndarray] = []
    for coefficient, size in variation(fit).items():
        if coefficient not in fit.flight.moved or size <= 0.0:
            continue
        allowed = [term for term in _symmetric_terms(coefficient) if (coefficient, term) not in present]
        whole = series_of(fit, allowed)
        left = unlike_derivatives(fit, coefficient, whole)[fit.batch.live]
        spread = np.std(left, axis=0)
        rests = np.array([rounding ** parse_term(term).degree for term in allowed])
        varies = np.flatnonzero(spread > np.maximum(rounding * np.abs(whole[fit.batch.live]).max(axis=0), rests))
        unit = left[:, varies] / spread[varies]
        names += [(coefficient, allowed[i]) for i in varies]
        factors.append(prior * size / spread[varies])
        series.append(whole[..., varies] * factors[-1])
        ridge = fit.criteria.structure.known  # some terms are nearly the sum of others
        blocks.append((unit.T @ unit / len(unit) + ridge * np.eye(len(varies))) / (1.0 + ridge))
    if not names:
        return no_terms(fit)
    return SmallTerms(
        names=tuple(names),
        factors=np.concatenate(factors),
        series=np.concatenate(series, axis=2),
        alike=np.asarray(block_diag(*blocks)),
    )


def series_of(fit: FlightFit, terms: Sequence[str]) -> np.ndarray:
    """(N, R, terms) Time histories of terms along a fit."""
    along = [np.broadcast_to(parse_term(term).evaluate(fit.regressors), fit.batch.live.shape) for term in terms]
    return np.stack(along, axis=2)


def most_likely_scales(
    square: np.ndarray, match: np.ndarray, alike: np.ndarray, owners: Sequence[str], scales: Sequence[float]
) -> dict[str, float]:
    """Owner -> the scale with the largest marginal likelihood (empirical Bayes), by coordinate descent.

    square, match  (n, n), (n,) Normal equations of the small terms, all other parameters eliminated
    alike          (n, n) Their prior information at a scale of one
    """
    n = len(match)
    root = np.linalg.cholesky(alike)
    match = solve_triangular(root, match, lower=True)
    square = without_rounding(solve_triangular(root, solve_triangular(root, square, lower=True).T, lower=True))

    def deviance(of: dict[str, float]) -> float:
        scale = np.array([of[owner] for owner in owners])
        factor = np.linalg.cholesky(np.eye(n) + square * scale[:, None] * scale)
        pulled = solve_triangular(factor, match * scale, lower=True, check_finite=False)
        return 2.0 * float(np.sum(np.log(np.diag(factor)))) - float(pulled @ pulled)

    best = dict.fromkeys(owners, scales[0])
    lowest = deviance(best)
    for _ in range(len(best) * len(scales)):  # a few suffice
        before = lowest
        for owner in best:
            for scale in scales:
                if (found := deviance(best | {owner: scale})) < lowest:
                    lowest = found
                    best = best | {owner: scale}
        if lowest == before:
            break
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """A fit with model discrepancy as nuisance parameters."""

    fit: FlightFit
    covariance: np.ndarray  # (k, k) of their joint posterior
    newton: np.ndarray  # (k,) posterior mean of the small terms, and of the changes of the parameters beside them
    deviance: float  # -2 log marginal likelihood up to a constant of the data, small terms integrated out
    terms: tuple[tuple[str, str], ...]  # (coefficient, term) of the small terms, in units of `factors`
    factors: np.ndarray  # (terms,) units of the small terms
    # coefficient -> prior 1-sigma of its small terms, in units of the smallest: how nonlinear it is
    scales: Mapping[str, float]
    sums: EvidenceSums  # normal equations behind these results

    @property
    def criteria(self) -> Criteria:
        """The thresholds for all decisions made with this evidence."""
        return self.fit.criteria

    @property
    def samples(self) -> int:
        return self.fit.readings

    @property
    def nonlinear(self) -> bool:
        """Return True if a coefficient is more nonlinear than usual."""
        return max(self.scales.values(), default=1.0) > 1.0

    @property
    def series(self) -> np.ndarray:
        """(N, R, terms) Time histories of the small terms."""
        kept = self.fit.kept.arrays
        if (mine := ("series", self.terms)) not in kept:
            kept[mine] = series_of(self.fit, [term for _, term in self.terms]) * self.factors
        return kept[mine]

    @property
    def left(self) -> np.ndarray:
        """(N, R, ny) Whitened residuals with parameters and small terms fitted."""
        kept = self.fit.kept.arrays
        if (mine := ("left", self.terms)) not in kept:
            kept[mine] = self.fit.white - self.along(self.newton)
        return kept[mine]

    def lighter(self) -> Evidence:
        """The evidence of a copy of the fit that has no time histories."""
        fit = self.fit.without_histories()
        fit.kept.small["evidence"] = dict(self.fit.kept.small.get("evidence", {}))
        return replace(self, fit=fit)

    def in_records(self) -> Iterator[tuple[slice, Evidence]]:
        """(records, evidence of their time histories) A few records at a time, so many that their arrays are small
        beside those of the fit; estimates and sums are those of all records.
        """
        N, R = self.fit.batch.live.shape
        together = max(1, WHOLE // N)
        if together >= R:
            yield slice(None), self
            return
        for first in range(0, R, together):
            some = slice(first, first + together)
            yield some, replace(self, fit=self.fit.of_records(some))

    def columns(self, together: int) -> Iterator[tuple[int, np.ndarray]]:
        """(number of the first, (R, N, ny, columns)) Whitened innovations and sensitivities to the fitted parameters,
        then to the small terms, so many at a time.
        """
        fit = self.fit
        stations = self._stations
        yield 0, np.concatenate([fit.white[..., None], fit.columns], axis=3).swapaxes(0, 1)
        for first in range(0, len(stations), together):
            some = slice(first, first + together)
            white = fit.filter.whiten_histories(stations[some], self.series[..., some])
            yield 1 + len(fit.slots) + first, white.swapaxes(0, 1)

    def products(self, white: np.ndarray) -> np.ndarray:
        """(R, k, n) Products of whitened columns (N, R, ny, n) with the sensitivities to parameters and small terms."""
        rows = white.swapaxes(0, 1)
        found = [self._of_slots.swapaxes(1, 2) @ rows.reshape(*self._of_slots.shape[:2], -1)]
        if self.terms:
            acting = np.unique(self._stations)
            entering, _ = self.fit.filter.entrances(acting, rows.copy(), read=False)
            for station, part in zip(acting, entering, strict=True):
                found.append(self.series[..., self._stations == station].transpose(1, 2, 0) @ part)
        return np.concatenate(found, axis=1)

    def along(self, direction: np.ndarray) -> np.ndarray:
        """(N, R, ny) Sum of the whitened sensitivities times a direction (k,)."""
        (N, R, ny), k = self.fit.white.shape, len(self.fit.slots)
        found = (self._of_slots @ direction[:k]).reshape(R, N, ny).swapaxes(0, 1)
        if self.terms:
            acting = np.unique(self._stations)
            entering = self.series @ np.where(self._stations[:, None] == acting, direction[k:, None], 0.0)
            found = found + self.fit.filter.whiten_histories(acting, entering, [0])[..., 0]
        return found

    @cached_property
    def _stations(self) -> np.ndarray:
        """(terms,) Index of the disturbance where each small term enters."""
        return _stations(self.fit, self.terms)

    @property
    def _of_slots(self) -> np.ndarray:
        """(R, N ny, slots) Whitened sensitivities to the fitted parameters."""
        N, R, ny = self.fit.white.shape
        return self.fit.columns.swapaxes(0, 1).reshape(R, N * ny, len(self.fit.slots))

    @property
    def small_information(self) -> np.ndarray:
        """Inverse of the prior covariance of the small terms, in units of `factors`, at a scale of one."""
        return self.sums.alike

    def deviance_at_scales(self, scales: Mapping[str, float]) -> float:
        """The deviance if no coefficient were more nonlinear than `scales`."""
        least = {c: min(scale, scales.get(c, scale)) for c, scale in self.scales.items()}
        return self.fit.deviance + self.sums.posterior(least)[2]


def weigh(fit: FlightFit, discrepancy: bool = True) -> Evidence:
    """The evidence of a fit; without `discrepancy` the model structure is taken as exact."""
    known = fit.kept.small.setdefault("evidence", {})  # several stages ask for it
    if discrepancy not in known:
        known[discrepancy] = _weighed(fit, small_terms(fit) if discrepancy else no_terms(fit))
    return Evidence(fit=fit, **known[discrepancy])


def _weighed(fit: FlightFit, small: SmallTerms) -> dict[str, Any]:
    """The parts of `Evidence` beside the fit."""
    sums = _sums(fit, small)
    scales = sums.most_likely()
    covariance, newton, deviance = sums.posterior(scales)
    return {
        "covariance": covariance,
        "newton": newton,
        "deviance": fit.deviance + deviance,
        "terms": small.names,
        "factors": small.factors,
        "scales": scales,
        "sums": sums,
    }


def _stations(fit: FlightFit, terms: Sequence[tuple[str, str]]) -> np.ndarray:
    """(terms,) Index of the disturbance where each small term enters."""
    names = [station.coefficient(coefficient) for coefficient, _ in terms]
    return np.array([fit.model.disturbances.index(name) for name in names], dtype=int)


@dataclass(frozen=True, eq=False, kw_only=True)
class EvidenceSums:
    """Normal equations of the fitted parameters, prior included, and the small terms."""

    grams: np.ndarray  # (R, k, k) matrix of the readings of each record
    slopes: np.ndarray  # (R, k) right-hand side of the readings of each record
    gram: np.ndarray  # (k, k) matrix, prior of the parameters included
    slope: np.ndarray  # (k,) right-hand side, prior of the parameters included
    alike: np.ndarray  # prior information of the small terms at a scale of one
    owners: tuple[str, ...]  # coefficient of each small term
    scales: tuple[float, ...]  # scales that are tried

    def most_likely(self) -> dict[str, float]:
        """Coefficient -> scale with the largest marginal likelihood."""
        k = len(self.slope) - len(self.owners)
        by_slots = self.gram[k:, :k] @ scaled_inverse(self.gram[:k, :k]) if k else np.zeros((len(self.owners), 0))
        square = self.gram[k:, k:] - by_slots @ self.gram[:k, k:]
        match = self.slope[k:] - by_slots @ self.slope[:k]
        return most_likely_scales(square, match, self.alike, self.owners, self.scales)

    def information(self, scales: Mapping[str, float]) -> np.ndarray:
        """(k, k) Information on parameters and small terms, priors included."""
        k = len(self.slope) - len(self.owners)
        scale = np.array([scales[owner] for owner in self.owners])
        found = self.gram.copy()
        found[k:, k:] += self.alike / scale[:, None] / scale
        return found

    def posterior(self, scales: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, float]:
        """Covariance, posterior mean, and change of the deviance by the small terms that are integrated out."""
        k = len(self.slope) - len(self.owners)
        scale = np.array([scales[owner] for owner in self.owners])
        prior = self.alike / scale[:, None] / scale
        information = self.information(scales)
        covariance = scaled_inverse(information)
        newton = covariance @ self.slope
        deviance = -float(self.slope @ newton)
        if self.owners:
            by_slots = information[k:, :k] @ scaled_inverse(information[:k, :k]) @ information[:k, k:] if k else 0.0
            before = np.linalg.slogdet(prior)[1]
            after = np.linalg.slogdet(information[k:, k:] - by_slots)[1]
            deviance += float(after - before)
        return covariance, newton, deviance


def _sums(fit: FlightFit, small: SmallTerms) -> EvidenceSums:
    """The normal equations of a fit with its small terms, summed over parts of the records that stay in the cache."""
    (N, R, ny), k, n = fit.white.shape, len(fit.slots), len(small.names)
    grams = np.zeros((R, k + n, k + n))
    slopes = np.zeros((R, k + n))
    columns = fit.columns.swapaxes(0, 1).reshape(R, N * ny, k)
    white = fit.white.swapaxes(0, 1).reshape(R, N * ny)
    grams[:, :k, :k] = fit.grams
    slopes[:, :k] = fit.pulls
    together = SAMPLES
    stations = _stations(fit, small.names)
    squares = [Gram(n) for _ in range(R)]
    for first, part in fit.filter.histories_in_parts(stations, small.series, together) if n else ():
        rows = slice(first * ny, (first + part.shape[1]) * ny)
        for r, terms in enumerate(one.reshape(-1, n) for one in part):
            squares[r].add(terms)
            grams[r, k:, :k] += terms.T @ columns[r, rows]
            slopes[r, k:] += white[r, rows] @ terms
    grams[:, k:, k:] = [square.whole for square in squares]
    grams[:, :k, k:] = grams[:, k:, :k].swapaxes(1, 2)
    gram = grams.sum(axis=0)
    slope = slopes.sum(axis=0)
    gram[range(k), range(k)] += fit.prior_weight
    slope[:k] -= fit.prior_pull
    return EvidenceSums(
        grams=grams,
        slopes=slopes,
        gram=gram,
        slope=slope,
        alike=small.alike,
        owners=tuple(c for c, _ in small.names),
        scales=fit.criteria.structure.scales,
    )


def deviation(evidence: Evidence, name: str, records: Sequence[int] = ()) -> float:
    """Corrected standard deviation of a fitted parameter.

    It is the root of a sum of squares. The parts are the standard deviation with model discrepancy, or the `scatter`
    between stretches of record, or the effect of leaving out whole `records`, whichever is most; the change that the
    model discrepancy would make; the effect of sampling and input noise (`left_open`); and a fraction of the value,
    because no value is known better.
    """
    index = [slot.name for slot in evidence.fit.slots].index(name)
    along = np.eye(len(evidence.newton))[index]
    slope = deviation_along(evidence, along, evidence.fit[name], jackknife(evidence, name, records))
    return float(np.linalg.norm([slope, *left_open(evidence, index)]))


def deviation_along(evidence: Evidence, along: np.ndarray, value: float, least: float = 0.0) -> float:
    """Corrected standard deviation of a sum of parameters and small terms with factors `along` (k,), which is `value`
    (see `deviation`); `least` is one by leaving out records.
    """
    std = float(np.sqrt(max(along @ evidence.covariance @ along, 0.0)))
    apart = max(std, scatter(evidence, along), least)
    moved = float(along @ evidence.newton)
    return math.hypot(apart, moved, evidence.criteria.structure.known * value)


def straight_lines(evidence: Evidence) -> np.ndarray:
    """(slots, k) Factors of parameters and small terms in the derivative of each slot, as a model without these terms
    has it: the straight line that is nearest along the records.

    A small term has a slope of its own. The derivative beside it is the slope where the term vanishes, which neither a
    file without the term means nor records determine.
    """
    fit = evidence.fit
    k = len(evidence.fit.slots)
    number = {slot.name: i for i, slot in enumerate(fit.slots)}
    live = fit.batch.live
    lines = np.eye(k, len(evidence.newton))
    for coefficient in evidence.scales:
        mine = [k + j for j, (owner, _) in enumerate(evidence.terms) if owner == coefficient]
        present = {term: name for c, name, term in fit.flight.terms if c == coefficient and "dot" not in term}
        bent = series_of(fit, [evidence.terms[j - k][1] for j in mine]) * evidence.factors[[j - k for j in mine]]
        basis = series_of(fit, ["0", *(term for term in present if term != "0")])
        slopes = np.linalg.lstsq(basis[live], bent[live], rcond=None)[0]
        for name, slope in zip((present.get("0"), *(n for t, n in present.items() if t != "0")), slopes, strict=True):
            if name in number:
                lines[number[name], mine] = slope
    return lines


def left_open(evidence: Evidence, index: int) -> tuple[float, float]:
    """Uncertainty of a parameter due to sampling and noise of the records that its effect is computed from.

    The first number is for the straight lines between samples: a third of the change when every second sample is left
    out, since the error grows with the square of the interval (Richardson). The second is for noise of recorded inputs:
    the change when they are replaced by their most likely values. Both are zero for an effect that uses no records.
    """
    fit = evidence.fit
    slot = evidence.fit.slots[index]
    one = None if slot.attached is None else fit.attached[slot.attached]
    if one is None or (one.effect.series is None and one.effect.output is None):
        return 0.0, 0.0
    made = fit.known | fit.flight.regressors(fit.model).recorded
    coarse = {name: _every_second(fit.batch.t, series) for name, series in made.items()}
    return _moved(evidence, index, one, coarse, made) / 3.0, _moved(evidence, index, one, fit.known, made)


def _moved(
    evidence: Evidence, index: int, one: Attached, known: dict[str, np.ndarray], instead: dict[str, np.ndarray]
) -> float:
    """Change of a parameter if its effect is computed from other time histories."""
    fit = evidence.fit
    names = evidence.fit.batch.names
    t = evidence.fit.batch.t
    stations = evidence.fit.model.disturbances
    change = disturbance_series([one], names, t, known, stations) - disturbance_series(
        [one], names, t, instead, stations
    )
    white = fit.filter.whiten_histories(list(range(len(stations))), change).sum(axis=3)
    if one.effect.output is not None:
        read = [readings([one], names, t, fit.linear.output, fit.model.outputs, some) for some in (known, instead)]
        Y = np.where(fit.linear.seen, read[0] - read[1], 0.0)[..., None]
        white = white + fit.filter.whiten(Y, np.zeros((*fit.linear.defect.shape, 1)))[..., 0]
    pull = evidence.products(white[..., None]).sum(axis=0)[:, 0]
    return abs(float(evidence.covariance[index] @ pull))


def _every_second(t: np.ndarray, series: np.ndarray) -> np.ndarray:
    """(N, R) Series of every second sample, with straight lines between them."""
    return np.stack([np.interp(at, at[::2], y[::2]) for at, y in zip(t.T, series.T, strict=True)], axis=1)


def is_sure(evidence: Evidence, name: str) -> bool:
    """Return True if zero is more than three corrected deviations away from a value, or the value is not estimated."""
    return all(gate.passed for gate in sure(evidence, name))


def sure(evidence: Evidence, name: str, records: Sequence[int] = ()) -> tuple[Gate, ...]:
    """The gate on a value that must differ from zero; none for a value that is not estimated."""
    if name not in {slot.name for slot in evidence.fit.slots}:
        return ()
    ratio = abs(evidence.fit[name]) / max(deviation(evidence, name, records), 1e-300)
    return (ask.SURE.of(ratio, evidence.criteria.significance.sigmas, "significance.chance"),)


def scatter(evidence: Evidence, along: np.ndarray) -> float:
    """Standard deviation of a sum of parameters with factors `along` (k,) from the differences between stretches of
    record, whatever their reason.

    This is the sandwich covariance with stretches as clusters. Each stretch is weighted up by what it determines of the
    sum itself, as in the jackknife (Bell and McCaffrey 2002). For a correct model it equals the posterior
    standard deviation on average. Structure of the real aircraft that the model lacks makes it larger.
    """
    along = evidence.along(evidence.covariance @ along)
    pulls = []
    shares = []
    criteria = evidence.criteria
    for r, record in enumerate(evidence.fit.flight.records):
        first = np.arange(0, len(along), max(1, round(criteria.structure.stretch / record.dt)))
        pulls.append(np.add.reduceat((along[:, r] * evidence.left[:, r]).sum(axis=1), first))
        shares.append(np.add.reduceat((along[:, r] ** 2).sum(axis=1), first))
    share = np.concatenate(shares)
    own = np.minimum(share / max(float(share.sum()), 1e-300), criteria.parts.most)
    return float(np.linalg.norm(np.concatenate(pulls) / (1.0 - own)))


def jackknife(evidence: Evidence, name: str, records: Sequence[int]) -> float:
    """Standard deviation of a parameter from leaving out whole records, to first order; zero for fewer than three
    records.

    It includes differences between flights that are constant within each flight, which `scatter` does not see.
    """
    index = [slot.name for slot in evidence.fit.slots].index(name)
    if len(records) < 3:
        return 0.0
    sums = evidence.sums
    information = evidence.sums.information(evidence.scales)
    without = []
    for r in records:
        found = scaled_inverse(information - sums.grams[r]) @ (sums.slope - sums.slopes[r])
        without.append(float(found[index]))
    n = len(records)
    return float(np.sqrt((n - 1) / n * np.sum((np.array(without) - np.mean(without)) ** 2)))
