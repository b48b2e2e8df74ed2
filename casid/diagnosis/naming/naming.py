"""Name causes one after the other: screen, fit the best few, keep what gains enough, look again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, all_passed
from casid.diagnosis.evidence.detectable import smallest_sizes
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.evidence.screening import Candidate, Screen, equivalence, rank, screen
from casid.diagnosis.flight.colour import in_colour
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, relaxed, without
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.naming.comparing import (
    can_be_named,
    equivalents_of,
    gains_enough,
    in_order,
    ranked_behind,
    simplest_first,
    sine,
    small_first,
)
from casid.diagnosis.naming.events import Intervals, configuration_changes
from casid.diagnosis.naming.explaining import explains
from casid.diagnosis.naming.round import Round, Trial
from casid.diagnosis.naming.structure import demanded_offsets
from casid.diagnosis.naming.trials import is_same, required_gain, settled, try_cause, worth_trying
from casid.model.effect import Effect, Values
from casid.native.processors import side_by_side


@dataclass(frozen=True, eq=False, kw_only=True)
class Naming:
    """Where the naming stands: evidence of the current model, evidence of its kinematics and the ranking by these
    alone, what the model still misses, the rounds so far, and onset intervals by cause name."""

    evidence: Evidence
    kinematic: Evidence | None
    observed: Sequence[Candidate]
    missing: tuple[MissingInput, ...]
    rounds: tuple[Round, ...]
    intervals: dict[str, Intervals]

    @property
    def criteria(self) -> Criteria:
        return self.evidence.criteria

    @property
    def named(self) -> list[Round]:
        """The rounds that named a cause."""
        return [one for one in self.rounds if one.named]


def name_causes(
    baseline: Evidence,
    catalogue: Sequence[Effect],
    kinematic: Evidence | None,
    observed: Sequence[Candidate],
    required: float,
    report: Callable[[str], None],
) -> Naming:
    """Greedy naming from the fitted baseline, under its noise, with the evidence of `kinematic` and their ranking
    `observed`; it stops when nothing in the catalogue has the required gain and matters.

    When no unknown input gains, events are not looked for any more. Faults of instruments still are, whose shape no
    unknown input has, and so is what small terms of a nonlinear coefficient explain as well.
    """
    accepted = state = _standing(baseline, kinematic, observed, (), {})
    criteria, numerics = baseline.criteria.naming, baseline.criteria.numerics.naming
    for number in range(1, numerics.rounds + 1):
        report(f"naming, round {number}")
        state = one_round(state, catalogue, required)
        if not state.rounds[-1].named:
            break
        gates = believed(accepted, state)
        if not all_passed(gates) and (other := all_reconsidered(state, required)) is not state:
            state, gates = other, believed(accepted, other)
        state = replace(state, rounds=(*state.rounds[:-1], replace(state.rounds[-1], believed=gates)))
        if all_passed(gates):
            accepted = state
        elif len(state.rounds) - len(accepted.rounds) >= numerics.tentative:
            break
        if state.missing[0].gain < criteria.nothing_left:
            nonlinear = state.evidence.nonlinear
            catalogue = [one for one in catalogue if one.of_an_instrument or (nonlinear and not one.timed)]
    refused = tuple(replace(round_, named=False) for round_ in state.rounds[len(accepted.rounds) :])
    accepted = all_reconsidered(accepted, required)
    return replace(accepted, rounds=(*accepted.rounds, *refused))


def believed(accepted: Naming, state: Naming) -> tuple[Gate, ...]:
    """What the last cause must pass to be believed; nothing where it is too small to matter."""
    last = state.rounds[-1].leader
    return explains(accepted.missing, state.missing, last, state.evidence) if last.meaningful else ()


def _standing(
    evidence: Evidence,
    kinematic: Evidence | None,
    observed: Sequence[Candidate],
    rounds: tuple[Round, ...],
    intervals: dict[str, Intervals],
) -> Naming:
    return Naming(
        evidence=evidence,
        kinematic=kinematic,
        observed=observed,
        missing=tuple(missing_inputs(evidence)),
        rounds=rounds,
        intervals=intervals,
    )


def one_round(state: Naming, catalogue: Sequence[Effect], required: float) -> Naming:
    attached, criteria = state.evidence.fit.attached, state.criteria
    taken = {a.effect.key for a in attached}
    effects = [e for e in catalogue if e.key not in taken]
    prints = fingerprints(state.evidence, effects)
    # what a cause predicts with the structure exact finds it, what it gains beside small terms confirms it; and what
    # kinematics alone say of it does not drown in wrong aerodynamics
    exactly = Screen(state.evidence, exact=True)
    candidates = rank(exactly, prints)
    cautious = rank(Screen(state.evidence), prints)
    names = {e.name for e in effects}
    observed = [c for c in state.observed if c.name in names]
    switching = any(e.timed for e in catalogue) and not any(a.effect.members for a in attached)
    switches = configuration_changes(state.evidence) if switching else []
    chosen, screened = worth_trying(state.evidence.fit, candidates, cautious, observed, switches, required)
    apart = criteria.events.apart
    chosen += [c for c in _left_behind(state) if not any(is_same(c.attached, one.attached, apart) for one in chosen)]
    trials, fits, intervals = _tried(
        state, _with_look_alikes(chosen, effects, state.evidence.fit.batch.names), required
    )
    nameable = [t for t in fits if t.meaningful]
    trials = small_first(in_order(trials, nameable), fits, criteria) if nameable else in_order(trials, ())
    best = trials[0] if nameable else None
    equivalents = equivalents_of(best, trials, criteria) if best is not None and best.meaningful else ()
    trials = simplest_first(trials, equivalents, nameable) if equivalents else trials
    if best is not None and trials[0] is not best:
        best = trials[0]
        equivalents = equivalents_of(best, trials, criteria)
    first = not state.rounds  # later ones have less to look for
    this = Round(
        candidates=tuple(sorted([*candidates, *switches], key=lambda c: -c.net)),
        detectable=smallest_sizes(exactly, prints, candidates, criteria.verdict.detectable) if first else {},
        trials=tuple(trials),
        equivalents=equivalents,
        named=best is not None,
        screened=screened,
        ranked=ranked_behind(trials[0], trials, criteria) if trials else {},
    )
    if best is None:
        return replace(state, rounds=(*state.rounds, this))
    best, evidence, moved = settled(best, fits[best])
    evidence = without_superseded(state.rounds, best, evidence)
    evidence = _in_colour(_with_offsets(_relaxed(evidence)))
    best = replace(best, fit=evidence.fit)
    this = replace(this, trials=(best, *this.rivals))
    kinematic, observed = _kinematics_with(state.kinematic, evidence.fit, best.effect), state.observed
    if kinematic is not None and kinematic is not state.kinematic:
        observed = screen(kinematic, [e for e in effects if e.kinematic and e.key != best.effect.key])
    return _standing(evidence, kinematic, observed, (*state.rounds, this), intervals | moved)


def _tried(
    state: Naming, candidates: Sequence[Candidate], required: float
) -> tuple[list[Trial], dict[Trial, FlightFit], dict[str, Intervals]]:
    """Trials of all candidates, the fits of those that can be named or are too small for that, and intervals of onsets
    by cause name. A few are fitted side by side on however many processors, so that the answer does not depend on
    them. Those that come later are given up when they are unlikely to come near the best before."""
    trials: list[Trial] = []
    fits: dict[Trial, FlightFit] = {}
    intervals, give_up = dict(state.intervals), np.inf

    def run(candidate: Candidate) -> tuple[Trial, FlightFit, Intervals]:
        trial, joint, interval = try_cause(state.evidence, candidate, state.kinematic, give_up)
        return trial, joint.fit.lighter(), interval  # most of them are not looked at again

    at_once = state.criteria.numerics.naming.side_by_side
    for first in range(0, len(candidates), at_once):
        for tried, fitted, interval in side_by_side(run, candidates[first : first + at_once]):
            enough = gains_enough(tried, prices(tried, state, required)) if tried.given_up is None else None
            trial = replace(tried, enough=enough)
            trials.append(trial)
            if not trial.refuted:
                give_up = min(give_up, fitted.deviance + state.criteria.naming.give_up * abs(trial.gain.raw))
            if interval:
                intervals[trial.candidate.name] = interval
            if can_be_named(trial):
                fits[trial] = fitted
    return trials, fits, intervals


def _left_behind(state: Naming) -> list[Candidate]:
    """The best trial of the round before that has nothing in common with what it named: it is still there, and found,
    where a screening beside what else is missing may look for it elsewhere."""
    if not state.rounds:
        return []
    best, *others = state.rounds[-1].trials
    by = state.criteria.naming
    apart = [t for t in others if t.meaningful and not t.refuted and t.effect.key != best.effect.key]
    return [
        t.candidate for t in apart if t.gain.total > by.left_behind * best.gain.total and sine(best, t) > by.rival_angle
    ][:1]


def _reversed(values: Values) -> Values:
    return {**values, "value": -values["value"]}


def _with_look_alikes(
    candidates: Sequence[Candidate], effects: Sequence[Effect], records: Sequence[str]
) -> list[Candidate]:
    """Candidates, and behind each of them causes that derivatives imitate but for what shows as that one, so that no
    screening finds them. A shift of the centre of gravity moves the accelerometers the other way. And what only shows
    as a difference between records, the other way in all others: beside the difference, the level may show."""
    found, names = [], {c.name for c in candidates}
    for candidate in candidates:
        one = candidate.attached
        found.append(candidate)
        if one.effect.relative and one.records:
            others = tuple(name for name in records if name not in one.records)
            found.append(replace(candidate, attached=replace(one, records=others, values=_reversed(one.values))))
        for effect in (e for e in effects if e.name not in names):
            if _look_alike(effect, one.effect):
                alike = Attached(effect=effect, values=_reversed({"value": one.values["value"]}), records=one.records)
                found.append(replace(candidate, attached=alike))
    return found


def without_superseded(rounds: Sequence[Round], best: Trial, evidence: Evidence) -> Evidence:
    """Evidence of the fit without those earlier causes that had `best` as a rival when they were named and gain nothing
    beside it. What was missing then and is named by now may have decided for the wrong one."""
    key = best.effect.key
    for earlier in (r for r in rounds if r.named):
        name = earlier.leader.candidate.name
        rivals = {trial.effect.key for trial in earlier.trials}
        fitted = evidence.fit
        if key not in rivals or name not in {a.name for a in fitted.attached} or _is_needed(evidence, name):
            continue
        others = weigh(without(fitted, {name}))
        if others.deviance < evidence.deviance + evidence.criteria.naming.gain:
            evidence = others
    return evidence


def _relaxed(evidence: Evidence) -> Evidence:
    """Evidence of the fit by its own noise, where it was compared under that of another."""
    held = evidence.fit.filter_held or evidence.fit.noise_held
    return weigh(relaxed(evidence.fit)) if held else evidence


def _with_offsets(evidence: Evidence) -> Evidence:
    """Evidence of the fit with small offsets of instruments that what was named before had hidden; none in moving air,
    which they imitate."""
    fitted = evidence.fit
    offsets = [] if fitted.noise.coloured else demanded_offsets(fitted)
    return weigh(fit(fitted.flight, [*fitted.attached, *offsets], fitted.noise, fitted)) if offsets else evidence


def _in_colour(evidence: Evidence) -> Evidence:
    """Evidence under the noise that its fit leaves, of channels whose noise is estimated with the fit."""
    fitted = in_colour(evidence.fit)
    return evidence if fitted is evidence.fit else weigh(fitted)


def _is_needed(evidence: Evidence, name: str) -> bool:
    """Whether a cause is so far from zero, in its 1-sigma, that no fit without it can come near."""
    if name not in {slot.name for slot in evidence.fit.slots}:
        return False
    index, by = [slot.name for slot in evidence.fit.slots].index(name), evidence.criteria.naming
    return evidence.fit[name] ** 2 > by.needed * by.gain * evidence.covariance[index, index]


def prices(trial: Trial, state: Naming, required: float) -> dict[str, float]:
    """Name of criterion -> gain that a trial must reach by it.

    What the rough shape of an earlier cause, or of turbulence, leaves is no evidence for another cause. What kinematics
    find is: they include turbulence and know no aerodynamics.
    """
    effect, by = trial.effect, state.criteria.naming
    of_a_name = "naming.gain_of_an_instrument" if effect.of_an_instrument else "naming.gain"
    earlier = [round_.leader for round_ in state.named]
    leave = [one.gain.raw for one in earlier if one.effect.kinematic or not trial.confirmed]
    return {
        of_a_name: required_gain(effect, state.criteria),
        "turbulence.left": 0.0 if trial.confirmed else required,
        "naming.left_to_others": by.left_to_others * max(leave, default=0.0),
    }


def _look_alike(one: Effect, other: Effect) -> bool:
    """Whether derivatives imitate one of them but for what shows as the other."""
    shown = {(one.shows_as, other.kind), (other.shows_as, one.kind)}
    return one.target == other.target and any(as_ == kind for as_, kind in shown)


def all_reconsidered(state: Naming, required: float) -> Naming:
    """The naming with every cause but the last compared once more with its rivals."""
    for at in range(len(state.rounds) - 1):
        state = _reconsidered(state, at, required)
    return state


def _reconsidered(state: Naming, at: int, required: float) -> Naming:
    """The naming with one of its causes compared once more with its rivals, beside those named since: what was missing
    then may have decided between them."""
    round_, fitted, criteria = state.rounds[at], state.evidence.fit, state.criteria
    most = criteria.numerics.naming.rivals
    best, taken = round_.leader, {a.effect.key for a in fitted.attached}
    rivals = [t for t in near_rivals(round_, criteria) if t.effect.key not in taken]
    near = [t for t in rivals if not _look_alike(t.effect, best.effect)][:most]
    rivals = [t for t in rivals if t in near or _look_alike(t.effect, best.effect)]
    if not rivals or best.effect.key not in taken or not best.meaningful:
        return state
    return with_best_of(state, at, (best, *rivals), required)


def near_rivals(round_: Round, criteria: Criteria) -> list[Trial]:
    """Trials of a round that may stand in its leader's place: they explain nearly as much, and much the same, or
    just as much (`is_dead_heat`)."""
    best, by = round_.leader, criteria.naming
    possible = [t for t in round_.rivals if t.meaningful and not t.refuted]

    def near(t: Trial) -> bool:
        much_the_same = t.gain.total > by.rival * best.gain.total and sine(best, t) < by.rival_angle
        return much_the_same or is_dead_heat(best, t, criteria)

    return [t for t in possible if near(t) or _look_alike(t.effect, best.effect)]


def is_dead_heat(best: Trial, other: Trial, criteria: Criteria) -> bool:
    """Whether two trials explain the same amount, each in its own channel, and kinematics confirm both: a vane metres
    ahead, an accelerometer metres behind. Which came first is chance."""
    behind = abs(best.gain.total - other.gain.total)
    return best.confirmed and other.confirmed and behind < equivalence(best.gain.raw, criteria)


def with_best_of(state: Naming, at: int, trials: Sequence[Trial], required: float) -> Naming:
    """The naming with the best of these in the place of one of its causes, beside all others."""
    round_, fitted, criteria = state.rounds[at], state.evidence.fit, state.criteria
    best = round_.leader
    alone = without(fitted, {best.candidate.name})
    others = replace(
        state,
        evidence=weigh(alone),
        kinematic=_kinematics_with(state.kinematic, alone, best.effect),
        rounds=tuple(r for r in state.rounds if r is not round_),
    )
    found, fits, intervals = _tried(others, [t.candidate for t in trials], required)
    nameable = [t for t in fits if t.meaningful]
    trials = in_order(found, nameable)
    if not nameable:
        return state
    rounds = list(state.rounds)
    ranked = {**round_.ranked, **ranked_behind(trials[0], trials, criteria)}
    rounds[at] = replace(round_, equivalents=equivalents_of(trials[0], trials, criteria), ranked=ranked)
    if trials[0].effect.key == best.effect.key:
        return replace(state, rounds=tuple(rounds))
    first, evidence, moved = settled(trials[0], fits[trials[0]])
    evidence = _in_colour(_relaxed(evidence))
    rest = [t for t in round_.trials if t.effect.key not in {one.effect.key for one in trials}]
    rounds[at] = replace(rounds[at], trials=(first, *trials[1:], *rest))
    for i, one in enumerate(rounds):
        later = {r.leader.candidate.name for r in rounds[i + 1 :]}
        winner = replace(one.leader, fit=without(evidence.fit, later) if later else evidence.fit)
        rounds[i] = replace(one, trials=(winner, *one.rivals))
    kinematic = _kinematics_with(others.kinematic, evidence.fit, first.effect)
    return _standing(evidence, kinematic, state.observed, tuple(rounds), intervals | moved)


def _kinematics_with(kinematic: Evidence | None, model: FlightFit, changed: Effect) -> Evidence | None:
    """Evidence of the kinematics beside the instrument and air causes of a model, of which one has `changed`."""
    if kinematic is None or not changed.kinematic:
        return kinematic
    return kinematics.with_causes(kinematic, model.attached)
