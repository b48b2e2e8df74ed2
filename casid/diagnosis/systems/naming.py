"""Which causes: wholes are fitted, scored and compared by their evidence, until none that has one cause more is better.

A linearisation about a model without the cause says which causes to try. What is compared are the wholes, each fitted
as an extended model and linearised about its own fit, by log p(y | whole) with all that may enter besides it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from casid.diagnosis.explanations.posterior import Posterior, posterior
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.score import Sums, background, gain, hold, sums_of
from casid.diagnosis.explanations.search import search_sums
from casid.diagnosis.systems.cause import CandidateCause, PartOfModel, Run
from casid.diagnosis.systems.columns import SystemEvidence, columns_of
from casid.diagnosis.systems.criteria import SystemCriteria
from casid.diagnosis.systems.extended import Extended
from casid.diagnosis.systems.fit import Fitted, Question, fitted
from casid.diagnosis.systems.library import Library
from casid.model.port import ModelPort as Port


@dataclass(frozen=True, eq=False, kw_only=True)
class Whole:
    """An extended model, fitted and scored; `total` log of its weight with whatever unknown may enter beside it."""

    found: Fitted
    evidence: SystemEvidence
    sums: Sums
    total: float
    criteria: SystemCriteria

    @cached_property
    def promises(self) -> Promises:
        """What each cause by itself promises."""
        return _promises(self.sums, self.evidence.priors)

    @cached_property
    def beyond(self) -> Posterior:
        """What may be wrong besides, of the causes that promise most by themselves."""
        innovations, pool = self.evidence.innovations, self.promises.pool(self.criteria.pool)
        few = replace(innovations, causes=tuple(innovations.causes[i] for i in pool))
        sums = replace(self.sums, innovations=few, picked=tuple(picked[list(pool)] for picked in self.sums.picked))
        return posterior(search_sums(sums, self.evidence.priors))

    @property
    def attached(self) -> tuple[PartOfModel, ...]:
        return self.found.extended.attached

    @property
    def names(self) -> frozenset[str]:
        return frozenset(one.name for one in self.attached)

    def std(self, name: str) -> float:
        """1-sigma of the value of a cause in it."""
        return self.found.fit.parameters[name].std


@dataclass(frozen=True, eq=False, kw_only=True)
class SystemNaming:
    """All wholes that were fitted; the best of them, and what they say together."""

    wholes: tuple[Whole, ...]
    criteria: SystemCriteria

    @cached_property
    def best(self) -> Whole:
        return max(self.wholes, key=lambda one: one.total)

    @cached_property
    def weights(self) -> np.ndarray:
        """(wholes,) probability of each."""
        totals = np.array([one.total for one in self.wholes])
        return np.exp(totals - np.logaddexp.reduce(totals))

    def probability(self, names: Iterable[str]) -> float:
        """Of one of these causes as a part of the model."""
        wanted = set(names)
        weights = [w for w, whole in zip(self.weights, self.wholes, strict=True) if wanted & whole.names]
        return float(min(sum(weights), 1.0))

    def log_odds(self, name: str) -> float:
        """Of the best whole with a cause against the best without it."""
        with_it = [one.total for one in self.wholes if name in one.names]
        without = [one.total for one in self.wholes if name not in one.names]
        return float(max(with_it, default=-np.inf) - max(without, default=-np.inf))

    def rivals(self, name: str) -> tuple[tuple[str, float], ...]:
        """Causes that stand for one of the best whole in others of some weight, with their probabilities."""
        found: dict[str, float] = defaultdict(float)
        rest = self.best.names - {name}
        for weight, whole in zip(self.weights, self.wholes, strict=True):
            if name not in whole.names:
                for other in whole.names - rest:
                    found[other] += float(weight)
        return tuple(sorted(((n, p) for n, p in found.items() if p > self.criteria.member), key=lambda one: -one[1]))

    def unknown(self) -> dict[str, float]:
        """Disturbance -> probability that something unknown enters there in the best model."""
        return dict(self.best.beyond.unknown)

    def without(self, name: str) -> Whole | None:
        """The best whole that has less than the best one, without this cause."""
        others = [one for one in self.wholes if one.names <= self.best.names - {name}]
        return max(others, key=lambda one: one.total, default=None)


def share_of(whole: Whole, one: PartOfModel, question: Question) -> tuple[float, float]:
    """Size of a cause of a whole in units of what matters, and its 1-sigma."""
    value, std = whole.found.values[one.name], whole.std(one.name)
    if one.cause.onset:
        return 1.0 / question.criteria.size.share, 0.0  # nothing is left of a reading that does not move
    if one.cause.history is None or not one.cause.grid:
        return abs(value) / one.matters, std / one.matters
    unit = whole.evidence.matters[str(one.cause.port)]

    def size(at: float) -> float:
        runs = _raw(whole, question) if one.cause.operator else whole.evidence.runs
        history = [one.cause.history(run, at) for run in runs] if one.cause.history else []
        return float(np.sqrt(np.mean(np.concatenate(history) ** 2))) / unit

    return size(value), abs(size(value + std) - size(value - std)) / 2.0


def _raw(whole: Whole, question: Question) -> list[Run]:
    inputs = whole.found.extended.base.inputs
    return [Run(t=r.t, inputs={name: r[name] for name in inputs}, outputs={}, terms={}) for r in question.records]


@dataclass(frozen=True, eq=False, kw_only=True)
class Searching:
    """What a search of wholes stands on."""

    question: Question
    ports: tuple[Port, ...]
    causes: tuple[CandidateCause, ...]
    library: Library

    def naming(self, base: Extended, start: Mapping[str, float], say: Callable[[str], None]) -> SystemNaming | None:
        """Causes added one by one while that makes a better whole, then dropped; None when nothing can be fitted."""
        say("refit")
        criteria = self.question.criteria.systems
        first = self.whole(base, start)
        if first is None:
            return None
        wholes = {_key(base): first}

        def tried(extended: Extended, values: Mapping[str, float]) -> None:
            if _key(extended) not in wholes:
                say("refit with " + ", ".join(one.name for one in extended.attached))
                found = self.whole(extended, values, first.found.fit.cost + criteria.worse)
                if found is not None:
                    wholes[_key(extended)] = found

        current = first
        while len(current.attached) < criteria.most:
            for look in (_leaders, _believed):
                for one in look(current):
                    tried(current.found.extended.with_cause(one), current.found.values)
                best = max(wholes.values(), key=lambda one: one.total)
                if best is not current:
                    break
            if best is current:
                break
            current = best
        for one in current.attached if len(current.attached) > 1 else ():
            tried(current.found.extended.without(one.name), current.found.values)
        return SystemNaming(wholes=tuple(wholes.values()), criteria=criteria)

    def whole(self, extended: Extended, start: Mapping[str, float], most: float = np.inf) -> Whole | None:
        """An extended model fitted and scored; None when it cannot be fitted to a cost of `most`, or its motion
        ran off so far that it has no slopes."""
        known = {name: value for name, value in start.items() if name in extended.model.parameters}
        found = fitted(extended, self.question, known)
        if found is None or found.fit.cost > most:
            return None
        taken = {one.name for one in extended.attached}
        driven = {one.cause.target for one in extended.attached if one.cause.operator}
        causes = [c for c in self.causes if c.name not in taken and not (c.operator and c.target in driven)]
        try:
            evidence = columns_of(found, self.question, self.ports, causes, self.library)
        except np.linalg.LinAlgError:
            return None
        sums = sums_of(evidence.innovations, evidence.priors.numerics)
        total = sum(one.log_prior for one in found.extended.attached) + _alone(sums, evidence)
        return Whole(found=found, evidence=evidence, sums=sums, total=total, criteria=self.question.criteria.systems)


def _alone(sums: Sums, evidence: SystemEvidence) -> float:
    """Log weight of a whole by itself and with something unknown at its ports, but with no further cause."""
    none = replace(evidence.innovations, causes=())
    bare = replace(sums, innovations=none, picked=tuple(np.zeros(0, dtype=int) for _ in sums.picked))
    return float(np.logaddexp.reduce([one.log for one in search_sums(bare, evidence.priors).explanations]))


def _key(extended: Extended) -> tuple:
    return tuple(sorted((one.name, one.records, tuple(one.onset_s)) for one in extended.attached))


@dataclass(frozen=True, eq=False, kw_only=True)
class Promises:
    """What causes promise by themselves, each at each of its scales: log odds against nothing, without anything unknown
    (`alone`) and with the best unknown history (`joint`, which has the log odds `unknown` by itself)."""

    column: np.ndarray
    alone: np.ndarray
    joint: np.ndarray
    unknown: float
    sizes: np.ndarray

    def pool(self, most: int) -> tuple[int, ...]:
        """Columns of the causes that promise most, so many of each ranking, in the order of the columns."""
        ranked = [self.column[np.argsort(-of, kind="stable")].tolist() for of in (self.alone, self.joint)]
        return tuple(sorted({column for of in ranked for column in list(dict.fromkeys(of))[:most]}))


def _promises(sums: Sums, priors: Priors) -> Promises:
    causes = sums.innovations.causes
    entries = [(i, s) for i, cause in enumerate(causes) for s in cause.scales]
    at, scale = np.array([i for i, _ in entries], dtype=int), np.array([s for _, s in entries])
    mean = np.array([causes[i].mean for i in at])
    prior = np.array([causes[i].log_prior - np.log(len(causes[i].scales)) for i in at])
    back = background(sums, priors, hold(sums, priors, priors.base[-1]), {})
    diagonal = np.maximum(np.diag(back.K), 0.0)
    alone = gain(back.z[at], diagonal[at], mean, scale) + prior
    joint, unknown = alone, 0.0
    for entrance in sums.innovations.entrances:
        for one in back.loosened(entrance, priors):
            z, K = back.z - one.f.T @ (one.d * one.a), np.maximum(diagonal - one.d @ one.f**2, 0.0)
            of_it = one.log + one.log_prior
            joint = np.maximum(joint, of_it + gain(z[at], K[at], mean, scale) + prior)
            unknown = max(unknown, of_it)
    value = np.array([causes[i].value for i in at])
    sizes = (scale**2 * back.z[at] + mean) / (1.0 + scale**2 * diagonal[at]) * value
    return Promises(column=at, alone=alone, joint=joint, unknown=unknown, sizes=sizes)


def _leaders(whole: Whole) -> list[PartOfModel]:
    """The causes that promise most by themselves, with something unknown at one of the ports and without."""
    said, found = whole.promises, dict[str, PartOfModel]()
    for promise, floor in ((said.alone, 0.0), (said.joint, said.unknown)):
        names: set[str] = set()
        for k in np.argsort(-promise, kind="stable").tolist():
            if len(names) == whole.criteria.tried or promise[k] < floor + whole.criteria.promise:
                break
            one = whole.evidence.attachable[said.column[k]]
            if one.name not in names:
                names.add(one.name)
                found.setdefault(one.name, _part(one, float(said.sizes[k]), whole.evidence.priors))
    return list(found.values())


def _believed(whole: Whole) -> list[PartOfModel]:
    """The causes that a search of all that may be wrong besides believes in."""
    believed = [b for b in whole.beyond.causes if b.probability > whole.criteria.worth][: whole.criteria.tried]
    number = {id(column): i for i, column in enumerate(whole.evidence.innovations.causes)}
    return [_part(whole.evidence.attachable[number[id(b.column)]], b.size, whole.evidence.priors) for b in believed]


def _part(one: PartOfModel, size: float, priors: Priors) -> PartOfModel:
    """A cause as a part of the model: one that enters linearly with the prior of its size nearest to it."""
    if one.cause.grid:
        return one
    sizes = np.array(priors.sizes) * one.matters
    spread = float(sizes[np.argmin(np.abs(np.log(sizes / max(abs(size), 1e-300))))])
    return replace(one, value=size, spread=spread, log_prior=one.log_prior - float(np.log(len(sizes))))
