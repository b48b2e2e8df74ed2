"""The search for a set of causes: causes are added one by one, dropped, and swapped for rivals, each set fitted.

A linearisation about the present model says which causes to fit beside it. The best of those that were fitted is added;
causes that are not needed beside it are dropped. A set is accepted when its last cause explains what was missing
(`acceptance.explains`). When a set is refused, and in the end, each cause is compared once more with its rivals, each
fitted in its place. What the set shows of the conditions it was found in (noise, input timing, moving air, another
minimum of the baseline) is a move like these: the causes are put into the other baseline, and the search goes on there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, all_passed
from casid.diagnosis.engine.acceptance import can_be_named, explains, gains_enough, required_gain
from casid.diagnosis.engine.baseline import Baseline, baseline_from, baseline_of
from casid.diagnosis.engine.candidates import is_same, with_look_alikes, worth_trying
from casid.diagnosis.engine.comparison import look_alike, ranked, ranked_behind, sine
from casid.diagnosis.engine.fitting import settled, try_cause
from casid.diagnosis.engine.onsets import Intervals, configuration_changes
from casid.diagnosis.engine.structure import demanded_offsets
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.evidence.screening import Candidate, Screen, rank, screen, smallest_sizes
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, from_elsewhere, relaxed, without
from casid.diagnosis.flight.noise import as_inputs_run, in_colour, is_far, unread
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.stage import without_turbulence
from casid.model.effect import Effect
from casid.native.processors import side_by_side

Say = Callable[[str], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """A fitted set of causes, and how the search came to it.

    baseline   what the causes are added to
    evidence   of the model that has them
    kinematic  evidence of the kinematics beside them; None where the records cannot free the forces
    observed   ranking of instrument and air causes by the kinematics alone
    missing    what an unknown input at each station still gains
    rounds     of the search so far
    intervals  of onsets, by name of the cause
    """

    baseline: Baseline
    evidence: Evidence
    kinematic: Evidence | None
    observed: Sequence[Candidate]
    missing: tuple[MissingInput, ...]
    rounds: tuple[Round, ...] = ()
    intervals: Mapping[str, Intervals]

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
        """Those whose cause is in the model still."""
        there = {one.name for one in self.fit.attached}
        return [one for one in self.named if one.leader.candidate.name in there]


def search(baseline: Baseline, say: Say) -> State:
    """The set of causes, from a baseline on."""
    state = _grown(at_baseline(baseline), say)
    for condition in () if baseline.fixed else _CONDITIONS:
        other = condition(state, say)
        if other is not None:
            state = _grown(dropped(carried(other, state)), say)
    return state


def at_baseline(baseline: Baseline) -> State:
    """Without any cause."""
    evidence, found = weigh(baseline.start), baseline.kinematics
    return State(
        baseline=baseline,
        evidence=evidence,
        kinematic=found.evidence,
        observed=found.ranked,
        missing=tuple(missing_inputs(evidence)),
        intervals={},
    )


def _grown(state: State, say: Say) -> State:
    """With what can be added, one cause after the other, while each set is accepted.

    Two causes may together explain what neither does: a few sets may be refused on the way to one that is accepted.
    """
    accepted, numerics = state, state.criteria.numerics.naming
    catalogue: Sequence[Effect] = state.fit.flight.effects
    for _ in range(len(state.rounds), numerics.rounds):
        say(f"naming, round {len(state.rounds) + 1}")
        state = added(state, catalogue)
        if not state.rounds[-1].named:
            break
        gates = _believed(accepted, state)
        if not all_passed(gates) and (other := swapped(state)) is not state:
            state, gates = other, _believed(accepted, other)
        state = replace(state, rounds=(*state.rounds[:-1], replace(state.rounds[-1], believed=gates)))
        if all_passed(gates):
            accepted = state
        elif len(state.rounds) - len(accepted.rounds) >= numerics.tentative:
            break
        if state.missing[0].gain < state.criteria.naming.nothing_left:  # no event either, but where terms may hide one
            nonlinear = state.evidence.nonlinear
            catalogue = [one for one in catalogue if one.of_an_instrument or (nonlinear and not one.timed)]
    refused = tuple(replace(round_, named=False) for round_ in state.rounds[len(accepted.rounds) :])
    accepted = swapped(accepted)
    return replace(accepted, rounds=(*accepted.rounds, *refused))


def _believed(accepted: State, state: State) -> tuple[Gate, ...]:
    """What the last cause must pass for the set to be accepted; nothing where it is too small to matter."""
    last = state.rounds[-1].leader
    return explains(accepted.missing, state.missing, last, state.evidence) if last.meaningful else ()


def added(state: State, catalogue: Sequence[Effect]) -> State:
    """With the best cause that can be named beside those of the state, those that it makes needless dropped; with a
    round that names none, where there is none."""
    taken = {one.effect.key for one in state.fit.attached}
    effects = [one for one in catalogue if one.key not in taken]
    screened = _screened(state, effects)
    trials, fits, intervals = _tried(state, with_look_alikes(screened.chosen, effects, state.fit.batch.names))
    trials, equivalents = ranked(trials, fits, state.criteria)
    named = any(trial.meaningful for trial in fits)
    this = Round(
        candidates=screened.candidates,
        detectable=screened.detectable,
        trials=tuple(trials),
        equivalents=equivalents,
        named=named,
        screened=screened.refused,
        ranked=ranked_behind(trials[0], trials, state.criteria) if trials else {},
    )
    if not named:
        return replace(state, rounds=(*state.rounds, this))
    best, fitted, moved = settled(trials[0], fits[trials[0]])
    this = replace(this, trials=(best, *this.rivals))
    grown = replace(state, rounds=(*state.rounds, this), intervals={**state.intervals, **intervals, **moved})
    return _settled_in(grown, _without_needless(fitted, state, best), best.effect)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Screening:
    """What a linearisation says: the causes to be fitted, why the others are not, all of them by what they promise, and
    the smallest sizes that would show, of the first round."""

    chosen: Sequence[Candidate]
    refused: Mapping[str, tuple[Gate, ...]]
    candidates: tuple[Candidate, ...]
    detectable: Mapping[str, float]


def _screened(state: State, effects: Sequence[Effect]) -> _Screening:
    """Which of some effects are worth a fit.

    What a cause predicts with the structure exact finds it; what it gains beside small terms confirms it; and what
    kinematics alone say of it does not drown in wrong aerodynamics. So there are three rankings.
    """
    prints, exactly = fingerprints(state.evidence, effects), Screen(state.evidence, exact=True)
    candidates, cautious = rank(exactly, prints), rank(Screen(state.evidence), prints)
    names = {one.name for one in effects}
    observed = [one for one in state.observed if one.name in names]
    switching = any(one.timed for one in effects) and not any(one.effect.members for one in state.fit.attached)
    switches = configuration_changes(state.evidence) if switching else []
    rankings = (candidates, cautious, observed)
    chosen, refused = worth_trying(state.fit, rankings, switches, state.baseline.required)
    apart, sigmas = state.criteria.events.apart, state.criteria.verdict.detectable
    more = [c for c in _left_behind(state) if not any(is_same(c.attached, one.attached, apart) for one in chosen)]
    return _Screening(
        chosen=[*chosen, *more],
        refused=refused,
        candidates=tuple(sorted([*candidates, *switches], key=lambda one: -one.net)),
        detectable={} if state.rounds else smallest_sizes(exactly, prints, candidates, sigmas),
    )


def _settled_in(state: State, fitted: FlightFit, changed: Effect) -> State:
    """The state with another model, in which a cause has `changed`, under its own noise and with small offsets of
    instruments that it shows."""
    evidence = weigh(in_colour(_with_offsets(_relaxed(fitted))))
    kinematic, observed = state.kinematic, state.observed
    if kinematic is not None and changed.kinematic:
        kinematic = kinematics.with_causes(kinematic, evidence.fit.attached)
        taken = {one.effect.key for one in evidence.fit.attached}
        observed = screen(kinematic, [e for e in evidence.fit.flight.effects if e.kinematic and e.key not in taken])
    missing = tuple(missing_inputs(evidence))
    return replace(state, evidence=evidence, kinematic=kinematic, observed=observed, missing=missing)


def _tried(
    state: State, candidates: Sequence[Candidate]
) -> tuple[list[Trial], dict[Trial, FlightFit], dict[str, Intervals]]:
    """Trials of all candidates, the fits of those that can be named or are too small for that, and intervals of onsets
    by cause name. A few are fitted side by side on however many processors, so that the answer does not depend on
    them. Those that come later are given up when they are unlikely to come near the best before."""
    trials: list[Trial] = []
    fits: dict[Trial, FlightFit] = {}
    intervals, give_up = dict[str, Intervals](), np.inf
    earlier, required = [one.leader for one in state.named], state.baseline.required

    def run(candidate: Candidate) -> tuple[Trial, FlightFit, Intervals]:
        trial, joint, interval = try_cause(state.evidence, candidate, state.kinematic, give_up)
        return trial, joint.fit.lighter(), interval  # most of them are not looked at again

    at_once = state.criteria.numerics.naming.side_by_side
    for first in range(0, len(candidates), at_once):
        for tried, fitted, interval in side_by_side(run, candidates[first : first + at_once]):
            enough = gains_enough(tried, earlier, required, state.criteria) if tried.given_up is None else None
            trial = replace(tried, enough=enough)
            trials.append(trial)
            if not trial.refuted:
                give_up = min(give_up, fitted.deviance + state.criteria.naming.give_up * abs(trial.gain.raw))
            if interval:
                intervals[trial.candidate.name] = interval
            if can_be_named(trial):
                fits[trial] = fitted
    return trials, fits, intervals


def _left_behind(state: State) -> list[Candidate]:
    """The best trial of the round before that has nothing in common with what it named: it is still there, and found,
    where a screening beside what else is missing may look for it elsewhere."""
    if not state.rounds:
        return []
    best, *others = state.rounds[-1].trials
    by, taken = state.criteria.naming, {one.effect.key for one in state.fit.attached}
    apart = [t for t in others if t.meaningful and not t.refuted and t.effect.key not in taken]
    return [
        t.candidate for t in apart if t.gain.total > by.left_behind * best.gain.total and sine(best, t) > by.rival_angle
    ][:1]


def _without_needless(fitted: FlightFit, state: State, last: Trial | None = None) -> FlightFit:
    """The fit without those causes of a state that gain too little for a name beside the others. With a `last` one,
    those that had it as a rival when they were named: what was missing then may have decided wrongly."""
    doubted = [
        one.leader
        for one in state.standing
        if last is None or last.effect.key in {trial.effect.key for trial in one.trials}
    ]
    if not doubted:
        return fitted
    evidence = weigh(fitted)
    for one in doubted:
        name = one.candidate.name
        if _is_needed(evidence, name):
            continue
        others = weigh(without(evidence.fit, {name}))
        if others.deviance < evidence.deviance + required_gain(one.effect, evidence.criteria):
            evidence = others
    return evidence.fit


def _is_needed(evidence: Evidence, name: str) -> bool:
    """Whether a cause is so far from zero, in its 1-sigma, that no fit without it can come near."""
    if name not in {slot.name for slot in evidence.fit.slots}:
        return False
    index, by = [slot.name for slot in evidence.fit.slots].index(name), evidence.criteria.naming
    return evidence.fit[name] ** 2 > by.needed * by.gain * evidence.covariance[index, index]


def dropped(state: State) -> State:
    """Without the causes that are not needed beside the others."""
    fitted = _without_needless(state.fit, state)
    if fitted is state.fit:
        return state
    gone = [one.leader.effect for one in state.standing if one.leader.candidate.name not in _names(fitted)]
    return _settled_in(state, fitted, next((e for e in gone if e.kinematic), gone[0]))


def _names(fitted: FlightFit) -> set[str]:
    return {one.name for one in fitted.attached}


def swapped(state: State) -> State:
    """With each cause but the last compared once more with its near rivals, beside those named since: what was missing
    when it was named may have decided between them."""
    for at in range(len(state.rounds) - 1):
        round_, taken = state.rounds[at], {one.effect.key for one in state.fit.attached}
        best = round_.leader
        rivals = [t for t in _near_rivals(round_, state.criteria) if t.effect.key not in taken]
        if rivals and round_.named and best.effect.key in taken and best.meaningful:
            state = _with_best_of(state, at, (best, *rivals))
    return state


def _near_rivals(round_: Round, criteria: Criteria) -> list[Trial]:
    """Trials of a round that may stand in its leader's place, a few of those that explain nearly as much and much the
    same, and all that look alike."""
    best, by = round_.leader, criteria.naming
    possible = [t for t in round_.rivals if t.meaningful and not t.refuted]
    alike = [t for t in possible if look_alike(t.effect, best.effect)]
    near = [t for t in possible if t.gain.total > by.rival * best.gain.total and sine(best, t) < by.rival_angle]
    return [*[t for t in near if t not in alike][: criteria.numerics.naming.rivals], *alike]


def _with_best_of(state: State, at: int, trials: Sequence[Trial]) -> State:
    """With the best of these causes in the place of that of a round, beside all others."""
    round_, criteria = state.rounds[at], state.criteria
    best, alone = round_.leader, without(state.fit, {round_.leader.candidate.name})
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
    first, fitted, moved = settled(first, fits[first])
    rest = [t for t in round_.trials if t.effect.key not in {one.effect.key for one in trials}]
    this = replace(this, trials=(first, *ordered[1:], *rest))
    swapped = replace(
        others,
        rounds=_replaced(state.rounds, at, this),
        intervals={**state.intervals, **intervals, **moved},
    )
    return _settled_in(swapped, fitted, first.effect)


def _replaced(rounds: tuple[Round, ...], at: int, one: Round) -> tuple[Round, ...]:
    return (*rounds[:at], one, *rounds[at + 1 :])


def _relaxed(fitted: FlightFit) -> FlightFit:
    """The fit by its own noise, where it was compared under that of another."""
    return relaxed(fitted) if fitted.filter_held or fitted.noise_held else fitted


def _with_offsets(fitted: FlightFit) -> FlightFit:
    """The fit with small offsets of instruments that what was named before had hidden; none in moving air, which they
    imitate."""
    offsets = [] if fitted.noise.coloured else demanded_offsets(fitted)
    return fit(fitted.flight, [*fitted.attached, *offsets], fitted.noise, fitted) if offsets else fitted


def carried(baseline: Baseline, state: State) -> State:
    """The causes of a state put into another baseline."""
    names = {one.leader.candidate.name for one in state.standing}
    causes = [one for one in state.fit.attached if one.name in names]
    start = at_baseline(baseline)
    rounds = tuple(one for one in state.rounds if one.named)
    if not causes:
        return start
    model = baseline.start
    fitted = fit(model.flight, [*model.attached, *causes], model.noise, state.fit, iterations=20)
    moved = replace(start, rounds=rounds, intervals=state.intervals)
    return _settled_in(moved, fitted, next((e.effect for e in causes if e.effect.kinematic), causes[0].effect))


def _noise_of_the_fit(state: State, say: Say) -> Baseline | None:
    """The noise is what the fit leaves, where the causes leave far more than was read as noise."""
    if not is_far(state.fit, state.criteria.noise.far_from_causes):
        return None
    return baseline_of(unread(state.baseline.flight), state.baseline.calm.attached, say)


def _input_timing(state: State, say: Say) -> Baseline | None:
    """Inputs run otherwise between samples, where surfaces agree on that beside the causes."""
    begun, share = state.baseline, as_inputs_run(state.fit, named=True).flight.held
    if share == begun.flight.held:
        return None
    flight = begun.flight.with_inputs_held(share)
    again = fit(flight, begun.calm.attached, flight.noise(), begun.calm, iterations=20)
    return _recalculated(begun, again)


def _calm_air(state: State, say: Say) -> Baseline | None:
    """The air does not move, where the causes leave little of what was read as turbulence."""
    begun, found = state.baseline, state.baseline.kinematics
    if not begun.turbulence.named:
        return None
    calm = without_turbulence(begun.flight, begun.calm.attached, state.fit.attached, begun.turbulence)
    if calm is None:
        return None
    evidence, ranked_ = calm
    still = kinematics.still_air(begun.flight)
    found = replace(found, evidence=evidence, ranked=ranked_, turbulence=still)
    return replace(begun, start=begun.structured, kinematics=found)


def _another_minimum(state: State, say: Say) -> Baseline | None:
    """The baseline comes nearer to the data from another start, where it ended far from them and nothing was named."""
    calm = state.baseline.calm
    if state.named or state.baseline.turbulence.named:
        return None
    other = from_elsewhere(calm)
    return None if other is None or other.deviance > calm.deviance else _recalculated(state.baseline, other)


def _recalculated(begun: Baseline, calm: FlightFit) -> Baseline:
    """The baseline from another fit of the file, its kinematics as they were."""
    skews = [one for one in begun.kinematics.nuisance if one.effect.late]
    nuisance = [] if begun.turbulence.named else [*demanded_offsets(calm), *skews]
    return baseline_from(calm, replace(begun.kinematics, nuisance=nuisance))


_CONDITIONS: tuple[Callable[[State, Say], Baseline | None], ...] = (
    _input_timing,
    _calm_air,
    _another_minimum,
    _noise_of_the_fit,
)
