"""Score every cause of the catalogue at once, from one linearisation of the fitted baseline.

The fingerprint m of a cause is the whitened response of the linearised, filtered aircraft to a unit of it. With the
fitted slots eliminated (their Gram matrix, prior included), statistic T = (m'e)^2 / m'm is the predicted drop of the
deviance, chi-square with one degree of freedom when the cause is absent, and m'e / m'm its predicted size. Fingerprints
are kept record by record, so that a cause that is in some records only costs no further pass.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy import stats

from casid.diagnosis.evaluation import Fit
from casid.diagnosis.evidence import Evidence, cross_of
from casid.diagnosis.hypothesis import Attached, disturbance_series, readings, station_series
from casid.estimation.innovations import linearise
from casid.estimation.processors import side_by_side
from casid.model.effect import Effect
from casid.model.terms import parse_term

_AT_ONCE, _LEAST, _MOST = 1.8e6, 24, 96  # numbers of whitened responses, and responses, that are in memory together
ONSET_STEP, _FINE_UP_TO = 1.0, 30.0  # s, between onsets, and length of a record up to which they are as near as asked
EDGE = 1.0  # s from either end of a record: what sets in nearer to it has always been there, or never
STARTS = 4  # records from which sets of records grow
_EQUIVALENT = (10.0, 0.005)  # absolute and relative distance in gain within which causes are one set
_SURVIVING = 0.02  # below this share a fingerprint is a combination of fitted derivatives


@dataclass(frozen=True, eq=False, kw_only=True)
class Fingerprint:
    """Sums over each record of the whitened response m to one cause: square (R,), cross with the fitted slots (R, k),
    and with the residual (R,)."""

    effect: Effect
    values: Mapping[str, float]
    onset: float | None
    square: np.ndarray
    cross: np.ndarray
    match: np.ndarray


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

    @property
    def p_value(self) -> float:
        """Chance of such a statistic without the cause, all tries counted (Bonferroni), on white Gaussian noise."""
        return float(min(1.0, self.tries * stats.chi2.sf(self.statistic, self.dof)))


_Row = tuple[Effect, Mapping[str, float], float | None]  # an effect, its further values, and its onset


class Screen:
    """Projection off the fitted slots and the small terms, and prices, for one baseline; `exact` takes the structure of
    the model as exact and projects off the slots alone."""

    def __init__(self, evidence: Evidence, exact: bool = False) -> None:
        self.evidence, self.base = evidence, evidence.fit
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
        if left <= 0.0 or share < _SURVIVING:
            return 0.0, 0.0, np.inf, share
        return match**2 / left, match / left, left**-0.5, share


def fingerprints(evidence: Evidence, effects: Iterable[Effect], onsets: np.ndarray | None = None) -> list[Fingerprint]:
    """The fingerprints of effects on the whole grid of their further values and onsets.

    onsets  [s] after each record's first sample; default `onset_grid` over the longest record
    """
    effects, base = list(effects), evidence.fit
    rows: list[_Row] = []
    for effect in effects:
        for values in effect.grid:
            if not effect.timed:
                rows.append((effect, values, None))
                continue
            at = onset_grid(evidence, ONSET_STEP, values.get("length", np.inf)) if onsets is None else onsets
            rows += [(effect, values, float(onset)) for onset in at]
    rows.sort(key=lambda row: row[2] or 0.0)  # what has not begun yet needs no work
    symbolic = _symbolic_columns(base, [e for e, _, _ in rows if e.symbolic and not e.quasi_steady])
    direct = [row for row in rows if not _a_history(row[0])]
    known = [row for row in rows if _a_history(row[0])]

    def some(of: Sequence[_Row]) -> list[Fingerprint]:
        white = _white_histories(base, of) if _a_history(of[0][0]) else _white_direct(base, of, symbolic)
        return _fingerprints(evidence, of, white)

    together = _together(base)
    parts = [of[at : at + together] for of in (known, direct) for at in range(0, len(of), together)]
    return [print_ for found in side_by_side(some, parts) for print_ in found]


def onset_grid(evidence: Evidence, step: float, length: float = np.inf) -> np.ndarray:
    """Onsets [s] after a record's first sample to look at, `step` apart, and further in long records, so that the work
    grows as the records do; but no further than an event of that `length` takes."""
    longest = max(record.duration for record in evidence.fit.flight.records)
    wider = max(step, min(step * longest / _FINE_UP_TO, length))
    return np.arange(EDGE, longest - EDGE, wider)


def _a_history(effect: Effect) -> bool:
    """Whether an effect is time histories at disturbances of the model."""
    return effect.quasi_steady or (effect.series is not None and not effect.symbolic)


def _fingerprints(evidence: Evidence, rows: Sequence[_Row], white: np.ndarray) -> list[Fingerprint]:
    """Of the whitened responses to the rows (last samples, R, ny, rows), zero before."""
    before = evidence.fit.white[: len(evidence.fit.white) - len(white), 0].size
    parts = [white[:, r].reshape(-1, len(rows)) for r in range(white.shape[1])]
    square = np.stack([np.einsum("kj,kj->j", w, w) for w in parts])
    cross = np.stack([cross_of(c[before:], w) for c, w in zip(evidence.by_record, parts, strict=True)])
    match = np.stack([evidence.fit.white[:, r].reshape(-1)[before:] @ w for r, w in enumerate(parts)])
    return [
        Fingerprint(effect=e, values=v, onset=o, square=square[:, j], cross=cross[:, :, j], match=match[:, j])
        for j, (e, v, o) in enumerate(rows)
    ]


def _symbolic_columns(base: Fit, effects: Sequence[Effect]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """name -> (Y, F) of symbolic effects, from the Jacobians of a model that has them all at their null."""
    already = [a.effect for a in base.attached]
    effects = [e for e in effects if e.name not in {a.name for a in already}]
    if not effects:
        return {}
    model = base.flight.model([*already, *effects])
    P = np.tile(model.nominal_vector(), (len(base.batch.names), 1))
    P[:, [model.parameters.index(name) for name in base.model.parameters]] = base.parameters
    names = [e.name for e in effects]
    linear = linearise(base.flight.functions(model, names), base.batch, P, base.linear.X, base.moving)
    return {name: (linear.Dp[..., i], linear.Bp[..., i]) for i, name in enumerate(names)}


def _white_histories(base: Fit, rows: Sequence[_Row]) -> np.ndarray:
    """`_whitened` responses to a unit of effects that are time histories."""
    histories, index = [], base.model.disturbances.index
    for effect, values, onset in rows:
        if effect.quasi_steady:
            term = parse_term(effect.regressor or "0").evaluate(base.regressors)
            found = {f"d{effect.target}": np.broadcast_to(term, base.batch.live.shape)}
        else:
            found = station_series(_unit(effect, values, onset, base), base.batch.names, base.batch.t, base.known)
        histories.append({index(station): series for station, series in found.items()})
    return _whitened(base, histories)


def history(base: Fit, one: Attached) -> np.ndarray:
    """(N, R, nw) what an effect puts on the stations of a fit."""
    return disturbance_series([one], base.batch.names, base.batch.t, base.known, base.model.disturbances)


def _by_station(W: np.ndarray) -> dict[int, np.ndarray]:
    """Station -> (N, R) time history, of those of (N, R, nw) that act; one if none does. Copies: W is large."""
    acting = np.flatnonzero(W.any(axis=(0, 1)))
    return {int(s): W[..., s].copy() for s in (acting if len(acting) else [0])}


def _whitened(base: Fit, histories: Sequence[Mapping[int, np.ndarray]]) -> np.ndarray:
    """(last samples, R, ny, histories) whitened responses to time histories by station, from where the first of them
    begins."""
    stations = [station for one in histories for station in one]
    series = np.stack([h for one in histories for h in one.values()], axis=2)
    parts = np.array([len(one) for one in histories])
    begins = int(np.argmax(series.any(axis=(1, 2))))
    return base.filter.whiten_histories(stations, series, np.cumsum(parts) - parts)[begins:]


def prints_of(evidence: Evidence, effect: Effect, histories: Iterable[np.ndarray]) -> list[Fingerprint]:
    """The fingerprints of time histories (N, R, nw), as those of an effect."""
    found, following = [], map(_by_station, histories)
    while some := list(islice(following, _together(evidence.fit))):
        found += _fingerprints(evidence, [(effect, {}, None)] * len(some), _whitened(evidence.fit, some))
    return found


def _together(base: Fit) -> int:
    """Responses that are in memory at a time."""
    return int(np.clip(_AT_ONCE / base.white.size, _LEAST, _MOST))


def _white_direct(base: Fit, rows: Sequence[_Row], symbolic: Mapping) -> np.ndarray:
    """(N, R, ny, rows) whitened responses to a unit of effects in the model's equations, from their Jacobians, and of
    effects on readings, to the whole of one that is not linear."""
    seen, shape = base.linear.seen, base.linear.defect.shape
    outputs, states = [], {}
    for i, (effect, values, onset) in enumerate(rows):
        if effect.symbolic:
            Y, F = symbolic.get(effect.name, (np.zeros(base.read.shape), np.zeros(shape)))
            outputs.append(Y)
            states[i] = F
            continue
        one, output = _unit(effect, values, onset, base), base.read
        read = readings([one], base.batch.names, base.batch.t, output, base.model.outputs, base.known)
        outputs.append(np.where(seen, read - output, 0.0))
    F = np.zeros((*shape, len(rows)))
    for i, state in states.items():
        F[..., i] = state
    # by way of rows: columns written one by one take twice the time
    Y = np.stack(outputs).reshape(len(rows), -1).T.reshape(*base.read.shape, len(rows))
    return base.filter.whiten(Y, F)


def _unit(effect: Effect, values: Mapping[str, float], onset: float | None, base: Fit) -> Attached:
    """The effect at unit amplitude in every record, its onset counted from each record's first sample."""
    onsets = {r.name: r.t[0] + onset for r in base.flight.records} if onset is not None else {}
    return Attached(effect=effect, values={"value": 1.0} | dict(values), onsets=onsets)


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
    R = len(names)
    best: Candidate | None = None
    for one in prints:
        sets = _onset_sets(judge, [one], R) if effect.by_record else []
        some = sorted({tuple(sorted(chosen)) for _, chosen in sets if len(chosen) < R}, key=len)
        for keep in (np.ones(R), *(_subset(chosen, R) for chosen in some)):
            statistic, size, std, share = judge.score([one], keep[None])
            if size == 0.0 or (not effect.linear and not 0.3 < size < 3.0):
                continue
            tried = len(prints) * (1.0 if keep.all() else 2.0**R - 1.0)
            dof = 1 + (effect.linear and len(one.values) > 0)
            net = statistic - dof * judge.price - 2.0 * np.log(tried)
            records = () if keep.all() else tuple(names[keep > 0].tolist())
            before = best.attached.records if best is not None and effect.relative else ()
            in_more = 0 < len(before) < len(records) and {*before, *records} == {*names.tolist()}
            if best is None or net > best.net + (equivalence(net) if in_more else 0.0):
                value = size if effect.linear else one.values["value"] * min(size, 1.5)
                attached = Attached(effect=effect, values=dict(one.values) | {"value": value}, records=records)
                best = Candidate(
                    attached=attached, statistic=statistic, net=net, dof=dof, value=value, std=std * abs(value / size),
                    surviving=share, tries=tried,
                )  # fmt: skip
    return best


def equivalence(gain: float) -> float:
    """Distance in gain within which causes are one set."""
    return max(_EQUIVALENT[0], _EQUIVALENT[1] * gain)


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
                    attached=attached, statistic=statistic, net=net, dof=dof, value=size, std=std, surviving=share,
                    tries=tries,
                )  # fmt: skip
    return list(best.values())


def _onset_sets(judge: Screen, prints: Sequence[Fingerprint], R: int) -> list[tuple[list[Fingerprint], list[int]]]:
    """(fingerprints at their best onsets, records) for single records and larger sets that share one size.

    Larger sets grow from each of the `STARTS` records that say most by the record and onset that add most, all onsets
    then moved once more: the fitted derivatives hide a loss that is in most records, so that single records say little.
    """
    sums = _Sums(judge, prints)
    alone = sums.statistics({})
    singles = [{r: int(np.argmax(alone[:, r]))} for r in range(R)]
    sets = list(singles)
    for first in np.argsort(-alone.max(axis=0), kind="stable")[:STARTS]:
        chosen = dict(singles[first])
        while len(chosen) < R:
            beside = sums.statistics(chosen)
            beside[:, list(chosen)] = -np.inf
            added, record = np.unravel_index(np.argmax(beside), beside.shape)
            chosen[int(record)] = int(added)
            for r in chosen if len(prints) > 1 else ():
                others = {s: p for s, p in chosen.items() if s != r}
                chosen[r] = int(np.argmax(sums.statistics(others, [r])))
            sets.append(dict(chosen))
    return [([prints[p] for p in chosen.values()], list(chosen)) for chosen in sets]


class _Sums:
    """Sums of fingerprints of one effect over records, stacked: what `Screen.projected` does, for many sets at once."""

    def __init__(self, judge: Screen, prints: Sequence[Fingerprint]) -> None:
        self._square, self._cross = np.stack([p.square for p in prints]), np.stack([p.cross for p in prints])
        self._match = np.stack([p.match for p in prints]) - self._cross @ judge.newton
        self._covariance = judge.covariance
        self._spent = self._cross @ judge.covariance
        self._alone = self._square - np.sum(self._spent * self._cross, axis=2)

    def statistics(self, others: Mapping[int, int], records: Sequence[int] | slice = slice(None)) -> np.ndarray:
        """(prints, records) statistic of each fingerprint in a record beside the fingerprints `others` by record."""
        rows, prints = list(others), list(others.values())
        fixed = self._cross[prints, rows].sum(axis=0)
        square = self._square[:, records] + self._square[prints, rows].sum()
        left = self._alone[:, records] + self._square[prints, rows].sum()
        left = left - 2.0 * self._spent[:, records] @ fixed - float(fixed @ self._covariance @ fixed)
        match = self._match[:, records] + self._match[prints, rows].sum()
        enough = left > np.maximum(_SURVIVING**2, 1e-9) * np.maximum(square, 1e-300)
        return np.where(enough, match**2 / np.where(enough, left, 1.0), 0.0)
