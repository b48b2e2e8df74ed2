"""Score every cause of the catalogue at once, from one linearisation of the fitted baseline.

The fitted slots are projected off the fingerprint m of a cause, their prior included. Then T = (m'e)^2 / m'm is the
predicted drop of the deviance, chi-square with one degree of freedom when the cause is absent. Its predicted size is
m'e / m'm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.fingerprints import Fingerprint, fingerprints
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.effect import Effect


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """A cause with its predicted size.

    statistic  predicted drop of the deviance;  net: less the price of its parameters and of the `tries`: places tried
    attached   ready to be fitted
    surviving  share of the fingerprint that fitted derivatives cannot imitate
    """

    attached: Attached
    statistic: float
    net: float
    dof: int
    value: float
    std: float
    surviving: float
    tries: float

    @property
    def name(self) -> str:
        return self.attached.name


class Screen:
    """Projection off the fitted slots and the small terms, and prices, for one baseline; `exact` takes the structure of
    the model as exact and projects off the slots alone."""

    def __init__(self, evidence: Evidence, exact: bool = False) -> None:
        self.evidence, self.base, self.criteria = evidence, evidence.fit, evidence.criteria
        self.covariance, self.newton = evidence.covariance, evidence.newton
        if exact:
            k = len(evidence.fit.slots)
            self.covariance, self.newton = np.zeros_like(self.covariance), np.zeros_like(self.newton)
            self.covariance[:k, :k] = evidence.fit.covariance
            self.newton[:k] = evidence.fit.covariance @ evidence.fit.gradient
        self.price = float(np.log(max(evidence.samples, 2)))
        slots = len(evidence.fit.slots)
        self._terms = {} if exact else {term: slots + i for i, term in enumerate(evidence.terms)}

    def projected(self, parts: Sequence[Fingerprint], keep: np.ndarray) -> tuple[float, float, float]:
        """(m'm, m'e, surviving share) of the sum of fingerprints; keep (parts, R) weights of each record."""
        square = sum(float((k**2 * p.square).sum()) for p, k in zip(parts, keep, strict=True))
        cross = sum(k @ p.cross for p, k in zip(parts, keep, strict=True))
        match = sum(float((k * p.match).sum()) for p, k in zip(parts, keep, strict=True))
        spent, step = float(cross @ self.covariance @ cross), float(cross @ self.newton)
        own = self._own_term(parts[0].effect)
        if own is not None:
            # the candidate is one of the small terms: as a cause it is free, so its nuisance twin must go
            column, pivot = self.covariance[own], self.covariance[own, own]
            spent -= float(cross @ column) ** 2 / pivot
            step -= float(cross @ column) * self.newton[own] / pivot
        left = square - spent
        left = left if left > 1e-9 * max(square, 1e-300) else 0.0
        return left, match - step, float(np.sqrt(left / square)) if square > 0 else 0.0

    def drop(self, print_: Fingerprint, r: int) -> float:
        """Predicted drop of the deviance by a cause of the size that its fingerprint stands for, in record r alone."""
        left, match, _ = self.projected([print_], np.eye(len(print_.square))[[r]])
        return 2.0 * match - left

    def _own_term(self, effect: Effect) -> int | None:
        return self._terms.get((effect.target, effect.regressor)) if effect.regressor else None

    def score(self, parts: Sequence[Fingerprint], keep: np.ndarray) -> tuple[float, float, float, float]:
        """(statistic, size, its 1-sigma, surviving share); zero statistic for what derivatives imitate fully."""
        left, match, share = self.projected(parts, keep)
        if left <= 0.0 or share < self.criteria.screening.surviving:
            return 0.0, 0.0, np.inf, share
        return match**2 / left, match / left, left**-0.5, share


def screen(evidence: Evidence, effects: Iterable[Effect], exact: bool = False) -> list[Candidate]:
    """All effects ranked by predicted drop of the deviance less its price (`Candidate.net`), best first.

    The price is ln(samples) per parameter, as in the BIC, and 2 ln(places tried) for shapes, onsets and subsets.
    """
    return rank(Screen(evidence, exact), fingerprints(evidence, effects))


def rank(judge: Screen, prints: Iterable[Fingerprint]) -> list[Candidate]:
    """The fingerprints as candidates, one an effect (two for an event of either sign), best first."""
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


def _untimed(judge: Screen, prints: Sequence[Fingerprint]) -> Candidate | None:
    """The best of the tried shapes, in all records or, for what may change between flights, in some. What only shows as
    a difference between records, which a set and all the others tell equally well, is in the fewer."""
    effect, names = prints[0].effect, np.array(judge.base.batch.names)
    R, criteria, longest = len(names), judge.criteria.screening, judge.criteria.numerics.screening.longest_start
    best: Candidate | None = None
    for one in prints:
        sets = _onset_sets(judge, [one], R) if effect.by_record else []
        some = sorted({tuple(sorted(chosen)) for _, chosen in sets if len(chosen) < R}, key=len)
        for keep in (np.ones(R), *(_subset(chosen, R) for chosen in some)):
            statistic, size, std, share = judge.score([one], keep[None])
            if size == 0.0 or (not effect.linear and not criteria.smallest_size < size < criteria.largest_size):
                continue
            tried = len(prints) * (1.0 if keep.all() else 2.0**R - 1.0)
            dof = 1 + (effect.linear and len(one.values) > 0)
            net = statistic - dof * judge.price - 2.0 * np.log(tried)
            records = () if keep.all() else tuple(names[keep > 0].tolist())
            before = best.attached.records if best is not None and effect.relative else ()
            in_more = 0 < len(before) < len(records) and {*before, *records} == {*names.tolist()}
            if best is None or net > best.net + (equivalence(net, judge.criteria) if in_more else 0.0):
                value = size if effect.linear else one.values["value"] * min(size, longest)
                attached = Attached(effect=effect, values=dict(one.values) | {"value": value}, records=records)
                best = Candidate(
                    attached=attached,
                    statistic=statistic,
                    net=net,
                    dof=dof,
                    value=value,
                    std=std * abs(value / size),
                    surviving=share,
                    tries=tried,
                )
    return best


def equivalence(gain: float, criteria: Criteria) -> float:
    """Distance in gain within which causes are one set."""
    return max(criteria.screening.equivalent, criteria.screening.equivalent_part * gain)


def _subset(chosen: Iterable[int], R: int) -> np.ndarray:
    keep = np.zeros(R)
    keep[list(chosen)] = 1.0
    return keep


def _timed(judge: Screen, prints: Sequence[Fingerprint]) -> list[Candidate]:
    """The set of records that share one size, and the onset in each: best of all sets, by coordinate ascent, of either
    sign where a loss early and a gain late resemble each other."""
    effect = prints[0].effect
    names, R = judge.base.batch.names, len(prints[0].square)
    best: dict[bool, Candidate] = {}
    for values in effect.grid:
        mine = [p for p in prints if p.values is values]
        for parts, chosen in _onset_sets(judge, mine, R):
            keep = np.stack([_subset([r], R) for r in chosen])
            statistic, size, std, share = judge.score(parts, keep)
            dof = 1 + len(values)
            tries = float(len(mine)) ** len(chosen) * 2.0**R * len(effect.grid)
            net = statistic - dof * judge.price - 2.0 * np.log(tries)
            sign = size > 0.0 and effect.either_sign
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
                    dof=dof,
                    value=size,
                    std=std,
                    surviving=share,
                    tries=tries,
                )
    return list(best.values())


def _onset_sets(judge: Screen, prints: Sequence[Fingerprint], R: int) -> list[tuple[list[Fingerprint], list[int]]]:
    """(fingerprints at their best onsets, records) for single records and larger sets that share one size."""
    sets = grown_sets(R, _ScreeningSums(judge, prints).statistics, judge.criteria.numerics.screening.starts)
    return [([prints[p] for p in chosen.values()], list(chosen)) for chosen in sets]


def grown_sets(
    records: int, statistics: Callable[[Mapping[int, int], Sequence[int]], np.ndarray], starts: int
) -> Iterator[dict[int, int]]:
    """Record -> number of the onset, for single records and for larger sets that share one size.

    statistics  (what is chosen, records) -> (onsets, records) statistic of each onset in a record beside that

    Larger sets grow from each of the `starts` records that say most by the record and onset that add most, all onsets
    then moved once more. The fitted derivatives hide a loss that is in most records, so that single records say little.
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
    """Sums of fingerprints of one effect over records, stacked: what `Screen.projected` does, for many sets at once."""

    def __init__(self, judge: Screen, prints: Sequence[Fingerprint]) -> None:
        self._square, self._cross = np.stack([p.square for p in prints]), np.stack([p.cross for p in prints])
        self._match = np.stack([p.match for p in prints]) - self._cross @ judge.newton
        self._covariance, self._surviving = judge.covariance, judge.criteria.screening.surviving
        self._spent = self._cross @ judge.covariance
        self._alone = self._square - np.sum(self._spent * self._cross, axis=2)

    def statistics(self, others: Mapping[int, int], records: Sequence[int]) -> np.ndarray:
        """(prints, records) statistic of each fingerprint in a record beside the fingerprints `others` by record."""
        rows, prints = list(others), list(others.values())
        fixed = self._cross[prints, rows].sum(axis=0)
        square = self._square[:, records] + self._square[prints, rows].sum()
        left = self._alone[:, records] + self._square[prints, rows].sum()
        left = left - 2.0 * self._spent[:, records] @ fixed - float(fixed @ self._covariance @ fixed)
        match = self._match[:, records] + self._match[prints, rows].sum()
        enough = left > np.maximum(self._surviving**2, 1e-9) * np.maximum(square, 1e-300)
        return np.where(enough, match**2 / np.where(enough, left, 1.0), 0.0)


def smallest_sizes(
    judge: Screen, prints: Iterable[Fingerprint], candidates: Iterable[Candidate], sigmas: float
) -> dict[str, float]:
    """Name -> smallest size in all records that stands out by so many `sigmas`, aerodynamic terms apart; infinite where
    derivatives imitate it at any size.

    Of an effect that sets in at a time, at the best onset of its candidate. Left out are those that are the weaker the
    larger their value is, like a limit.
    """
    by_name = groupby(sorted(prints, key=lambda p: p.effect.name), key=lambda p: p.effect.name)
    sizes = {name: _smallest(judge, list(of), sigmas) for name, of in by_name}
    sizes |= {c.name: sigmas * c.std for c in candidates if c.attached.effect.timed and c.attached.effect.linear}
    return {name: float(size) for name, size in sizes.items() if size is not None}


def _smallest(judge: Screen, prints: Sequence[Fingerprint], sigmas: float) -> float | None:
    """Of one effect: of the tried sizes and shapes, by the one that is nearest to where it stands out."""
    effect = prints[0].effect
    if effect.timed or effect.quasi_steady or effect.members or (not effect.linear and "value" not in effect.grid[0]):
        return None
    everywhere = np.ones((1, len(prints[0].square)))
    tried = np.array([1.0 if effect.linear else abs(one.values["value"]) for one in prints])
    shown = np.array([_sigmas(judge, one, everywhere) for one in prints])
    if not shown.any():
        return np.inf
    if not effect.linear and shown[np.argmax(tried)] < shown[np.argmin(tried)]:
        return None
    # between sizes that were tried it is taken as growing in proportion
    reached = np.array([size * sigmas / s if s > 0.0 else np.inf for size, s in zip(tried, shown, strict=True)])
    if effect.linear:
        return reached.min()
    nearest = reached[np.argmin(np.abs(np.log(reached / tried)))]
    return max(nearest, judge.criteria.screening.smallest_size * tried.min())  # below, a screening takes it for another


def _sigmas(judge: Screen, one: Fingerprint, everywhere: np.ndarray) -> float:
    """By how many 1-sigmas the response to the size that was tried differs from what derivatives can imitate."""
    left, _, share = judge.projected([one], everywhere)
    return float(np.sqrt(left)) if share >= judge.criteria.screening.surviving else 0.0
