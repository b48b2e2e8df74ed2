"""A diagnosis by the score, on flights of which the truth is known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from diagnosis_flights import flights, rough_file

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes import actuator_lag, aero_term, sensor_bias

LAG = Attached(effect=actuator_lag("delta_e"), values={"value": 0.15})
PAIR = (
    Attached(effect=sensor_bias("p"), values={"value": 0.007}),
    Attached(effect=aero_term("CL", "alpha*delta_e"), values={"value": 14.0}),
)


def test_a_lag_is_named_with_its_probability(tmp_path: Path) -> None:
    """The lag that was flown, at its size; probabilities stand in the document and sum to one."""
    found = diagnose(rough_file(), flights([LAG], seed=1, count=3), naming="score")
    assert [(c.kind, c.target) for c in found.causes] == [("actuator_lag", "delta_e")], str(found)
    (cause,) = found.causes
    assert abs(cause.value - 0.15) < 5.0 * cause.std
    assert cause.probability is not None and 0.98 < cause.probability <= 0.99
    assert cause.log_odds is not None and cause.log_odds > 100.0
    found.write(tmp_path / "diagnosis.json")
    document = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert document["causes"][0]["probability"] == pytest.approx(cause.probability)
    assert "actuator_lag(delta_e)" in document["explanations"][0]["causes"]
    assert 0.9 < sum(one["probability"] for one in document["explanations"]) <= 1.0 + 1e-9


def test_two_causes_are_named_and_nothing_else() -> None:
    """A bias of 0.007 rad/s and a term: each to 5 sigma or 5 % of what was flown."""
    found = diagnose(rough_file(), flights(PAIR, seed=5, count=3), naming="score")
    truth = {one.effect.key: one.values["value"] for one in PAIR}
    assert {(c.kind, c.target, c.term) for c in found.causes} == truth.keys(), str(found)
    for cause in found.causes:
        value = truth[cause.kind, cause.target, cause.term]
        assert abs(cause.value - value) < 5.0 * cause.std + 0.05 * abs(value)


def test_clean_flights_have_wrong_values_and_no_cause() -> None:
    """The structure of the file is right, and its moments are 30 % below the truth."""
    found = diagnose(rough_file(), flights(seed=11, count=3), naming="score")
    assert (found.verdict, found.causes) == ("values wrong", ()), str(found)
    assert "adequate" not in found.sentence and ".The" not in found.sentence
    assert all(p < 0.1 for p in found.believed.values())
