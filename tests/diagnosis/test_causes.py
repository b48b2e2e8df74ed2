"""What a verdict tells of causes. Truth: flights of the Do 328 with hidden events."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import at_least, flights, trial_of

from casid.diagnosis.cause import IN_A_SET, MINOR, REFUSED, Cause
from casid.diagnosis.causes import minor_trials, onset_intervals, trace_of_search
from casid.diagnosis.comparisons import all_passed
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import can_be_named, ranked, ranked_behind
from casid.diagnosis.engine.trial import Round, refused_rounds
from casid.diagnosis.evidence.evidence import deviation, weigh
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.last_tests import too_small_or_refused
from casid.model.causes.aerodynamics import aero_term, unsteady_aero
from casid.model.causes.air import gust
from casid.model.causes.controls import actuator_lag, effectiveness_change, input_delay
from casid.model.causes.instruments import sensor_bias
from casid.model.causes.loading import mass
from casid.model.effect import Effect
from problems.do328 import do328


def test_an_onset_has_room_for_what_is_not_known_of_the_length() -> None:
    """The middle of an event is what the data tell: half of the length's uncertainty is the onset's."""
    events = [
        Attached(effect=gust("z"), values={"value": 4.0, "length": 1.6}, onsets={"m2": 12.3}),
        Attached(effect=effectiveness_change("delta_r"), values={"value": -0.3}, onsets={"m1": 8.0}),
    ]
    flight = prepare(do328(), flights(events, seed=3))
    evidence = weigh(fit(flight, events, flight.noise()))
    room = 1.96 * 0.5 * deviation(evidence, f"{events[0].name}.length")
    wide, plain = (onset_intervals(evidence, one, {"m2": (12.2, 12.4)}) for one in evidence.fit.attached)
    assert room > 0.004
    assert wide["m2"] == pytest.approx((12.2 - room, 12.4 + room), abs=1e-3)
    assert plain == {"m2": (12.2, 12.4)}


def test_minor_is_what_is_small_and_what_failed_another_gate_is_refused() -> None:
    """Of three causes without a name: a small one, one that is not sure, and drag of alpha^2, as any aircraft has."""

    def cause(effect: Effect, share: float) -> Cause:
        unsure = at_least("size, in corrected standard deviations", 2.0, 3.0)
        return Cause(
            effect=effect,
            value=1.0,
            std=0.5,
            records=("m1",),
            statistic=900.0,
            sentence="",
            share=share,
            meaningful=share >= 1.0,
            gates=(unsure,),
        )

    small, unsure, usual = (
        cause(sensor_bias("q"), 0.4),
        cause(actuator_lag("delta_e"), 3.0),
        cause(aero_term("CD", "alpha^2"), 2.0),
    )
    fitted = SimpleNamespace(attached=[SimpleNamespace(effect=one.effect) for one in (small, unsure, usual)])
    minor, refused = too_small_or_refused(fitted, [small, unsure, usual])  # pyright: ignore
    assert minor == (small, usual) and refused == (unsure,)
    without = SimpleNamespace(rounds=())
    decisions = {one.cause: one for one in trace_of_search(without, (), minor, refused).decisions}  # pyright: ignore
    assert decisions[unsure.name].outcome == REFUSED and not all_passed(decisions[unsure.name].gates)
    assert decisions[small.name].outcome == MINOR


def test_what_looks_alike_at_one_place_is_minor_once() -> None:
    """A delay and a lag of the elevator that are one; a bias that has the same fingerprint acts elsewhere."""

    def small(one: Attached, gain: float):
        return trial_of(one, gain, fingerprint=[1.0, 0.0], share=0.5)

    lag, delay, bias = (
        Attached(effect=effect, values={"value": value})
        for effect, value in (
            (actuator_lag("delta_e"), 0.05),
            (input_delay("delta_e"), 0.05),
            (sensor_bias("q"), 0.004),
        )
    )
    trials = [small(lag, 422.0), small(delay, 424.0), small(bias, 300.0)]
    state = SimpleNamespace(rounds=[SimpleNamespace(named=False, trials=trials)], criteria=Criteria())
    found = [trial.candidate.name for trial in minor_trials(state, ())]  # pyright: ignore
    assert found == ["input_delay(delta_e)", "sensor_bias(q)"]


def drawn_round(rng: np.random.Generator) -> Round:
    """A round that named the best of causes with any gains and likenesses, some of them in several forms."""
    effects = [actuator_lag("delta_e"), input_delay("delta_e"), unsteady_aero("CL"), mass(), sensor_bias("q")]
    forms = [Attached(effect=effect, values={"value": 0.1}, records=("m1",)) for effect in effects]
    forms += [Attached(effect=one.effect, values={"value": -0.1}, records=("m2",)) for one in forms[2:4]]
    trials = []
    for one in forms:
        gain, share = float(rng.uniform(10.0, 900.0)), float(rng.uniform(0.5, 9.0))
        enough = at_least("gain", gain, 40.0, "significance.search")
        trials.append(
            replace(trial_of(one, gain, fingerprint=rng.uniform(0.5, 1.0, 2).tolist(), share=share), enough=enough)
        )
    able = [t for t in trials if can_be_named(t)]
    trials, equivalents = ranked(trials, able, Criteria())
    named = any(t.meaningful for t in able)
    behind = ranked_behind(trials[0], trials, Criteria())
    equivalents = tuple(replace(one) for one in equivalents)  # as those that were fitted again beside later causes
    passed = at_least("size, in corrected standard deviations", rng.uniform(2.0, 9.0), 3.0)
    return Round(
        candidates=(),
        trials=tuple(trials),
        equivalents=equivalents,
        named=named,
        ranked=behind,
        accepted_by=(passed,) if named else (),
    )


@pytest.mark.parametrize("seed", range(40))
def test_what_is_refused_has_a_gate_that_failed(seed: int) -> None:
    """Any rounds, of which the last ones are refused as a set; some of the others are gone beside later causes."""
    rng = np.random.default_rng(seed)
    rounds = [drawn_round(rng) for _ in range(4)]
    kept = int(rng.integers(0, 4))
    of_set = [one for one in rounds[kept:] if one.named]
    if all(all_passed(one.accepted_by) for one in of_set):
        kept, of_set = 4, []
    state = SimpleNamespace(rounds=(*rounds[:kept], *refused_rounds(rounds[kept:])))
    causes = {
        one.leader.effect.key: cause_of(one.leader.effect) for one in rounds[:kept] if one.named and rng.integers(2)
    }
    found = trace_of_search(state, tuple(causes.values()), ())  # pyright: ignore
    assert all(one.failed for one in found.decisions if one.outcome == REFUSED)
    assert not any(one.failed for one in found.decisions if one.outcome == IN_A_SET)
    failed = {one.leader.candidate.name for one in of_set if one.doubt}
    for number, one in enumerate(rounds[kept:], kept + 1):
        if one.named and not one.doubt:  # what it was refused with is named
            (first,) = [d for d in found.decisions if d.round == number and d.cause == one.leader.candidate.name][:1]
            assert all(name in str(first.failed[-1]) for name in failed)


def cause_of(effect: Effect) -> Cause:
    return Cause(
        effect=effect, value=1.0, std=0.1, records=("m1",), statistic=9.0, sentence="", meaningful=True, share=2.0
    )
