"""Naming: which sets of records are looked at, how causes compare, and fits that end at a maximum."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import flights, trial_of

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.naming import naming
from casid.diagnosis.engine.comparison import gains_enough, in_order
from casid.diagnosis.naming.naming import without_superseded
from casid.diagnosis.engine.trial import Round, Trial
from casid.errors import InputError
from casid.model.causes import (
    actuator_lag,
    aero_term,
    dead_zone,
    effectiveness_change,
    input_delay,
    mass,
)
from problems.do328 import do328


def test_causes_compare_in_the_structure_that_they_leave() -> None:
    """A lag that gains more beside a nonlinear coefficient stands behind a delay that leaves it straight; a term too.
    What only straightens, and is no term, is not named for that."""

    def trial(effect, net: float, excess: float) -> Trial:
        return trial_of(Attached(effect=effect, values={"value": 1.0}), net, excess)

    lag, delay = trial(actuator_lag("delta_a"), 120.0, 0.0), trial(input_delay("delta_a"), 115.0, 30.0)
    term, shape = trial(aero_term("Cl", "beta^3"), 20.0, 130.0), trial(dead_zone("delta_a"), 20.0, 130.0)
    trials = (lag, shape, delay, term)
    ordered = in_order(trials, [one for one in trials if gains_enough(one, {"naming.gain": 40.0}).passed])
    assert ordered == [term, delay, lag, shape]


def test_an_aircraft_that_cannot_fly_its_records_is_one_line() -> None:
    """With the stability of another sign and a million times as strong nothing can be filtered."""
    wild = do328().with_derivatives({"Cm_alpha": 1e9, "Cn_beta": -1e9})
    flight = prepare(wild, flights(seed=1, count=1))
    with pytest.raises(InputError, match="diverges along the records"):
        fit(flight, [], flight.noise())


@pytest.mark.parametrize(("gain", "angle", "kept"), [(500.0, 1.0, True), (500.0, 0.5, False), (100.0, 1.0, False)])
def test_what_came_near_and_has_nothing_in_common_is_tried_again(gain: float, angle: float, kept: bool) -> None:
    """A change of lift and drag, found in the first round behind a late rudder that gained 1000, was not found again
    beside it: another screening looked elsewhere. A cause that resembles what was named was its rival only."""
    named = Attached(effect=input_delay("delta_r"), values={"value": 0.08})
    other = Attached(effect=effectiveness_change("thrust"), values={"value": -0.3}, onsets={"m1": 7.0})
    trials = (
        trial_of(named, 1000.0, fingerprint=[1.0, 0.0]),
        trial_of(other, gain, fingerprint=[np.sqrt(1.0 - angle**2), angle]),
    )
    state = SimpleNamespace(rounds=[SimpleNamespace(trials=trials)], criteria=Criteria())
    assert naming._left_behind(state) == ([trials[1].candidate] if kept else [])  # pyright: ignore
    assert naming._left_behind(SimpleNamespace(rounds=[])) == []  # pyright: ignore


@pytest.mark.parametrize("lag", [0.0, 0.25])
def test_a_cause_goes_when_its_rival_explains_all_and_stays_when_both_are_there(lag: float) -> None:
    """A lag is named where a delay is missing, and the delay after it; with both flown, both stay."""
    both = [
        Attached(effect=actuator_lag("delta_e"), values={"value": lag}),
        Attached(effect=input_delay("delta_e"), values={"value": 0.15}),
    ]
    flight = prepare(do328(), flights(both if lag else both[1:], seed=3, count=3))
    guessed = [one.with_values({"value": 0.1}) for one in both]
    trials = tuple(trial_of(one) for one in guessed)
    rounds = [Round(candidates=(), trials=trials, equivalents=(), named=True)]
    evidence = weigh(fit(flight, guessed, flight.noise(), iterations=20))
    kept = without_superseded(rounds, trials[1], evidence).fit.attached
    assert [one.effect.kind for one in kept] == (["actuator_lag"] if lag else []) + ["input_delay"]


def test_what_shows_as_a_difference_between_records_is_tried_in_the_others_too() -> None:
    """Truth: a mass that is 1045 kg off in m1 and m3 is one 950 kg off in m2 to all free derivatives, and the thrust,
    which is not free, tells which. Of the one alone, "thrust 9 % less than its record" was named beside it."""
    light = trial_of(Attached(effect=mass(""), values={"value": -950.0}, records=("m2",))).candidate
    late = trial_of(Attached(effect=input_delay("delta_e"), values={"value": 0.05}, records=("m2",))).candidate
    offered = naming._with_look_alikes([light, late], [], ("m1", "m2", "m3"))
    assert [(c.attached.effect.kind, c.attached.values["value"], c.attached.records) for c in offered] == [
        ("mass", -950.0, ("m2",)),
        ("mass", 950.0, ("m1", "m3")),
        ("input_delay", 0.05, ("m2",)),
    ]
