"""`casid match` as a user types it. Truth: exit statuses, and the files that it writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import casid as cs
from casid.cli.match import match
from casid.cli.options import DEMO
from casid.errors import InputError
from casid.report.pdf import browser

RECORD, PLANE = str(DEMO / "m4.csv"), str(DEMO / "aircraft.toml")
OWN = """
[standard]
name = "House rules"
edition = "2"
source = "desk"
[[test]]
id = "T1"
title = "Roll"
manoeuvre = "aileron input"
paragraph = "4.2"
[[test.tolerance]]
channel = "p"
absolute = {limit}
unit = "deg/s"
"""


def test_status_1_where_a_test_fails(capsys: pytest.CaptureFixture[str]) -> None:
    """The demo's file lacks a lag of the elevator."""
    assert match(RECORD, aircraft=[PLANE], tests=["2.c.10"], as_json=True) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["passed"] is False and {one["id"] for one in told["tests"]} == {"2.c.10"}


@pytest.mark.parametrize(("limit", "status"), [(20.0, 0), (0.05, 1)])
def test_a_table_of_ones_own_decides(tmp_path: Path, limit: float, status: int) -> None:
    (tmp_path / "own.toml").write_text(OWN.format(limit=limit))
    assert match(RECORD, aircraft=[PLANE], tolerances=str(tmp_path / "own.toml"), as_json=True) == status


def test_a_test_that_no_part_changes_has_its_rationale(tmp_path: Path) -> None:
    """A lag of the elevator on a test of the roll: its page stated nothing under "what was changed" and broke off."""
    lag = cs.EffectValue(kind="actuator_lag", target="delta_e", value=0.12)
    cs.Aircraft.read(PLANE).with_effects([lag]).write(tmp_path / "lagging.toml")
    match(RECORD, aircraft=[PLANE, str(tmp_path / "lagging.toml")], out=tmp_path / "out")
    told = json.loads((tmp_path / "out" / "match.json").read_text())
    changed = [one["rationale"]["changed"] for one in told["tests"] if one.get("rationale")]
    assert changed and all(changed)


def test_the_page_and_its_files(tmp_path: Path) -> None:
    match(RECORD, aircraft=[PLANE, PLANE], tests=["2.c.10=6.5:13", "2.d.2"], out=tmp_path / "out")
    told = json.loads((tmp_path / "out" / "match.json").read_text())
    times = {one["id"]: (one["start_s"], one["end_s"]) for one in told["tests"]}
    assert times["2.c.10"] == (6.5, 13.0)
    page = (tmp_path / "out" / "match.html").read_text()
    assert page.count('<section class="test"') == len(told["tests"]) == 2
    assert all(one["paragraph"] in page for one in told["tests"])
    assert len(list((tmp_path / "out" / "match_figures").glob("*.svg"))) == 2
    assert (tmp_path / "out" / "run.json").is_file()


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"tests": ["2.c.10=7"]}, "START:END"),
        ({"tests": ["2.c.11"]}, "2.c.1"),
        ({"tolerances": "part61"}, "part60"),
        ({"aircraft": [PLANE, PLANE, PLANE]}, "3 files"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path: Path, more: dict, named: str) -> None:
    with pytest.raises(InputError) as caught:
        match(RECORD, **{"aircraft": [PLANE], "out": tmp_path / "out", **more})
    assert named in str(caught.value) and "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(browser() is None, reason="no Chromium, Chrome or Edge is installed")
def test_the_page_is_printed_by_one_command(tmp_path: Path) -> None:
    match(RECORD, aircraft=[PLANE], tests=["2.d.2"], out=tmp_path / "out", pdf=True)
    assert (tmp_path / "out" / "match.pdf").read_bytes().startswith(b"%PDF-")


def test_without_a_browser_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("casid.report.pdf.BROWSERS", ())
    with pytest.raises(InputError, match="Chromium"):
        match(RECORD, aircraft=[PLANE], tests=["2.d.2"], out=tmp_path / "out", pdf=True)
    assert not (tmp_path / "out").exists()
