"""Choice of the causes that are worth a fit, by the predictions of a linearisation, and their trial fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis import comparisons as ask
from casid.diagnosis import gates
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import look_alike, size_gates
from casid.diagnosis.engine.trial import Gain, Trial
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.onsets import Intervals, alone, at_peak, in_its_records, sudden, weak_members
from casid.diagnosis.evidence.screening import Candidate, equivalence
from casid.diagnosis.evidence.size import meaningful_share
from casid.diagnosis.flight.evaluation import FlightFit, as_read, by_rows, gram_of, lateness, scaled_inverse
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics.check import kinematic_check, worth_fitting
from casid.errors import InputError
from casid.model.causes.aerodynamics import configuration_change
from casid.model.effect import Effect, Values
from casid.model.station import MOVING_AIR
from casid.native.processors import side_by_side

Screened = Mapping[str, tuple[Gate, ...]]  # name of a candidate that is not fitted -> its gates, of which one failed


def worth_trying(
    base: FlightFit,
    kinematic: Evidence | None,
    rankings: Sequence[Sequence[Candidate]],
    switches: Sequence[Candidate],
    required: float,
) -> tuple[list[Candidate], Screened]:
    """Choose the best few causes of each ranking.

    A cause needs the `required` score statistic, unless the kinematics may confirm it, and a predicted size that
    matters and is possible. One that the kinematics reject at its predicted size takes no other's place. A
    configuration change is scored in one record only, so it cannot be ranked with the others.

    kinematic  evidence of the kinematics, if there is any
    rankings   rankings of the causes, best first. Most trials are taken from the first ranking.
    switches   configuration changes, best first
    required   the part of the statistic of turbulence that counts as misfit of its approximate shape
    screened   name of a cause that is not fitted -> its gates, of which one failed
    """
    criteria = base.criteria
    trials = criteria.numerics.naming.trials
    few = criteria.numerics.naming.further_trials
    first, *others_ranked = rankings
    chosen, screened = _best_few(base, kinematic, first, trials)
    switching, others = _best_few(base, None, switches, 1)
    chosen = [*chosen, *switching]
    screened = {**others, **screened}
    for ranking in others_ranked:
        before = tuple(chosen)
        further, others = _best_few(base, kinematic, ranking, few)
        # a fit moves an onset to its best place in the whole record, wherever the linearisation begins it
        chosen += [c for c in further if not any(is_same(c.attached, b.attached, np.inf) for b in before)]
        screened = {**others, **screened}
    least = criteria.parts.third * required
    beside = {c.name: ask.BESIDE_TURBULENCE.of(c.net, least, "parts.third") for c in chosen}
    kinematic_ones = {c.name for c in chosen if c.attached.effect.kinematic}
    faint = {name: (asked,) for name, asked in beside.items() if not asked.passed and name not in kinematic_ones}
    chosen = [c for c in chosen if c.name not in faint]
    tried = {c.name for c in chosen}
    return chosen, {name: asked for name, asked in {**screened, **faint}.items() if name not in tried}


def is_same(one: Attached, other: Attached, apart: float) -> bool:
    """Return True if two candidates are the same cause.

    An event with onsets more than `apart` [s] from the other's, or with the opposite sign, is another cause.
    """
    if one.name != other.name or not one.effect.timed:
        return one.name == other.name
    near = all(abs(other.onsets.get(record, np.inf) - onset) <= apart for record, onset in one.onsets.items())
    return near and one.values["value"] * other.values["value"] > 0.0


def _best_few(
    base: FlightFit, kinematic: Evidence | None, candidates: Sequence[Candidate], count: int
) -> tuple[list[Candidate], Screened]:
    """The best `count` candidates with at most two terms of one coefficient, and the gates of those that are not tried.

    Candidates with nearly the same prediction as a chosen one are added, because they may form one ambiguity set.
    """
    numerics = base.criteria.numerics.naming
    screened = dict[str, tuple[Gate, ...]]()
    chosen: list[Candidate] = []
    alike: list[Candidate] = []
    places = count
    for candidate in candidates:
        effect = candidate.attached.effect
        enough = _promising(candidate, base.criteria)
        if not enough.passed or not places:
            rank = (ask.PLACES.of(places, 1.0, where=" among those tried"),) if enough.passed else ()
            screened[candidate.name] = (enough, *rank)
            continue
        asked = (enough, *_predicted_size(base, candidate))
        if not all_passed(asked):
            screened[candidate.name] = asked
            continue
        terms = [
            c for c in (*chosen, *alike) if c.attached.effect.quasi_steady and c.attached.effect.target == effect.target
        ]
        if effect.quasi_steady and len(terms) >= numerics.further_trials:
            near = terms[0].net - candidate.net < equivalence(terms[0].net, base.criteria)
            if len(terms) < numerics.trials and near:
                alike.append(candidate)
            else:
                left = numerics.further_trials - len(terms)
                full = ask.PLACES.of(left, 1.0, where=" among terms of its coefficient")
                screened[candidate.name] = (*asked, full)
            continue
        chosen.append(candidate)
        seen = worth_fitting(kinematic, candidate.attached)
        places -= seen is None or seen.passed
    names = {one.name for one in (*chosen, *alike)}
    others = [c for c in candidates if c.name not in names and _promising(c, base.criteria).passed]
    alike += [c for c in others if any(_predict_the_same(c, one, base.criteria) for one in chosen)]
    return [*chosen, *alike], screened


def _predicted_size(base: FlightFit, candidate: Candidate) -> tuple[Gate, ...]:
    """The gates on the predicted size of a cause that is to be fitted."""
    one = candidate.attached
    clear = gates.clear_gain(one.effect, base.criteria, base.flight.noise_by_fit)
    share = meaningful_share(base, one)
    matters = gates.predicted_size(one.effect, share, candidate.statistic, clear, base.criteria)
    return (*matters, *gates.possible(one, 0.5))


def _promising(candidate: Candidate, criteria: Criteria) -> Gate:
    """The gate on the score statistic of a cause that is to be fitted."""
    return ask.PREDICTED.of(candidate.net, criteria.parts.third * criteria.significance.search, "parts.third")


def _predict_the_same(one: Candidate, other: Candidate, criteria: Criteria) -> bool:
    """Return True if two causes that are not terms act at the same place, like a lag and a delay, with nearly equal
    statistics."""
    effect = one.attached.effect
    second = other.attached.effect
    of_one_place = effect.target == second.target and not (effect.quasi_steady or second.quasi_steady)
    return of_one_place and abs(one.net - other.net) < equivalence(other.net, criteria)


def with_look_alikes(
    candidates: Sequence[Candidate], effects: Sequence[Effect], records: Sequence[str]
) -> list[Candidate]:
    """The candidates, each followed by causes that screening cannot find but that may be the true one.

    These are causes of which derivatives reproduce everything except an effect like that of the candidate: a shift of
    the centre of gravity shows as an error of the accelerometers with the opposite sign, and less thrust as drag that
    grows with it. And for a cause that shows only as a difference between records, they are the same cause with the
    opposite sign in all other records: beside the difference, the common level may be identifiable.
    """
    found = []
    names = {c.name for c in candidates}
    for candidate in candidates:
        one = candidate.attached
        found.append(candidate)
        if one.effect.traits.relative and one.records:
            others = tuple(name for name in records if name not in one.records)
            found.append(replace(candidate, attached=replace(one, records=others, values=_reversed(one.values))))
        for effect in (e for e in effects if e.name not in names):
            if look_alike(effect, one.effect):
                alike = Attached(effect=effect, values=_reversed({"value": one.values["value"]}), records=one.records)
                found.append(replace(candidate, attached=alike))
    return found


def _reversed(values: Values) -> Values:
    return {**values, "value": -values["value"]}


def try_cause(
    evidence: Evidence, candidate: Candidate, seen: Gate | None, give_up: float
) -> tuple[Trial, Evidence, Intervals]:
    """Fit a candidate together with the effects of the present model.

    evidence   evidence of the present model
    candidate  the cause to be fitted, with its predicted values
    seen       the gate of the kinematics on its predicted size (`worth_fitting`). If it failed, the cause is not
               fitted.
    give_up    deviance that the fit must come below. The fit stops as soon as that is impossible.
    joint      evidence of the model with the cause; of the present model if it was not fitted
    interval   95 % intervals of the onsets [s], by record
    """
    base = evidence.fit
    attached = replace(candidate.attached, passes=False)
    noise = evidence.fit.noise
    if seen is not None and not seen.passed:
        return given_up(base, candidate, seen), evidence, {}
    tried: dict[Candidate, tuple[Trial, Evidence, Intervals]] = base.kept.small.setdefault("tried", {})
    if candidate in tried:  # the next best takes the place of one that is refused
        return tried[candidate]
    interval: Intervals = {}
    # At size zero the other values of an effect have no influence and could not be estimated.
    alone = attached.effect.linear and set(attached.values) == {"value"}
    begin = [*base.attached, attached.with_values({"value": 0.0}) if alone else attached]
    try:
        fitted = fit(base.flight, begin, noise, base, extent="rough", give_up=give_up)
        joint = weigh(fitted)
    except (InputError, np.linalg.LinAlgError):  # with the cause, the model diverges on a record
        return given_up(base, candidate, ask.SIMULATED.failed()), evidence, {}
    if attached.effect.timed:
        wider = in_its_records(joint, fitted.attached[-1])
        if wider.onsets.keys() != joint.fit.attached[-1].onsets.keys():
            joint = weigh(fit(base.flight, [*base.attached, wider], noise, fitted, extent="rough"))
        if joint.fit.deviance < give_up:
            joint, interval = at_peak(joint, evidence.criteria.numerics.naming.few)
    if attached.effect.members:
        joint = _without_weak(base, joint)
    fitted = joint.fit
    one = fitted.attached[-1]
    trial = Trial(
        candidate=replace(candidate, attached=one),
        std=_std(fitted, one),
        fingerprint=_fingerprint(fitted, base, one),
        gain=_gain(candidate, evidence, joint),
        share=meaningful_share(fitted, one),
        moved={slot.name: fitted[slot.name] - base[slot.name] for slot in base.slots},
    )
    if fitted.converged:
        tried[trial.candidate] = trial, joint.lighter(), interval
    return trial, joint.lighter(), interval  # of many trials the time histories would be more than those of a model


def _gain(candidate: Candidate, evidence: Evidence, joint: Evidence) -> Gain:
    """The likelihood-ratio statistic of a cause: `evidence` of the model without it, `joint` of the model with it."""
    return Gain(
        raw=evidence.deviance - joint.deviance,
        price=candidate.statistic - candidate.net,
        spared=evidence.deviance_at_scales(joint.scales) - evidence.deviance,
        exact=evidence.fit.deviance - joint.fit.deviance,
    )


def checked(trial: Trial, fitted: FlightFit, evidence: Evidence, kinematic: Evidence | None) -> Trial:
    """The trial of a cause that was `fitted` beside the model of `evidence`, with the gates on its size and that of the
    kinematics, which are None if the forces cannot be left free with these records."""
    if trial.given_up is not None:
        return trial
    gain = trial.gain
    one = trial.candidate.attached
    # A term makes its coefficient look more nonlinear. The other terms therefore keep their scale from before.
    clear = gain.raw + gain.spared if one.effect.regressor else gain.raw
    check = kinematic_check(kinematic, one)
    size = size_gates(fitted, one, trial.share, clear, check.confirmed)
    trial = replace(trial, size=size, check=check)
    if trial.meaningful and one.effect.event.recurring:
        trial = replace(trial, size=(*trial.size, sudden(evidence, one)))
    if trial.meaningful and kinematic is None and one.effect.timed and one.effect.enters in MOVING_AIR:
        trial = replace(trial, size=(*trial.size, alone(evidence, one)))
    return trial


def given_up(base: FlightFit, candidate: Candidate, because: Gate) -> Trial:
    """The trial of a candidate that was not fitted, with its predicted values and the gate that it failed."""
    return Trial(
        candidate=candidate,
        std=candidate.std,
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


def _std(fitted: FlightFit, one: Attached) -> float:
    """Standard deviation of the value of a cause; NaN if the value is not estimated."""
    return fitted.std(one.name) if any(slot.name == one.name for slot in fitted.slots) else float("nan")


def _fingerprint(fitted: FlightFit, base: FlightFit, one: Attached) -> np.ndarray:
    """(N R ny,) Whitened sensitivity to the cause, less what the parameters of the model without it make of it.

    In closed loop these are as uncertain as stated: numbers known to a few per cent take little of a cause.
    """
    late = lateness(fitted.attached, fitted.flight, fitted.model)
    flat = by_rows(as_read(late, fitted.columns))
    known = {slot.name for slot in base.slots}
    beside = np.array([slot.name in known for slot in fitted.slots])
    own = [slot.name for slot in fitted.slots].index(one.name)
    gram = gram_of(flat) if late.any() else fitted.grams.sum(axis=0)
    if fitted.flight.by_innovations:
        gram = gram + np.diag(fitted.prior_weight)
    direction = np.zeros(len(beside))
    direction[beside] = -scaled_inverse(gram[np.ix_(beside, beside)]) @ gram[beside, own]
    direction[own] = 1.0
    N, R, ny = fitted.white.shape
    return (flat @ direction).reshape(R, N, ny).swapaxes(0, 1).reshape(-1).astype(np.float32)


def settled(trial: Trial, fitted: FlightFit, without: Evidence) -> tuple[Trial, FlightFit, dict[str, Intervals]]:
    """Fit the winner of a round to convergence.

    A cause that is not fully converged leaves residuals that look like another cause. The onsets of events named
    earlier are estimated again beside it.

    without    evidence of the model without it
    trial      the winner with its final values and statistics
    intervals  95 % intervals of the onsets, by name of the cause
    """
    intervals = dict[str, Intervals]()
    name = fitted.attached[-1].name
    fitted = _ended(fitted)
    fitted = fit(fitted.flight, fitted.attached, fitted.noise, fitted, extent="settled")
    events = [i for i, one in enumerate(fitted.attached[:-1]) if one.effect.timed]
    if fitted.attached[-1].effect.timed:
        evidence, intervals[name] = at_peak(weigh(fitted))
        fitted = evidence.fit
        wider = in_its_records(evidence, fitted.attached[-1])
        if wider.onsets.keys() != fitted.attached[-1].onsets.keys():
            attached = [*fitted.attached[:-1], wider]
            fitted = fit(fitted.flight, attached, fitted.noise, fitted, extent="settled")
            events.append(len(attached) - 1)
        if events:
            events.append(len(fitted.attached) - 1)
    for i in dict.fromkeys(events):
        evidence, intervals[fitted.attached[i].name] = at_peak(weigh(fitted), which=i)
        fitted = evidence.fit
    one = fitted.attached[-1]
    candidate = replace(trial.candidate, attached=one)
    gain = _gain(candidate, without, weigh(fitted))
    return replace(trial, std=_std(fitted, one), candidate=candidate, gain=gain), fitted, intervals


def _ended(fitted: FlightFit) -> FlightFit:
    """The fit with its last event ending inside the records, if that is better.

    An end behind all records has no gradient, so the iterations cannot find a better one.
    """
    one = fitted.attached[-1]
    longest = max(record.duration for record in fitted.flight.records)
    endless = [name for name in one.effect.beside if one.values[name] > longest]
    if not one.effect.timed or not endless:
        return fitted
    shapes = [shape for shape in one.effect.further.grid if all(shape[name] < longest for name in endless)]
    shorter = [replace(one, values={**one.values, **shape}) for shape in shapes]

    def ending(other: Attached) -> FlightFit:
        return fit(
            fitted.flight,
            [*fitted.attached[:-1], other],
            fitted.noise,
            fitted,
            extent="rough",
        )

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
    return weigh(fit(base.flight, [*base.attached, slim], base.noise, fitted, extent="rough"))
