"""Latent inputs of several evidences of one fit. Truth: those of the same fit that no evidence has seen before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes import actuator_lag
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
