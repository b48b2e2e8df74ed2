"""Choice of the causes that are worth a fit, by the predictions of a linearisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, all_passed, at_least
from casid.diagnosis.engine.acceptance import clear_gain
from casid.diagnosis.engine.comparison import look_alike
from casid.diagnosis.engine.size import meaningful_share
from casid.diagnosis.evidence.screening import Candidate, equivalence
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.effect import Effect, Values

Screened = Mapping[str, tuple[Gate, ...]]  # name of a candidate that is not fitted -> its gates, of which one failed


def worth_trying(
    base: FlightFit, rankings: Sequence[Sequence[Candidate]], switches: Sequence[Candidate], required: float
) -> tuple[list[Candidate], Screened]:
    """Choose the best few causes of each ranking.

    A cause needs the `required` score statistic, unless the kinematics may confirm it, and a predicted size that
    matters. A configuration change is scored in one record only, so it cannot be ranked with the others.

    Parameters
    ----------
    base
        The present fit.
    rankings
        Rankings of the causes, best first. Most trials are taken from the first ranking.
    switches
        Configuration changes, best first.
    required
        The part of the statistic of turbulence that counts as misfit of its approximate shape.

    Returns
    -------
    chosen
        The causes to be fitted.
    screened
        Name of a cause that is not fitted -> its gates, of which one failed.
    """
    criteria = base.criteria
    trials, few = criteria.numerics.naming.trials, criteria.numerics.naming.further_trials
    apart = criteria.events.apart
    first, *others_ranked = rankings
    chosen, screened = _best_few(base, first, trials)
    switching, others = _best_few(base, switches, 1)
    chosen, screened = [*chosen, *switching], {**others, **screened}
    for ranking in others_ranked:
        before = tuple(chosen)
        further, others = _best_few(base, ranking, few)
        chosen += [c for c in further if not any(is_same(c.attached, b.attached, apart) for b in before)]
        screened = {**others, **screened}
    faint = {c.name: gates for c in chosen if not all_passed(gates := _beside_turbulence(c, required, criteria))}
    chosen = [c for c in chosen if c.name not in faint]
    tried = {c.name for c in chosen}
    return chosen, {name: gates for name, gates in {**screened, **faint}.items() if name not in tried}


def _beside_turbulence(candidate: Candidate, required: float, criteria: Criteria) -> tuple[Gate, ...]:
    """The gate on the score statistic beside the misfit of an approximate model of turbulence."""
    if candidate.attached.effect.kinematic:
        return ()
    part = criteria.naming.tried_gain * required
    return (at_least("predicted statistic beside turbulence", candidate.net, part, "naming.tried_gain"),)


def is_same(one: Attached, other: Attached, apart: float) -> bool:
    """Whether two candidates are the same cause.

    An event with onsets `apart` [s] or more from the other's, or with the opposite sign, is another cause.
    """
    if one.name != other.name or not one.effect.timed:
        return one.name == other.name
    near = all(abs(other.onsets.get(record, np.inf) - onset) < apart for record, onset in one.onsets.items())
    return near and one.values["value"] * other.values["value"] > 0.0


def _best_few(base: FlightFit, candidates: Sequence[Candidate], count: int) -> tuple[list[Candidate], Screened]:
    """The best `count` candidates with at most two terms of one coefficient, and the gates of those that are not tried.

    Candidates with nearly the same prediction as a chosen one are added, because they may form one ambiguity set.
    """
    numerics, screened = base.criteria.numerics.naming, dict[str, tuple[Gate, ...]]()
    chosen: list[Candidate] = []
    alike: list[Candidate] = []
    for candidate in candidates:
        effect, enough = candidate.attached.effect, _predicted_statistic(candidate, base.criteria)
        if not enough.passed or len(chosen) == count:
            rank = at_least("places left among those tried", count - len(chosen), 1.0)
            screened[candidate.name] = (enough, *((rank,) if enough.passed else ()))
            continue
        gates = (enough, *_predicted_size(base, candidate))
        if not all_passed(gates):
            screened[candidate.name] = gates
            continue
        terms = [
            c for c in (*chosen, *alike) if c.attached.effect.quasi_steady and c.attached.effect.target == effect.target
        ]
        if effect.quasi_steady and len(terms) >= numerics.terms:
            near = terms[0].net - candidate.net < equivalence(terms[0].net, base.criteria)
            if len(terms) < numerics.equivalent_terms and near:
                alike.append(candidate)
            else:
                rank = at_least("places left among terms of its coefficient", numerics.terms - len(terms), 1.0)
                screened[candidate.name] = (*gates, rank)
            continue
        chosen.append(candidate)
    names = {one.name for one in (*chosen, *alike)}
    others = [c for c in candidates if c.name not in names and _predicted_statistic(c, base.criteria).passed]
    alike += [c for c in others if any(_predict_the_same(c, one, base.criteria) for one in chosen)]
    return [*chosen, *alike], screened


def _predicted_statistic(candidate: Candidate, criteria: Criteria) -> Gate:
    """The gate on the score statistic of a cause that is to be fitted."""
    by = criteria.naming
    return at_least("predicted statistic", candidate.net, by.tried_gain * by.gain, "naming.tried_gain")


def _predicted_size(base: FlightFit, candidate: Candidate) -> tuple[Gate, ...]:
    """The gates on the predicted size of a cause that is to be fitted: its share of what matters, and its clearness."""
    share, by = meaningful_share(base, candidate.attached), base.criteria.naming
    gates = (at_least("predicted size", share, by.tried_size, "naming.tried_size"),)
    if candidate.attached.effect.of_an_instrument:
        return gates
    clear = share**2 * candidate.statistic / clear_gain(base)
    return (*gates, at_least("predicted clearness", clear, by.tried_clear, "naming.tried_clear"))


def _predict_the_same(one: Candidate, other: Candidate, criteria: Criteria) -> bool:
    """Whether two causes that are not terms act at the same place, like a lag and a delay, with nearly equal
    statistics.
    """
    effect, second = one.attached.effect, other.attached.effect
    of_one_place = effect.target == second.target and not (effect.quasi_steady or second.quasi_steady)
    return of_one_place and abs(one.net - other.net) < equivalence(other.net, criteria)


def with_look_alikes(
    candidates: Sequence[Candidate], effects: Sequence[Effect], records: Sequence[str]
) -> list[Candidate]:
    """The candidates, each followed by causes that screening cannot find but that may be the true one.

    These are causes of which derivatives reproduce everything except an effect like that of the candidate: a shift of
    the centre of gravity shows as an error of the accelerometers with the opposite sign. And for a cause that shows
    only as a difference between records, they are the same cause with the opposite sign in all other records: beside
    the difference, the common level may be identifiable.
    """
    found, names = [], {c.name for c in candidates}
    for candidate in candidates:
        one = candidate.attached
        found.append(candidate)
        if one.effect.relative and one.records:
            others = tuple(name for name in records if name not in one.records)
            found.append(replace(candidate, attached=replace(one, records=others, values=_reversed(one.values))))
        for effect in (e for e in effects if e.name not in names):
            if look_alike(effect, one.effect):
                alike = Attached(effect=effect, values=_reversed({"value": one.values["value"]}), records=one.records)
                found.append(replace(candidate, attached=alike))
    return found


def _reversed(values: Values) -> Values:
    return {**values, "value": -values["value"]}
