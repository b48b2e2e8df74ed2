"""A drift of a reading against slow noise. Truth: what was added to a reading."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.data_check.reading import Finding
from casid.diagnosis.cause import NAMED, REFUSED, Trace
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, drifts
from casid.diagnosis.evidence.size import missing_size
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.noise import as_slow_as_left
from casid.diagnosis.last_tests import drifting, traced
from casid.diagnosis.verdict import of_data
from casid.model.causes.instruments import sensor_bias
from problems.do328 import do328


def test_a_drift_matters_as_a_bias_does_however_much_the_reading_varies() -> None:
    """A rate gyro whose zero runs off by twice a bias that matters, in a flight that turns 20 times as fast."""
    least = sensor_bias("q").smallest_that_matters(do328()) or 0.0
    flight = prepare(do328(), flights(seed=5, count=2, duration_s=8.0, size=3.0))
    fitted = fit(flight, (), flight.noise(), extent=(2, 0.5))
    for part in (0.5, 2.0):
        missing = MissingInput(station="reading_q", gain=9e3, size=0.1, history=ramp(part * least))
        assert (missing_size(fitted, missing) > 1.0) == (part > 1.0)


@pytest.mark.parametrize("channel", ["q", *(pytest.param(one, marks=pytest.mark.slow) for one in ("alpha", "ay"))])
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
    assert left[3.0] > fitted.criteria.missing > left[0.1]


def test_ports_and_data_have_their_trace() -> None:
    """A drift that is told, one that is too small, and a reading that was corrected; `why` answers for each."""
    told = MissingInput(station="reading_q", gain=9e3, size=0.1, history=ramp(0.3))
    small = MissingInput(station="reading_alpha", gain=9e3, size=1e-6, history=ramp(1e-6))
    flight = prepare(do328(), flights(seed=5, count=2, duration_s=8.0))
    evidence = weigh(fit(flight, (), flight.noise(), extent=(2, 0.5)))
    kept = SimpleNamespace(evidence=evidence, fit=evidence.fit)
    turned = Finding(kind="data_sign", target="ay", records=("m1",), handled="corrected", sentence="", odds=1e6)
    trace = traced(kept, [told, small], [told], Trace(decisions=of_data([turned])))  # pyright: ignore
    assert trace.of("reading_q").outcome["reading_q"] == NAMED
    (refused,) = trace.of("reading_alpha").decisions
    assert refused.outcome == REFUSED and refused.failed[0].criterion == "size.share"
    assert trace.of("data_sign(ay)").decisions[0].gates[0].value == 1e6


def ramp(size: float) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    return {"m1": (np.arange(9.0), size * np.linspace(-1.0, 1.0, 9), np.ones(9))}
