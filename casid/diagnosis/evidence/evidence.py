"""Evidence: a fit with model discrepancy integrated out, which screening and acceptance use.

No linear aircraft model is exact. Each coefficient may contain `small_terms`, and the data determine how nonlinear each
coefficient is. What these terms can explain is no evidence for a cause. A term much larger than usual on this aircraft
is still found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import get_blas_funcs

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, all_passed, at_least
from casid.diagnosis.evidence.small_terms import SmallTerms, most_likely_scales, no_terms, small_terms
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings
from casid.model import station
from casid.native.processors import share_out, side_by_side


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """A fit with model discrepancy as nuisance parameters.

    by_record   for each record (samples, k) whitened sensitivities to the fitted parameters and to the small `terms`
    covariance  (k, k) of their joint posterior
    newton      (k,) posterior mean of their changes; zero for converged parameters
    deviance    -2 log marginal likelihood up to a constant of the data, small terms integrated out
    terms       (coefficient, term) of the small terms, in units of `factors`; in `by_record` they follow the parameters
    factors     (terms,) units of the small terms
    scales      coefficient -> prior 1-sigma of its small terms, in units of the smallest: how nonlinear it is
    sums        normal equations behind these results
    """

    fit: FlightFit
    by_record: tuple[np.ndarray, ...]
    covariance: np.ndarray
    newton: np.ndarray
    deviance: float
    terms: tuple[tuple[str, str], ...]
    factors: np.ndarray
    scales: Mapping[str, float]
    sums: EvidenceSums

    @property
    def criteria(self) -> Criteria:
        """The thresholds for all decisions made with this evidence."""
        return self.fit.criteria

    @property
    def samples(self) -> int:
        return self.fit.readings

    @property
    def nonlinear(self) -> bool:
        """Whether a coefficient is more nonlinear than usual."""
        return max(self.scales.values(), default=1.0) > 1.0

    @cached_property
    def left(self) -> np.ndarray:
        """(N, R, ny) Whitened residuals with parameters and small terms fitted."""
        left = self.fit.white.copy()
        for r, flat in enumerate(self.by_record):
            left[:, r] -= (flat @ self.newton).reshape(left[:, r].shape)
        return left

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
    small = small_terms(fit) if discrepancy else no_terms(fit)
    stations = [fit.model.disturbances.index(station.coefficient(coefficient)) for coefficient, _ in small.names]
    white = fit.filter.whiten_histories(stations, small.series * small.factors) if small.names else None
    k, by_record = len(fit.slots), []
    for r in range(len(fit.batch.names)):
        slots = fit.columns[:, r].reshape(fit.white[:, r].size, k)
        by_record.append(np.hstack([slots, white[:, r].reshape(len(slots), -1)]) if white is not None else slots)
    sums = _sums(fit, by_record, small)
    scales = sums.most_likely()
    covariance, newton, deviance = sums.posterior(scales)
    return Evidence(
        fit=fit,
        by_record=tuple(by_record),
        covariance=covariance,
        newton=newton,
        deviance=fit.deviance + deviance,
        terms=small.names,
        factors=small.factors,
        scales=scales,
        sums=sums,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class EvidenceSums:
    """Normal equations of the fitted parameters, prior included, and the small terms.

    gram    (k, k) matrix
    slope   (k,) right-hand side
    alike   prior information of the small terms at a scale of one
    owners  coefficient of each small term
    scales  scales that are tried
    """

    gram: np.ndarray
    slope: np.ndarray
    alike: np.ndarray
    owners: tuple[str, ...]
    scales: tuple[float, ...]

    def most_likely(self) -> dict[str, float]:
        """Coefficient -> scale with the largest marginal likelihood."""
        k = len(self.slope) - len(self.owners)
        by_slots = self.gram[k:, :k] @ scaled_inverse(self.gram[:k, :k]) if k else np.zeros((len(self.owners), 0))
        square = self.gram[k:, k:] - by_slots @ self.gram[:k, k:]
        match = self.slope[k:] - by_slots @ self.slope[:k]
        return most_likely_scales(square, match, self.alike, self.owners, self.scales)

    def information(self, scales: Mapping[str, float]) -> np.ndarray:
        """(k, k) Information on parameters and small terms, priors included."""
        k, scale = len(self.slope) - len(self.owners), np.array([scales[owner] for owner in self.owners])
        found = self.gram.copy()
        found[k:, k:] += self.alike / scale[:, None] / scale
        return found

    def posterior(self, scales: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, float]:
        """Covariance, posterior mean, and change of the deviance by the small terms that are integrated out."""
        k, scale = len(self.slope) - len(self.owners), np.array([scales[owner] for owner in self.owners])
        prior = self.alike / scale[:, None] / scale
        information = self.information(scales)
        covariance = scaled_inverse(information)
        newton = covariance @ self.slope
        deviance = -float(self.slope @ newton)
        if self.owners:
            by_slots = information[k:, :k] @ scaled_inverse(information[:k, :k]) @ information[:k, k:] if k else 0.0
            before, after = np.linalg.slogdet(prior)[1], np.linalg.slogdet(information[k:, k:] - by_slots)[1]
            deviance += float(after - before)
        return covariance, newton, deviance


def _sums(fit: FlightFit, by_record: Sequence[np.ndarray], small: SmallTerms) -> EvidenceSums:
    """The normal equations of a fit with its small terms."""
    k, n = len(fit.slots), len(fit.slots) + len(small.names)
    gram = sum(side_by_side(gram_of, by_record)) + np.zeros((n, n))
    slope = sum(flat.T @ fit.white[:, r].reshape(-1) for r, flat in enumerate(by_record)) + np.zeros(n)
    gram[range(k), range(k)] += fit.prior_weight
    slope[:k] -= fit.prior_pull
    owners = tuple(c for c, _ in small.names)
    return EvidenceSums(gram=gram, slope=slope, alike=small.alike, owners=owners, scales=fit.criteria.structure.scales)


def deviation(evidence: Evidence, name: str, records: Sequence[int] = ()) -> float:
    """Corrected standard deviation of a fitted parameter.

    It is the root of a sum of squares. The parts are the `spread`, or the effect of leaving out whole `records` if that
    is more; the change that the model discrepancy would make; the effect of sampling and input noise (`left_open`); and
    a fraction of the value, because no value is known better.
    """
    index = [slot.name for slot in evidence.fit.slots].index(name)
    apart = max(spread(evidence, name), jackknife(evidence, name, records))
    parts = apart, evidence.newton[index], evidence.criteria.structure.known * evidence.fit[name]
    return float(np.linalg.norm([*parts, *left_open(evidence, index)]))


def left_open(evidence: Evidence, index: int) -> tuple[float, float]:
    """Uncertainty of a parameter due to sampling and noise of the records that its effect is computed from.

    The first number is for the straight lines between samples: a third of the change when every second sample is left
    out, since the error grows with the square of the interval (Richardson). The second is for noise of recorded inputs:
    the change when they are replaced by their most likely values. Both are zero for an effect that uses no records.
    """
    fit, slot = evidence.fit, evidence.fit.slots[index]
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
    fit, names, t, stations = (
        evidence.fit,
        evidence.fit.batch.names,
        evidence.fit.batch.t,
        evidence.fit.model.disturbances,
    )
    change = disturbance_series([one], names, t, known, stations) - disturbance_series(
        [one], names, t, instead, stations
    )
    white = fit.filter.whiten_histories(list(range(len(stations))), change).sum(axis=3)
    if one.effect.output is not None:
        read = [readings([one], names, t, fit.linear.output, fit.model.outputs, some) for some in (known, instead)]
        Y = np.where(fit.linear.seen, read[0] - read[1], 0.0)[..., None]
        white = white + fit.filter.whiten(Y, np.zeros((*fit.linear.defect.shape, 1)))[..., 0]
    pull = sum(flat.T @ white[:, r].reshape(-1) for r, flat in enumerate(evidence.by_record))
    return abs(float(evidence.covariance[index] @ pull))


def _every_second(t: np.ndarray, series: np.ndarray) -> np.ndarray:
    """(N, R) Series of every second sample, with straight lines between them."""
    return np.stack([np.interp(at, at[::2], y[::2]) for at, y in zip(t.T, series.T, strict=True)], axis=1)


def is_sure(evidence: Evidence, name: str, records: Sequence[int] = ()) -> bool:
    """Whether a value passes `sure`."""
    return all_passed(sure(evidence, name, records))


def sure(evidence: Evidence, name: str, records: Sequence[int] = ()) -> tuple[Gate, ...]:
    """The gate on a value that must differ from zero: its 99 % interval, from the corrected deviation, excludes zero.

    A value that is not estimated has no gate.
    """
    if name not in {slot.name for slot in evidence.fit.slots}:
        return ()
    ratio = abs(evidence.fit[name]) / max(deviation(evidence, name, records), 1e-300)
    return (
        at_least(
            "size, in corrected standard deviations", ratio, evidence.criteria.structure.certain, "structure.certain"
        ),
    )


def spread(evidence: Evidence, name: str) -> float:
    """Standard deviation of a parameter with model discrepancy, or its `scatter` between stretches of record if that is
    more.
    """
    index = [slot.name for slot in evidence.fit.slots].index(name)
    return max(float(np.sqrt(evidence.covariance[index, index])), scatter(evidence, index))


def scatter(evidence: Evidence, index: int) -> float:
    """Standard deviation of a parameter from the differences between stretches of record, whatever their reason.

    This is the sandwich covariance with stretches as clusters. Each stretch is weighted up by what it determines of the
    parameter itself, as in the jackknife (Bell and McCaffrey 2002). For a correct model it equals the posterior
    standard deviation on average. Structure of the real aircraft that the model lacks makes it larger.
    """
    direction, pulls, shares = evidence.covariance[index], [], []
    criteria = evidence.criteria.structure
    for r, flat in enumerate(evidence.by_record):
        samples = max(1, round(criteria.stretch / evidence.fit.flight.records[r].dt))
        along = (flat @ direction).reshape(evidence.fit.white.shape[0], -1)
        first = np.arange(0, len(along), samples)
        pulls.append(np.add.reduceat((along * evidence.left[:, r]).sum(axis=1), first))
        shares.append(np.add.reduceat((along**2).sum(axis=1), first))
    share = np.concatenate(shares)
    own = np.minimum(share / max(float(share.sum()), 1e-300), criteria.stretch_part)
    return float(np.linalg.norm(np.concatenate(pulls) / (1.0 - own)))


def jackknife(evidence: Evidence, name: str, records: Sequence[int]) -> float:
    """Standard deviation of a parameter from leaving out whole records, to first order; zero for fewer than three
    records.

    It includes differences between flights that are constant within each flight, which `scatter` does not see.
    """
    index = [slot.name for slot in evidence.fit.slots].index(name)
    if len(records) < 3:
        return 0.0
    information, without = evidence.sums.information(evidence.scales), []
    for r in records:
        flat = evidence.by_record[r]
        others = evidence.sums.slope - flat.T @ evidence.fit.white[:, r].reshape(-1)
        without.append(float((scaled_inverse(information - gram_of(flat)) @ others)[index]))
    n = len(records)
    return float(np.sqrt((n - 1) / n * np.sum((np.array(without) - np.mean(without)) ** 2)))


def gram_of(columns: np.ndarray) -> np.ndarray:
    """Product of the transposed columns with themselves, at half the cost of a general product."""
    if not columns.shape[1]:
        return np.zeros((0, 0))
    (syrk,) = get_blas_funcs(("syrk",), (columns,))
    half = syrk(1.0, columns.T)
    return half + np.triu(half, 1).T


def cross_of(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Product left' right, for many columns on the right."""
    found = np.empty((left.shape[1], right.shape[1]))

    def run(first: int, last: int) -> None:
        np.matmul(left.T, right[:, first:last], out=found[:, first:last])

    share_out(right.shape[1], run)
    return found
