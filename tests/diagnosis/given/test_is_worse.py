"""What becomes of an extended model that loses on held-out records. Truth: the errors as they are written here."""

from __future__ import annotations

import math

import pytest

from casid.diagnosis.claims import grown
from casid.diagnosis.facts import Facts
from casid.diagnosis.given.budget import Budget, BudgetSteps


@pytest.mark.parametrize(
    ("given", "extended", "worse"),
    [
        (9.0, 3.0, False),
        (9.0, 9.5, False),
        (0.9, 1.05, False),
        (9.0, 45.0, True),
        (3.0, math.inf, True),
        (3.0, math.nan, True),
    ],
)
def test_a_model_that_is_further_from_new_records_is_not_written(given: float, extended: float, worse: bool) -> None:
    steps = BudgetSteps(as_given=given, data_mended=given, values=extended, structure=extended)
    budget = Budget(records=("m2",), channels={"q": steps}, together=steps)
    assert bool(grown(Facts(source="file", witness="flight", budget=budget))) == worse
