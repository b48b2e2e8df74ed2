"""Fit of one more cause: quickly as a trial, for comparison with others, and to convergence when it is added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casid.diagnosis.decision import Gate, at_least
from casid.diagnosis.engine.acceptance import clear_gain, size_gates
from casid.diagnosis.engine.onsets import Intervals, at_peak, further_records, sudden, weak_members
from casid.diagnosis.engine.size import meaningful_share
from casid.diagnosis.engine.trial import Gain, Trial
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.flight.evaluation import FlightFit, as_read, lateness
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics.check import kinematic_check, worth_fitting
from casid.errors import InputError
from casid.model.causes import configuration_change
from casid.native.processors import side_by_side


def try_cause(
    evidence: Evidence, candidate: Candidate, kinematic: Evidence | None, give_up: float
) -> tuple[Trial, Evidence, Intervals]:
    """Fit a candidate together with the effects of the present model.

    Parameters
    ----------
    evidence
        Evidence of the present model.
    candidate
        The cause to be fitted, with its predicted values.
    kinematic
        Evidence of the kinematics, or None. If they reject the cause at half of its predicted size, they reject it at
        any larger size, and it is not fitted.
    give_up
        Deviance that the fit must come below. The fit stops as soon as that is impossible.

    Returns
    -------
    trial
        The result.
    joint
        Evidence of the model with the cause; of the present model if it was not fitted.
    interval
        95 % intervals of the onsets [s], by record.
    """
    base, attached, noise = evidence.fit, replace(candidate.attached, passes=False), evidence.fit.noise
    seen = worth_fitting(kinematic, attached)
    if seen is not None and not seen.passed:
        return _given_up(base, candidate, seen), evidence, {}
    interval: Intervals = {}
    # At size zero the other values of an effect have no influence and could not be estimated.
    alone = attached.effect.linear and set(attached.values) == {"value"}
    begin = [*base.attached, attached.with_values({"value": 0.0}) if alone else attached]
    iterations = base.criteria.numerics.naming.trial_iterations
    try:
        fitted = fit(base.flight, begin, noise, base, iterations=iterations, tolerance=3.0, give_up=give_up)
        joint = weigh(fitted)
    except (InputError, np.linalg.LinAlgError):  # with the cause, the model diverges on a record
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
    # A term makes its coefficient look more nonlinear. The other terms therefore keep their scale from before.
    clear = raw + spared if one.effect.regressor else raw
    share = meaningful_share(fitted, one)
    check = kinematic_check(kinematic, one)
    trial = Trial(
        candidate=replace(candidate, attached=one),
        std=_std(fitted, one),
        fingerprint=_fingerprint(fitted, base, one),
        gain=Gain(
            raw=raw,
            price=candidate.statistic - candidate.net,
            spared=spared,
            exact=base.deviance - fitted.deviance,
        ),
        size=size_gates(fitted, one, share, clear, clear_gain(base), check.confirmed),
        share=share,
        check=check,
    )
    if trial.meaningful and one.effect.recurring:
        trial = replace(trial, size=(*trial.size, sudden(evidence, one)))
    return trial, joint, interval


def _given_up(base: FlightFit, candidate: Candidate, because: Gate) -> Trial:
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
    """(samples,) Whitened sensitivity to the cause, less its projection on the parameters of the model without it."""
    late = lateness(fitted.attached, fitted.flight, fitted.model)
    flat = as_read(late, fitted.columns).reshape(fitted.white.size, len(fitted.slots))
    own = flat[:, [slot.name for slot in fitted.slots].index(one.name)]
    known = {slot.name for slot in base.slots}
    basis = flat[:, [i for i, slot in enumerate(fitted.slots) if slot.name in known]]
    basis = basis / np.maximum(np.linalg.norm(basis, axis=0), 1e-300)
    return (own - basis @ np.linalg.lstsq(basis, own, rcond=None)[0]).astype(np.float32)


def settled(trial: Trial, fitted: FlightFit) -> tuple[Trial, FlightFit, dict[str, Intervals]]:
    """Fit the winner of a round to convergence.

    A cause that is not fully converged leaves residuals that look like another cause. The onsets of events named
    earlier are estimated again beside it.

    Returns
    -------
    trial
        The winner with its final values.
    fitted
        The fit with it.
    intervals
        95 % intervals of the onsets, by name of the cause.
    """
    before, intervals = fitted.deviance, {}
    name = fitted.attached[-1].name
    fitted = _ended(fitted)
    fitted = fit(fitted.flight, fitted.attached, fitted.noise, fitted, iterations=15, tolerance=0.3)
    events = [i for i, one in enumerate(fitted.attached[:-1]) if one.effect.timed]
    if fitted.attached[-1].effect.timed:
        evidence, intervals[name] = at_peak(weigh(fitted))
        fitted = evidence.fit
        wider = further_records(evidence, fitted.attached[-1])
        if len(wider.onsets) > len(fitted.attached[-1].onsets):
            attached = [*fitted.attached[:-1], wider]
            fitted = fit(fitted.flight, attached, fitted.noise, fitted, iterations=15, tolerance=0.3)
            events.append(len(attached) - 1)
        if events:
            events.append(len(fitted.attached) - 1)
    for i in dict.fromkeys(events):
        evidence, intervals[fitted.attached[i].name] = at_peak(weigh(fitted), which=i)
        fitted = evidence.fit
    one, more = fitted.attached[-1], before - fitted.deviance
    candidate = replace(trial.candidate, attached=one)
    trial = replace(trial, std=_std(fitted, one), candidate=candidate, gain=trial.gain.and_further(more))
    return trial, fitted, intervals


def _ended(fitted: FlightFit) -> FlightFit:
    """The fit with its last event ending inside the records, if that is better.

    An end behind all records has no gradient, so the iterations cannot find a better one.
    """
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
