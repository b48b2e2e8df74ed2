"""The reported causes of a search: named causes, minor ones, and what is still missing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from casid.diagnosis import comparisons as ask
from casid.diagnosis import gates
from casid.diagnosis.cause import IN_A_SET, MINOR, NAMED, REFUSED, Cause, Decision, Trace, merged
from casid.diagnosis.comparisons import FINAL, Gate, all_passed
from casid.diagnosis.engine.acceptance import concerned, sine, sure_beside_all
from casid.diagnosis.engine.baseline import is_induced_drag, is_usual
from casid.diagnosis.engine.held_out import Kept
from casid.diagnosis.engine.search import State
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.evidence import Evidence, deviation, sure, unlike_derivatives, variation
from casid.diagnosis.evidence.fingerprints import largest_change
from casid.diagnosis.evidence.missing_input import MissingInput, missing_oscillation
from casid.diagnosis.evidence.onsets import Intervals, end_intervals
from casid.diagnosis.evidence.size import meaningful_share, missing_size
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics.turbulence import Turbulence
from casid.diagnosis.sentences import NOT_CONFIRMED, NOT_NEEDED, cause_sentence, expected_of, noted
from casid.model import station
from casid.model.aircraft import Aircraft
from casid.model.causes.aerodynamics import aero_term, unsteady_aero
from casid.model.causes.air import turbulence as turbulence_effect
from casid.model.effect import Effect
from casid.model.terms import parse_term
from casid.model.vocabulary import effect_sentence, title_of

_LASTING = ("length", "duration")  # durations of events
_OF_THE_AIR = tuple(station.reading(channel) for channel in ("V", "alpha", "beta"))


def causes_of(
    state: State, kept: Kept, left: Sequence[MissingInput], alone: tuple[Gate, ...] = ()
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """The named and the minor causes, strongest first.

    A cause is named if the held-out records support it, and if it is significant and matters beside all others in the
    final model. Structure that every aircraft has is minor unless it is unusually large. An effect that is expected of
    some aircraft is minor unless it is equivalent to another cause. `left` are latent inputs of the model. A cause of
    a size that does not matter is named if the gates on what values leave `alone` pass.
    """
    final = kept.evidence.fit
    required = state.baseline.required
    told = [*_moving_air(state, kept)]
    told += [_of_round(one, state, kept, alone) for one in state.named if not _is_structure(one, final)]
    causes, minor = ([cause for cause, named in told if named is wanted] for wanted in (True, False))
    missing = {m.station: m.gain for m in left}
    unexplained = still_missing(kept.evidence, left, causes, required)
    usual = {one.name: kept.structure_gain for one in kept.structure}
    names = (one.leader.candidate.name for one in state.named if _is_structure(one, final))
    usual |= {name: kept.gains.get(name) for name in names}
    for name, held in usual.items():
        target = next(one.effect.target for one in final.attached if one.name == name)
        left_there = np.inf if unexplained else missing.get(station.coefficient(target), 0.0)
        put_in = _expected(name, kept.evidence, held, required, left_there)
        (causes if put_in.meaningful else minor).append(put_in)
    return tuple(sorted(causes, key=lambda c: -c.statistic)), tuple(minor)


def _is_structure(round_: Round, final: FlightFit) -> bool:
    """Return True if a round named structure that every aircraft has, and it is still in the final model."""
    name = round_.leader.candidate.name
    return is_usual(round_.leader.effect) and name in {one.name for one in final.attached}


def _moving_air(state: State, kept: Kept) -> list[tuple[Cause, bool]]:
    """Turbulence as a cause, and whether it is named; empty in calm air."""
    air = state.baseline.turbulence
    fitted = kept.fit
    if not air.named:
        return []
    cause = turbulence_cause(air, fitted.flight.aircraft, kept.air_gain)
    named = bool(fitted.noise.coloured)
    return [(cause if named else noted(cause, NOT_CONFIRMED), named)]


def _of_round(round_: Round, state: State, kept: Kept, alone: tuple[Gate, ...]) -> tuple[Cause, bool]:
    """The cause of a round, and whether it is named."""
    evidence = kept.evidence
    leader = round_.leader
    name = leader.candidate.name
    held = kept.gains.get(name)
    asked = tuple(gate for of, gate in kept.gates.items() if of == name)
    if name not in {one.name for one in evidence.fit.attached}:
        if name in {one.name for one in state.fit.attached}:
            return noted(cause_of(leader, state, (), held, asked), NOT_CONFIRMED), False
        asked = (*asked, ask.STILL_NEEDED.failed())
        return noted(cause_of(leader, state, (), held, asked), NOT_NEEDED), False
    size = still_matters(evidence.fit, name, alone)
    final = (*sure_beside_all(evidence, name), *(replace(gate, gate=gate.gate + FINAL) for gate in size))
    asked = (*asked, *final)
    present = _as_in(evidence, leader)
    if not all_passed(final):
        refused = cause_of(present, state, (), held, asked)
        return noted(refused, NOT_NEEDED) if leader.meaningful else refused, False
    cause = cause_of(present, state, round_.equivalents, held, asked)
    if leader.effect.traits.expected and not round_.equivalents:
        return expected_of(cause, "a propeller aircraft"), False
    return cause, True


def trace_of_search(
    state: State, causes: Sequence[Cause], minor: Sequence[Cause], refused: Sequence[Cause] = ()
) -> Trace:
    """The decisions of all rounds, with the later gates of the causes that these named.

    A cause is named, too small to matter, or refused with the gate that it failed.
    """
    final, small, out = ({one.key: one for one in some} for some in (causes, minor, refused))
    alike = {(o["kind"], o["target"], o["term"]) for one in causes for o in one.indistinguishable_from}
    found = []
    told = set[tuple[str, str, str | None]]()
    for number, round_ in enumerate(state.rounds, 1):
        keys = {trial.candidate.name: trial.effect.key for trial in round_.trials}
        for one in round_.decisions(number):
            key = keys.get(one.cause)
            if one.outcome == NAMED and key is not None:
                cause = final.get(key) or small.get(key) or out.get(key)
                told.add(key)
                outcome = NAMED if key in final else MINOR if key in small else REFUSED
                later = cause.gates if cause else (ask.STILL_NEEDED.failed(),)
                one = replace(one, outcome=outcome, gates=(*one.gates, *later))
            elif one.outcome == IN_A_SET and key not in alike:
                unnamed = ask.FIRST_IS_NAMED.failed(f" ({round_.leader.candidate.name})")
                one = replace(one, outcome=REFUSED, gates=(*one.gates, unnamed))
            found.append(one)
    exits = ((causes, NAMED), (minor, MINOR), (refused, REFUSED))
    put_in = [
        Decision(cause=one.name, round=0, outcome=outcome, gates=one.gates)
        for some, outcome in exits
        for one in some
        if one.gates and one.key not in told
    ]
    return Trace(decisions=merged([*put_in, *found]))


def still_matters(fit: FlightFit, name: str, alone: tuple[Gate, ...] = ()) -> tuple[Gate, ...]:
    """The gates on the size of a named cause beside the causes named after it: it is possible, and it matters, or what
    values leave `alone` does."""
    one = next(a for a in fit.attached if a.name == name)
    return (*gates.possible(one), ask.MATTERS.of(meaningful_share(fit, one), 1.0, "size.share", alone))


def too_small(state: State, seen: Sequence[Cause], missing: Sequence[MissingInput]) -> tuple[Cause, ...]:
    """Causes that the records show beside those already reported (`seen`), but that do not matter.

    These are causes of the round that named nothing, and small terms. Sizes of small causes are distorted while
    something larger is missing. In that case only one cause is returned, and only if it has most of the
    likelihood-ratio statistic of the strongest latent input of `missing`: it may be what is missing.
    """
    found = [cause_of(trial, state) for trial in minor_trials(state, seen)]
    if missing:
        part = state.criteria.parts.most
        return tuple(c for c in found[:1] if c.share < 1.0 and c.statistic > part * missing[0].gain)
    return (*found, *_small_terms(state.evidence, {(c.target, c.term) for c in (*seen, *found)}))


def minor_trials(state: State, seen: Sequence[Cause]) -> list[Trial]:
    """Trials of the round that named nothing beside all causes, with enough statistic and a size that is sure and does
    not matter.

    The strongest come first. Of several that act at one place with similar fingerprints, only the first is returned.
    """
    known = {c.key for c in seen}
    found = []
    last = max((at for at, one in enumerate(state.rounds, 1) if one.named), default=0)
    for round_ in state.rounds[last:]:
        for trial in sorted(round_.trials, key=lambda t: -t.gain.net):
            effect = trial.effect
            if (
                trial.gain.net > gates.required_gain(effect, state.criteria)
                and not trial.refuted
                and not trial.meaningful
                and abs(trial.candidate.attached.values["value"]) > state.criteria.significance.sigmas * trial.std
                and gates.is_possible(trial.candidate.attached)
                and effect.key not in known
                and not any(
                    t.effect.target == effect.target and sine(t, trial) < state.criteria.parts.most for t in found
                )
            ):
                found.append(trial)
                known.add(effect.key)
    return found


def _as_in(evidence: Evidence, trial: Trial) -> Trial:
    """The trial with its value in the final model, and its corrected standard deviation."""
    one = next(a for a in evidence.fit.attached if a.name == trial.candidate.name)
    candidate = replace(trial.candidate, attached=one)
    share = meaningful_share(evidence.fit, one)
    std = deviation(evidence, one.name, concerned(evidence, one.name))
    return replace(trial, candidate=candidate, std=std, share=share)


def cause_of(
    trial: Trial,
    state: State,
    equivalents: Sequence[Trial] = (),
    held: float | None = None,
    asked: tuple[Gate, ...] = (),
) -> Cause:
    """The cause to be reported for a trial."""
    one = trial.candidate.attached
    fit = state.evidence.fit
    names = state.evidence.fit.batch.names
    effect = one.effect
    values = one.effect.in_words(one.values)
    dof, (value, std) = len(values), fit.flight.sizes.told(fit, one, trial.std)
    onsets = onset_intervals(state.evidence, one, state.intervals.get(one.name, {}))
    ends = end_intervals(state.evidence, one)
    equal = _equal(one, fit, trial.gain.raw)
    keys = {(entry["kind"], entry["target"], entry["term"]) for entry in equal}
    return Cause(
        effect=effect,
        value=value,
        std=std,
        records=tuple(one.onsets) if effect.timed else one.records or names,
        onset_s=onsets if effect.timed else None,
        end_s=ends or None,
        statistic=trial.gain.raw + trial.gain.spared,
        dof=dof,
        held_out_gain=held,
        indistinguishable_from=(*equal, *(_named(t) for t in equivalents if t.effect.key not in keys)),
        sentence=cause_sentence(one, value, std, len(names), (onsets, ends)),
        parameters={k: v for k, v in values.items() if k != "value" and v != effect.further.defaults.get(k)},
        meaningful=trial.meaningful,
        share=trial.share,
        on_readings=math.inf if one.name in {a.name for a in fit.attached} else largest_change(fit, one),
        gates=asked,
    )


def onset_intervals(evidence: Evidence, one: Attached, intervals: Intervals) -> Intervals:
    """Intervals of the onsets [s], widened by the uncertainty of the duration.

    The records determine the middle of an event, so that its onset is uncertain by half of its duration's uncertainty.
    An event that outlasts the records is not widened.
    """
    longest = max(record.duration for record in evidence.fit.flight.records)
    lasting = {f"{one.name}.{key}" for key, value in one.values.items() if key in _LASTING and value < longest}
    half = [0.5 * deviation(evidence, slot.name) for slot in evidence.fit.slots if slot.name in lasting]
    room = float(special.ndtri(0.5 * (1.0 + evidence.criteria.priors.holds))) * sum(half)
    return {record: (round(low - room, 3), round(high + room, 3)) for record, (low, high) in intervals.items()}


def _expected(name: str, evidence: Evidence, held: float | None, required: float, left: float) -> Cause:
    """A term that was added before the search, which is a cause (`meaningful`) only if it is unusually large.

    It must be significant and matter, have more statistic than `required`, and not lose on the held-out records
    (`held`). At most a small part may still be missing at its coefficient (`left`), because that distorts it.
    """
    fit = evidence.fit
    criteria = evidence.criteria
    one = next(a for a in fit.attached if a.name == name)
    effect = one.effect
    value = fit[name]
    statistic = (fit[name] / fit.std(name)) ** 2
    share = meaningful_share(fit, one)
    sentence = effect_sentence(*one.effect.key, value)
    usual = one.nuisance or is_induced_drag(effect, value, fit)
    clear = gates.clear_gain(effect, criteria, fit.flight.noise_by_fit)
    asked = (
        ask.UNUSUAL.of(usual, 0.0),
        ask.GAIN.of(statistic, required, "naming.approximate"),
        *gates.clear_size(share, statistic, clear, criteria),
        *sure(evidence, name),
        ask.GAIN_HELD_OUT.of(held or 0.0, 0.0),
        gates.still_missing(statistic, left, criteria),
    )
    meaningful = all_passed(asked)
    cause = Cause(
        effect=effect,
        value=value,
        std=deviation(evidence, name),
        records=fit.batch.names,
        statistic=statistic,
        held_out_gain=held,
        meaningful=meaningful,
        share=share,
        gates=asked,
        sentence=sentence,
    )
    return cause if meaningful or one.nuisance else expected_of(cause, "any aircraft")


def _named(trial: Trial) -> Mapping[str, object]:
    """The entry of an alternative in `indistinguishable_from`."""
    return _entry(trial.effect, float(trial.candidate.attached.values["value"]), trial.gain.raw)


def _equal(one: Attached, fit: FlightFit, gain: float) -> list[Mapping[str, object]]:
    """The entry of the effect that is equal to a cause by algebra; empty without one."""
    if one.effect.traits.equal is None or one.records:
        return []
    other, factor = one.effect.traits.equal(fit.flight.file)
    return [_entry(other, factor * one.values["value"], gain)]


def _entry(effect: Effect, value: float, gain: float) -> Mapping[str, object]:
    return {
        "kind": effect.kind,
        "target": effect.target,
        "term": effect.term,
        "title": title_of(effect),
        "value": value,
        "unit": effect.unit,
        "gain": gain,
    }


def turbulence_cause(turbulence: Turbulence, aircraft: Aircraft, held: float | None) -> Cause:
    """Turbulence as a cause; `held` is the log likelihood per held-out sample that it adds."""
    effect = turbulence_effect("")
    return Cause(
        effect=effect,
        value=turbulence.sigma,
        std=turbulence.std,
        records=turbulence.records,
        statistic=turbulence.gain,
        held_out_gain=held,
        sentence=effect_sentence(*effect.key, turbulence.sigma),
        meaningful=True,
        share=turbulence.sigma / (effect.smallest_that_matters(aircraft) or 1.0),
    )


def _small_terms(evidence: Evidence, known: set) -> list[Cause]:
    """Terms that are significant in the model discrepancy but too small to matter."""
    fit = evidence.fit
    k = len(evidence.fit.slots)
    size = variation(evidence.fit)
    sigmas = evidence.criteria.significance.detectable
    matter = evidence.criteria.size.share
    found = []
    for i, (coefficient, term) in enumerate(evidence.terms):
        mean = float(evidence.newton[k + i])
        std = float(np.sqrt(evidence.covariance[k + i, k + i]))
        if abs(mean) < sigmas * std or (coefficient, term) in known:
            continue
        factor = evidence.factors[i]
        series = np.broadcast_to(parse_term(term).evaluate(fit.regressors), fit.batch.live.shape)
        left = unlike_derivatives(fit, coefficient, mean * factor * series)
        share = float(np.std(left[fit.batch.live])) / size[coefficient]
        if share > matter:
            continue  # not small: it represents something missing, and the verdict states where
        effect = unsteady_aero(coefficient) if "dot" in term else aero_term(coefficient, term)
        sentence = effect_sentence(*effect.key, mean * factor)
        found.append(
            Cause(
                effect=effect,
                value=mean * factor,
                std=std * factor,
                records=fit.batch.names,
                statistic=(mean / std) ** 2,
                meaningful=False,
                share=share / matter,
                on_readings=largest_change(fit, Attached(effect=effect, values={"value": mean * factor})),
                sentence=f"Real, but too small to matter ({100 * share:.1f} % of {coefficient}): {sentence}",
            )
        )
    return sorted(found, key=lambda c: -c.statistic)[: evidence.criteria.numerics.naming.trials]


def still_missing(
    evidence: Evidence,
    left: Sequence[MissingInput],
    causes: Sequence[Cause],
    required: float,
    share: float | None = None,
) -> list[MissingInput]:
    """Latent inputs that no cause explains, strongest first.

    Candidates are the inputs `left` and one oscillation. The statistic of each must exceed the criterion for a missing
    input, the part of turbulence that is misfit (`required`), and what the approximate shapes of the `causes` leave.
    Its size must matter; `share` is another share of the variation at its port than that from which a cause matters.
    """
    least = 1.0 if share is None else share / evidence.criteria.size.share
    by = evidence.criteria
    rough = sum((by.naming.approximate if one.onset_s else by.structure.known) * one.statistic for one in causes)
    enough = max(by.missing, required, rough)
    if evidence.fit.noise.coloured:  # slow wind is part of turbulence, whatever its spectrum
        left = [m for m in left if m.station not in _OF_THE_AIR]
    left = [m for m in left if m.place.name not in evidence.fit.flight.unknown]
    found = [*left, *missing_oscillation(evidence)]
    return sorted(
        (m for m in found if m.gain > enough and missing_size(evidence.fit, m) > least), key=lambda m: -m.gain
    )
