"""The search: which explanations are worth their weight.

From nothing, and from every port at which something unknown may enter, causes are added one by one, the best of each
number kept. Then causes of the best explanations are dropped and others put in their place, until none is better. What
is found does not depend on the order of the causes. Base levels, scales of small terms and levels at further ports are
settings of their own: each that the best explanation asks for is gone through as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
    with_priors,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """What a search found: explanations that are not negligible, best first, none twice.

    without  name of a cause -> the best explanation without it
    alike    (causes, causes) cosines of the responses to the causes' columns, as far as the background leaves them
    """

    sums: Sums
    priors: Priors
    explanations: tuple[Explanation, ...]
    without: Mapping[str, Explanation]
    alike: np.ndarray

    @property
    def innovations(self) -> WhitenedInnovations:
        return self.sums.innovations


def search_sums(sums: Sums, priors: Priors) -> Found:
    """The explanations of innovations, by their normal equations, that are worth their weight."""
    ones = dict.fromkeys(sums.innovations.owners, priors.bends[0])
    gone, settings = _Gone(sums, priors), priors.numerics.settings
    todo: list[_Wanted] = [(level, (), ones) for level in priors.base[:2]]
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
            todo = [one for one in _wanted_now(gone, best) if _named(one) not in gone.done]
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
        self.hopeful: frozenset[str] | None = None  # entrances; all before the first setting
        self.large: dict[Unknown, float] = {}
        self._found: dict[object, Explanation] = {}
        self._without: dict[str, Explanation] = {}
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
            alike=K * unit[:, None] * unit,
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
