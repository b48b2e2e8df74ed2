"""Logs: series of several rates on one clock, attitudes. Truth: how many samples were taken, three rotations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from records.test_formats import flown_log

from casid.records.log import of_log
from casid.records.quaternions import euler_angles
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


@given(st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_quaternions_turn_as_three_rotations(angles):
    """The quaternion of 3-2-1 angles, written out as the product of its three half turns."""
    phi, theta, psi = angles
    w, x, y, z = 1.0, 0.0, 0.0, 0.0
    for angle, axis in ((psi, (0, 0, 1)), (theta, (0, 1, 0)), (phi, (1, 0, 0))):
        c, (i, j, k) = np.cos(angle / 2), np.sin(angle / 2) * np.array(axis)
        w, x, y, z = (
            w * c - x * i - y * j - z * k,
            w * i + x * c + y * k - z * j,
            w * j - x * k + y * c + z * i,
            w * k + x * j - y * i + z * c,
        )
    np.testing.assert_allclose(euler_angles(np.array([[w, x, y, z]]))[0], angles, atol=1e-7)
