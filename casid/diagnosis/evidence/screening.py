"""Screening: score statistics of all causes of the catalogue, from one linearisation of the fitted model.

The fitted parameters, with their prior, are projected off the fingerprint m of a cause. T = (m'e)^2 / m'm is then the
predicted decrease of the deviance, chi-square distributed with one degree of freedom if the cause is absent. The
predicted size is m'e / m'm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.fingerprints import Fingerprint, fingerprints
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.terms import term_along
from casid.model.effect import Effect


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """A cause with its predicted size."""

    attached: Attached  # the cause with predicted values
    statistic: float  # score statistic: predicted decrease of the deviance
    net: float  # the same less the selection penalty
    value: float  # predicted size
    std: float  # its standard deviation
    surviving: float  # share of the fingerprint that fitted derivatives cannot reproduce

    @property
    def name(self) -> str:
        return self.attached.name


class Screen:
    """Projection off the fitted parameters and small terms, and the selection penalty, for one model.

    With `exact` the structure of the model is taken as exact, and the parameters alone are projected off.
    """

    def __init__(self, evidence: Evidence, exact: bool = False) -> None:
        self.evidence = evidence
        self.base = evidence.fit
        self.criteria = evidence.criteria
        self.covariance = evidence.covariance
        self.newton = evidence.newton
        if exact:
            k = len(evidence.fit.slots)
            self.covariance, self.newton = np.zeros_like(self.covariance), np.zeros_like(self.newton)
            self.covariance[:k, :k] = evidence.fit.covariance
            self.newton[:k] = evidence.fit.covariance @ evidence.fit.gradient
        self.price = float(np.log(max(evidence.samples, 2)))
        slots = len(evidence.fit.slots)
        self._terms = {} if exact else {term: slots + i for i, term in enumerate(evidence.terms)}

    def holding(self, name: str) -> Screen:
        """The same with a fitted parameter held, so that nothing may be made up for by it."""
        slots = [slot.name for slot in self.base.slots]
        if name in slots:
            i = slots.index(name)
            column = self.covariance[:, i] / max(self.covariance[i, i], 1e-300)
            self.newton = self.newton - column * self.newton[i]
            self.covariance = self.covariance - np.outer(column, self.covariance[i])
        return self

    def projected(self, parts: Sequence[Fingerprint], keep: np.ndarray) -> tuple[float, float, float]:
        """(m'm, m'e, surviving share) of a sum of fingerprints; keep (parts, R) are weights of each record."""
        square = sum(float((k**2 * p.square).sum()) for p, k in zip(parts, keep, strict=True))
        cross = sum(k @ p.cross for p, k in zip(parts, keep, strict=True))
        match = sum(float((k * p.match).sum()) for p, k in zip(parts, keep, strict=True))
        spent = float(cross @ self.covariance @ cross)
        step = float(cross @ self.newton)
        own = self._own_term(parts[0].effect)
        if own is not None:
            # The candidate is also one of the small terms. As a cause it is free, so the small term is removed.
            column = self.covariance[own]
            pivot = self.covariance[own, own]
            spent -= float(cross @ column) ** 2 / pivot
            step -= float(cross @ column) * self.newton[own] / pivot
        left = square - spent
        left = left if left > 1e-9 * max(square, 1e-300) else 0.0
        return left, match - step, float(np.sqrt(left / square)) if square > 0 else 0.0

    def drop(self, print_: Fingerprint, r: int) -> float:
        """Predicted decrease of the deviance by a cause of the size of its fingerprint, in record r alone."""
        left, match, _ = self.projected([print_], np.eye(len(print_.square))[[r]])
        return 2.0 * match - left

    def _own_term(self, effect: Effect) -> int | None:
        """Index of the small term that is the same as the effect; None if there is none."""
        return self._terms.get((effect.target, effect.regressor)) if effect.regressor else None

    def score(self, parts: Sequence[Fingerprint], keep: np.ndarray) -> tuple[float, float, float, float]:
        """(statistic, size, its 1-sigma, surviving share); the statistic is zero for a cause that derivatives can
        reproduce. In closed loop the numbers of the file are known well: only their priors separate a cause from them.
        """
        left, match, share = self.projected(parts, keep)
        least = 0.0 if self.base.flight.by_innovations else self.criteria.naming.approximate
        if left <= 0.0 or share < least * _bent(self.base, parts[0].effect):
            return 0.0, 0.0, np.inf, share
        return match**2 / left, match / left, left**-0.5, share


def _bent(base: FlightFit, effect: Effect) -> float:
    """Part of a term of a system that no straight line in states and inputs has; 1 where it is a line itself.

    A square far from its zero is nearly a line, which parameters reproduce. How much of it is left must not depend on
    where its variables have their zero.
    """
    names = base.flight.lines if effect.quasi_steady else ()
    if not names:
        return 1.0
    live = base.batch.live
    term = np.broadcast_to(term_along(effect.regressor or "", base.regressors), live.shape)[live]
    lines = np.stack([np.ones(len(term)), *(base.regressors[name][live] for name in names)], axis=1)
    left = term - lines @ np.linalg.lstsq(lines, term, rcond=None)[0]
    part = np.linalg.norm(left) / max(float(np.linalg.norm(term)), 1e-300)
    return float(part) if part > base.criteria.numerics.rounding else 1.0


def screen(evidence: Evidence, effects: Iterable[Effect], exact: bool = False) -> list[Candidate]:
    """All effects ranked by net score statistic (`Candidate.net`), best first.

    The selection penalty is ln(samples) per parameter, as in the BIC, and 2 ln(places tried) for shapes, onsets and
    subsets of records.
    """
    return rank(Screen(evidence, exact), fingerprints(evidence, effects))


def rank(judge: Screen, prints: Iterable[Fingerprint]) -> list[Candidate]:
    """The fingerprints as candidates, best first: one for each effect, two for an event that may have either sign."""
    by_name: dict[str, list[Fingerprint]] = {}
    for print_ in prints:
        by_name.setdefault(print_.effect.name, []).append(print_)
    found = []
    for group in by_name.values():
        if group[0].effect.timed:
            found += _timed(judge, group)
        elif (best := _untimed(judge, group)) is not None:
            found.append(best)
    return sorted(found, key=lambda c: -c.net)


def predicted_statistics(rankings: Sequence[Sequence[Candidate]]) -> Mapping[Candidate, np.ndarray]:
    """Candidate -> (2,) its predicted statistics in the full model, with the structure taken as exact and with model
    discrepancy; also of one that the kinematics rank."""
    exactly, cautious = ({c.name: c.statistic for c in reversed(ranking)} for ranking in rankings[:2])
    every = [one for ranking in rankings for one in ranking]
    return {one: np.array([exactly.get(one.name, np.inf), cautious.get(one.name, np.inf)]) for one in every}


def _untimed(judge: Screen, prints: Sequence[Fingerprint]) -> Candidate | None:
    """The best of the tried shapes in all records, or in some records for an effect that may change between flights.

    A set of records and its complement explain an effect equally well if it shows only as a difference between records.
    The smaller set is then returned.

    Of an effect that is not linear every tried size has a response of its own. A multiple of it represents a surface
    that does more than the model without the effect makes of it: a play, a lag or a delay that is missing there makes
    its derivatives too small. A reading has no such derivative: a multiple of its response is a larger effect.
    """
    effect = prints[0].effect
    names = np.array(judge.base.batch.names)
    R = len(names)
    least = 1.0 / judge.criteria.data.outlying
    most = 1.0 if effect.series is not None else np.inf
    best: Candidate | None = None
    for one in prints:
        sets = _onset_sets(judge, [one], R) if effect.traits.by_record else []
        some = sorted({tuple(sorted(chosen)) for _, chosen in sets if len(chosen) < R}, key=len)
        whole = (
            [] if effect.traits.relative else [np.ones(R)]
        )  # only the prior of the file would separate it from derivatives
        for keep in (*whole, *(_subset(chosen, R) for chosen in some)):
            statistic, size, std, share = judge.score([one], keep[None])
            if size == 0.0 or (not effect.linear and size < least):
                continue
            tried = len(prints) * (1.0 if keep.all() else 2.0**R - 1.0)
            dof = 1 + (effect.linear and len(one.values) > 0)
            net = statistic - dof * judge.price - 2.0 * np.log(tried)
            records = () if keep.all() else tuple(names[keep > 0].tolist())
            before = best.attached.records if best is not None and effect.traits.relative else ()
            in_more = 0 < len(before) < len(records) and {*before, *records} == {*names.tolist()}
            if best is None or net > best.net + (equivalence(net, judge.criteria) if in_more else 0.0):
                value = size if effect.linear else one.values["value"] * min(size, most)
                attached = Attached(effect=effect, values=dict(one.values) | {"value": value}, records=records)
                best = Candidate(
                    attached=attached,
                    statistic=statistic,
                    net=net,
                    value=value,
                    std=std * abs(value / size),
                    surviving=share,
                )
    return best


def equivalence(gain: float, criteria: Criteria) -> float:
    """Distance of the statistics within which causes are equivalent."""
    return max(criteria.significance.chance, criteria.structure.known * gain)


def _subset(chosen: Iterable[int], R: int) -> np.ndarray:
    """(R,) Weights: one for the chosen records, else zero."""
    keep = np.zeros(R)
    keep[list(chosen)] = 1.0
    return keep


def _timed(judge: Screen, prints: Sequence[Fingerprint]) -> list[Candidate]:
    """The best set of records that share one size, with the onset in each, found by coordinate ascent.

    Both signs are returned for an effect for which an early decrease and a late increase look alike.
    """
    effect = prints[0].effect
    names = judge.base.batch.names
    R = len(prints[0].square)
    best: dict[bool, Candidate] = {}
    for values in effect.further.grid:
        mine = [p for p in prints if p.values is values]
        for parts, chosen in _onset_sets(judge, mine, R):
            keep = np.stack([_subset([r], R) for r in chosen])
            statistic, size, std, share = judge.score(parts, keep)
            dof = 1 + len(values)
            tries = float(len(mine)) ** len(chosen) * 2.0**R * len(effect.further.grid)
            net = statistic - dof * judge.price - 2.0 * np.log(tries)
            sign = size > 0.0 and effect.further.either_sign
            if sign not in best or net > best[sign].net:
                first = {r.name: r.t[0] for r in judge.base.flight.records}
                starts = {
                    names[r]: float(first[names[r]] + (p.onset or 0.0)) for r, p in zip(chosen, parts, strict=True)
                }
                attached = Attached(effect=effect, values=dict(values) | {"value": size}, onsets=starts)
                best[sign] = Candidate(
                    attached=attached,
                    statistic=statistic,
                    net=net,
                    value=size,
                    std=std,
                    surviving=share,
                )
    return list(best.values())


def _onset_sets(judge: Screen, prints: Sequence[Fingerprint], R: int) -> list[tuple[list[Fingerprint], list[int]]]:
    """(fingerprints at their best onsets, records) for single records and larger sets that share one size."""
    sets = grown_sets(R, _ScreeningSums(judge, prints).statistics, judge.criteria.numerics.naming.trials)
    return [([prints[p] for p in chosen.values()], list(chosen)) for chosen in sets]


def grown_sets(
    records: int, statistics: Callable[[Mapping[int, int], Sequence[int]], np.ndarray], starts: int
) -> Iterator[dict[int, int]]:
    """Record -> index of the onset, for single records and for larger sets that share one size.

    Larger sets grow from each of the `starts` records with the largest statistics. The record and onset with the
    largest increase are added, and all onsets are then moved once more. This is necessary because fitted derivatives
    hide an effect that is in most records, so that a single record shows little.

    statistics  (chosen, records) -> (onsets, records) statistic of each onset in a record together with the chosen ones
    """
    alone = statistics({}, range(records))
    singles = [{r: int(np.argmax(alone[:, r]))} for r in range(records)]
    yield from singles
    for first in np.argsort(-alone.max(axis=0), kind="stable")[:starts]:
        chosen = dict(singles[first])
        while len(chosen) < records:
            others = [r for r in range(records) if r not in chosen]
            beside = statistics(chosen, others)
            added, record = np.unravel_index(np.argmax(beside), beside.shape)
            chosen[others[int(record)]] = int(added)
            for r in chosen if len(alone) > 1 else ():
                rest = {s: p for s, p in chosen.items() if s != r}
                chosen[r] = int(np.argmax(statistics(rest, [r])))
            yield dict(chosen)


class _ScreeningSums:
    """Stacked sums of the fingerprints of one effect: the same as `Screen.projected`, for many sets at once."""

    def __init__(self, judge: Screen, prints: Sequence[Fingerprint]) -> None:
        self._square, self._cross = np.stack([p.square for p in prints]), np.stack([p.cross for p in prints])
        self._match = np.stack([p.match for p in prints]) - self._cross @ judge.newton
        self._covariance = judge.covariance
        self._surviving = judge.criteria.naming.approximate
        self._spent = self._cross @ judge.covariance
        self._alone = self._square - np.sum(self._spent * self._cross, axis=2)

    def statistics(self, others: Mapping[int, int], records: Sequence[int]) -> np.ndarray:
        """(prints, records) Statistic of each fingerprint in a record together with the fingerprints `others` by
        record.
        """
        rows = list(others)
        prints = list(others.values())
        fixed = self._cross[prints, rows].sum(axis=0)
        square = self._square[:, records] + self._square[prints, rows].sum()
        left = self._alone[:, records] + self._square[prints, rows].sum()
        left = left - 2.0 * self._spent[:, records] @ fixed - float(fixed @ self._covariance @ fixed)
        match = self._match[:, records] + self._match[prints, rows].sum()
        enough = left > np.maximum(self._surviving**2, 1e-9) * np.maximum(square, 1e-300)
        return np.where(enough, match**2 / np.where(enough, left, 1.0), 0.0)
