"""Stated probabilities against sealed answers, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from problems.blind.calibration import log_score, parsed, reliability, stated
from problems.blind.case import RECORDS, Answer, Hidden


def answer(*hidden: Hidden) -> Answer:
    return Answer(
        of="do328",
        case="two-1",
        seed=1,
        size=1.0,
        aircraft="A",
        hidden=hidden,
        mismatch={},
        conditions={"durations_s": (26.0,) * 4},
    )


def test_probabilities_are_scored_against_what_was_hidden() -> None:
    """A lag stated at 0.8 and hidden, a bias at 0.3 and not, and a second hidden cause that was not told: by hand."""
    lag = Hidden(kind="actuator_lag", target="delta_e", value=0.1, records=RECORDS)
    term = Hidden(kind="aero_term", target="CL", term="alpha^2", value=1.0, records=RECORDS)
    told = {"believed": {"actuator_lag(delta_e)": 0.8, "sensor_bias(q)": 0.3}}
    pairs = stated(answer(lag, term), told)
    assert [(one.probability, one.true) for one in pairs] == [(0.8, True), (0.3, False), (1e-4, True)]
    drift = Hidden(kind="sensor_drift", target="theta", value=0.02)
    assert stated(answer(drift), {"believed": {}}) == []  # nothing of the catalogue could be stated
    assert log_score(pairs) == pytest.approx(np.log(0.8) + np.log(0.7) + np.log(1e-4))
    assert [(row["stated"], row["causes"], row["hidden"]) for row in reliability(pairs)] == [
        ("0 to 0.1", 1, "1.000"),
        ("0.1 to 0.5", 1, "0.000"),
        ("0.5 to 0.9", 1, "1.000"),
    ]


def test_names_of_causes_are_told_apart() -> None:
    """As `Effect.name` writes them: kind, target, term, variant."""
    assert parsed("mass") == {"kind": "mass", "target": "", "term": None}
    assert parsed("aero_term(CL:alpha^2)") == {"kind": "aero_term", "target": "CL", "term": "alpha^2"}
    assert parsed("unsteady_aero(CY, lagged)") == {"kind": "unsteady_aero", "target": "CY", "term": None}
