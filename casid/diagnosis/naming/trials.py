"""Try a cause: which are worth a fit, the fit itself, and whether the size that it finds matters and is possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.screening import Candidate, equivalence
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.late import as_read, lateness
from casid.diagnosis.kinematics.check import hopeless, kinematic_check
from casid.diagnosis.naming.events import Intervals, at_peak, further_records, is_sudden, weak_members
from casid.diagnosis.naming.round import Gain, Trial
from casid.diagnosis.naming.size import is_artefact, meaningful_share, plausible
from casid.errors import InputError
from casid.model.causes import configuration_change
from casid.model.effect import Effect
from casid.native.processors import side_by_side


def worth_trying(
    base: FlightFit,
    candidates: Sequence[Candidate],
    cautious: Sequence[Candidate],
    observed: Sequence[Candidate],
    switches: Sequence[Candidate],
    required: float,
) -> list[Candidate]:
    """The best few of the three rankings, and only what could reach the `required` gain, unless kinematics
    may confirm it, and a size that matters at all. A configuration change is scored in one record only, so it cannot be
    ranked with the others."""
    criteria = base.criteria
    trials, few = criteria.numerics.naming.trials, criteria.numerics.naming.further_trials
    apart = criteria.events.apart
    chosen = [*_best_few(base, candidates, trials), *_best_few(base, switches, 1)]
    for ranking in (cautious, observed):
        before = tuple(chosen)
        chosen += [
            c for c in _best_few(base, ranking, few) if not any(is_same(c.attached, b.attached, apart) for b in before)
        ]
    return [c for c in chosen if c.net > criteria.naming.tried_gain * required or c.attached.effect.kinematic]


def is_same(one: Attached, other: Attached, apart: float) -> bool:
    """Whether two candidates are one: an event at another time, `apart` [s] or more, or the other way, is another."""
    if one.name != other.name or not one.effect.timed:
        return one.name == other.name
    near = all(abs(other.onsets.get(record, np.inf) - onset) < apart for record, onset in one.onsets.items())
    return near and one.values["value"] * other.values["value"] > 0.0


def _best_few(base: FlightFit, candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """`count` of them, no more than two terms of one coefficient; and beside these such as promise the same, for
    they may be one set."""
    criteria, numerics = base.criteria.naming, base.criteria.numerics.naming
    reached = criteria.tried_gain * criteria.gain
    chosen: list[Candidate] = []
    alike: list[Candidate] = []
    for candidate in candidates:
        effect = candidate.attached.effect
        if candidate.net < reached or len(chosen) == count:
            break
        share = meaningful_share(base, candidate.attached)
        clear = effect.of_an_instrument or share**2 * candidate.statistic > criteria.tried_clear * clear_gain(base)
        if share < criteria.tried_size or not clear:
            continue
        terms = [
            c for c in (*chosen, *alike) if c.attached.effect.quasi_steady and c.attached.effect.target == effect.target
        ]
        if effect.quasi_steady and len(terms) >= numerics.terms:
            near = terms[0].net - candidate.net < equivalence(terms[0].net, base.criteria)
            if len(terms) < numerics.equivalent_terms and near:
                alike.append(candidate)
            continue
        chosen.append(candidate)
    names = {one.name for one in (*chosen, *alike)}
    others = [c for c in candidates if c.name not in names and c.net > reached]
    alike += [c for c in others if any(_promise_the_same(c, one, base.criteria) for one in chosen)]
    return [*chosen, *alike]


def _promise_the_same(one: Candidate, other: Candidate, criteria: Criteria) -> bool:
    """Whether two causes that are no terms act at the same place, as a lag and a delay do, and neither leads."""
    effect, second = one.attached.effect, other.attached.effect
    of_one_place = effect.target == second.target and not (effect.quasi_steady or second.quasi_steady)
    return of_one_place and abs(one.net - other.net) < equivalence(other.net, criteria)


def try_cause(
    evidence: Evidence, candidate: Candidate, kinematic: Evidence | None, give_up: float
) -> tuple[Trial, Evidence, Intervals]:
    """A candidate fitted beside what the evidence's model has: the trial, evidence, and intervals of onsets. It is
    not fitted to the end when it cannot come below the deviance `give_up`, and not at all when kinematics refute it at
    half the predicted size and any larger one."""
    base, attached, noise = evidence.fit, replace(candidate.attached, passes=False), evidence.fit.noise
    if hopeless(kinematic, attached):
        return _given_up(base, candidate), evidence, {}
    interval: Intervals = {}
    # of size zero, the further values of an effect would be free of any sense
    alone = attached.effect.linear and set(attached.values) == {"value"}
    begin = [*base.attached, attached.with_values({"value": 0.0}) if alone else attached]
    try:
        fitted = fit(base.flight, begin, noise, base, iterations=8, tolerance=3.0, give_up=give_up)
        joint = weigh(fitted)
    except (InputError, np.linalg.LinAlgError):  # it makes an aircraft that cannot fly the record, or hardly
        return _given_up(base, candidate), evidence, {}
    if attached.effect.timed:
        wider = further_records(joint, fitted.attached[-1])
        if len(wider.onsets) > len(attached.onsets):
            joint = weigh(fit(base.flight, [*base.attached, wider], noise, fitted, iterations=6, tolerance=3.0))
        if joint.fit.deviance < give_up:
            joint, interval = at_peak(joint, evidence.criteria.numerics.events.trial_moves)
    if attached.effect.members:
        joint = _without_weak(base, joint)
    fitted = joint.fit
    one = fitted.attached[-1]
    raw = evidence.deviance - joint.deviance
    spared = evidence.deviance_at_scales(joint.scales) - evidence.deviance
    # a term makes its coefficient look more nonlinear: the scale of the others is what it was without it
    clear = raw + spared if one.effect.regressor else raw
    share = meaningful_share(fitted, one)
    check = kinematic_check(kinematic, one)
    trial = Trial(
        candidate=replace(candidate, attached=one),
        std=_std(fitted, one),
        fit=None,
        fingerprint=_fingerprint(fitted, base, one),
        gain=Gain(
            raw=raw,
            price=candidate.statistic - candidate.net,
            spared=spared,
            exact=base.deviance - fitted.deviance,
        ),
        where=_where(base, fitted),
        meaningful=matters(share, clear, clear_gain(base), check.confirmed or one.effect.of_an_instrument)
        and plausible(one)
        and not is_artefact(one, share, base.criteria.size)
        and not _from_the_start(fitted, one)
        and (not one.effect.recurring or is_sudden(evidence, one, joint)),
        share=share,
        check=check,
    )
    return trial, joint, interval


def _where(base: FlightFit, fitted: FlightFit) -> np.ndarray:
    """(N, R) part of the likelihood gained at each sample."""
    gained = base.deviance_by_sample - fitted.deviance_by_sample
    return gained / gained.sum() if gained.sum() > 0.0 else np.zeros((0, 0))


def _given_up(base: FlightFit, candidate: Candidate) -> Trial:
    return Trial(
        candidate=candidate,
        std=candidate.std,
        fit=None,
        fingerprint=np.zeros(0),
        gain=Gain(
            raw=candidate.statistic,
            price=candidate.statistic - candidate.net,
            spared=0.0,
            exact=candidate.statistic,
        ),
        where=np.zeros((0, 0)),
        share=meaningful_share(base, candidate.attached),
        meaningful=False,
        given_up=True,
    )


def required_gain(effect: Effect, criteria: Criteria) -> float:
    """Net drop of the deviance that a cause must reach to be named."""
    return criteria.naming.gain_of_an_instrument if effect.of_an_instrument else criteria.naming.gain


def clear_gain(base: FlightFit) -> float:
    """Gain at which a cause that just matters is clear: misfit of the structure, where it is not in the noise, makes
    many sigmas of nothing."""
    by = base.criteria.naming
    return by.clear_of_misfit if base.flight.noise_by_fit else by.clear


def matters(share: float, gain: float, clear: float, unlike_aerodynamics: bool = False) -> bool:
    """Whether a size, in units of the smallest that matters, matters and is clear enough to be believed, or nothing in
    the aerodynamics could look like it."""
    return share >= 1.0 and (unlike_aerodynamics or share**2 * gain > clear)


def _from_the_start(fitted: FlightFit, one: Attached) -> bool:
    """Whether an event sets in as early in every record as events are looked for: then it is none."""
    edge, within = fitted.criteria.screening.edge, fitted.criteria.events.at_start
    first = {record.name: record.t[0] + edge for record in fitted.flight.records}
    return bool(one.onsets) and all(onset < first[record] + within for record, onset in one.onsets.items())


def _std(fitted: FlightFit, one: Attached) -> float:
    """1-sigma of the value; of a value that is not fitted itself, none."""
    return fitted.std(one.name) if any(slot.name == one.name for slot in fitted.slots) else float("nan")


def _fingerprint(fitted: FlightFit, base: FlightFit, one: Attached) -> np.ndarray:
    """(samples,) whitened sensitivity to the cause, projected off the slots of the model without it."""
    late = lateness(fitted.attached, fitted.flight, fitted.model)
    flat = as_read(late, fitted.columns).reshape(fitted.white.size, len(fitted.slots))
    own = flat[:, [slot.name for slot in fitted.slots].index(one.name)]
    known = {slot.name for slot in base.slots}
    basis = flat[:, [i for i, slot in enumerate(fitted.slots) if slot.name in known]]
    basis = basis / np.maximum(np.linalg.norm(basis, axis=0), 1e-300)
    return (own - basis @ np.linalg.lstsq(basis, own, rcond=None)[0]).astype(np.float32)


def settled(trial: Trial, fitted: FlightFit) -> tuple[Trial, Evidence, dict[str, Intervals]]:
    """The winner fitted to the end, its evidence, and intervals of onsets by cause: what a half-converged cause leaves
    behind looks like another cause. Events that were named before it move to where they belong beside it."""
    before, intervals = fitted.deviance, {}
    name = fitted.attached[-1].name
    fitted = _ended(fitted)
    evidence = weigh(fit(fitted.flight, fitted.attached, fitted.noise, fitted, iterations=15, tolerance=0.3))
    earlier = [i for i, one in enumerate(fitted.attached[:-1]) if one.effect.timed]
    if fitted.attached[-1].effect.timed:
        evidence, intervals[name] = at_peak(evidence)
        fitted = evidence.fit
        wider = further_records(evidence, fitted.attached[-1])
        if len(wider.onsets) > len(fitted.attached[-1].onsets):
            attached = [*fitted.attached[:-1], wider]
            fitted = fit(fitted.flight, attached, fitted.noise, fitted, iterations=15, tolerance=0.3)
            evidence, intervals[name] = at_peak(weigh(fitted))
    for i in earlier:
        evidence, intervals[evidence.fit.attached[i].name] = at_peak(evidence, which=i)
    if earlier and evidence.fit.attached[-1].effect.timed:
        evidence, intervals[name] = at_peak(evidence)
    fitted = evidence.fit
    one, more = fitted.attached[-1], before - fitted.deviance
    candidate = replace(trial.candidate, attached=one)
    trial = replace(trial, fit=fitted, std=_std(fitted, one), candidate=candidate, gain=trial.gain.and_further(more))
    return trial, evidence, intervals


def _ended(fitted: FlightFit) -> FlightFit:
    """The fit with its last effect ending inside the records, where that is better: an end that lies behind all of them
    is nowhere to be found by steps."""
    one, longest = fitted.attached[-1], max(record.duration for record in fitted.flight.records)
    endless = [name for name in one.effect.further if one.values[name] > longest]
    if not one.effect.timed or not endless:
        return fitted
    shapes = [shape for shape in one.effect.grid if all(shape[name] < longest for name in endless)]
    shorter = [replace(one, values={**one.values, **shape}) for shape in shapes]

    def ending(other: Attached) -> FlightFit:
        return fit(fitted.flight, [*fitted.attached[:-1], other], fitted.noise, fitted, iterations=8, tolerance=3.0)

    return min([fitted, *side_by_side(ending, shorter)], key=lambda one: one.deviance)


def _without_weak(base: FlightFit, evidence: Evidence) -> Evidence:
    """A configuration change fitted again without the coefficients that do not take part."""
    fitted = evidence.fit
    one = fitted.attached[-1]
    weak = weak_members(fitted, one)
    names = [c for c in one.effect.members if c not in weak]
    if not weak or not names:
        return evidence
    sizes = {c: one.values["value" if c == one.effect.members[0] else c] for c in names}
    values = {("value" if c == names[0] else c): size for c, size in sizes.items()}
    values["duration"] = one.values["duration"]
    slim = Attached(effect=configuration_change("+".join(names)), values=values, onsets=one.onsets)
    return weigh(fit(base.flight, [*base.attached, slim], base.noise, fitted, iterations=6, tolerance=3.0))
