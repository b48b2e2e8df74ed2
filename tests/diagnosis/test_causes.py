"""What a verdict tells of causes. Truth: flights of the Do 328 with hidden events."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from diagnosis_flights import flights, trial_of

from casid.diagnosis.cause import MINOR, REFUSED, Cause, all_passed, at_least
from casid.diagnosis.causes import minor_trials, onset_intervals, trace_of_search
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import deviation, weigh
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.last_tests import too_small_or_refused
from casid.model.causes import (
    actuator_lag,
    aero_term,
    effectiveness_change,
    gust,
    input_delay,
    sensor_bias,
)
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
