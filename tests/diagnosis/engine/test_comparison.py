"""Comparing causes: under the same noise, and once more beside those that were named since."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import SURFACE_NOISE, at_least, flights, trial_of

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import can_be_named, equivalents_of, gains_enough, ranked
from casid.diagnosis.engine.candidates import settled, try_cause
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, relaxed
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics.check import KinematicCheck
from casid.model.causes.aerodynamics import aero_term, unsteady_aero
from casid.model.causes.air import gust
from casid.model.causes.controls import actuator_lag, dead_zone, input_delay, washed_out
from casid.model.causes.instruments import sensor_bias, sensor_delay, sensor_lag, sensor_scale
from casid.model.causes.recording import clock_drift
from problems.do328 import do328

LATE = Attached(effect=input_delay("delta_e"), values={"value": 0.05})
LAGGED = Attached(effect=actuator_lag("delta_e"), values={"value": 0.05})
BIAS = Attached(effect=sensor_bias("q"), values={"value": 0.004})


def asked(trial: Trial) -> Trial:
    """The trial where a name needs a gain of 40."""
    return replace(trial, enough=gains_enough(trial, [], 0.0, Criteria()))


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
    assert ranked([scale, delay, term], [delay, scale], Criteria())[0][0].candidate.name == first


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
    assert ranked([late, slow], [late, slow], Criteria())[0][0] is late


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


@pytest.mark.parametrize(("exactly", "together"), [(12030.0, True), (6000.0, False)])
def test_what_two_statistics_prefer_in_turn_is_a_set(exactly: float, together: bool) -> None:
    """Figures of a trainer in turbulence without any damper: feedback of q gains 3970 of its exact 6580 beside model
    discrepancy, a lag of the pitching moment 3635 of 12 030. Discrepancy takes more of the aerodynamics."""
    damper, late = (
        trial_of(Attached(effect=effect, values={"value": 1.0}), gain, fingerprint=fingerprint, exact=exact)
        for effect, gain, exact, fingerprint in (
            (washed_out("delta_e", "q"), 3970.0, 6580.0, [1.0, 0.0]),
            (unsteady_aero("Cm"), 3635.0, exactly, [0.6, 0.8]),
        )
    )
    assert equivalents_of(damper, [damper, late], Criteria()) == ((late,) if together else ())


def test_causes_compare_in_the_structure_that_they_leave() -> None:
    """A lag that gains more beside a nonlinear coefficient stands behind a delay that leaves it straight; a term too.
    What only straightens, and is no term, is not named for that."""

    def trial(effect, net: float, excess: float) -> Trial:
        return trial_of(Attached(effect=effect, values={"value": 1.0}), net, excess)

    lag, delay = trial(actuator_lag("delta_a"), 120.0, 0.0), trial(input_delay("delta_a"), 115.0, 30.0)
    term, shape = trial(aero_term("Cl", "beta^3"), 20.0, 130.0), trial(dead_zone("delta_a"), 20.0, 130.0)
    trials = (lag, shape, delay, term)
    ordered = ranked(trials, [one for one in trials if gains_enough(one, [], 0.0, Criteria()).passed], Criteria())[0]
    assert ordered == [term, delay, lag, shape]


@pytest.fixture(scope="module")
def late() -> FlightFit:
    """The baseline of a flight in which nothing is wrong but that a noisily recorded elevator moves late."""
    hidden = replace(LATE, values={"value": 0.04})
    flight = prepare(do328(), flights([hidden], 2, rate_hz=50.0, surface_noise=2 * SURFACE_NOISE, size=0.4))
    return fit(flight, (), flight.noise(), extent="settled")


def test_a_lag_gains_nothing_by_smoothing_the_record(late: FlightFit) -> None:
    """Truth: a delay. What smooths a noisy record predicts with less noise, whatever is true: counted, that would put a
    lag before the delay."""
    (delay, _, _), (lag, beside, _) = (
        try_cause(weigh(late), trial_of(one).candidate, None, np.inf) for one in (LATE, LAGGED)
    )
    assert delay.gain.exact > lag.gain.exact + 50.0
    assert not beside.fit.acting.coloured and beside.fit.noise_held
    smoothing = fit(late.flight, [LAGGED], late.noise, late, extent="settled")
    assert smoothing.acting.coloured
    assert late.deviance - smoothing.deviance > delay.gain.exact
    named = relaxed(beside.fit)
    assert named.acting.coloured and not named.noise_held


def test_a_winner_has_the_statistics_of_its_final_fit(late: FlightFit) -> None:
    """Truth: the decreases of the two deviances, with and without model discrepancy. A lag that was tried far from its
    size ends elsewhere than its trial."""
    slow = replace(LAGGED, values={"value": 0.3})
    tried, joint, _ = try_cause(weigh(late), trial_of(slow).candidate, None, np.inf)
    winner, fitted, _ = settled(tried, joint.fit, weigh(late))
    assert winner.candidate.attached.values != tried.candidate.attached.values
    assert winner.gain.raw == pytest.approx(weigh(late).deviance - weigh(fitted).deviance)
    assert winner.gain.exact == pytest.approx(late.deviance - fitted.deviance)


@pytest.mark.parametrize("ahead", [0.0, 9.0, 400.0])
def test_of_equivalent_terms_the_simplest_comes_first(ahead: float) -> None:
    """A cube and a square of one deflection, and its magnitude, which has a bend, that records do not tell apart.

    A term of another coefficient that explains less stays behind. A cube that explains 400 more is told apart.
    """
    cube, square, magnitude, other = (
        trial_of(Attached(effect=aero_term(c, term), values={"value": 1.0}), gain, fingerprint=print_)
        for c, term, gain, print_ in (
            ("CD", "delta_e^3", 2400.0 + ahead, [1.0, 0.3, 0.0]),
            ("CD", "delta_e^2", 2399.0, [1.0, 0.0, 0.0]),
            ("CD", "|delta_e|", 2398.0, [1.0, 0.0, 0.0]),
            ("CL", "alpha^2", 300.0, [0.0, 0.0, 1.0]),
        )
    )
    trials = [cube, square, magnitude, other]
    ordered, alike = ranked(trials, trials, Criteria())
    assert ordered[0] is (square if ahead < 10.0 else cube)
    assert other not in alike and (magnitude in alike) is (ahead < 10.0)
