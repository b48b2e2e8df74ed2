"""Latent inputs of several evidences of one fit. Truth: those of the same fit that no evidence has seen before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.controls import actuator_lag
from problems.do328 import do328


def test_what_is_kept_of_a_fit_does_not_depend_on_the_evidence() -> None:
    hidden = Attached(effect=actuator_lag("delta_e"), values={"value": 0.12})
    flight = prepare(do328(), flights([hidden], seed=2, duration_s=12.0))
    base = fit(flight, (), flight.noise())
    cautious = missing_inputs(weigh(base))
    again = missing_inputs(weigh(base, discrepancy=False))
    alone = missing_inputs(weigh(replace(base), discrepancy=False))
    assert [one.station for one in again] == [one.station for one in alone]
    assert [one.gain for one in again] == pytest.approx([one.gain for one in alone], rel=1e-9)
    assert again[0].gain > cautious[0].gain > 0.0
    for one, other in zip(again, alone, strict=True):
        assert one.history.keys() == other.history.keys()
        for name, (_, mean, sigma) in one.history.items():
            assert mean == pytest.approx(other.history[name][1], rel=1e-6, abs=1e-9 * np.max(sigma, initial=1.0))


def test_long_flights_are_gone_through_a_record_at_a_time_with_the_same_result(monkeypatch) -> None:
    """Truth: the same records gone through together."""
    records = flights([], seed=2, duration_s=12.0)
    flight = prepare(do328(), records)
    base, found = fit(flight, (), flight.noise(), extent=(1, np.inf)), []
    for samples in (4096, 1):
        monkeypatch.setattr("casid.diagnosis.evidence.evidence.WHOLE", samples)
        seen = weigh(replace(base))  # by itself: products are kept with a fit
        found.append((len(list(seen.in_records())), missing_inputs(seen), fingerprints(seen, flight.effects)))
    (once, inputs, prints), (parts, apart, prints_apart) = found
    assert (once, parts) == (1, len(records))
    assert [one.station for one in inputs] == [one.station for one in apart]
    assert [one.gain for one in inputs] == pytest.approx([one.gain for one in apart], rel=1e-6, abs=1e-6)
    for one, other in zip(prints, prints_apart, strict=True):
        assert one.effect.key == other.effect.key
        assert one.square == pytest.approx(other.square, rel=1e-9)
        assert one.cross == pytest.approx(other.cross, rel=1e-6, abs=1e-9 * np.abs(one.cross).max(initial=1.0))
