"""Gates, decisions and traces. Truth: the comparisons themselves, and a diagnosis that must agree with its trace."""

from __future__ import annotations

import json
import math

import pytest
from diagnosis_flights import at_least, at_most
from hypothesis import given
from hypothesis import strategies as st

from casid.diagnosis.cause import Decision, Trace, merged, trace_of
from casid.errors import InputError
from casid.keeping import plain

NUMBERS = st.floats(-1e9, 1e9)


@given(NUMBERS, NUMBERS)
def test_a_gate_is_its_comparison(value: float, threshold: float) -> None:
    assert at_least("a", value, threshold).passed == (value >= threshold)
    assert at_most("a", value, threshold).passed == (value <= threshold)


def test_what_is_not_a_number_passes_nothing() -> None:
    assert not at_least("a", math.nan, 1.0).passed and not at_most("a", math.nan, 1.0).passed


def test_one_alternative_suffices() -> None:
    good, bad = at_least("a", 2.0, 1.0), at_least("b", 0.0, 1.0)
    assert at_least("c", 0.0, 1.0, or_else=[bad, good]).passed
    assert not at_least("c", 0.0, 1.0, or_else=[bad]).passed


def _decisions() -> tuple[Decision, ...]:
    enough, little = (
        at_least("gain", 50.0, 40.0, "significance.search"),
        at_least("gain", 4.0, 40.0, "significance.search"),
    )
    return (
        Decision(cause="actuator_lag(delta_e)", round=1, outcome="named", gates=(enough,), against=("mass",)),
        Decision(cause="input_delay(delta_e)", round=1, outcome="refused", gates=(enough, little)),
        Decision(cause="mass", round=1, outcome="not tried", gates=(little,)),
        Decision(cause="mass", round=2, outcome="not tried", gates=(little,)),
    )


def test_a_trace_survives_json() -> None:
    """JSON has no infinite numbers; they come back with the sign that the outcome of their gate tells."""
    gates = (at_most("a", math.inf, 1.0), at_least("b", -math.inf, 1.0), at_least("c", math.inf, 1.0))
    odd = Decision(cause="gust(z)", round=2, outcome="refused", gates=gates)
    wanted = (*_decisions(), odd)
    text = json.dumps(plain({"decisions": [one.to_dict() for one in wanted]}))
    back = trace_of(json.loads(text)).decisions
    assert [str(one) for one in back] == [str(one) for one in wanted]


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ("actuator_lag(delta_e)", 1),
        ("actuator_lag delta_e", 1),
        ("actuator_lag", 1),
        ("mass", 2),
    ],
)
def test_a_cause_is_found_by_any_of_its_spellings(asked: str, found: int) -> None:
    assert len(Trace(decisions=_decisions()).of(asked).decisions) == found


NAMES = ("sensor_lag(phi)", "sensor_lag(psi)", "mass", "aero_term(Cm:alpha^2)", "aero_term(Cm:q, slow)")


def considered(*names: str) -> Trace:
    return Trace(decisions=tuple(Decision(cause=name, round=1, outcome="refused", gates=()) for name in names))


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ("sensor_lag", NAMES[:2]),
        ("aero_term(Cm)", NAMES[3:]),
        ("aero_term Cm", NAMES[3:]),
        ("aero_term(Cm:q)", NAMES[4:]),
    ],
)
def test_a_kind_and_target_stand_for_all_their_terms(asked: str, found: tuple[str, ...]) -> None:
    assert tuple(one.cause for one in considered(*NAMES).of(asked).decisions) == found


@pytest.mark.parametrize("asked", ["sensor_lag(p)", "sensor_lag p", "m", "aero_term(C)", "aero_term(Cm:alpha)", ""])
def test_the_beginning_of_a_name_is_not_the_cause(asked: str) -> None:
    """The roll-rate gyro is not the roll angle, and was not considered here."""
    with pytest.raises(InputError):
        considered(*NAMES).of(asked)


def test_an_unknown_cause_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"actuator_lag\(delta_e\)"):
        Trace(decisions=_decisions()).of("actuator_lag(delta_f)")


def test_a_document_of_before_says_what_to_do() -> None:
    with pytest.raises(InputError, match=r"casid\.diagnosis/2.*run casid diagnose again"):
        trace_of({"schema": "casid.diagnosis/2"})


def test_what_was_not_tried_is_told_once() -> None:
    kept = merged(_decisions())
    assert [(one.cause, one.round) for one in kept if one.outcome == "not tried"] == [("mass", 2)]


def test_the_summary_begins_with_what_was_named() -> None:
    lines = Trace(decisions=_decisions()).summary().splitlines()
    assert lines[0].startswith("named") and "actuator_lag(delta_e)" in lines[0]
    assert any(line.startswith("not named") and "4.00 in 2 ln L, and 40.0 is needed" in line for line in lines)
