"""What kinematics say of a cause: refuted, confirmed, or of another size; and which cause then goes first."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from diagnosis_flights import flights, rough_file, trial_of

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import ranked
from casid.diagnosis.engine.candidates import worth_trying
from casid.diagnosis.engine.held_out import kinematic_gain
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.screening import screen
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.check import KinematicCheck, kinematic_check, worth_fitting
from casid.model.causes.aerodynamics import aero_term
from casid.model.causes.instruments import (
    accelerometer_position,
    sensor_bias,
    sensor_delay,
    sensor_lag,
    sensor_scale,
    vane_position,
)
from casid.model.causes.loading import thrust_line
from casid.model.effect import Effect
from casid.model.effects import catalogue
from problems.do328 import do328


@pytest.mark.parametrize(
    ("predicted", "achieved", "refuted", "confirmed"),
    [
        (1000.0, 1000.0, False, True),
        (1000.0, 600.0, False, False),
        (1000.0, 100.0, True, False),
        (83.0, 7.0, False, False),  # 0.54 +- 0.11 of the size: neither all of it nor nothing
        (60.0, -60.0, True, False),
        (40.0, -40.0, True, False),  # 0.0 +- 0.16: too small to be confirmed, not to be missed
        (13.0, -13.0, False, False),  # 0.0 +- 0.28, hardly visible
        (13.0, -1.0, False, False),
        (5.0, -20.0, False, False),
        (20.0, 20.0, False, False),
        (60.0, 60.0, False, True),
        (2589.0, 4744.0, False, False),  # 1.42 +- 0.02 of the size
        (80.0, 160.0, False, True),  # 1.5 +- 0.11: larger, but not for sure
    ],
)
def test_kinematics_refute_and_confirm(predicted: float, achieved: float, refuted: bool, confirmed: bool) -> None:
    """The size by kinematics is (1 + achieved / predicted) / 2 of the full model's, 1-sigma 1 / sqrt(predicted)."""
    check = KinematicCheck(predicted=predicted, achieved=achieved)
    assert (check.refuted, check.confirmed) == (refuted, confirmed)


def test_a_long_delay_is_what_kinematics_fit_and_not_what_its_tangent_says() -> None:
    """The truth is the delay that was flown, 0.18 s. By the tangent kinematics found 0.16 s where the full model had
    the right 0.18, so that a scale error of alpha went before it. What they gain by it does not depend on the size that
    is asked about."""
    late = Attached(effect=sensor_delay("az"), values={"value": 0.18})
    flight = prepare(do328(), flights([late], seed=1))
    evidence = weigh(kinematics.reconstruct(flight), discrepancy=False)
    gained = evidence.fit.deviance - kinematics.again(evidence.fit, [late]).deviance
    for size, confirmed in ((0.09, False), (0.18, True), (0.4, False)):
        check = kinematic_check(evidence, late.with_values({"value": size}))
        assert size * (1.0 + check.achieved / check.predicted) / 2.0 == pytest.approx(0.18, rel=0.06)
        assert check.gain == pytest.approx(gained, rel=0.01)
        assert (check.judges, check.confirmed) == (True, confirmed)
    calm = weigh(kinematics.reconstruct(prepare(do328(), flights([], seed=1))), discrepancy=False)
    assert kinematic_check(calm, late).refuted


@pytest.mark.parametrize(("over", "worth"), [(1.0, True), (2.0, True), (2.9, True), (3.3, False), (-1.0, False)])
def test_a_cause_is_worth_fitting_if_the_kinematics_find_enough_of_half_its_size(over: float, worth: bool) -> None:
    """Truth: a parabola. The deviance of a size x is lowest at the size s that the kinematics find, so that x gains
    2s / x - 1 of what it predicts: half of `over` times s gains 4 / over - 1, of which three tenths are enough."""
    scale = Attached(effect=sensor_scale("V"), values={"value": 0.1})
    flight = prepare(do328(), flights([scale], seed=1, count=1))
    evidence = weigh(kinematics.reconstruct(flight), discrepancy=False)
    check = kinematic_check(evidence, scale)
    found = 0.1 * (1.0 + check.achieved / check.predicted) / 2.0
    gate = worth_fitting(evidence, scale.with_values({"value": over * found}))
    assert gate is not None and gate.passed is worth
    assert gate.value == pytest.approx(4.0 / over - 1.0)


def test_what_kinematics_find_is_tried_whatever_ranks_before_it() -> None:
    """With a late vertical accelerometer nearly every term of the lift seems to gain."""
    late = Attached(effect=sensor_delay("az"), values={"value": 0.3})
    flight = prepare(do328(), flights([late], seed=1))
    base = fit(flight, (), flight.noise())
    others = [effect for effect in catalogue(flight.aircraft, flight.outputs) if not effect.kinematic]
    by_model = screen(weigh(base), others, exact=True)
    observed = screen(weigh(kinematics.reconstruct(flight), discrepancy=False), [sensor_delay("az"), sensor_lag("q")])
    assert [one.name for one in observed if one.net > 40.0] == ["sensor_delay(az)"]
    tried, without = (worth_trying(base, None, [by_model, [], seen], [], 40.0)[0] for seen in (observed, []))
    assert len(without) == 4
    assert [one.name for one in tried] == [*(one.name for one in without), "sensor_delay(az)"]


def test_what_kinematics_confirm_goes_before_what_they_find_otherwise() -> None:
    """Figures of the ATTAS records: an accelerometer 10 m behind its place gains most in a model whose coefficients
    are all nonlinear, but kinematics put it at 14 m; the vane ahead is the same to both."""

    def trial(effect: Effect, total: float, predicted: float = 0.0, achieved: float = 0.0) -> Trial:
        check = KinematicCheck(predicted=predicted, achieved=achieved)
        return trial_of(Attached(effect=effect, values={"value": 1.0}), total, check=check)

    accelerometer, vane, late, term, line = (
        trial(accelerometer_position("x"), 3920.0, 2589.0, 4744.0),
        trial(vane_position("alpha"), 3352.0, 3067.0, 3385.0),
        trial(sensor_delay("alpha"), 2870.0, 1983.0, 1627.0),
        trial(aero_term("CL", "alpha^2"), 4600.0),
        trial(thrust_line(), 9000.0),
    )
    assert ranked([accelerometer, late, vane], {accelerometer, vane, late}, Criteria())[0] == [
        vane,
        accelerometer,
        late,
    ]
    assert ranked([line, term, vane, accelerometer], {term, accelerometer, vane}, Criteria())[0] == [
        term,
        accelerometer,
        vane,
        line,
    ]
    assert ranked([vane, accelerometer], {accelerometer}, Criteria())[0] == [accelerometer, vane]


def test_what_kinematics_find_smaller_but_clearer_than_another_stays_first() -> None:
    """Figures of a simulated fighter: an accelerometer 1.4 m ahead, smaller to kinematics because of the noise of the
    angular acceleration, beside the vane of alpha, which imitates part of it."""

    def trial(effect: Effect, total: float, predicted: float, achieved: float) -> Trial:
        check = KinematicCheck(predicted=predicted, achieved=achieved)
        return trial_of(Attached(effect=effect, values={"value": 1.0}), total, check=check)

    accelerometer = trial(accelerometer_position("x"), 1463.0, 2554.0, 930.0)
    vane = trial(vane_position("alpha"), 930.0, 827.0, 914.0)
    assert ranked([vane, accelerometer], {accelerometer, vane}, Criteria())[0] == [accelerometer, vane]


def test_of_two_that_kinematics_confirm_the_one_that_explains_more_to_both_goes_first() -> None:
    """Figures of the ATTAS records: the vane of the sideslip, 12 m ahead, beside a lag of it in two flights."""
    lag = trial_of(
        Attached(effect=sensor_lag("beta"), values={"value": 0.087}),
        1557.0,
        check=KinematicCheck(predicted=1389.0, achieved=1377.0),
    )
    vane = trial_of(
        Attached(effect=vane_position("beta"), values={"value": 11.3}),
        1502.0,
        check=KinematicCheck(predicted=1342.0, achieved=1741.0),
    )
    assert lag.check.confirmed and vane.check.confirmed
    assert ranked([lag, vane], {lag, vane}, Criteria())[0] == [vane, lag]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_held_out_kinematics_judge_a_vane_whatever_is_wrong_with_the_aerodynamics(sign: float) -> None:
    """Flown with the vane 4 m ahead: there it gains on a record that no fit has seen, 4 m behind it loses, in a model
    whose moments are all 30 % off."""
    vane = Attached(effect=vane_position("alpha"), values={"value": 4.0})
    fitted, held = flights([vane], seed=5, count=2)
    flight = prepare(rough_file(), [fitted])
    before, after = (
        fit(flight, attached, flight.noise(), free="states", extent=(1, 0.5))
        for attached in ([], [vane.with_values({"value": sign * 4.0})])
    )
    gain = kinematic_gain(flight, [held], before, after, {})
    assert sign * gain > 0.005


@pytest.mark.parametrize(
    ("predicted", "achieved", "refuted"), [(2.5, 8.2, True), (42.0, 39.0, False), (42.0, -5.0, True)]
)
def test_an_accelerometers_place_that_kinematics_do_not_see_is_no_cause(predicted, achieved, refuted) -> None:
    """Truth: a lift L of the tail, l behind, makes qdot = L l / Iyy and L / m = qdot Iyy / (m l), as read Iyy / (m l)
    behind: metres. A real flight whose file had no lift of the elevator put it 4.7 m behind, with a drop of the
    deviance of 3332, of which kinematics promise 2.5. Ailerons make no side force: its height is another matter."""
    check = KinematicCheck(predicted=predicted, achieved=achieved)
    place = Attached(effect=accelerometer_position("x"), values={"value": -4.7})
    assert trial_of(place, gain=3332.0, check=check).refuted == refuted
    assert not trial_of(replace(place, effect=accelerometer_position("z")), check=KinematicCheck()).refuted
    assert not trial_of(Attached(effect=sensor_bias("q"), values={"value": 0.1}), check=KinematicCheck()).refuted


@pytest.mark.parametrize(
    ("ends", "deviance", "refuted"),
    [
        (0.078, 103.0, False),  # it stays where it was, hardly worse: the deviance is flat, whatever its tangent says
        (0.078, 190.0, True),  # it stays, and is clearly worse
        (0.001, 100.5, True),  # it goes all the way to zero, with a 1-sigma of a tenth of the size
    ],
)
def test_a_size_at_which_kinematics_gain_nothing(
    monkeypatch: pytest.MonkeyPatch, ends: float, deviance: float, refuted: bool
) -> None:
    """Truth: the drop of the deviance itself, 100 without the cause. A delay of ay of 0.07 s in one record was once
    refuted by a tangent of 10 sigmas, where all delays from 0 to 0.08 s were within 4 of each other."""

    class Found(dict):
        def std(self, name: str) -> float:
            return 0.007

    late = Attached(effect=sensor_delay("ay"), values={"value": 0.072})
    found = Found({late.name: ends})
    found.deviance = deviance  # pyright: ignore
    monkeypatch.setattr(kinematics, "again", lambda *_: found)
    without = SimpleNamespace(attached=(), deviance=100.0, criteria=Criteria())
    assert kinematic_check(SimpleNamespace(fit=without), late).refuted is refuted  # pyright: ignore


def test_kinematics_beside_a_cause_do_not_know_it() -> None:
    """Truth: a late beta. Asked again in kinematics that have it already, it would be refuted by what it explained."""
    late = Attached(effect=sensor_delay("beta"), values={"value": 0.15})
    flight = prepare(do328(), flights([late], seed=5))
    kinematic = kinematics.with_causes(weigh(kinematics.reconstruct(flight), discrepancy=False), [late])
    without = kinematics.with_causes(kinematic, [])
    again = kinematics.with_causes(without, [late])
    assert not without.fit.attached and without.fit.deviance > again.fit.deviance + 1000.0
    check, own = (kinematic_check(one, late) for one in (without, kinematic))
    assert check.confirmed and not own.confirmed


@pytest.mark.parametrize(
    ("predicted", "achieved", "refuted"),
    [(0.0, 0.0, False), (3.0, 2.0, True), (60.0, 55.0, False), (60.0, -10.0, True)],
)
def test_an_instrument_that_the_kinematics_contain_must_be_seen_there(
    predicted: float, achieved: float, refuted: bool
) -> None:
    """A scale of ax that only the aerodynamics show; records that kinematics cannot judge say nothing."""
    trial = trial_of(Attached(effect=sensor_scale("ax"), values={"value": 0.02}), 43.0)
    assert replace(trial, check=KinematicCheck(predicted=predicted, achieved=achieved)).refuted == refuted
    inside = trial_of(Attached(effect=aero_term("Cm", "alpha^2"), values={"value": 2.0}), 43.0)
    assert not replace(inside, check=KinematicCheck(predicted=0.0)).refuted
