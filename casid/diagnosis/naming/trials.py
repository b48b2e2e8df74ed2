"""Try a cause: which are worth a fit, the fit itself, and whether the size that it finds matters and is possible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, all_passed, at_least
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.screening import Candidate, equivalence
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.late import as_read, lateness
from casid.diagnosis.kinematics.check import kinematic_check, worth_fitting
from casid.diagnosis.naming.events import Intervals, at_peak, further_records, sudden, weak_members
from casid.diagnosis.naming.round import Gain, Trial
from casid.diagnosis.naming.size import meaningful_share, plausible_size
from casid.errors import InputError
from casid.model.causes import configuration_change
from casid.model.effect import Effect
from casid.native.processors import side_by_side

Screened = Mapping[str, tuple[Gate, ...]]  # name of a candidate that is not tried -> its gates, of which one failed


def worth_trying(
    base: FlightFit,
    candidates: Sequence[Candidate],
    cautious: Sequence[Candidate],
    observed: Sequence[Candidate],
    switches: Sequence[Candidate],
    required: float,
) -> tuple[list[Candidate], Screened]:
    """The best few of the three rankings, and only what could reach the `required` gain, unless kinematics
    may confirm it, and a size that matters at all; and why the others are not tried. A configuration change is scored
    in one record only, so it cannot be ranked with the others."""
    criteria = base.criteria
    trials, few = criteria.numerics.naming.trials, criteria.numerics.naming.further_trials
    apart = criteria.events.apart
    chosen, screened = _best_few(base, candidates, trials)
    switching, others = _best_few(base, switches, 1)
    chosen, screened = [*chosen, *switching], {**others, **screened}
    for ranking in (cautious, observed):
        before = tuple(chosen)
        further, others = _best_few(base, ranking, few)
        chosen += [c for c in further if not any(is_same(c.attached, b.attached, apart) for b in before)]
        screened = {**others, **screened}
    faint = {c.name: gates for c in chosen if not all_passed(gates := _beside_turbulence(c, required, criteria))}
    chosen = [c for c in chosen if c.name not in faint]
    tried = {c.name for c in chosen}
    return chosen, {name: gates for name, gates in {**screened, **faint}.items() if name not in tried}


def _beside_turbulence(candidate: Candidate, required: float, criteria: Criteria) -> tuple[Gate, ...]:
    """What a cause must promise of the gain that the rough model of turbulence leaves to others."""
    if candidate.attached.effect.kinematic:
        return ()
    part = criteria.naming.tried_gain * required
    return (at_least("promised gain beside turbulence", candidate.net, part, "naming.tried_gain"),)


def is_same(one: Attached, other: Attached, apart: float) -> bool:
    """Whether two candidates are one: an event at another time, `apart` [s] or more, or the other way, is another."""
    if one.name != other.name or not one.effect.timed:
        return one.name == other.name
    near = all(abs(other.onsets.get(record, np.inf) - onset) < apart for record, onset in one.onsets.items())
    return near and one.values["value"] * other.values["value"] > 0.0


def _best_few(base: FlightFit, candidates: Sequence[Candidate], count: int) -> tuple[list[Candidate], Screened]:
    """`count` of them, no more than two terms of one coefficient; and beside these such as promise the same, for
    they may be one set. And why the others are not tried."""
    numerics, screened = base.criteria.numerics.naming, dict[str, tuple[Gate, ...]]()
    chosen: list[Candidate] = []
    alike: list[Candidate] = []
    for candidate in candidates:
        effect, enough = candidate.attached.effect, _promised_gain(candidate, base.criteria)
        if not enough.passed or len(chosen) == count:
            rank = at_least("places left among those tried", count - len(chosen), 1.0)
            screened[candidate.name] = (enough, *((rank,) if enough.passed else ()))
            continue
        gates = (enough, *_promised_size(base, candidate))
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
    others = [c for c in candidates if c.name not in names and _promised_gain(c, base.criteria).passed]
    alike += [c for c in others if any(_promise_the_same(c, one, base.criteria) for one in chosen)]
    return [*chosen, *alike], screened


def _promised_gain(candidate: Candidate, criteria: Criteria) -> Gate:
    """What a cause must promise to be fitted."""
    by = criteria.naming
    return at_least("promised gain", candidate.net, by.tried_gain * by.gain, "naming.tried_gain")


def _promised_size(base: FlightFit, candidate: Candidate) -> tuple[Gate, ...]:
    """The size that a cause must promise to be fitted, in units of what matters, and how clear that must be."""
    share, by = meaningful_share(base, candidate.attached), base.criteria.naming
    gates = (at_least("promised size", share, by.tried_size, "naming.tried_size"),)
    if candidate.attached.effect.of_an_instrument:
        return gates
    clear = share**2 * candidate.statistic / clear_gain(base)
    return (*gates, at_least("promised clearness", clear, by.tried_clear, "naming.tried_clear"))


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
    seen = worth_fitting(kinematic, attached)
    if seen is not None and not seen.passed:
        return _given_up(base, candidate, seen), evidence, {}
    interval: Intervals = {}
    # of size zero, the further values of an effect would be free of any sense
    alone = attached.effect.linear and set(attached.values) == {"value"}
    begin = [*base.attached, attached.with_values({"value": 0.0}) if alone else attached]
    try:
        fitted = fit(base.flight, begin, noise, base, iterations=8, tolerance=3.0, give_up=give_up)
        joint = weigh(fitted)
    except (InputError, np.linalg.LinAlgError):  # it makes an aircraft that cannot fly the record, or hardly
        return _given_up(base, candidate, at_least("records that can be flown with it", 0.0, 1.0)), evidence, {}
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
        size=_size(fitted, one, share, clear, clear_gain(base), check.confirmed),
        share=share,
        check=check,
    )
    if trial.meaningful and one.effect.recurring:
        trial = replace(trial, size=(*trial.size, sudden(evidence, one)))
    return trial, joint, interval


def _size(
    fitted: FlightFit, one: Attached, share: float, gain: float, clear: float, confirmed: bool
) -> tuple[Gate, ...]:
    """What the fitted size of a cause must pass: it matters, is clear, is possible, and an event begins in a record."""
    alone = confirmed or one.effect.of_an_instrument
    gates = (*matters(share, gain, clear, fitted.criteria, alone), *plausible_size(one))
    if not one.onsets:
        return gates
    edge, within = fitted.criteria.screening.edge, fitted.criteria.events.at_start
    first = {record.name: record.t[0] + edge for record in fitted.flight.records}
    latest = max(onset - first[record] for record, onset in one.onsets.items())
    return (*gates, at_least("onset after the beginning of a record", latest, within, "events.at_start"))


def _given_up(base: FlightFit, candidate: Candidate, because: Gate) -> Trial:
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
        share=meaningful_share(base, candidate.attached),
        size=(),
        given_up=because,
    )


def required_gain(effect: Effect, criteria: Criteria) -> float:
    """Net drop of the deviance that a cause must reach to be named."""
    return criteria.naming.gain_of_an_instrument if effect.of_an_instrument else criteria.naming.gain


def clear_gain(base: FlightFit) -> float:
    """Gain at which a cause that just matters is clear: misfit of the structure, where it is not in the noise, makes
    many sigmas of nothing."""
    by = base.criteria.naming
    return by.clear_of_misfit if base.flight.noise_by_fit else by.clear


def matters(
    share: float, gain: float, clear: float, criteria: Criteria, unlike_aerodynamics: bool = False
) -> tuple[Gate, ...]:
    """What a size must pass: it is at least the smallest that matters, and clear enough to be believed, unless nothing
    in the aerodynamics could look like it."""
    size = at_least("size, of what matters", share, 1.0, "size.share")
    if unlike_aerodynamics:
        return (size,)
    name = "naming.clear" if clear == criteria.naming.clear else "naming.clear_of_misfit"
    return size, at_least("clearness", share**2 * gain, clear, name)


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
