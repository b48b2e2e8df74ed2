"""Numbers of the file that flight contradicts. Truth: the aircraft that flew, of which the file is a wrong copy."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from diagnosis_flights import flights

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.given.contradicted import FlightValue, contradicted
from casid.diagnosis.result import Diagnosis
from casid.model.aircraft import Aircraft, EffectValue, Inertia
from casid.model.causes.controls import actuator_lag
from problems.do328 import STABLE, do328

WRONG = {"Cm_delta_e": -1.0, "Cl_p": 2.0, "Cn_beta": 2.0}


def scaled(factors: dict[str, float], uncertainty: float = 0.3) -> Aircraft:
    values = {name: factors.get(name, 1.0) * value for name, value in STABLE.items()}
    return replace(do328(values), relative_uncertainty=uncertainty)


def lag(seconds: float, std: float = 0.0) -> EffectValue:
    return EffectValue(kind="actuator_lag", target="delta_e", value=seconds, std=std)


@pytest.fixture(scope="module")
def wrong() -> Diagnosis:
    return diagnose(scaled(WRONG), flights(seed=3, count=3))


def test_wrong_derivatives_are_contradicted_and_nothing_else(wrong: Diagnosis) -> None:
    assert wrong.verdict == "values wrong", str(wrong)
    assert {one.parameter for one in wrong.contradicted} == set(WRONG)
    for one in wrong.contradicted:
        truth = STABLE[one.parameter]
        assert one.given == pytest.approx(WRONG[one.parameter] * truth) and abs(one.flight - truth) < 4.0 * one.std
        assert one.sentence in wrong.sentence and f"{one.parameter} is " in one.sentence
        assert one.sigmas > 3.0
    doubled = [one for one in wrong.contradicted if WRONG[one.parameter] == 2.0]
    assert all(not one.reversed and one.percent == pytest.approx(-50.0, abs=5.0) for one in doubled)
    sigmas = [one.sigmas for one in doubled]
    assert sigmas == sorted(sigmas, reverse=True)


def test_a_reversed_derivative_stands_first_and_is_called_so(wrong: Diagnosis) -> None:
    first = wrong.contradicted[0]
    assert first.parameter == "Cm_delta_e" and first.reversed
    assert "opposite sign" in first.sentence and first.flight == pytest.approx(STABLE["Cm_delta_e"], rel=0.05)


def test_the_file_as_it_is_given_is_flown_and_not_a_refit(wrong: Diagnosis) -> None:
    """Roll damping twice as strong leaves half the roll rate unexplained, far above the noise that a refit reaches."""
    p = wrong.budget.channels["p"]
    assert p.as_given > 10.0 and p.values < 1.5 and p.data_mended == p.as_given
    assert wrong.held_out_as_given.fit.parameters[0, wrong.as_given.fit.model.parameters.index("Cl_p")] == (
        2.0 * STABLE["Cl_p"]
    )


def test_the_true_file_is_not_contradicted() -> None:
    found = diagnose(scaled({}), flights(seed=3, count=3))
    assert found.verdict == "adequate" and found.contradicted == ()
    assert all(steps.as_given < 3.0 for steps in found.budget.channels.values())


@pytest.mark.parametrize(("given", "impossible"), [pytest.param(0.5, False, marks=pytest.mark.slow), (-1.0, True)])
def test_a_lag_of_the_file_that_flight_contradicts(given: float, impossible: bool) -> None:
    """The elevator lags by 0.12 s."""
    flown = flights([Attached(effect=actuator_lag("delta_e"), values={"value": 0.12})], seed=3, count=3)
    found = diagnose(scaled({}).with_effects([lag(given)]), flown)
    (one,) = found.contradicted
    assert found.verdict == "values wrong" and one.parameter == "actuator_lag(delta_e)", str(found)
    assert one.impossible == impossible and one.flight == pytest.approx(0.12, abs=4.0 * one.std)
    assert ("impossible" in one.sentence) == impossible
    assert found.extended_aircraft.effects[0].value == pytest.approx(0.12, abs=4.0 * one.std)


# -- the rule itself ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flight", "std", "uncertainty", "stands_against"),
    [
        (1.25, 0.01, 0.3, False),  # within what the file states
        (1.35, 0.01, 0.3, True),
        (1.35, 0.2, 0.3, False),  # within three honest deviations
        (1.08, 0.001, 0.0, False),  # within a tenth, where none is stated
        (1.12, 0.001, 0.0, True),
    ],
)
def test_beyond_the_stated_uncertainty_and_three_deviations(flight, std, uncertainty, stands_against) -> None:
    given = 2.0 * STABLE["Cm_delta_e"]
    file = scaled({"Cm_delta_e": 2.0}, uncertainty)
    told = {"Cm_delta_e": FlightValue(value=flight * given, std=abs(std * given), determined=True)}
    assert bool(contradicted(file, told)) == stands_against


def test_what_the_records_do_not_tell_contradicts_nothing() -> None:
    told = {"Cm_delta_e": FlightValue(value=9.0, std=0.1, determined=False)}
    assert contradicted(scaled({}), told) == ()


def test_an_inertia_of_no_rigid_body_is_said() -> None:
    """Izz above Ixx + Iyy: no distribution of mass has it."""
    file = replace(do328(), inertia=Inertia(Ixx=1e5, Iyy=1.5e5, Izz=3e5, Ixz=0.0))
    (one,) = contradicted(file, {})
    assert one.impossible and "no rigid body" in one.sentence and math.isnan(one.flight)
