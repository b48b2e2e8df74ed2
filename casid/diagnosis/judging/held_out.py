"""Judge fitted models on records that no fit has seen: only initial states, and onsets of events, are found anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from casid.diagnosis.criteria import HeldOutCriteria
from casid.diagnosis.decision import Gate, at_least
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints, onset_grid
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.colour import in_colour
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, without
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.judging.predicted import Predicted, predicted
from casid.diagnosis.kinematics.forces import without_aerodynamics
from casid.diagnosis.kinematics.kinematics import forceless_noise
from casid.diagnosis.naming.events import at_peak
from casid.diagnosis.naming.round import Trial
from casid.errors import InputError
from casid.model.applied import with_estimates
from casid.records.record import Record


def split(
    records: Sequence[Record], hold_out: Sequence[Record], criteria: HeldOutCriteria
) -> tuple[list[Record], list[Record]]:
    """(records to fit, records held back). Without `hold_out` the last record is held back, or of a single one its last
    third, or what the `criteria` leave of it. Raises InputError when two records share a name."""
    if not records:
        raise InputError("no record to diagnose")
    names = [r.name for r in (*records, *hold_out)]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise InputError(f"two records are named '{twice[0]}'; names must differ")
    if hold_out:
        return list(records), list(hold_out)
    if len(records) > 1:
        return list(records[:-1]), [records[-1]]
    only = records[0]
    cut = only.t[0] + criteria.fitted_part * only.duration
    part = "last third" if criteria == HeldOutCriteria() else "last part"
    return [only.between(-np.inf, cut)], [only.between(cut, np.inf, name=f"{only.name}, {part}")]


def predicted_on(records: Sequence[Record], fitted: FlightFit) -> Predicted:
    """`judge_on`, and how likely the fitted records make these."""
    return predicted(judge_on(records, fitted), fitted)


def judge_on(records: Sequence[Record], fitted: FlightFit) -> FlightFit:
    """The fitted model on other records, derivatives and effects fixed; noise that is what a fit leaves is what it
    leaves there."""
    held = fitted.flight.with_records(with_estimates(fitted.flight.aircraft, fitted.derivatives, {}), records)
    steady = [_everywhere(a) for a in fitted.attached if not a.effect.timed]
    base = in_colour(fit(held, steady, fitted.held, free="states", iterations=6, tolerance=1.0), free="states")
    for one in fitted.attached:
        if one.records:
            without = _states(base, [a for a in base.attached if a.name != one.name])
            base = min(base, without, key=lambda f: f.deviance)
    recurring = [a for a in fitted.attached if a.effect.recurring]
    for one in (*recurring, *recurring[:-1]):  # once more, beside those that were not there yet
        base = _recurred(base, one)
    return base


def with_events(held: FlightFit, fitted: FlightFit) -> FlightFit:
    """The fit of held-out records with those events too that need not repeat, where they do."""
    for one in fitted.attached:
        if one.effect.timed and not one.effect.recurring:
            held = _recurred(held, one)
    return held


def _recurred(base: FlightFit, one: Attached) -> FlightFit:
    """The fit with the event where it helps most, or without it, whichever is better."""
    others = [a for a in base.attached if a.name != one.name]
    without = base if len(others) == len(base.attached) else _states(base, others)
    found = [base, without]
    if onsets := _onsets(without, one):
        moved = _states(without, [*others, replace(one, onsets=onsets)])
        moves = base.criteria.numerics.events.held_out_moves
        found.append(at_peak(weigh(moved, discrepancy=False), moves, free="states")[0].fit)
    return min(found, key=lambda f: f.deviance)


def _states(base: FlightFit, attached: Sequence[Attached]) -> FlightFit:
    return fit(base.flight, attached, base.noise, base, free="states", iterations=4, tolerance=1.0)


def _everywhere(one: Attached) -> Attached:
    return replace(one, records=())


def _onsets(base: FlightFit, one: Attached) -> dict[str, float]:
    """Where the event, at its known size, helps most in each record; a record that it does not help is left out."""
    judge, found = Screen(weigh(base, discrepancy=False)), {}
    size = one.values["value"]
    further = {k: v for k, v in one.values.items() if k != "value"}
    effect = replace(one.effect, grid=({**further, "value": size},))
    step, length = judge.criteria.numerics.events.gust_step, further.get("length", np.inf)
    prints = fingerprints(judge.evidence, [effect], onset_grid(judge.evidence, step, length))
    for r, record in enumerate(base.flight.records):
        drops = [judge.drop(print_, r) for print_ in prints]  # none in records too short for an event
        if max(drops, default=0.0) > 2.0 * np.log(max(len(prints), 1)):
            found[record.name] = float(record.t[0] + (prints[int(np.argmax(drops))].onset or 0.0))
    return found


def steps_to_keep(gains: Sequence[float | None]) -> int:
    """Number of first steps whose gains (None: not known) add up to the most, the largest of equals."""
    sums = np.cumsum([0.0, *(gain or 0.0 for gain in gains)])
    return int(len(gains) - np.argmax(sums[::-1]))


def best_on_held(
    held: Sequence[Record],
    steps: Sequence[FlightFit],
    on_held: Sequence[Predicted],
    gains: Sequence[float | None],
    spare: Sequence[float],
) -> tuple[FlightFit, FlightFit, dict[str, Gate]]:
    """The best model of all records, the largest of equals, its fit on the held-out ones, and by name what the effects
    of its steps had to pass.

    spare  of each step, what it gains on the fitted records beyond what it must, in 2 ln L. By the chain rule of
           probability that and the gain on the held-out ones add up to the evidence of all records; these may hardly
           move what a cause is about.

    Either the first steps, or all, without those of them that lost on the held-out records and are no help beside the
    others either.
    """
    samples = 2.0 * on_held[-1].fit.readings
    both = [None if gain is None else samples * gain + more for gain, more in zip(gains, spare, strict=True)]
    new = [{a.name for a in after.attached} - {a.name for a in before.attached} for before, after in pairwise(steps)]
    found = []
    for n in {steps_to_keep(both), len(both)}:
        final, there, kept = steps[n], on_held[n], sum(spare[:n])
        gates = {name: _borne_out(sum(one or 0.0 for one in both[n:])) for names in new[n:] for name in names}
        for i in sorted(range(n), key=lambda i: both[i] or 0.0):  # for the worst may be why another lost
            if (gains[i] or 0.0) >= 0.0 or not new[i]:
                gates |= dict.fromkeys(new[i], _borne_out(both[i] or 0.0))
                continue
            others = without(final, new[i])
            held_others = predicted_on(held, others)
            gate = _borne_out(held_others.deviance + spare[i] - there.deviance)
            gates |= dict.fromkeys(new[i], gate)
            if not gate.passed:
                final, there, kept = others, held_others, kept - spare[i]
        found.append((there.deviance - kept, -n, final, there.fit, gates))
    *_, final, held_final, gates = min(found, key=lambda one: one[:2])
    return final, held_final, gates


def _borne_out(gain: float) -> Gate:
    """What a step must pass on held-out records, which add to what it gains on the fitted ones beyond what it must."""
    return at_least("gain with held-out records", gain, 0.0)


def kinematic_gain(
    flight: Flight,
    held: Sequence[Record],
    before: FlightFit,
    after: FlightFit,
    moving: Mapping[str, tuple[float, float]],
) -> float:
    """Log likelihood per held-out sample that a fault of an instrument adds with forces free, in `moving` air: whatever
    is wrong with the aerodynamics of the held-out records cannot refuse it."""
    there = without_aerodynamics(flight.with_records(flight.aircraft, held))
    noise = forceless_noise(there, moving)
    found = []
    for step in (before, after):
        faults = [_everywhere(a) for a in step.attached if a.effect.of_an_instrument]
        found.append(fit(there, faults, noise, free="states", iterations=6, tolerance=1.0))
    return 0.5 * (found[0].data_deviance - found[1].data_deviance) / found[1].readings


def gains_by_kinematics(
    flight: Flight,
    held: Sequence[Record],
    steps: Sequence[FlightFit],
    gains: Sequence[float | None],
    trials: Sequence[Trial],
    moving: Mapping[str, tuple[float, float]],
) -> list[float | None]:
    """`gains` of the steps, the last of which named `trials`; instruments that kinematics found and that lose there are
    judged by the held-out kinematics."""
    found = list(gains)
    for i, trial in enumerate(trials, start=len(found) - len(trials)):
        if trial.confirmed and trial.effect.of_an_instrument and (found[i] or 0.0) < 0.0:
            found[i] = kinematic_gain(flight, held, steps[i], steps[i + 1], moving)
    return found


def held_gains(on_held: Sequence[Predicted]) -> list[float | None]:
    """Log likelihood per sample that each step adds; None for an event that the held-out records do not repeat,
    whatever nuisance errors of instruments were put in beside it."""
    gains: list[float | None] = []
    for before, after in pairwise(on_held):
        was, now = before.fit, after.fit
        new = {a.name for a in now.attached if not a.nuisance} - {a.name for a in was.attached}
        gain = 0.5 * (before.deviance - after.deviance) / now.readings
        gains.append(gain if new or now.noise.coloured != was.noise.coloured else None)
    return gains
