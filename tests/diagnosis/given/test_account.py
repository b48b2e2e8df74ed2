"""The account of the error. Truth: shares worked out by hand from the levels of a budget."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from casid.diagnosis import claims, sentences
from casid.diagnosis.cause import Cause
from casid.diagnosis.facts import Facts
from casid.diagnosis.given.budget import Budget, BudgetSteps, account_of
from casid.diagnosis.verdict import verdict_of
from casid.model.causes.controls import actuator_lag


def facts(as_given: float, data: float, values: float, structure: float, expected: float = 1.0) -> Facts:
    steps = BudgetSteps(as_given=as_given, data_mended=data, values=values, structure=structure, expected=expected)
    return Facts(source="file", witness="flight", budget=Budget(records=("m4",), channels={"q": steps}, together=steps))


def test_shares_add_up_to_the_error_as_given() -> None:
    account = account_of(facts(20.0, 18.0, 4.0, 2.0).budget, {"values": ["Cn_beta +22 %"]})
    assert {one.step: one.share for one in account} == pytest.approx(
        {"data": 0.1, "values": 0.7, "structure": 0.1, "unexplained": 0.05, "noise": 0.05}
    )
    assert account[0].step == "values" and account[-1].step == "noise"


def test_the_error_of_the_right_model_needs_no_explanation() -> None:
    """In moving air a free simulation of the right model is off by 4 times the noise."""
    account = account_of(facts(20.0, 20.0, 8.0, 5.0, expected=4.0).budget, {})
    assert {one.step: one.share for one in account} == pytest.approx(
        {"data": 0.0, "values": 0.6, "structure": 0.15, "unexplained": 0.05, "noise": 0.2}
    )


def test_a_step_that_makes_it_worse_has_no_share_and_is_told() -> None:
    """Values refitted without the cause double the error; the cause then halves that as given."""
    found = facts(10.0, 10.0, 20.0, 5.0)
    account = {one.step: one for one in account_of(found.budget, {})}
    assert account["values"].share == 0.0 and account["values"].grown_to == 20.0
    assert account["structure"].share == pytest.approx(0.5) and account["structure"].grown_to is None
    assert "makes it worse" in sentences.accounted(found, claims.account(found))


levels = st.floats(0.05, 1e6)


@given(levels, levels, levels, levels, st.floats(1.0, 100.0))
def test_shares_of_any_budget_are_from_0_to_1_and_add_up(a: float, b: float, c: float, d: float, e: float) -> None:
    account = account_of(facts(a, b, c, d, e).budget, {})
    assert all(0.0 <= one.share <= 1.0 for one in account)
    assert math.fsum(one.share for one in account) == pytest.approx(1.0)
    assert sum(claims.percents(account)) == 100 and min(claims.percents(account)) >= 0


@pytest.mark.parametrize("structure", [1000.0, 1e31, math.inf])
def test_a_model_that_gets_worse_by_ten_fails(structure: float) -> None:
    """A hovering aircraft in closed loop: 2e4 times the noise as given, 9e31 with re-estimated values."""
    assert "fails on m4" in sentences.failure(facts(20.0, 20.0, 30.0, structure))


@pytest.mark.parametrize(("as_given", "structure"), [(20.0, 19.0), (20.0, 150.0), (0.5, 4.0)])
def test_a_model_that_is_as_good_or_near_the_noise_does_not_fail(as_given: float, structure: float) -> None:
    assert sentences.failure(facts(as_given, as_given, as_given, structure)) == ""


@pytest.mark.parametrize(("values", "structure", "told"), [(10.0, 30.0, True), (10.0, 9.0, False), (0.3, 0.9, False)])
def test_causes_that_make_held_out_records_worse_are_told(values: float, structure: float, told: bool) -> None:
    """Something is missing then, whatever the causes gain where they were fitted; below the noise nothing is told."""
    assert bool(sentences.cost(facts(250.0, 250.0, values, structure))) is told


@pytest.mark.parametrize(
    ("levels", "verdict"),
    [
        ((1.1, 1.1, 1.0, 1.0), "adequate"),
        ((20.0, 20.0, 1.1, 1.1), "values wrong"),  # the structure is right, and the file does not fly
        ((20.0, 20.0, 4.0, 4.0), "partly explained"),
        ((4.0, 4.0, 4.0, 400.0), "unexplained"),  # the refit fails
        ((1.6, 1.6, 1.7, 1.7), "unexplained"),  # nor do values account for it: a repaired file, diagnosed again
    ],
)
def test_the_verdict_without_a_cause_follows_the_held_out_error(levels: tuple[float, ...], verdict: str) -> None:
    assert verdict_of(facts(*levels)) == verdict


@given(levels, levels, levels, levels)
def test_values_are_wrong_only_where_others_are_better(a: float, b: float, c: float, d: float) -> None:
    assert verdict_of(facts(a, b, c, d)) != "values wrong" or d < a


@pytest.mark.parametrize(("by_chance", "flies"), [(1.0, False), (2.7, False), (2.9, True)])
def test_nothing_speaks_against_a_simulation_that_noise_may_have_led_astray(by_chance: float, flies: bool) -> None:
    """An error of 2.8 times the noise in a channel, 1.4 in all, as where a filter has hidden most of the noise; the
    noise at the beginning of a record alone makes an error of `by_chance` in one case of twenty."""
    known = facts(1.4, 1.4, 1.0, 1.0)
    led = replace(known.budget.together, as_given=2.8, by_chance=by_chance)
    known = replace(known, budget=replace(known.budget, channels={"theta": led}))
    assert (verdict_of(known) == "adequate") is flies and (claims.not_flown(known) == "") is flies


@given(
    st.lists(st.floats(1.0, 200.0), min_size=4, max_size=4),
    st.floats(1.0, 10.0),
    st.sampled_from(["", "Cm is missing."]),
)
def test_with_causes_nothing_is_explained_that_leaves_twice_the_error_of_the_right_model(
    levels: list[float], expected: float, missing: str
) -> None:
    """An absolute standard, however much was gained: 34 times the noise was left of 400, and it was explained."""
    lag = Cause(
        effect=actuator_lag("delta_e"),
        value=0.1,
        std=0.01,
        records=("m1",),
        statistic=900.0,
        sentence="",
        meaningful=True,
        share=3.0,
    )
    as_given, data, values, structure = levels
    known = replace(
        facts(as_given, data, values, structure, expected), causes=(lag,), unexplained=(missing,) * bool(missing)
    )
    too_much = structure > 2.0 * (1.0 + 1e-9) * expected
    if too_much or missing:
        assert verdict_of(known) != "explained" and claims.nothing_missing(0.99, known) is None
        assert claims.probability(0.99, known) <= 0.9


def test_a_simulation_that_diverges_is_told() -> None:
    assert "diverges" in sentences.flown(facts(math.inf, math.inf, 4.0, 2.0))
