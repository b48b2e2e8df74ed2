"""Manoeuvres in a long record. Truth: where they were put, between minutes of rest with noise and small corrections."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.cli.run import call, script
from casid.cli.segments import segments as command
from casid.records.record import Record

DT = 0.02
PUT_IN = {"delta_e": [(60.0, 67.0), (200.0, 210.0)], "delta_a": [(120.0, 126.0)], "delta_r": [(124.0, 130.0)]}


def long_log(noise: float = 3e-4, corrections: float = 1.5e-3, seconds: float = 300.0) -> Record:
    """Five minutes with four inputs of 3 deg in three manoeuvres; between them a slow change of trim, small corrections
    of an autopilot, and noise."""
    t = np.arange(round(seconds / DT)) * DT
    rng = np.random.default_rng(5)
    channels = {}
    for k, (name, spans) in enumerate(PUT_IN.items()):
        x = 0.02 * np.sin(2.0 * np.pi * t / 240.0) + corrections * np.sin(0.9 * t + k)
        for start, stop in spans:
            x += 0.052 * np.sign(np.sin(2.0 * np.pi * (t - start) / 2.0)) * ((t >= start) & (t < stop))
        channels[name] = x + noise * rng.standard_normal(len(t))
    channels["q"] = np.gradient(channels["delta_e"], DT) * 0.01 + 1e-3 * rng.standard_normal(len(t))
    return Record(name="log", t=t, channels=channels)


def test_manoeuvres_are_found_where_they_are() -> None:
    """Each whole, with at most a second before and five behind it, on the axes that are moved."""
    found = cs.segments(long_log())
    assert [one.axes for one in found] == [("pitch",), ("roll", "yaw"), ("pitch",)]
    for one, (start, stop) in zip(found, [(60.0, 67.0), (120.0, 130.0), (200.0, 210.0)], strict=True):
        assert start - 2.0 < one.start < start and stop < one.stop < stop + 5.5
    assert found[0].surfaces["delta_e"] == pytest.approx(0.052 * np.sqrt(7.0 / found[0].duration), rel=0.15)
    part = long_log().between(found[0].start, found[0].stop)
    assert part.duration == pytest.approx(found[0].duration, abs=2 * DT)


def test_nothing_is_found_where_nothing_stands_out() -> None:
    """Noise alone, an autopilot at work all the time, and surfaces at rest."""
    t = np.arange(6000) * DT
    rng = np.random.default_rng(6)
    noise = Record(name="n", t=t, channels={"delta_e": 1e-3 * rng.standard_normal(len(t))})
    busy = Record(name="b", t=t, channels={"delta_e": 0.03 * np.sin(1.3 * t) + 1e-3 * rng.standard_normal(len(t))})
    still = Record(name="s", t=t, channels={"delta_e": np.full(len(t), 0.1)})
    assert [cs.segments(one) for one in (noise, busy, still)] == [(), (), ()]


def test_a_surface_without_samples_has_no_manoeuvre() -> None:
    t = np.arange(0.0, 60.0, 0.05)
    assert cs.segments(cs.Record(name="m", t=t, channels={"delta_e": np.full(len(t), np.nan)})) == ()


def test_a_pause_in_the_time_parts_manoeuvres() -> None:
    log = long_log()
    t = np.where(log.t > 64.0, log.t + 100.0, log.t)
    found = cs.segments(Record(name="log", t=t, channels=log.channels))
    assert not any(one.start < 70.0 and one.stop > 160.0 for one in found)


def test_the_command_writes_the_manoeuvres(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = long_log()
    cs.write_record(log, tmp_path / "log.csv")
    out = tmp_path / "out"
    assert call(script(command), [str(tmp_path / "log.csv"), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["logs"]["log"]
    assert told == json.loads((out / "segments.json").read_text())["logs"]["log"] and len(told) == 3
    second = cs.read_record(out / "log_2.csv")
    np.testing.assert_array_equal(second["delta_a"], log.between(told[1]["start"], told[1]["stop"])["delta_a"])
    assert (out / "figures" / "segments_log.svg").stat().st_size > 1000
    assert call(script(command), [str(tmp_path / "log.csv"), "--from", "220"]) == 1
    assert "no manoeuvre stands out" in capsys.readouterr().out


@pytest.mark.parametrize("seed", range(6))
def test_manoeuvres_lie_within_the_time_that_was_recorded(seed: int) -> None:
    """Truth: when the surface was moved. A movement from the first sample on, one to the last before a pause, two that
    are near and two that are far; every one is within one manoeuvre, in the order of time, none across the pause."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(200.0 / DT)) * DT
    gap = rng.uniform(1.5, 60.0)
    blocks = [(0.0, 4.0), (36.0, 40.0), (60.0, 64.0), (66.0, 70.0), (120.0, 125.0)]
    x = 2e-4 * rng.standard_normal(len(t))
    for start, stop in blocks:
        x += 0.05 * np.sign(np.sin(2.0 * np.pi * (t - start) / 2.0 + 0.3)) * ((t >= start) & (t < stop))
    recorded = t + np.where(t >= 40.0, gap, 0.0)
    found = cs.segments(Record(name="log", t=recorded, channels={"delta_e": x}))
    assert [one.start for one in found] == sorted(one.start for one in found)
    assert all(a.stop <= b.start for a, b in pairwise(found))
    assert found[0].start == 0.0 and all(0.0 <= one.start < one.stop <= recorded[-1] + 1.01 * DT for one in found)
    for start, stop in blocks:
        moved = recorded[(t >= start) & (t < stop)]
        assert sum(one.start <= moved[0] and moved[-1] < one.stop for one in found) == 1
    assert not any(one.start < 40.0 and one.stop > 40.0 + gap for one in found)
    near, far = (
        sum(one.start < gap + end and one.stop > gap + start for one in found) for start, end in ((61, 69), (61, 124))
    )
    assert (near, far) == (1, 2)
