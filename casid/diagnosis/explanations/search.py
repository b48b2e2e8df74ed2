"""The search: which explanations are worth their weight.

From nothing, and from every port at which something unknown may enter, causes are added one by one, the best of each
number kept; then causes of the best explanations are dropped and others put in their place, until none is better. What
is found does not depend on the order of the causes. Base levels, scales of small terms and levels at further ports are
settings of their own: each that the best explanation asks for is gone through as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from casid.diagnosis.explanations.explanation import Element, Explanation, Unknown, WhitenedInnovations
from casid.diagnosis.explanations.growth import Growth
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.score import (
    Held,
    Sums,
    background,
    hold,
    root_of,
    small_information,
    solved,
    sums_of,
    with_priors,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """What a search found: explanations that are not negligible, best first, none twice.

    without  name of a cause -> the best explanation without it
    nothing  log weight of the best explanation without any cause
    alike    (causes, causes) cosines of the responses to the causes' columns, as far as the background leaves them
    gone     the settings that were gone through, for `further`
    """

    sums: Sums
    priors: Priors
    explanations: tuple[Explanation, ...]
    without: Mapping[str, Explanation]
    nothing: float
    alike: np.ndarray
    gone: _Gone

    @property
    def innovations(self) -> WhitenedInnovations:
        return self.sums.innovations

    def cosine(self, one: str, other: str) -> float:
        """Largest cosine between responses to two causes in any of their shapes; none of what was not asked about."""
        if one == other:
            return 1.0
        at, there = self._columns.get(one), self._columns.get(other)
        return 0.0 if at is None or there is None else float(np.abs(self.alike[np.ix_(at, there)]).max())

    @cached_property
    def _columns(self) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        for i, cause in enumerate(self.innovations.causes):
            found.setdefault(cause.name, []).append(i)
        return found


def search(
    innovations: WhitenedInnovations, priors: Priors, about: Explanation | None = None, settings: int | None = None
) -> Found:
    """The explanations of these innovations that are worth their weight.

    about     an explanation of nearly the same innovations, in whose setting it begins
    settings  that are gone through at most, where a glance will do
    """
    return search_sums(sums_of(innovations, priors.numerics), priors, about, settings)


def search_sums(sums: Sums, priors: Priors, about: Explanation | None = None, settings: int | None = None) -> Found:
    """The same from normal equations that are there already."""
    ones = dict.fromkeys(sums.innovations.owners, priors.bends[0])
    todo: list[_Wanted] = [(level, (), ones) for level in priors.base[:2]]
    if about is not None:
        todo = [(about.setting.level, (), {**ones, **{o: v for o, v in about.setting.scales if o in ones}})]
    gone = _Gone(sums, priors)
    gone.todo = todo
    return _gone_on(gone, settings or priors.numerics.settings)


def further(found: Found) -> Found:
    """The same search through all of its settings."""
    if not found.gone.todo or len(found.gone.done) >= found.priors.numerics.settings:
        return found
    return _gone_on(found.gone, found.priors.numerics.settings)


def _gone_on(gone: _Gone, settings: int) -> Found:
    todo = gone.todo
    while todo and len(gone.done) < settings:
        wanted = todo.pop(0)
        if _named(wanted) not in gone.done:
            gone.through(wanted)
            more = gone.higher(wanted)
            todo += more
            settings += len(more)
        if not todo:
            best = gone.best
            gone.large |= dict(zip(best.unknown, best.large, strict=True))
            todo = gone.todo = [one for one in _wanted_now(gone, best) if _named(one) not in gone.done]
    return gone.found()


_Wanted = tuple[float, tuple[Unknown, ...], dict[str, float]]


def _named(wanted: _Wanted) -> object:
    return *wanted[:2], tuple(sorted(wanted[2].items()))


class _Gone:
    """Settings that were gone through, and what was found in them."""

    def __init__(self, sums: Sums, priors: Priors) -> None:
        self.sums, self.priors = sums, priors
        self.helds: dict[tuple[float, tuple[Unknown, ...]], Held] = {}
        self.done: list[object] = []
        self.todo: list[_Wanted] = []
        self.hopeful: frozenset[str] | None = None  # entrances; all before the first setting
        self.large: dict[Unknown, float] = {}
        self._found: dict[object, Explanation] = {}
        self._without: dict[str, Explanation] = {}
        self._nothing = -np.inf
        self._alike: dict[object, np.ndarray] = {}

    @property
    def best(self) -> Explanation:
        return max(self._found.values(), key=lambda one: one.log)

    def held(self, level: float, loose: tuple[Unknown, ...]) -> Held:
        if (level, loose) not in self.helds:
            self.helds[level, loose] = hold(self.sums, self.priors, level, loose)
        return self.helds[level, loose]

    def through(self, wanted: _Wanted) -> None:
        level, loose, scales = wanted
        self.done.append(_named(wanted))
        back = background(self.sums, self.priors, self.held(level, loose), scales)
        one = Growth(back, self.priors, self.large, self.hopeful)
        known = sorted(self._found.values(), key=lambda one: -one.log)[: self.priors.numerics.changed]
        for explanation in one.run([explanation.elements for explanation in known]):
            key = explanation.setting, explanation.unknown, explanation.elements
            self._found.setdefault(key, explanation)
        self._alike.setdefault(one.setting, back.K)
        for name, other in one.without().items():
            if name not in self._without or other.log > self._without[name].log:
                self._without[name] = other
        self._nothing = max(self._nothing, one.nothing)
        self.hopeful = one.hopeful if self.hopeful is None else self.hopeful | one.hopeful

    def higher(self, wanted: _Wanted) -> list[_Wanted]:
        """The base level above that of a setting, where nothing explains the innovations at those below it."""
        level, loose, scales = wanted
        above = [one for one in self.priors.base if one > level]
        if not above or level < self.priors.base[1] or self.misfit < self.priors.numerics.misfit:
            return []
        return [(above[0], (), scales)] if not loose else []

    @property
    def misfit(self) -> float:
        """Log evidence per reading that the best explanation lacks of what white noise would have."""
        readings = sum(len(record.residual) for record in self.sums.innovations.records)
        white = -0.5 * (readings * (1.0 + np.log(2.0 * np.pi)) + self.sums.innovations.log_determinant)
        return float(white - self.best.log) / max(readings, 1)

    def found(self) -> Found:
        best = self.best
        least = best.log - self.priors.numerics.negligible
        kept = sorted((o for o in self._found.values() if o.log > least), key=lambda one: -one.log)
        K = self._alike[best.setting]
        unit = 1.0 / np.sqrt(np.maximum(np.diag(K), 1e-300))
        return Found(
            sums=self.sums,
            priors=self.priors,
            explanations=tuple(kept),
            without=self._without,
            nothing=self._nothing,
            alike=K * unit[:, None] * unit,
            gone=self,
        )


def _wanted_now(gone: _Gone, best: Explanation) -> list[_Wanted]:
    """The settings that the best explanation asks for: other scales, and what it loosens as a part of all others."""
    level, scales = best.setting.level, dict(best.setting.scales)
    loose = best.unknown[: gone.priors.numerics.loose - 1]
    held = gone.held(level, loose)
    likely, bare = (likely_scales(gone.sums, held, elements, gone.priors) for elements in (best.elements, ()))
    return [(level, loose, wanted) for wanted in (likely, bare, scales)]


def likely_scales(sums: Sums, held: Held, elements: Sequence[Element], priors: Priors) -> dict[str, float]:
    """owner -> scale of the small terms with the largest evidence beside these causes, by coordinate ascent."""
    innovations, k, m = sums.innovations, len(sums.innovations.precision), len(sums.innovations.owners)
    best = dict.fromkeys(innovations.owners, priors.bends[0])
    if not m:
        return best
    common, match = with_priors(innovations, held)
    columns, scale = [e.column for e in elements], np.array([e.scale for e in elements])
    mean = np.array([innovations.causes[c].mean for c in columns])
    others = np.block(
        [
            [common[:k, :k], held.cross[:k, columns]],
            [held.cross[:k, columns].T, held.K[np.ix_(columns, columns)] + np.diag(scale**-2.0)],
        ]
    )
    L, unit = root_of(others, priors.numerics.ridge)
    by = solved(L, unit, np.concatenate([common[:k, k:], held.cross[k:, columns].T]))
    y = solved(L, unit, np.concatenate([match[:k], held.z[columns] + mean / scale**2]))
    square, match = common[k:, k:] - by.T @ by, match[k:] - by.T @ y

    def evidence(of: Mapping[str, float]) -> float:
        prior = small_information(innovations, of)
        L = np.linalg.cholesky(square + prior)
        y = solve_triangular(L, match, lower=True, check_finite=False)
        return 0.5 * float(y @ y) - float(np.log(np.diag(L)).sum()) + 0.5 * float(np.linalg.slogdet(prior)[1])

    most, settled = evidence(best), False
    while not settled:
        settled = True
        for owner in best:
            for bend in priors.bends:
                if (found := evidence(best | {owner: bend})) > most + 1e-9:
                    most, best, settled = found, best | {owner: bend}, False
    return best
