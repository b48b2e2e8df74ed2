"""Comparing causes: under the same noise, and once more beside those that were named since."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import SURFACE_NOISE, flights, trial_of

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import at_least
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, relaxed
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.causes import minor_trials
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.check import KinematicCheck, kinematic_check
from casid.diagnosis.naming import naming
from casid.diagnosis.engine.comparison import can_be_named, equivalents_of, gains_enough, small_first
from casid.diagnosis.naming.naming import Naming
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.naming.trials import try_cause
from casid.model.causes import (
    actuator_lag,
    aero_term,
    clock_drift,
    gust,
    input_delay,
    sensor_bias,
    sensor_delay,
    sensor_lag,
    sensor_scale,
    thrust_line,
)
from problems.do328 import do328

LATE = Attached(effect=input_delay("delta_e"), values={"value": 0.05})
LAGGED = Attached(effect=actuator_lag("delta_e"), values={"value": 0.05})
BIAS = Attached(effect=sensor_bias("q"), values={"value": 0.004})


@pytest.fixture(scope="module")
def late() -> FlightFit:
    """The baseline of a flight in which nothing is wrong but that a noisily recorded elevator moves late."""
    hidden = replace(LATE, values={"value": 0.04})
    flight = prepare(do328(), flights([hidden], 2, rate_hz=50.0, surface_noise=2 * SURFACE_NOISE, size=0.4))
    return fit(flight, (), flight.noise(), iterations=20)


def test_a_lag_gains_nothing_by_smoothing_the_record(late: FlightFit) -> None:
    """Truth: a delay. What smooths a noisy record predicts with less noise, whatever is true: counted, that would put a
    lag before the delay."""
    (delay, _, _), (lag, beside, _) = (
        try_cause(weigh(late), trial_of(one).candidate, None, np.inf) for one in (LATE, LAGGED)
    )
    assert delay.gain.exact > lag.gain.exact + 50.0
    assert not beside.fit.acting.coloured and beside.fit.noise_held
    smoothing = fit(late.flight, [LAGGED], late.noise, late, iterations=20)
    assert smoothing.acting.coloured
    assert late.deviance - smoothing.deviance > delay.gain.exact
    named = relaxed(beside.fit)
    assert named.acting.coloured and not named.noise_held


@pytest.mark.parametrize("named", [LAGGED, LATE])
def test_a_cause_is_compared_again_beside_those_named_since(named: Attached) -> None:
    """Truth: a delay and a bias. Whichever of delay and lag was named before the bias, the delay stays."""
    flight = prepare(do328(), flights([replace(LATE, values={"value": 0.06}), BIAS], 3))
    base = weigh(fit(flight, (), flight.noise(), iterations=20))
    other = LATE if named is LAGGED else LAGGED
    tried = [try_cause(base, trial_of(one).candidate, None, np.inf)[0] for one in (named, other, BIAS)]
    final = weigh(fit(flight, [named, BIAS], flight.noise(), base.fit, iterations=20))
    rounds = tuple(
        Round(candidates=(), trials=tuple(some), equivalents=(), named=True) for some in (tried[:2], tried[2:])
    )
    state = Naming(evidence=final, kinematic=None, observed=(), missing=(), rounds=rounds, intervals={})
    after = naming._reconsidered(state, 0, 40.0)
    assert {one.name for one in after.evidence.fit.attached} == {LATE.name, BIAS.name}
    assert after.evidence.fit[LATE.name] == pytest.approx(0.06, rel=0.05)
    assert [round_.leader.effect.key for round_ in after.rounds] == [LATE.effect.key, BIAS.effect.key]
    assert {trial.effect.key for trial in after.rounds[0].trials} == {LATE.effect.key, LAGGED.effect.key}
    assert all(before is now for before, now in zip(state.rounds[1:], after.rounds[1:], strict=True)) == (named is LATE)


@pytest.mark.parametrize(
    ("hidden", "alike"),
    [
        (Attached(effect=aero_term("Cm", "delta_e*Tc"), values={"value": -10.0}), False),
        (Attached(effect=aero_term("Cm", "delta_e*Tc"), values={"value": -3.0}), True),
        (Attached(effect=thrust_line(), values={"value": 1.5}), False),
    ],
)
@pytest.mark.slow
def test_a_tail_in_the_slipstream_is_told_from_another_thrust_line(hidden: Attached, alike: bool) -> None:
    """Truth: with the elevator at 3.5 deg in trim, an effectiveness that grows with thrust pitches the aircraft as a
    thrust line does that lies elsewhere. It is expected of propeller aircraft and no fault; the thrust line is one; and
    what is too little to tell them apart is a set."""
    found = diagnose(do328(), flights([hidden], 4, count=4 if alike else 3, rate_hz=50.0))
    no_fault = hidden.effect.expected and not alike
    (named,) = (cause for cause in (found.minor if no_fault else found.causes) if cause.kind == hidden.effect.kind)
    assert found.verdict == ("adequate" if no_fault else "explained")
    assert named.sentence.startswith("Expected of a propeller aircraft") == no_fault
    assert named.value == pytest.approx(hidden.values["value"], rel=0.1)
    assert [one["kind"] for one in named.indistinguishable_from] == (["thrust_line"] if alike else [])
    assert {"thrust_line", "aero_term"} <= {trial.effect.kind for trial in found.rounds[0].trials}


def asked(trial: Trial) -> Trial:
    """The trial where a name needs a gain of 40."""
    return replace(trial, enough=gains_enough(trial, {"naming.gain": 40.0}))


@pytest.mark.parametrize(("ahead", "first"), [(500.0, "sensor_delay(psi)"), (5.0, "sensor_scale(ay)")])
def test_what_is_too_small_to_matter_goes_first_where_it_explains_most(ahead: float, first: str) -> None:
    """Left out, it would make a cause of something else; as good as another, it is no reason to pass that over."""
    late, steep, nonlinear = (
        Attached(effect=effect, values={"value": value})
        for effect, value in ((sensor_delay("psi"), 0.04), (sensor_scale("ay"), 0.1), (aero_term("Cm", "alpha^2"), 1.0))
    )
    delay, term = (trial_of(one, gain, share=0.8) for one, gain in ((late, 1000.0 + ahead), (nonlinear, 5000.0)))
    scale = trial_of(steep, 1000.0)
    assert [can_be_named(asked(one)) for one in (delay, scale, term)] == [True, True, False]
    assert small_first([scale, delay, term], [delay, scale], Criteria())[0].candidate.name == first


def test_a_late_aileron_too_small_to_matter_goes_before_a_slow_clock_that_it_looks_like() -> None:
    """Of the records of the Twin Otter: the aileron, 17 ms late, would else be a drift of the clock of all surfaces."""
    late, slow = (
        trial_of(Attached(effect=effect, values={"value": value}), gain)
        for effect, value, gain in ((input_delay("delta_a"), 0.017, 420.0), (clock_drift("surfaces"), 0.002, 250.0))
    )
    late, unclear = (asked(trial_of(late.candidate.attached, 420.0, share=share)) for share in (0.7, 1.5))
    unclear = replace(unclear, size=(at_least("clearness", 1.0, 400.0),))
    assert late.effect.of_a_surface and not gust("z").of_a_surface and not sensor_delay("p").of_a_surface
    assert can_be_named(late) and not can_be_named(unclear)
    assert small_first([slow], [late, slow], Criteria())[0] is late


@pytest.mark.parametrize(("ahead", "together"), [(-7.0, True), (7.0, False)])
def test_what_kinematics_and_the_whole_model_put_first_in_turn_is_a_set(ahead: float, together: bool) -> None:
    """A delay that kinematics prefer by 20, and a lag of which they find 0.75 of what it promises. One set when the
    whole model prefers the lag, and not when it prefers the delay too."""
    delay, lag = (
        replace(
            trial_of(Attached(effect=effect, values={"value": 0.5}), gain),
            fingerprint=np.array([1.0, side]),
            check=KinematicCheck(predicted=promised, achieved=found),
        )
        for effect, gain, side, promised, found in (
            (sensor_delay("alpha"), 92.0, 0.1, 301.0, 280.0),
            (sensor_lag("alpha"), 92.0 - ahead, -0.1, 344.0, 255.0),
        )
    )
    assert delay.check.gain > lag.check.gain + 10.0 and delay.confirmed and lag.confirmed
    assert equivalents_of(delay, [delay, lag], Criteria()) == ((lag,) if together else ())
    assert naming.is_dead_heat(delay, lag, Criteria())


def test_kinematics_beside_a_cause_do_not_know_it() -> None:
    """Truth: a late beta. Asked again in kinematics that have it already, it would be refuted by what it explained."""
    late = Attached(effect=sensor_delay("beta"), values={"value": 0.15})
    flight = prepare(do328(), flights([late], seed=5))
    model, alone = fit(flight, [late], flight.noise()), fit(flight, [], flight.noise())
    kinematic = kinematics.with_causes(weigh(kinematics.reconstruct(flight), discrepancy=False), [late])
    without = naming._kinematics_with(kinematic, alone, late.effect)
    again = naming._kinematics_with(without, model, late.effect)
    assert without is not None and again is not None
    assert not without.fit.attached and without.fit.deviance > again.fit.deviance + 1000.0
    check, own = (kinematic_check(one, late) for one in (without, kinematic))
    assert check.confirmed and not own.confirmed
    assert naming._kinematics_with(kinematic, alone, thrust_line()) is kinematic


def test_what_looks_alike_at_one_place_is_minor_once() -> None:
    """A delay and a lag of the elevator that are one; a bias that has the same fingerprint acts elsewhere."""

    def small(one: Attached, gain: float):
        return trial_of(one, gain, fingerprint=[1.0, 0.0], share=0.5)

    trials = [small(LAGGED, 422.0), small(LATE, 424.0), small(BIAS, 300.0)]
    state = SimpleNamespace(rounds=[SimpleNamespace(named=False, trials=trials)], criteria=Criteria())
    found = [trial.candidate.name for trial in minor_trials(state, ())]  # pyright: ignore
    assert found == ["input_delay(delta_e)", "sensor_bias(q)"]


@pytest.mark.parametrize(("behind", "alike"), [(40.0, True), (60.0, False)])
def test_terms_that_look_alike_are_one_set(behind: float, alike: bool) -> None:
    """Fingerprints at an angle x, gains of 700 and 6700 besides when the coefficient is no more nonlinear than beside
    them: the difference of their gains scatters by 2 sqrt(7400) sin x, 25 for a sine of 0.146; two of that are 50."""

    def trial(term: str, total: float, fingerprint: list[float]) -> Trial:
        one = Attached(effect=aero_term("Cm", term), values={"value": 1.0})
        return trial_of(one, total - 6700.0, spared=6700.0, fingerprint=fingerprint)

    best = trial("beta*p*delta_e", 7400.0, [1.0, 0.0])
    other = trial("beta*p", 7400.0 - behind, [np.sqrt(1.0 - 0.146**2), 0.146])
    assert (equivalents_of(best, [best, other], Criteria()) == (other,)) == alike


@pytest.mark.parametrize(("behind", "alike"), [(40.0, True), (50.0, False)])
def test_terms_are_compared_by_all_that_they_explain(behind: float, alike: bool) -> None:
    """Small terms would explain most of the 9000 as well; 45 of them, half a percent, tell no terms apart."""

    def trial(term: str, gain: float, exact: float) -> Trial:
        one = Attached(effect=aero_term("CY", term), values={"value": 1.0})
        return trial_of(one, gain, spared=6700.0, fingerprint=[1.0, 0.0], exact=exact)

    best, other = trial("delta_a", 320.0, 9000.0), trial("delta_e^2*delta_a", 170.0, 9000.0 - behind)
    assert (equivalents_of(best, [best, other], Criteria()) == (other,)) == alike
