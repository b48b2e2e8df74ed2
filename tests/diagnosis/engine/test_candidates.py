"""Which causes are worth a fit. Truth: gains and angles written here."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosis_flights import flights, trial_of

from casid.diagnosis.comparisons import all_passed
from casid.diagnosis.engine.candidates import with_look_alikes, worth_trying
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.aerodynamics import aero_term
from casid.model.causes.controls import actuator_lag, input_delay
from casid.model.causes.instruments import accelerometer_position, sensor_bias
from casid.model.causes.loading import cg_offset, mass
from casid.model.causes.recording import thrust_scale
from casid.model.effect import Effect
from problems.do328 import do328


def test_terms_that_promise_the_same_are_all_tried() -> None:
    """The third term promises half a percent less than the first, and may be one set with it; the fourth does not. Both
    leave their places to other causes, and so does an inertia that no aircraft has."""
    flight = prepare(do328(), flights(count=1))
    base = fit(flight, [], flight.noise())

    def promising(effect: Effect, net: float, value: float = 500.0) -> Candidate:
        candidate = trial_of(Attached(effect=effect, values={"value": value}), net).candidate
        return replace(candidate, statistic=net)

    names = ("delta_e*delta_a", "delta_e^2*delta_a", "alpha*delta_a", "delta_a^3")
    terms = [
        promising(aero_term("CY", name), net) for name, net in zip(names, (9000.0, 8999.0, 8960.0, 8900.0), strict=True)
    ]
    others = [promising(sensor_bias(channel), 500.0 - i, 0.02) for i, channel in enumerate(("p", "q", "r"))]
    chosen, _ = worth_trying(base, None, [[*terms, *others]], [], 0.0)
    assert [c.name for c in chosen] == [c.name for c in (*terms[:2], *others[:2], terms[2])]
    (inertia,) = (effect for effect in flight.effects if effect.name == "inertia(Ixx)")
    impossible = [promising(inertia, 9500.0, -5.0 * do328().inertia.Ixx)]
    chosen, screened = worth_trying(base, None, [[*impossible, *terms, *others]], [], 0.0)
    assert [c.name for c in chosen] == [c.name for c in (*terms[:2], *others[:2], terms[2])]
    assert all(not all_passed(screened[one.name]) for one in impossible)


@pytest.mark.parametrize(("behind", "tried"), [(40.0, True), (60.0, False)])
def test_a_lag_and_a_delay_that_promise_the_same_are_both_tried(behind: float, tried: bool) -> None:
    """Half a percent of 10000 tells them not apart; a rudder that was late was named as a slow one, because two other
    causes had been tried first and the delay never was."""
    flight = prepare(do328(), flights(count=1))
    base = fit(flight, [], flight.noise())
    lag, delay = (
        replace(trial_of(Attached(effect=effect("delta_r"), values={"value": 0.3}), net).candidate, statistic=net)
        for effect, net in ((actuator_lag, 10000.0), (input_delay, 10000.0 - behind))
    )
    term = replace(trial_of(Attached(effect=aero_term("Cn", "beta^3"), values={"value": 9.0}), 2e4).candidate)
    chosen, _ = worth_trying(base, None, [[], [replace(term, statistic=2e4), lag, delay]], [], 0.0)
    assert (delay in chosen) == tried and lag in chosen


@pytest.mark.parametrize(
    ("first", "second"),
    [(thrust_scale(""), aero_term("CD", "Tc")), (cg_offset("x"), accelerometer_position("x"))],
)
def test_of_two_that_show_alike_both_are_tried_whichever_is_predicted(first: Effect, second: Effect) -> None:
    """Truth: drag in a slipstream takes 13 % of the thrust along the flight path; alone, either explains it."""
    for one, other in ((first, second), (second, first)):
        predicted = trial_of(Attached(effect=one, values={"value": 0.1})).candidate
        offered = with_look_alikes([predicted], [first, second, mass("")], ("m1", "m2"))
        assert [c.attached.effect for c in offered] == [one, other]


def test_what_shows_as_a_difference_between_records_is_tried_in_the_others_too() -> None:
    """Truth: a mass that is 1045 kg off in m1 and m3 is one 950 kg off in m2 to all free derivatives, and the thrust,
    which is not free, tells which. Of the one alone, "thrust 9 % less than its record" was named beside it."""
    light = trial_of(Attached(effect=mass(""), values={"value": -950.0}, records=("m2",))).candidate
    late = trial_of(Attached(effect=input_delay("delta_e"), values={"value": 0.05}, records=("m2",))).candidate
    offered = with_look_alikes([light, late], [], ("m1", "m2", "m3"))
    assert [(c.attached.effect.kind, c.attached.values["value"], c.attached.records) for c in offered] == [
        ("mass", -950.0, ("m2",)),
        ("mass", 950.0, ("m1", "m3")),
        ("input_delay", 0.05, ("m2",)),
    ]
