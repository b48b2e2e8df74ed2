"""A cause in words. Truth: the titles of the kinds, as the report has them."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from casid.diagnosis import comparisons as ask
from casid.diagnosis.cause import NAMED, REFUSED, Cause, Decision, Trace
from casid.diagnosis.comparisons import Gate
from casid.errors import InputError
from casid.model.causes.aerodynamics import aero_term
from casid.model.causes.controls import actuator_lag, input_delay
from casid.model.numbers import digits
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
    assert all(not {"inf", "-inf", "nan"} & set(re.split(r"[ ,:]+", text)) for text in (str(gate),))


def trace_of_round(*gates: Gate, statistic: float) -> Trace:
    """Return decisions of one round: a lag that is named with 2 ln L = 1000, and a delay with `gates`."""
    lag = Decision(cause="actuator_lag(delta_e)", round=1, outcome=NAMED, gates=(), statistic=1000.0)
    against = ("actuator_lag(delta_e)",)
    delay = Decision(
        cause="input_delay(delta_e)", round=1, outcome=REFUSED, gates=gates, against=against, statistic=statistic
    )
    return Trace(decisions=(lag, delay))


@given(statistic=st.floats(0.0, 999.0))
def test_a_reason_says_by_how_much_another_cause_fits_better(statistic: float) -> None:
    trace = trace_of_round(ask.BEHIND.of(10.0, 1.0), statistic=statistic)
    reason = trace.reason(trace.decisions[1])
    assert title_of(actuator_lag("delta_e")) in reason and f"{digits(1000.0 - statistic, 2)} in 2 ln L" in reason


def test_every_comparison_that_fails_has_a_reason_in_words() -> None:
    """Of all comparisons: no reason is the name of the comparison with its numbers."""
    made = [one for one in vars(ask).values() if isinstance(one, ask.Comparison)]
    assert len(made) > 30
    for one in made:
        trace = trace_of_round(one.failed(" (somewhere)"), statistic=500.0)
        reason = trace.reason(trace.decisions[1])
        assert reason.endswith(".") and not reason.lower().startswith(one.name), one.name


CONSIDERED = tuple(
    Decision(cause=name, round=1, outcome="refused", gates=())
    for name in (
        "actuator_lag(delta_a)",
        "actuator_lag(delta_e)",
        "input_delay(delta_r)",
        "sensor_bias(alpha)",
        "sensor_lag(V)",
        "sensor_scale(q)",
        "aero_term(Cm:alpha^2)",
    )
)


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("aileron_lag", {"actuator_lag(delta_a)"}),
        ("aileron lag", {"actuator_lag(delta_a)"}),
        ("lag of the elevator", {"actuator_lag(delta_e)"}),
        ("rudder delay", {"input_delay(delta_r)"}),
        ("late rudder", {"input_delay(delta_r)"}),
        ("alpha offset", {"sensor_bias(alpha)"}),
        ("bias of the angle of attack", {"sensor_bias(alpha)"}),
        ("pitch rate scale", {"sensor_scale(q)"}),
        ("airspeed lag", {"sensor_lag(V)"}),
        ("actuator_lag", {"actuator_lag(delta_a)", "actuator_lag(delta_e)"}),
        ("actuator_lag delta_e", {"actuator_lag(delta_e)"}),
    ],
)
def test_the_words_of_a_person_find_a_cause(said: str, meant: set[str]) -> None:
    assert {one.cause for one in Trace(decisions=CONSIDERED).of(said).decisions} == meant


def test_a_cause_that_was_not_considered_is_told_with_those_alike() -> None:
    with pytest.raises(InputError, match=r"input_delay\(delta_r\)"):
        Trace(decisions=CONSIDERED).of("rudder lug")
