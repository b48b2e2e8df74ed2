"""The causes that compete: the best of every ranking of the catalogue, in all of their shapes, with their priors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.screening import Candidate, Screen, rank
from casid.diagnosis.explanations.explanation import CauseColumn
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.naming.events import configuration_changes
from casid.diagnosis.naming.size import meaningful_share, plausible
from casid.diagnosis.numerics import ScoreNumerics
from casid.model.effect import Effect


@dataclass(frozen=True, eq=False, kw_only=True)
class Competitor:
    """A cause in one of its shapes: attached at unit amplitude (at its whole, where it is not linear), the column that
    it competes as, and the statistic that ranked it."""

    one: Attached
    column: CauseColumn


@dataclass(frozen=True, eq=False, kw_only=True)
class Pool:
    """What competes, and the `ranking` of the whole catalogue by one cause at a time."""

    competitors: tuple[Competitor, ...] = ()
    ranking: tuple[Candidate, ...] = ()


def pool_of(evidence: Evidence, priors: Priors, banned: Collection[str] = ()) -> Pool:
    """Causes that are not in the fit already, nor `banned`: found impossible."""
    base = evidence.fit
    there = {a.effect.key for a in base.attached}
    every = base.flight.effects
    effects = [e for e in every if e.key not in there and e.name not in banned]
    of_kind, kinds = Counter(e.kind for e in every), len({e.kind for e in every})
    found: list[Competitor] = []
    seen: set[object] = set()
    candidates, ranking = _ranked(evidence, effects, priors.numerics)
    for candidate in candidates:
        for one in _shapes(base, candidate):
            key = one.name, one.records, tuple(sorted(one.onsets.items())), tuple(sorted(one.values.items()))
            if key in seen:
                continue
            seen.add(key)
            share = meaningful_share(base, one)
            if not np.isfinite(share) or share <= 0.0:
                continue
            log_prior = priors.cause(kinds, max(of_kind[one.effect.kind], 1)) + _shape_prior(
                base, candidate, one, priors
            )
            found.append(Competitor(one=one, column=_column(base, one, 1.0 / share, log_prior, priors)))
    return Pool(competitors=tuple(found), ranking=tuple(ranking))


def _column(base: FlightFit, one: Attached, matters: float, log_prior: float, priors: Priors) -> CauseColumn:
    """The column of a cause that is not in the fit; its shape is filled in with the responses."""
    linear = one.effect.linear and not one.effect.members
    return CauseColumn(
        name=one.name,
        kind=one.effect.kind,
        shape={},
        mean=0.0 if linear else 1.0,
        scales=tuple(matters * s for s in priors.sizes) if linear else (priors.grid,),
        log_prior=log_prior,
        matters=matters,
        value=one.values["value"],
    )


def _ranked(
    evidence: Evidence, effects: Sequence[Effect], numerics: ScoreNumerics
) -> tuple[list[Candidate], list[Candidate]]:
    """The best with small terms allowed for and without, the best of every kind, switches, and events finely; and all
    of the catalogue, small terms allowed for."""
    found: dict[object, Candidate] = {}

    def add(candidates: Iterable[Candidate]) -> None:
        for c in candidates:
            key = c.name, tuple(sorted(c.attached.onsets.items())), c.attached.records, tuple(c.attached.values)
            found.setdefault(key, c)

    prints = fingerprints(evidence, effects)
    rankings = [rank(Screen(evidence, exact), prints) for exact in (False, True)]
    for ranking in rankings:
        add(ranking[: numerics.ranked])
        number: Counter[str] = Counter()
        for c in ranking:
            number[c.attached.effect.kind] += 1
            if number[c.attached.effect.kind] <= numerics.of_a_kind:
                add([c])
    timed = sorted((c for c in found.values() if c.attached.effect.timed), key=lambda c: -c.statistic)
    for c in timed[: numerics.timed]:
        add(_finely(evidence, c, numerics))
    if not any(a.effect.members for a in evidence.fit.attached):
        add(configuration_changes(evidence))
    return list(found.values()), rankings[0]


def _finely(evidence: Evidence, coarse: Candidate, numerics: ScoreNumerics) -> list[Candidate]:
    """An event with its onsets, and how long it takes, on a finer grid about the best of a coarse one."""
    effect, base = coarse.attached.effect, evidence.fit
    extent = next((k for k in ("length", "duration") if np.isfinite(coarse.attached.values.get(k, np.inf))), None)
    if extent is not None:
        effect = replace(effect, grid=tuple({extent: coarse.attached.values[extent] * f} for f in (0.75, 1.0, 1.33)))
    first = {record.name: record.t[0] for record in base.flight.records}
    since = [t - first[name] for name, t in coarse.attached.onsets.items()]
    near, step = numerics.onset_near, numerics.onset_step
    onsets = np.unique(np.round([t + d for t in since for d in np.arange(-near, near + step / 2, step)], 2))
    found = rank(Screen(evidence), fingerprints(evidence, [effect], onsets[onsets > numerics.onset_edge]))
    return [replace(one, tries=coarse.tries) for one in found[:1]]


def _shapes(base: FlightFit, candidate: Candidate) -> list[Attached]:
    """In the records that the ranking found and in all of them, at every point of the grid of a non-linear size."""
    one, effect = candidate.attached, candidate.attached.effect
    if effect.members:  # coefficients that switch together, at their joint sizes
        return [one] if plausible(one) else []
    values = [{**one.values, "value": 1.0}] if effect.linear else [dict(v) for v in effect.grid]
    return [
        Attached(effect=effect, values=v, onsets=one.onsets, records=records)
        for records in dict.fromkeys((one.records, ()))
        for v in values
    ]


def _shape_prior(base: FlightFit, candidate: Candidate, one: Attached, priors: Priors) -> float:
    """Log odds of this shape among those of its cause."""
    effect, records = one.effect, len(base.batch.names)
    log = float(np.log(priors.improbable)) if effect.improbable else 0.0
    if effect.members:
        log -= 0.5 * (candidate.dof - 1) * float(np.log(base.readings))
    if effect.timed:
        return log - float(np.log(candidate.tries))
    if effect.by_record and records > 1:
        log -= float(np.log(2.0)) + (float(np.log(2.0**records - 2.0)) if one.records else 0.0)
    return log - (float(np.log(len(effect.grid))) if not effect.linear else 0.0)


def unit_of(base: FlightFit, one: Attached) -> Mapping[str, float]:
    """Of an attached effect the smallest value that matters, and how many of it its value is."""
    share = meaningful_share(base, one)
    value = abs(one.values["value"])
    return {"share": share, "matters": value / share if share > 0.0 and np.isfinite(share) else np.inf}
