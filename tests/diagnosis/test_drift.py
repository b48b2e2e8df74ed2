"""A drift of a reading against slow noise. Truth: what was added to a reading."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import drifts
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.noise import as_slow_as_left
from casid.diagnosis.judgement import drifting
from casid.model.causes import sensor_bias
from problems.do328 import do328


@pytest.mark.parametrize("channel", ["q", "alpha", "ay"])
def test_a_drift_matters_from_the_size_of_a_bias_that_matters(channel: str) -> None:
    """A zero that runs off evenly. Noise as slow would explain all of it; so there is none where a bias of that size
    would be told. A tenth of that size is noise."""
    least = sensor_bias(channel).smallest_that_matters(do328())
    assert least is not None
    left = {}
    for part in (0.1, 3.0):
        records = flights(seed=5)
        run = [r.with_channels(**{channel: r[channel] + 2.0 * part * least * (r.t / r.t[-1] - 0.5)}) for r in records]
        flight = prepare(do328(), run)
        fitted = fit(flight, (), flight.noise())
        missing = drifts(weigh(fitted))
        told = drifting(fitted, missing)
        assert (channel in told) == (part > 1.0)
        slow = as_slow_as_left(fitted, told)
        left[part] = max((m.gain for m in drifts(weigh(slow)) if m.place.name == channel), default=0.0)
        assert all(np.isinf(tau) or tau < 6.0 for _, tau in slow.noise.slow.get(channel, ()) if channel in told)
    assert left[3.0] > fitted.criteria.verdict.missing > left[0.1]
