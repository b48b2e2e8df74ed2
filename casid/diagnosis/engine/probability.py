"""Probabilities of the reported causes, each relative to its alternatives and to no cause at all.

The causes were fitted as complete hypotheses, each in the place of the other, and their statistics are likelihood
ratios. These cannot be taken at face value, because the model structure is never exact. Two causes count as equivalent
up to a distance of their statistics (`significance.chance`), and an ambiguity set is to hold the true cause with 95 %
probability (`priors.holds`). The odds of two causes at that distance are therefore 19 to 1, and 19^x at x times the
distance. At the threshold for a name, the odds are the cost of a wrong name over the cost of a missed one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import prod

import numpy as np
from scipy.special import expit, logit

from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import can_be_named, distance, possible_rivals
from casid.diagnosis.engine.search import State
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.gates import required_gain
from casid.model.effect import Effect
from casid.model.effects import effect_named


@dataclass(frozen=True, eq=False, kw_only=True)
class Probabilities:
    """The reported causes with probabilities."""

    causes: tuple[Cause, ...]  # causes with their probabilities and those of their alternatives
    # the most probable combinations: names of causes, probability
    explanations: tuple[tuple[tuple[str, ...], float], ...]
    there: Mapping[str, float]  # name of a cause -> probability that it is present and matters
    # the cause nearest to a name, with its probability; None if it is not worth mentioning
    faint: tuple[Trial, float] | None
    entered: Mapping[str, float]  # port -> probability that something unexplained enters there
    nothing: float  # probability that nothing that matters is wrong


def probabilities(
    causes: Sequence[Cause], unexplained: Sequence[MissingInput], state: State, left: Sequence[MissingInput]
) -> Probabilities:
    """Probabilities of the named causes, of what is unexplained, and of the best cause that was not named.

    unexplained  latent inputs that no cause explains
    left         all latent inputs of the reported model
    """
    scale = Scale(criteria=state.criteria)
    rounds = {round_.leader.effect.key: round_ for round_ in state.named}
    named = {one.key for one in causes}
    places = [_place(one, rounds.get(one.key), scale, named) for one in causes]
    near = _not_named(state, {effect.key for place in places for effect in place.effects}, scale)
    faint = {} if near is None else {near[0].candidate.name: near[1]}
    entered = {one.station: scale.of_missing(one) for one in unexplained}
    further = max([scale.of_missing(one) for one in left] if not unexplained else entered.values(), default=0.0)
    tables = [place.probabilities for place in places]
    there = {name: 1.0 - prod(1.0 - one.get(name, 0.0) for one in tables) for table in tables for name in table} | faint
    nothing = (1.0 - further) * prod(place.nothing for place in places) * prod(1.0 - p for p in faint.values())
    priors = state.criteria.priors
    tempered = priors.tempered
    least = priors.doubt**2
    likely = _explanations(places, faint, least, state.criteria.numerics.naming.ranking)
    return Probabilities(
        causes=tuple(_stated(one, place, tempered) for one, place in zip(causes, places, strict=True)),
        explanations=tuple((names, tempered(p)) for names, p in likely),
        faint=None if near is None or near[1] < 1.0 - priors.named else (near[0], tempered(near[1])),
        there={name: tempered(p) for name, p in there.items() if p > least},
        entered={name: tempered(p) for name, p in entered.items()},
        nothing=tempered(nothing),
    )


def other_explanations(state: State, final: FlightFit, there: Mapping[str, float]) -> list[dict[str, float]]:
    """Changes of the values of the `final` model, by name, under each other explanation that is not refuted.

    It is a cause of an ambiguity set in the place of the named one, unless the set holds the true cause with enough
    probability without it; or a cause that has enough statistic for a name and was refused for another reason.

    there  name of a cause -> probability that it is present
    """
    found = []
    names = {one.name for one in final.attached}
    least = 1.0 - state.criteria.priors.holds
    for round_ in state.rounds:
        stands = round_.named and round_.leader.candidate.name in names
        alike = [t for t in round_.equivalents if there.get(t.effect.name, 0.0) > least]
        beside = round_.leader.moved if stands else {}
        for trial in alike if stands else filter(can_be_named, round_.trials):
            found.append({name: change - beside.get(name, 0.0) for name, change in trial.moved.items()})
    return found


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Conversion of likelihood-ratio statistics into logarithms of odds."""

    criteria: Criteria

    @property
    def per_distance(self) -> float:
        """Log odds of two causes whose statistics differ by the largest distance of equivalents."""
        return float(logit(self.criteria.priors.holds))

    def against_nothing(self, gain: float, required: float) -> float:
        """Log odds of a statistic `gain`, where `required` is the threshold."""
        priors = self.criteria.priors
        beyond = (gain - required) / equivalence(gain, self.criteria)
        return float(np.log(priors.wrong)) + self.per_distance * beyond

    def of_missing(self, one: MissingInput) -> float:
        """Probability that a latent input is present."""
        return float(expit(self.against_nothing(one.gain, self.criteria.missing)))

    def of_trial(self, trial: Trial) -> float:
        """Log odds of a fitted cause against no cause.

        Its statistic is weighed twice, and the smaller odds count: with its correlated residuals against the threshold
        of its kind, and as its own gate did, against a higher one beside turbulence and earlier causes.
        """
        gain = trial.decisive_gain
        gate = trial.enough
        odds = self.against_nothing(gain / trial.inflation, required_gain(trial.effect, self.criteria))
        return odds if gate is None else min(odds, self.against_nothing(gain, gate.threshold))

    def of_put_in(self, cause: Cause) -> float:
        """Log odds of turbulence or expected structure, which was added before the search."""
        air = self.criteria.missing
        structure = self.criteria.significance.search
        return self.against_nothing(cause.statistic, air if cause.effect.stochastic else structure)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Place:
    """A named cause, listed first, and its alternatives: effects, log weights, and the log weight of no cause."""

    effects: Sequence[Effect]
    logs: Sequence[float]
    log_nothing: float

    @property
    def _total(self) -> float:
        return float(np.logaddexp.reduce([*self.logs, self.log_nothing]))

    @property
    def probabilities(self) -> dict[str, float]:
        """Name of an effect -> probability."""
        return {e.name: float(np.exp(log - self._total)) for e, log in zip(self.effects, self.logs, strict=True)}

    @property
    def nothing(self) -> float:
        return float(np.exp(self.log_nothing - self._total))

    @property
    def log_odds(self) -> float:
        """Log odds of the first effect against all others and no cause."""
        return self.logs[0] - float(np.logaddexp.reduce([*self.logs[1:], self.log_nothing]))

    def of(self, key: tuple[str, str, str | None]) -> float:
        """Probability of a kind with its target and term, summed over its variants."""
        names = [effect.name for effect in self.effects if effect.key == key]
        return sum(self.probabilities[name] for name in names)


def _place(cause: Cause, round_: Round | None, scale: Scale, named: Collection[tuple[str, str, str | None]]) -> _Place:
    """The place of a cause. Another `named` cause is no alternative to it: the two were estimated beside each other."""
    if round_ is None:  # no alternative was fitted
        return _Place(effects=(cause.effect,), logs=(0.0,), log_nothing=-scale.of_put_in(cause))
    best = round_.leader
    logs = {}
    effects = {best.effect.name: best.effect}
    logs[best.effect.name] = 0.0
    stated = {(o["kind"], o["target"], o["term"]) for o in cause.indistinguishable_from}
    for kind, target, term in stated - {trial.effect.key for trial in round_.trials}:  # equal by algebra: as likely
        equal = effect_named(f"{kind}({target}:{term})")
        effects[equal.name] = equal
        logs[equal.name] = 0.0
    for rival in (one for one in possible_rivals(best, round_.rivals) if one.effect.key not in named):
        behind = -scale.per_distance * max(distance(best, rival, scale.criteria), 0.0)
        name = rival.effect.name
        effects[name], logs[name] = rival.effect, max(behind, logs.get(name, -np.inf))
    return _Place(effects=tuple(effects.values()), logs=tuple(logs.values()), log_nothing=-scale.of_trial(best))


def _stated(cause: Cause, place: _Place, tempered: Callable[[float], float]) -> Cause:
    """The cause with its probability and those of its alternatives."""
    alike = tuple(
        {**one, "probability": tempered(place.of((one["kind"], one["target"], one["term"])))}
        for one in cause.indistinguishable_from
    )
    own = place.of(cause.key)
    together = own + sum(place.of(key) for key in {(o["kind"], o["target"], o["term"]) for o in alike} - {cause.key})
    return replace(
        cause,
        probability=tempered(min(together, 1.0)),
        alone=tempered(own),
        log_odds=place.log_odds,
        indistinguishable_from=alike,
    )


def _not_named(state: State, seen: Collection[tuple[str, str, str | None]], scale: Scale) -> tuple[Trial, float] | None:
    """The cause that came nearest to a name without reaching it, and its probability; None if none was tried.

    All it lacks is statistic, so that its probability is below that at which a cause is named. A cause that led its
    round and is not among the reported ones, or that was refused in a set, had enough: another gate refused it, and it
    is absent.
    """
    judged = [one for one in state.rounds if one.trials and (one.named or one.doubt or one.refused_by)]
    known = {*seen, *(one.leader.effect.key for one in judged)}
    trials = [t for round_ in state.rounds if round_ not in judged for t in round_.trials]
    possible = [t for t in trials if t.meaningful and not t.refuted and t.effect.key not in known]
    if not possible:
        return None
    best = max(possible, key=scale.of_trial)
    return best, float(expit(scale.of_trial(best)))


def _explanations(
    places: Sequence[_Place], faint: Mapping[str, float], least: float, most: int
) -> list[tuple[tuple[str, ...], float]]:
    """Combinations of causes with their probabilities, the most probable first."""
    choices = [{(name,): p for name, p in place.probabilities.items()} | {(): place.nothing} for place in places]
    choices += [{(name,): p, (): 1.0 - p} for name, p in faint.items()]
    likely = [{names: p for names, p in one.items() if p > least} for one in choices]
    wholes: dict[tuple[str, ...], float] = {}
    for chosen in product(*(one.items() for one in likely)):  # an alternative of two causes may be in both places
        whole = tuple(sorted({name for names, _ in chosen for name in names}))
        wholes[whole] = wholes.get(whole, 0.0) + prod(p for _, p in chosen)
    return sorted(wholes.items(), key=lambda one: -one[1])[:most]
