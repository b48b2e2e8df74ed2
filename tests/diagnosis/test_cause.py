"""A cause in words. Truth: the titles of the kinds, as the report has them."""

from __future__ import annotations

import re

import pytest

from casid.diagnosis.cause import Cause, Gate
from casid.model.causes import actuator_lag, aero_term, input_delay
from casid.model.vocabulary import title_of


def test_what_it_cannot_be_told_from_is_told_by_titles() -> None:
    others = tuple({"title": title_of(one)} for one in (aero_term("CL", "alpha^2"), input_delay("delta_e")))
    cause = Cause(
        effect=actuator_lag("delta_e"),
        value=0.1,
        std=0.01,
        records=("m1",),
        statistic=100.0,
        indistinguishable_from=others,
        sentence="The elevator lags.",
        meaningful=True,
        share=2.0,
    )
    told = "The elevator lags. These data cannot tell that apart from CL: alpha^2 or elevator: input delay."
    assert cause.statement == told


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan")])
def test_a_number_without_bound_is_written_in_words(value: float) -> None:
    gate = Gate(gate="gain behind the first", value=value, threshold=1.0, least=False)
    assert all(not {"inf", "-inf", "nan"} & set(re.split(r"[ ,:]+", text)) for text in (str(gate), gate.words))
