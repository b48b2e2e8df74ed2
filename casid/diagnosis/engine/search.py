"""Search for a set of causes that explains the records.

Causes are added one at a time and the model is fitted again with each. Causes are exchanged for alternatives that
explain the records better, and what is not probable or not sure beside all others is left out.

One round works as follows. The causes of the catalogue are screened with a linearisation about the present model. The
best of them are fitted, and the best fitted one is added. The new set is accepted if its last cause explains what was
missing before (`acceptance.explains`). When a set is refused, and again at the end, each cause is compared with its
alternatives, each fitted in its place.

The set of causes may show that one of the conditions of the search was wrong: the noise, the behaviour of the inputs
between samples, the turbulence, or the minimum of the baseline. The causes are then put into the corrected baseline,
and the search continues from there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from types import MappingProxyType

import numpy as np

from casid.diagnosis import comparisons as ask
from casid.diagnosis import gates
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import (
    can_be_named,
    explains,
    gains_enough,
    may_come_near,
    near_rivals,
    ranked,
    ranked_behind,
    sure_beside_all,
    tempered,
)
from casid.diagnosis.engine.baseline import Baseline, baseline_from, baseline_of, is_usual
from casid.diagnosis.engine.candidates import (
    checked,
    given_up,
    settled,
    try_cause,
    with_look_alikes,
    worth_trying,
)
from casid.diagnosis.engine.trial import Round, Trial, refused_rounds
from casid.diagnosis.evidence.detectable import smallest_sizes
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.evidence.nuisance import demanded_offsets
from casid.diagnosis.evidence.onsets import Intervals, configuration_changes
from casid.diagnosis.evidence.screening import Candidate, Screen, predicted_statistics, rank, screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, from_elsewhere, relaxed, without
from casid.diagnosis.flight.flight import with_inputs_held
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_inputs_run, beyond_air, in_colour, is_far, unread
from casid.diagnosis.gates import promises_enough, required_gain
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.check import without_turbulence, worth_fitting
from casid.diagnosis.kinematics.turbulence import still_air
from casid.diagnosis.time_limit import TimeIsUpError
from casid.model.effect import Effect
from casid.native.processors import side_by_side

Say = Callable[[str], None]
_NOTHING: Mapping[Candidate, np.ndarray] = MappingProxyType({})


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """A fitted set of causes, with the rounds that led to it."""

    baseline: Baseline  # the model that the causes are added to
    evidence: Evidence  # of the fitted model with the causes
    kinematic: Evidence | None  # of the kinematics with the causes; None if the forces cannot be left free
    observed: Sequence[Candidate] | None  # causes ranked by the kinematics alone; None until a round needs them
    missing: tuple[MissingInput, ...]  # latent input at each port, with the statistic that it still has
    rounds: tuple[Round, ...] = ()
    intervals: Mapping[str, Intervals]  # 95 % intervals of the onsets, by name of the cause

    @property
    def criteria(self) -> Criteria:
        return self.evidence.criteria

    @property
    def fit(self) -> FlightFit:
        return self.evidence.fit

    @property
    def named(self) -> list[Round]:
        """The rounds that named a cause."""
        return [one for one in self.rounds if one.named]

    @property
    def standing(self) -> list[Round]:
        """The rounds whose named cause is still in the model."""
        there = {one.name for one in self.fit.attached}
        return [one for one in self.named if one.leader.candidate.name in there]


def search(baseline: Baseline, say: Say) -> State:
    """The set of causes found from a baseline, with corrections of the conditions that the causes reveal.

    When its time is over, or at Ctrl-C, the search ends with the last accepted set, and with a note of what was not
    tried (`TimeLimit`).
    """
    limit = baseline.flight.limit
    limit.begin_search()
    state = at_baseline(baseline)
    if limit.leaves_out(_SEARCH):
        return state
    state = _grown(state, say)
    for name, condition in {} if baseline.fixed else _CONDITIONS.items():
        if limit.leaves_out(name):
            continue
        try:
            with limit.cutting():
                other = condition(state, say)
        except TimeIsUpError:
            other = None
        limit.leaves_out(name)
        if other is not None:
            state = _grown(without_improbable(carried(other, state)), say)
    return state


def at_baseline(baseline: Baseline) -> State:
    """The state of the search without any cause."""
    evidence = weigh(baseline.start)
    found = baseline.kinematics
    return State(
        baseline=baseline,
        evidence=evidence,
        kinematic=found.evidence,
        observed=found.ranked,
        missing=tuple(missing_inputs(evidence)),
        intervals={},
    )


def _grown(state: State, say: Say) -> State:
    """The state with causes added one at a time for as long as the sets are accepted; where something is still missing
    at a port then, also those of last resort."""
    effects = state.fit.flight.effects
    limit = state.fit.flight.limit
    missing = state.criteria.missing
    usual, further = ([e for e in effects if e.traits.last_resort is last] for last in (False, True))
    accepted, refused = _with_accepted(state, usual, say)
    accepted = without_improbable(accepted)
    before = None
    for catalogue in (further, effects) if further else ():
        if accepted is before or accepted.missing[0].gain < missing or limit.leaves_out(_FURTHER):
            break
        before = accepted
        accepted, more = _with_accepted(before, catalogue, say)
        if accepted is before:
            refused = (*refused, *more)
        else:  # rounds stand in the order in which they were made
            new = accepted.rounds[len(before.rounds) :]
            accepted = without_improbable(replace(accepted, rounds=(*before.rounds, *refused, *new)))
            refused = more
    if len(accepted.rounds) < 2 or not limit.leaves_out("alternatives of causes beside those named later"):
        accepted = without_improbable(swapped(accepted))
    return replace(accepted, rounds=(*accepted.rounds, *refused))


def without_improbable(state: State) -> State:
    """The state without the causes that are not probable or not sure enough for a name, beside all others or as they
    were named.

    The statistic of a cause beside all others is what the fit without it loses, all else estimated again. The weakest
    is left out first, and the others are judged anew.
    """
    weighed = tempered(state.rounds, state.evidence)
    standing = [at for at, one in enumerate(state.rounds) if one in state.standing and one.leader.meaningful]
    for at in sorted(standing, key=lambda at: weighed[at].leader.gain.total):
        last = weighed[at].leader
        evidence = state.evidence
        others = weigh(without(evidence.fit, {last.candidate.name}))
        beside = last.decisive_gain - last.gain.raw + others.deviance - evidence.deviance
        least = min(beside, last.decisive_gain)
        probable = gates.probable(last.effect, least, last.inflation, state.criteria)
        asked = (probable, *([] if is_usual(last.effect) else sure_beside_all(evidence, last.candidate.name)))
        if not all_passed(asked):
            refused = replace(state.rounds[at], named=False, refused_by=asked)
            changed = replace(state, rounds=_replaced(state.rounds, at, refused))
            return without_improbable(_settled_in(changed, others.fit, last.effect))
    return state


def _with_accepted(state: State, catalogue: Sequence[Effect], say: Say) -> tuple[State, tuple[Round, ...]]:
    """The state with all causes of a catalogue that are accepted, and the rounds that were refused behind it.

    Two causes may explain together what neither explains alone: a few sets may be refused on the way to one.
    """
    accepted = state
    numerics = state.criteria.numerics.naming
    limit = state.fit.flight.limit
    for _ in range(len(state.named), state.criteria.numerics.fit.repeats):
        if state.rounds and limit.leaves_out(_FURTHER):
            break
        say(f"naming, round {len(state.rounds) + 1}")
        state = _after_round(accepted, added(state, catalogue))
        if not state.rounds[-1].named:
            if state.rounds[-1].waiting and len(_in_vain(state)) < numerics.few:
                continue
            break
        if _passes(accepted, state):
            accepted = state
        elif len(state.named) - len(accepted.named) >= numerics.few:
            break
        if state.missing[0].gain < state.criteria.significance.search:  # no event either, but where terms may hide one
            nonlinear = state.evidence.nonlinear
            kept = state.fit.flight.imitated_names
            catalogue = [e for e in catalogue if e.of_an_instrument or e.name in kept or (nonlinear and not e.timed)]
    return accepted, refused_rounds(state.rounds[len(accepted.rounds) :])


def _after_round(accepted: State, state: State) -> State:
    """The state with the gates of its set, and with other causes if the set is refused."""
    if not state.rounds[-1].named:
        return state
    state = with_gates_of_set(accepted, state)
    for changed in (_without_refused, lambda _, refused: swapped(refused), _with_next_best):
        if not _passes(accepted, state) and (other := changed(accepted, state)) is not state:
            state = with_gates_of_set(accepted, other)
    return state


def _without_refused(accepted: State, state: State) -> State:
    """The state without the causes before the last one that were refused: the last is not refused for them."""
    refused = [one for one in state.rounds[len(accepted.rounds) : -1] if not all_passed(one.accepted_by)]
    if not refused or not all_passed(state.rounds[-1].accepted_by):
        return state
    fitted = without(state.fit, {one.leader.candidate.name for one in refused})
    out = {id(one): replace(one, named=False, refused_by=one.accepted_by) for one in refused}
    kept = tuple(out.get(id(one), one) for one in state.rounds)
    return _settled_in(replace(state, rounds=kept), fitted, refused[0].leader.effect)


def _with_next_best(accepted: State, state: State) -> State:
    """The state with its last cause, which was refused, replaced by the best of the others that is not."""
    at = len(state.rounds) - 1
    round_ = state.rounds[-1]
    others = [t for t in round_.rivals if t.waits or (t.meaningful and can_be_named(t))]
    for rival in [] if all_passed(round_.accepted_by) else others[: state.criteria.numerics.naming.few]:
        other = with_gates_of_set(accepted, _with_best_of(state, at, (rival,), accepted.fit))
        if other.rounds[at].leader.effect.key == rival.effect.key and _passes(accepted, other):
            return other
    return state


def with_gates_of_set(accepted: State, state: State) -> State:
    """The state whose rounds since the accepted set have the gates of their causes, each judged beside the whole set.

    A cause that is too small to matter, or that is no longer in the model, has none.
    """
    there = {one.name for one in state.fit.attached}
    new = state.rounds[len(accepted.rounds) :]
    known = [one.kinematic for one in (accepted, state) if one.kinematic is not None]
    imitated = state.fit.flight.imitated_names  # nothing was missing where a number of the file took its place

    def judged(one: Round) -> Round:
        asked = one.named and (last := one.leader).meaningful and last.candidate.name in there - imitated
        gates = explains(accepted.missing, state.missing, last, state.evidence, known) if asked else ()
        return replace(one, accepted_by=gates)

    return replace(state, rounds=(*state.rounds[: len(accepted.rounds)], *map(judged, new)))


def _passes(accepted: State, state: State) -> bool:
    """Return True if every cause that was added to the accepted set passes its gates."""
    return all(all_passed(one.accepted_by) for one in state.rounds[len(accepted.rounds) :])


def added(state: State, catalogue: Sequence[Effect]) -> State:
    """The state after one more round.

    The best cause that can be named is added. If there is none, only the round is recorded, and the next one tries
    others.
    """
    taken = {one.effect.key for one in state.fit.attached}
    taken |= {trial.effect.key for one in _in_vain(state) for trial in one.trials}
    effects = [one for one in catalogue if one.key not in taken]
    if (kinematic := state.kinematic) is not None:
        seen = [one for one in state.fit.flight.effects if one.kinematic and one.key not in taken]
        state = replace(state, observed=state.observed or screen(kinematic, seen))
    screened = _screened(state, effects)
    chosen = with_look_alikes(screened.chosen, effects, state.fit.batch.names)
    trials, fits, intervals = _tried(state, chosen, screened.likely)
    trials, equivalents = ranked(trials, fits, state.criteria)
    named = any(trial.meaningful for trial in fits)
    this = Round(
        candidates=screened.candidates,
        detectable=screened.detectable,
        trials=tuple(trials),
        equivalents=equivalents,
        named=named,
        waiting=screened.waiting if trials else frozenset(),
        screened=screened.refused,
        ranked=ranked_behind(trials[0], trials, state.criteria) if trials else {},
    )
    if not named:
        return replace(state, rounds=(*state.rounds, this))
    best, fitted, moved = settled(trials[0], fits[trials[0]], state.evidence)
    this = replace(this, trials=(best, *this.rivals))
    grown = replace(state, rounds=(*state.rounds, this), intervals={**state.intervals, **intervals, **moved})
    return _settled_in(grown, fitted, best.effect)


def _in_vain(state: State) -> list[Round]:
    """List the last rounds, which named nothing beside the present causes."""
    return list(takewhile(lambda one: not one.named, reversed(state.rounds)))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Screening:
    """The result of screening with a linearisation."""

    chosen: Sequence[Candidate]  # causes to be fitted
    refused: Mapping[str, tuple[Gate, ...]]  # gates of the causes that are not fitted, by name
    waiting: frozenset[str]  # names of those that are predicted to reach a name, and for which no place was left
    candidates: tuple[Candidate, ...]  # all causes, by net score statistic
    detectable: Mapping[str, float]  # smallest detectable sizes by name; only in the first round
    likely: Mapping[Candidate, np.ndarray]  # predicted statistics of a candidate in the full model


def _screened(state: State, effects: Sequence[Effect]) -> _Screening:
    """Screen causes and choose those that are worth a fit.

    There are three rankings: by the score statistic with the structure taken as exact, which finds causes; by the score
    statistic with model discrepancy, which confirms them; and by the kinematics alone, which wrong aerodynamics do not
    disturb.
    """
    prints = fingerprints(state.evidence, effects)
    exactly = Screen(state.evidence, exact=True)
    candidates = rank(exactly, prints)
    cautious = rank(Screen(state.evidence), prints)
    names = {one.name for one in effects}
    observed = [one for one in state.observed or () if one.name in names]
    switching = any(one.timed for one in effects) and not any(one.effect.members for one in state.fit.attached)
    switches = configuration_changes(state.evidence) if switching else []
    rankings = (candidates, cautious, observed)
    misfit = 0.0 if beyond_air(state.fit) else state.baseline.required
    chosen, refused = worth_trying(state.fit, state.kinematic, rankings, switches, misfit)
    sigmas = state.criteria.significance.detectable
    if unbalanced := _unbalanced(state, candidates, names):
        chosen = unbalanced

    def waits(one: Candidate) -> bool:
        """Return True if a cause is predicted to reach a name, and no place is left for it."""
        effect = one.attached.effect
        least = max(required_gain(effect, state.criteria), 0.0 if effect.kinematic else misfit)
        full = (gate.gate.startswith(ask.PLACES.name) for gate in refused.get(one.name, ()))
        return one.net >= least and any(full)

    return _Screening(
        chosen=chosen,
        likely=predicted_statistics(rankings),
        refused=refused,
        waiting=frozenset(one.name for one in (*cautious, *observed) if waits(one)),
        candidates=tuple(sorted([*candidates, *switches], key=lambda one: -one.net)),
        detectable={} if state.rounds else smallest_sizes(exactly, prints, candidates, sigmas),
    )


def _unbalanced(state: State, candidates: Sequence[Candidate], names: Collection[str]) -> list[Candidate]:
    """Causes that fitted numbers imitate, with the size by which these left their stated uncertainty; of several such
    numbers also what changes the balance of steady flight as a whole. Empty where none left it."""
    found = []
    for effect, value, std in state.fit.flight.suspects(state.fit):
        attached = Attached(effect=effect, values={"value": value})
        statistic = (value / std) ** 2
        one = Candidate(attached=attached, statistic=statistic, net=statistic, value=value, std=std, surviving=1.0)
        found += [one] if effect.name in names else []
    known = {one.name for one in found}
    others = [one for one in candidates if one.attached.effect.traits.balance and one.name not in known]
    if len(found) == 1:  # what sits at the same place, or nothing
        return [*found, *(one for one in others if one.attached.effect.target == found[0].attached.effect.target)]
    return [*found, *others[: state.criteria.numerics.naming.trials]] if found else []


def _settled_in(state: State, fitted: FlightFit, changed: Effect) -> State:
    """The state with another fitted model, in which the cause `changed` was added or removed.

    The noise is estimated again, and small instrument offsets that the new model shows are added.
    """
    if fitted.filter_held or fitted.noise_held:  # as it was compared with others
        fitted = relaxed(fitted)
    evidence = weigh(in_colour(_with_offsets(fitted)))
    missing = tuple(missing_inputs(evidence))
    kinematic = state.kinematic
    observed = state.observed
    if kinematic is not None and changed.kinematic:
        kinematic = kinematics.with_causes(kinematic, evidence.fit.attached)
        observed = None
    return replace(state, evidence=evidence, kinematic=kinematic, observed=observed, missing=missing)


def _tried(
    state: State, candidates: Sequence[Candidate], likely: Mapping[Candidate, np.ndarray] = _NOTHING
) -> tuple[list[Trial], dict[Trial, FlightFit], dict[str, Intervals]]:
    """Fit all candidates.

    A fixed number of candidates is fitted side by side, whatever the number of processors, so that the result does not
    depend on it. Later candidates are abandoned when they are unlikely to come near the best earlier one. None is begun
    whose `likely` statistics are a small part of what that, or a name, takes.

    fits       the fits of the trials that can be named, or that are too small to be named
    intervals  95 % intervals of the onsets, by name of the cause
    """
    trials = list[Trial]()
    fits = dict[Trial, FlightFit]()
    intervals = dict[str, Intervals]()
    give_up = np.inf
    least = np.zeros(2)
    earlier = [one.leader for one in state.named]
    required = state.baseline.required
    no_air = beyond_air(state.fit)
    seen = [(one, worth_fitting(state.kinematic, one.attached)) for one in candidates]

    def run(one: tuple[Candidate, Gate | None]) -> tuple[Trial, FlightFit, Intervals]:
        needed = np.maximum(least, required_gain(one[0].attached.effect, state.criteria))
        part = float(np.max(likely.get(one[0], needed) / needed))
        promise = promises_enough(part, state.criteria)
        if not promise.passed:
            return given_up(state.fit, one[0], promise), state.fit, {}
        try:
            limit.check()
            trial, joint, interval = try_cause(state.evidence, *one, give_up)
        except TimeIsUpError:
            limit.leave_out_fit(one[0].name)
            return given_up(state.fit, one[0], ask.TIME_LEFT.failed()), state.fit, {}
        return trial, joint.fit, interval

    parts = state.criteria.parts
    limit = state.fit.flight.limit
    at_once = state.criteria.numerics.naming.few
    for first in range(0, len(seen), at_once):
        with limit.cutting():
            results = side_by_side(run, seen[first : first + at_once])
        together = [checked(trial, fitted, state.evidence, state.kinematic) for trial, fitted, _ in results]
        for tried, (_, fitted, interval) in zip(together, results, strict=True):
            enough = None
            if tried.given_up is None:
                by_air = not no_air or not gates.still_missing(no_air, beyond_air(fitted), state.criteria).passed
                enough = gains_enough(tried, earlier, required if by_air else 0.0, state.criteria)
            trial = replace(tried, enough=enough)
            trials.append(trial)
            if not trial.refuted:
                give_up = min(give_up, fitted.deviance + parts.third * abs(trial.gain.raw))
            if interval:
                intervals[trial.candidate.name] = interval
            if can_be_named(trial):
                fits[trial] = fitted
                if trial.meaningful and (trial.confirmed or not trial.check.judges):  # no other can take its place
                    least = np.maximum(least, parts.most * np.array([trial.gain.exact, trial.gain.raw]))
    return trials, fits, intervals


def swapped(state: State) -> State:
    """The state after each cause but the last was compared once more with its near alternatives.

    They are compared beside the causes named since, because what was missing at the time may have decided between them.
    """
    for at in range(len(state.rounds) - 1):
        round_ = state.rounds[at]
        if not round_.named:
            continue
        taken = {one.effect.key for one in state.fit.attached}
        best = round_.leader
        same = round_.equivalents
        rivals = [t for t in near_rivals(round_, state.criteria) if t.effect.key not in taken]
        there = best.effect.key in taken and best.meaningful
        if there and any(t in same or may_come_near(state.evidence, best, t) for t in rivals):
            state = _with_best_of(state, at, (best, *rivals))
    return state


def _with_best_of(state: State, at: int, trials: Sequence[Trial], near: FlightFit | None = None) -> State:
    """The state with the cause of round `at` replaced by the best of `trials`, others kept; `near` as in `without`."""
    round_ = state.rounds[at]
    criteria = state.criteria
    best = round_.leader
    alone = without(state.fit, {round_.leader.candidate.name}, near)
    rounds = tuple(one for one in state.rounds if one is not round_)
    kinematic = state.kinematic
    if kinematic is not None and best.effect.kinematic:
        kinematic = kinematics.with_causes(kinematic, alone.attached)
    others = replace(state, evidence=weigh(alone), kinematic=kinematic, rounds=rounds)
    found, fits, intervals = _tried(others, [t.candidate for t in trials])
    ordered, equivalents = ranked(found, fits, criteria)
    first = ordered[0]
    if first not in fits or not first.meaningful:
        return state
    this = replace(round_, equivalents=equivalents, ranked={**round_.ranked, **ranked_behind(first, ordered, criteria)})
    if first.effect.key == best.effect.key:
        return replace(state, rounds=_replaced(state.rounds, at, this))
    first, fitted, moved = settled(first, fits[first], others.evidence)
    rest = [t for t in round_.trials if t.effect.key not in {one.effect.key for one in trials}]
    this = replace(this, trials=(first, *ordered[1:], *rest))
    intervals = {**state.intervals, **intervals, **moved}
    others = replace(others, rounds=_replaced(state.rounds, at, this), intervals=intervals)
    return _settled_in(others, fitted, first.effect)


def _replaced(rounds: tuple[Round, ...], at: int, one: Round) -> tuple[Round, ...]:
    return (*rounds[:at], one, *rounds[at + 1 :])


def _with_offsets(fitted: FlightFit) -> FlightFit:
    """The fit with small offsets of instruments that the causes had hidden; none in turbulence, which these imitate."""
    offsets = [] if fitted.noise.coloured else demanded_offsets(fitted)
    if not offsets:
        return fitted
    return fit(fitted.flight, [*fitted.attached, *offsets], fitted.noise, fitted)


def carried(baseline: Baseline, state: State) -> State:
    """The state with the causes of `state` fitted in another baseline."""
    names = {one.leader.candidate.name for one in state.standing}
    causes = [one for one in state.fit.attached if one.name in names]
    start = at_baseline(baseline)
    rounds = tuple(one for one in state.rounds if one.named)
    if not causes:
        return start
    model = baseline.start
    fitted = fit(model.flight, [*model.attached, *causes], model.noise, state.fit, extent="settled")
    moved = replace(start, rounds=rounds, intervals=state.intervals)
    return _settled_in(moved, fitted, next((e.effect for e in causes if e.effect.kinematic), causes[0].effect))


def _noise_of_the_fit(state: State, say: Say) -> Baseline | None:
    """The baseline whose noise is estimated with the model; None unless residuals with the causes far exceed the
    measured noise.
    """
    flight = unread(state.baseline.flight)
    if not (flight.noise_by_fit and is_far(state.fit, state.criteria.significance.chance)):
        return None  # where the file states the noise of too many outputs, the search would be repeated as it was
    return baseline_of(flight, state.baseline.calm.attached, say)


def _input_timing(state: State, say: Say) -> Baseline | None:
    """The baseline with corrected behaviour of the inputs between samples; None if the fit with the causes agrees with
    the present one.
    """
    begun = state.baseline
    share = as_inputs_run(state.fit, named=True).flight.held
    if share == begun.flight.held:
        return None
    flight = with_inputs_held(begun.flight, share)
    again = fit(flight, begun.calm.attached, flight.noise(), begun.calm, extent="settled")
    return _recalculated(begun, again)


def _calm_air(state: State, say: Say) -> Baseline | None:
    """The baseline in calm air; None unless the causes explain most of what was taken for turbulence."""
    begun = state.baseline
    found = state.baseline.kinematics
    if not begun.turbulence.named:
        return None
    calm = without_turbulence(begun.flight, begun.calm.attached, state.fit.attached, begun.turbulence)
    if calm is None:
        return None
    evidence, ranked_ = calm
    still = still_air(begun.flight)
    found = replace(found, evidence=evidence, ranked=ranked_, turbulence=still)
    return replace(begun, start=begun.structured, kinematics=found)


def _another_minimum(state: State, say: Say) -> Baseline | None:
    """The baseline fitted from another start; None if a cause was named, the air is turbulent, or no fit is better."""
    calm = state.baseline.calm
    if state.named or state.baseline.turbulence.named:
        return None
    other = from_elsewhere(calm)
    return None if other is None or other.deviance > calm.deviance else _recalculated(state.baseline, other)


def _recalculated(begun: Baseline, calm: FlightFit) -> Baseline:
    """The baseline from another fit of the file, with the present result of the kinematic check."""
    skews = [one for one in begun.kinematics.nuisance if one.effect.traits.late]
    nuisance = [] if begun.turbulence.named else [*demanded_offsets(calm), *skews]
    return baseline_from(calm, replace(begun.kinematics, nuisance=nuisance))


_SEARCH = "the causes of the catalogue"
_FURTHER = "further causes beside those named"
_CONDITIONS: Mapping[str, Callable[[State, Say], Baseline | None]] = MappingProxyType(
    {
        "another timing of the inputs": _input_timing,
        "calm air in place of turbulence": _calm_air,
        "another start of the fit": _another_minimum,
        "noise that is estimated with the causes": _noise_of_the_fit,
    }
)
