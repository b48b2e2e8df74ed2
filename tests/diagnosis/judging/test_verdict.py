"""What a verdict tells of causes. Truth: flights of the Do 328 with hidden events."""

from __future__ import annotations

import pytest
from diagnosis_flights import flights

from casid.diagnosis.evidence.evidence import deviation, weigh
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.causes import onset_intervals
from casid.model.causes import (
    effectiveness_change,
    gust,
)
from problems.do328 import do328


def test_an_onset_has_room_for_what_is_not_known_of_the_length() -> None:
    """The middle of an event is what the data tell: half of the length's uncertainty is the onset's."""
    events = [
        Attached(effect=gust("z"), values={"value": 4.0, "length": 1.6}, onsets={"m2": 12.3}),
        Attached(effect=effectiveness_change("delta_r"), values={"value": -0.3}, onsets={"m1": 8.0}),
    ]
    flight = prepare(do328(), flights(events, seed=3))
    evidence = weigh(fit(flight, events, flight.noise()))
    room = 1.96 * 0.5 * deviation(evidence, f"{events[0].name}.length")
    wide, plain = (onset_intervals(evidence, one, {"m2": (12.2, 12.4)}) for one in evidence.fit.attached)
    assert room > 0.004
    assert wide["m2"] == pytest.approx((12.2 - room, 12.4 + room), abs=1e-3)
    assert plain == {"m2": (12.2, 12.4)}
