"""Fixes of flight recorders. Truth: numbers written by the layout of the FAI; a minute of latitude is a sixtieth of a
degree of the mean radius of the earth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError

N = 90
SECONDS = 2.0 * np.arange(N)
HEAD = ["AXXX001", "HFDTEDATE:170526,01", "I043638FXA3940SIU4143TAS4444TDS"]


def flight_recorder(begin: int = 86_390) -> str:
    """A flight to the south-west over midnight, which climbs; the last digit of the time is a tenth of a second."""
    rows = []
    for i, s in enumerate(SECONDS.tolist()):
        clock = (begin + int(s)) % 86_400
        at = f"{clock // 3600:02d}{clock // 60 % 60:02d}{clock % 60:02d}"
        place = f"47{30_000 - 10 * i:05d}N008{30_000 - 20 * i:05d}E{'V' if i == 5 else 'A'}"
        rows.append(f"B{at}{place}{-5 + i:05d}{500 + i:05d}01008{100 + i:03d}5")
    return "\r\n".join([*HEAD, *rows, "GABCDEF"])


def written(path: Path) -> Path:
    path.write_text(flight_recorder(), encoding="ascii")
    return path


def test_a_flight_recorder(tmp_path: Path) -> None:
    record = cs.read_record(written(tmp_path / "m.igc"))
    np.testing.assert_allclose(record.t, SECONDS, atol=1e-9)
    np.testing.assert_allclose(record["altitude"], np.arange(N) - 5.0)
    np.testing.assert_allclose(record["V"], (100.0 + np.arange(N)) / 3.6)
    minute = np.radians(1.0 / 60.0) * 6.371e6
    np.testing.assert_allclose(record["north"], -0.01 * np.arange(N) * minute, atol=1e-6)
    np.testing.assert_allclose(record["east"], -0.02 * np.arange(N) * minute * np.cos(np.radians(47.5)), atol=1e-6)
    gnss = record["altitude_gnss"]
    assert np.isnan(gnss[5]) and gnss[6] == 506.0 and np.isnan(gnss).sum() == 1
    np.testing.assert_allclose(record["igc_SIU"], 8.0)


def test_what_is_no_flight_recorder_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "m.igc").write_text("AXXX\nB123\n")
    with pytest.raises(InputError, match="m.igc: 0 fixes"):
        cs.read_record(tmp_path / "m.igc")
    content = written(tmp_path / "m.igc").read_text().replace("B235954", "B2359x4")
    (tmp_path / "m.igc").write_text(content)
    record = cs.read_record(tmp_path / "m.igc")
    assert len(record) == N - 1 and any("1 fixes are damaged" in note for note in record.notes)
