"""The F-16 of NASA's check cases as a blind aircraft."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from casid.errors import InputError
from problems.blind import f16
from problems.blind.flown import FLOWN_HZ
from problems.blind.manoeuvres import draw_segments, histories


def test_the_augmentation_of_the_f16_follows_its_motion(flight_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the healthy flight every surface is what was put in and the gains times the motion, which it is held against
    for a step only; without the file of NASA the set says what it needs."""
    monkeypatch.delenv("CASID_DATA", raising=False)
    with pytest.raises(InputError, match="F16_aero.dml"):
        f16.folder()
    monkeypatch.setenv("CASID_DATA", str(flight_data.parent))
    try:
        plane = f16.plane()
    except InputError:
        pytest.skip("no F-16: its DAVE-ML files are in nasa/simupy-flight, folder f16 beside the flight records")
    t = np.arange(0.0, 8.0, 1.0 / FLOWN_HZ)
    segments = draw_segments(np.random.default_rng(2), 8.0, plane.units_s, throttle=False)
    put_in = histories(segments, t, plane.sizes)
    record = plane.fly("m1", t, put_in)
    for surface, gains in plane.augmentation.items():
        added = sum(gain * (record[state] - record[state][0]) for state, gain in gains.items())
        fed_back = record[surface] - record[surface][0] - put_in[surface]
        assert np.std(fed_back) > 0.05 * np.std(put_in[surface])
        assert np.std(fed_back - added) < 0.03 * np.std(fed_back)
