"""Truth: a delay that was put into flights of the Do 328, of a channel that has every sixth sample only."""

from __future__ import annotations

import numpy as np
from diagnosis_flights import flights

from casid.diagnosis.flight.evaluation import as_read, lateness
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.instruments import sensor_delay
from problems.do328 import do328


def test_a_late_channel_that_is_read_rarely() -> None:
    """A reading is compared with the state that it speaks of, at a sample at which the channel has none."""
    hidden = Attached(effect=sensor_delay("beta"), values={"value": 0.12})
    records = []
    for record in flights([hidden], seed=4, count=2, rate_hz=50.0):
        rare = np.where(np.arange(len(record)) % 6 == 0, record["beta"], np.nan)
        records.append(record.with_channels(beta=rare))
    flight = prepare(do328(), records)
    start = Attached(effect=sensor_delay("beta"), values={"value": 0.05})
    fitted = fit(flight, [start], flight.noise(), extent="settled")
    name = start.name
    assert fitted.converged
    assert abs(fitted[name] - 0.12) < 4.0 * fitted.std(name)
    assert fitted.std(name) < 0.01
    beta = fitted.model.outputs.index("beta")
    late = lateness(fitted.attached, fitted.flight, fitted.model)
    seen = as_read(late, fitted.linear.seen.astype(float))[..., beta] > 0.0
    assert set(np.flatnonzero(seen[:, 0]) % 6) == {0}
