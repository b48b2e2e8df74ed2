"""Series of several rates on one clock. Truth: how many samples were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from records.test_formats import flown_log

from casid.records.log import of_log
from casid.records.readers import read_record


@pytest.mark.parametrize(("part", "complete"), [(0.95, True), (0.85, False)])
def test_nine_tenths_of_the_samples_are_the_rate_of_the_clock(part: float, complete: bool) -> None:
    """A channel that loses a sample now and then is joined; a slower one keeps its own samples and no others."""
    clock, slower = np.linspace(0.0, 10.0, 1001), np.linspace(0.0, 10.0, round(1001 * part))
    table = of_log(Path("m.ulg"), {"p": (clock, np.sin(clock)), "q": (slower, np.cos(slower))})
    q = table.values[:, [name.partition(" ")[0] for name in table.names or ()].index("q")]
    assert np.isfinite(q).sum() == (len(clock) if complete else len(slower))


@pytest.mark.parametrize("count", [1, 2])
def test_a_channel_of_a_log_has_two_readings_at_least(tmp_path, count):
    """Airspeed that was read twice is in the record, at its times; read once it is no series."""
    pytest.importorskip("pymavlink")
    stamps = [2_000_000, 8_000_000][:count]
    (tmp_path / "m.bin").write_bytes(flown_log(ARSP=("QBf", "TimeUS,I,Airspeed", [(t, 0, 20.0) for t in stamps])))
    record = read_record(tmp_path / "m.bin")
    found = record.t[np.isfinite(record["V"])] + 1.0 if "V" in record else ()
    np.testing.assert_allclose(found, [2.0, 8.0] if count == 2 else [], atol=1e-6)
