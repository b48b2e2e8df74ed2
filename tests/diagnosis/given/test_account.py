"""The account of the error. Truth: shares worked out by hand from the levels of a budget."""

from __future__ import annotations

import math

import pytest

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.given.budget import Budget, BudgetSteps, account_of, account_sentence, failure_sentence
from casid.diagnosis.sentences import cost
from casid.diagnosis.verdict import Facts, verdict_of


def budget(as_given: float, data: float, values: float, structure: float) -> Budget:
    steps = BudgetSteps(as_given=as_given, data_mended=data, values=values, structure=structure)
    return Budget(records=("m4",), channels={"q": steps}, together=steps)


def test_shares_add_up_to_the_error_as_given() -> None:
    account = account_of(budget(20.0, 18.0, 4.0, 2.0), {"values": ["Cn_beta +22 %"]})
    assert {one.step: one.share for one in account} == pytest.approx(
        {"data": 0.1, "values": 0.7, "structure": 0.1, "unexplained": 0.05, "noise": 0.05}
    )
    assert account[0].step == "values" and account[-1].step == "noise"
    assert math.fsum(one.share for one in account) == pytest.approx(1.0)


def test_the_sentence_gives_each_step_its_share_the_largest_first() -> None:
    levels = budget(20.0, 20.0, 4.0, 2.0)
    sentence = account_sentence(levels, account_of(levels, {"values": ["Cn_beta +22 %"]}), 3)
    assert sentence.index("80 %") < sentence.index("10 %") and "Cn_beta +22 %" in sentence
    assert "20 times the noise" in sentence and "2 times the noise is left" in sentence


def test_a_step_that_makes_it_worse_is_said_to_add() -> None:
    levels = budget(10.0, 10.0, 12.0, 5.0)
    assert "re-estimation of values adds 20 %" in account_sentence(levels, account_of(levels, {}), 3)


@pytest.mark.parametrize("structure", [1000.0, 1e31, math.inf])
def test_a_model_that_gets_worse_by_ten_fails(structure: float) -> None:
    """A hovering aircraft in closed loop: 2e4 times the noise as given, 9e31 with re-estimated values."""
    assert "fails on m4" in failure_sentence(budget(20.0, 20.0, 30.0, structure), Criteria().given)


@pytest.mark.parametrize(("as_given", "structure"), [(20.0, 19.0), (20.0, 150.0), (0.5, 4.0)])
def test_a_model_that_is_as_good_or_near_the_noise_does_not_fail(as_given: float, structure: float) -> None:
    levels = budget(as_given, as_given, as_given, structure)
    assert failure_sentence(levels, Criteria().given) == ""


@pytest.mark.parametrize(("values", "structure", "said"), [(10.0, 30.0, True), (10.0, 9.0, False), (0.3, 0.9, False)])
def test_causes_that_make_held_out_records_worse_are_said_to(values: float, structure: float, said: bool) -> None:
    """Something is missing then, whatever the causes gain where they were fitted; below the noise nothing is told."""
    assert bool(cost(budget(250.0, 250.0, values, structure), Criteria().given.refined)) is said
    assert verdict_of(Facts(causes=True, costs=said)) == ("partly explained" if said else "explained")


def test_a_simulation_that_diverges_is_said_to() -> None:
    levels = budget(math.inf, math.inf, 4.0, 2.0)
    assert "diverges" in account_sentence(levels, account_of(levels, {}), 3)
