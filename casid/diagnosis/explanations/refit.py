"""Refit the strongest and score again, until nothing is added; then the best rivals as wholes.

A linearisation about the file says which causes lead; how much of what else it finds is its own error shows only when
the lead is in the fit. Absolute evidence, each explanation's about its own fit, then compares those that are near.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.explanations.colour import searched_in_colour, tempered
from casid.diagnosis.explanations.columns import FlightColumns, flight_columns
from casid.diagnosis.explanations.explanation import CauseColumn, Explanation
from casid.diagnosis.explanations.pool import pool_of
from casid.diagnosis.explanations.posterior import Posterior, posterior
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.search import Found, further, search
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.naming.events import Intervals, at_peak, further_records
from casid.diagnosis.naming.size import plausible
from casid.errors import InputError


@dataclass(frozen=True, eq=False, kw_only=True)
class WeighedFit:
    """A fit, its columns, and what the search found about it; `own` the attached effects that compete, `intervals` of
    onsets by name, and the `ranking` of the catalogue by one cause at a time."""

    columns: FlightColumns
    found: Found
    own: Mapping[str, CauseColumn]
    intervals: Mapping[str, Intervals] = field(default_factory=dict)
    ranking: tuple[Candidate, ...] = ()

    @property
    def fit(self) -> FlightFit:
        return self.columns.fit

    @property
    def best(self) -> Explanation:
        return self.found.explanations[0]

    def with_found(self, found: Found) -> WeighedFit:
        """With another search about the same fit, of the same causes."""
        return replace(self, columns=replace(self.columns, innovations=found.innovations), found=found)

    def in_other_air(self, other_air: FlightFit, priors: Priors) -> float:
        """Log weight of the best explanation by the same causes under the noise of another fit of the records."""
        attached = [one for one in self.fit.attached if one.name in self.own]
        others = [one for one in other_air.attached if one.name not in self.own]
        other = fit(other_air.flight, [*others, *attached], other_air.noise, other_air, iterations=12, tolerance=2.0)
        return _alone(other, priors, self.own, self.best).best.log

    def attached(self, column: CauseColumn) -> Attached:
        """What a column stands for."""
        return self.columns.ones[self.columns.innovations.causes.index(column)]


@dataclass(frozen=True, eq=False, kw_only=True)
class Explained:
    """The posterior; where the naming began, `first` and the `ranking` of the catalogue there, and ended, `lead`, and
    `rivals` fitted as wholes.

    worths     channel -> part of its readings that independent ones would be as good as
    predicted  cause of the lead -> what held-out records say of it, a log likelihood ratio
    """

    posterior: Posterior
    first: FlightFit
    ranking: tuple[Candidate, ...]
    lead: WeighedFit
    rivals: tuple[WeighedFit, ...]
    worths: Mapping[str, float]
    predicted: Mapping[str, float] = field(default_factory=dict)

    def with_held_out(self, predicted: Mapping[str, float], wholes: Sequence[float]) -> Explained:
        """With what records that were not fitted say of the causes of the lead, and of each rival as a whole."""
        rivals = [one.found for one in self.rivals]
        believed = posterior(self.lead.found, *rivals, predicted=predicted, wholes=wholes)
        return replace(self, posterior=believed, predicted=predicted)

    def stands_for(self, column: CauseColumn) -> Attached:
        """What a column stands for, in whichever fit it is of."""
        for one in (self.lead, *self.rivals):
            if column in one.columns.innovations.causes:
                return one.attached(column)
        raise ValueError(f"no fit has a column of '{column.name}'")


def explain(
    start: FlightFit, priors: Priors, report: Callable[[str], None], competing: Sequence[Attached] = ()
) -> Explained:
    """The posterior over explanations of a fit; the effects `competing` that it has are causes like any others."""
    banned: set[str] = set()
    own: dict[str, CauseColumn] = {one.name: _given(one, priors) for one in competing}
    report("explanations, round 1")
    lead = _weighed(start, priors, own, banned)
    seen, ranking = {_content(lead)}, lead.ranking
    for number in range(2, priors.numerics.rounds + 1):
        if _agrees(lead, lead.best):
            break
        report(f"explanations, round {number}")
        plan = _plan(lead, _strongest(lead), priors)
        del lead  # its columns take as much memory as those of the next
        other = _fitted(plan, priors, banned)
        if other is None:
            lead = _weighed(plan.start, priors, plan.before, banned)
            continue
        # what linearisation promised and the fit does not keep is a step back: then the one before stays in the lead
        lead = _planned(plan, other, priors, banned)
        if _content(lead) in seen:
            break
        seen.add(_content(lead))
    lead = lead.with_found(further(lead.found))
    rivals = _rivals(lead, priors, banned, report)
    better = max(rivals, key=lambda one: one.best.log, default=lead)
    if better.best.log > lead.best.log + 1.0:
        rivals = [one for one in (lead, *rivals) if one is not better]
        lead = _weighed(better.fit, priors, better.own, banned)
        if not _agrees(lead, lead.best) and (other := _refitted(lead, lead.best, priors, banned)) is not None:
            lead = other
    lead, rivals, worths = _in_colour(lead, rivals)
    if not _agrees(lead, lead.best) and min(worths.values()) < 1.0:
        # with colour allowed for other causes lead: once more about a fit that has them
        report("explanations, colour")
        other = _refitted(lead, lead.best, priors, banned)
        if other is not None:
            lead, rivals, worths = _in_colour(other, [])
    believed = posterior(lead.found, *(one.found for one in rivals))
    return Explained(posterior=believed, first=start, ranking=ranking, lead=lead, rivals=tuple(rivals), worths=worths)


def _in_colour(lead: WeighedFit, rivals: Sequence[WeighedFit]) -> tuple[WeighedFit, list[WeighedFit], dict[str, float]]:
    """The lead and its rivals with the colour allowed for that the lead leaves of each channel, and what its readings
    are worth."""
    seen = lead.fit.linear.seen
    number = np.where(seen, np.arange(seen.shape[2]), -1)
    channels = [number[:, r].reshape(-1) for r in range(seen.shape[1])]
    lead = lead.with_found(further(lead.found))
    found, worths = searched_in_colour(lead.found, channels)
    by_name = {name: worths.get(i, 1.0) for i, name in enumerate(lead.fit.model.outputs)}
    if found is lead.found:
        return lead, list(rivals), by_name
    weights = [np.array([worths.get(int(c), 1.0) for c in at]) for at in channels]
    allowed = []
    for one in rivals:
        weighed = tempered(one.columns.innovations, weights)
        allowed.append(one.with_found(search(weighed, found.priors, one.best)))
    return lead.with_found(found), allowed, by_name


def _given(one: Attached, priors: Priors) -> CauseColumn:
    """A cause that is in the fit from the beginning."""
    return CauseColumn(
        name=one.name, kind=one.effect.kind, shape={}, scales=(priors.grid,), log_prior=priors.cause(1), matters=1.0
    )


def _weighed(now: FlightFit, priors: Priors, own: Mapping[str, CauseColumn], banned: set[str]) -> WeighedFit:
    evidence = weigh(now)
    pool = pool_of(evidence, priors, banned)
    columns = flight_columns(evidence, pool.competitors, priors, own)
    found = search(columns.innovations, priors, settings=priors.numerics.first_settings)
    one = WeighedFit(columns=columns, found=found, own=own, ranking=pool.ranking)
    return one.with_found(further(found)) if _agrees(one, one.best) else one


def _alone(now: FlightFit, priors: Priors, own: Mapping[str, CauseColumn], about: Explanation) -> WeighedFit:
    """The same with no cause offered but those in the fit."""
    columns = flight_columns(weigh(now), [], priors, own)
    return WeighedFit(columns=columns, found=search(columns.innovations, priors, about), own=own)


def _content(one: WeighedFit) -> frozenset[str]:
    return frozenset(one.own)


def _strongest(now: WeighedFit) -> Explanation:
    """The best explanation without causes that are nothing beside its strongest: they may be what linearisation is
    wrong by, of the strongest, and are found again if they are not. Those in the fit are judged as they stand."""
    best, columns = now.best, now.columns.innovations.causes
    linear = now.found.priors.numerics.linear
    names = [columns[e.column].name for e in best.elements]
    odds = [best.log - now.found.without[name].log for name in names]
    kept = [i for i, name in enumerate(names) if name in now.own or odds[i] > linear * max(odds)]
    elements = tuple(best.elements[i] for i in kept)
    return replace(best, elements=elements, amplitudes=tuple(best.amplitudes[i] for i in kept))


def _agrees(now: WeighedFit, best: Explanation) -> bool:
    """Whether an explanation has the causes that are in the fit, and no others."""
    return {now.columns.innovations.causes[e.column].name for e in best.elements} == set(now.own)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Plan:
    """What is to be fitted: the effects of an explanation, from the fit at which it was weighed, and the columns that
    they compete as; `before` those of that fit, and `intervals` of their onsets."""

    start: FlightFit
    before: Mapping[str, CauseColumn]
    attached: Sequence[Attached]
    own: Mapping[str, CauseColumn]
    intervals: Mapping[str, Intervals]


def _plan(now: WeighedFit, best: Explanation, priors: Priors) -> _Plan:
    """The causes of an explanation at the sizes that it gives them."""
    causes = now.columns.innovations.causes
    others = [one for one in now.fit.attached if one.name not in now.own]
    chosen, own = [], {}
    for element, (amplitude, _) in zip(best.elements, best.amplitudes, strict=True):
        column, one = causes[element.column], now.columns.ones[element.column]
        if one.name not in now.own:
            one = _sized(one, amplitude, priors)
        chosen.append(replace(one, passes=False))
        own[one.name] = now.own.get(one.name, column)
    return _Plan(start=now.fit, before=now.own, attached=[*others, *chosen], own=own, intervals=now.intervals)


def _fitted(plan: _Plan, priors: Priors, banned: set[str]) -> tuple[FlightFit, Mapping[str, Intervals]] | None:
    """The fit, and where the onsets of its new events may be; None, and a name more that is `banned`, when a cause is
    impossible in it."""
    start, own, before = plan.start, plan.own, plan.before
    try:
        fitted = fit(start.flight, plan.attached, start.noise, start, iterations=12, tolerance=2.0)
        fitted, intervals = _events(fitted, set(own) - set(before), priors.numerics.moves)
    except (InputError, ArithmeticError, ValueError, MemoryError):
        # of these sizes it makes an aircraft that cannot fly the record, or a shape ran off
        banned |= set(own) - set(before)
        return None
    impossible = {one.name for one in fitted.attached if one.name in own and not plausible(one)}
    if impossible - set(before):
        banned |= impossible
        return None
    return fitted, {**plan.intervals, **intervals}


def _planned(
    plan: _Plan, found: tuple[FlightFit, Mapping[str, Intervals]], priors: Priors, banned: set[str]
) -> WeighedFit:
    return replace(_weighed(found[0], priors, plan.own, banned), intervals=found[1])


def _refitted(now: WeighedFit, best: Explanation, priors: Priors, banned: set[str]) -> WeighedFit | None:
    """The fit with the causes of an explanation, weighed; None when it cannot be."""
    plan = _plan(now, best, priors)
    found = _fitted(plan, priors, banned)
    return None if found is None else _planned(plan, found, priors, banned)


def _sized(one: Attached, amplitude: float, priors: Priors) -> Attached:
    if one.effect.members:
        return one
    if one.effect.linear:
        return one.with_values({"value": amplitude})
    return one.with_values({"value": one.values["value"] * float(np.clip(amplitude, *priors.numerics.amplitudes))})


def _events(fitted: FlightFit, new: set[str], moves: int) -> tuple[FlightFit, dict[str, Intervals]]:
    """The fit with onsets of new events moved to where they belong, and in further records where they recur."""
    intervals: dict[str, Intervals] = {}
    for name in sorted(new):
        at = next(i for i, one in enumerate(fitted.attached) if one.name == name)
        if not fitted.attached[at].effect.timed:
            continue
        evidence, intervals[name] = at_peak(weigh(fitted), moves, which=at)
        wider = further_records(evidence, evidence.fit.attached[at])
        fitted = evidence.fit
        if len(wider.onsets) > len(fitted.attached[at].onsets):
            attached = [wider if i == at else one for i, one in enumerate(fitted.attached)]
            fitted = fit(fitted.flight, attached, fitted.noise, fitted, iterations=8, tolerance=2.0)
            evidence, intervals[name] = at_peak(weigh(fitted), moves, which=at)
            fitted = evidence.fit
    return fitted, intervals


def _rivals(lead: WeighedFit, priors: Priors, banned: set[str], report: Callable[[str], None]) -> list[WeighedFit]:
    """The best other explanations, each fitted as a whole: as far behind as linearisation may be wrong."""
    numerics = priors.numerics
    within = max(numerics.near, numerics.linear * (lead.best.log - lead.found.nothing))
    every = [*lead.found.without.values(), *lead.found.explanations]
    causes = lead.columns.innovations.causes
    ranked: dict[frozenset[str], Explanation] = {}
    for one in sorted(every, key=lambda one: -one.log):
        names = frozenset(causes[e.column].name for e in one.elements)
        if names and lead.best.log - one.log < within and not names >= lead.own.keys():
            ranked.setdefault(names, one)
    found: list[WeighedFit] = []
    plans = [(_plan(lead, one, priors), one) for one in list(ranked.values())[: numerics.rivals]]
    for plan, one in [*plans, *((plan, lead.best) for plan in _elsewhere(lead, priors))]:
        report("explanations, rivals")
        other = _fitted(plan, priors, set(banned))
        if other is not None:
            found.append(replace(_alone(other[0], priors, plan.own, one), intervals=other[1]))
    return found


def _elsewhere(lead: WeighedFit, priors: Priors) -> list[_Plan]:
    """A cause of some records as one of the opposite size of all the others. But for what is fitted the two differ by a
    cause of all records, and another cause beside the wrong one may make up for that."""
    plans, plan = [], _plan(lead, lead.best, priors)
    every = lead.fit.batch.names
    for one in plan.attached:
        if one.name not in plan.own or not one.records or one.effect.timed or not one.effect.linear:
            continue
        others = tuple(name for name in every if name not in one.records)
        opposite = replace(one, records=others).with_values({"value": -one.values["value"]})
        if others:
            plans.append(replace(plan, attached=[opposite if a is one else a for a in plan.attached]))
    return plans
