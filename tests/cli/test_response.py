"""`casid response` gives what the functions give. Truth: these, and the lag that the demonstration hides."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import casid as cs
from casid.cli.options import DEMO

RECORDS = [DEMO / f"m{k}.csv" for k in (1, 2, 3, 4)]


def test_the_command_writes_what_the_functions_give(script_here, tmp_path: Path) -> None:
    """The demonstration's elevator lags by 0.12 s: with that in the file the cost falls by a factor of five or more."""
    lagging = tmp_path / "lagging.toml"
    aircraft = cs.Aircraft.read(DEMO / "aircraft.toml")
    replace(aircraft, effects=(_lag(),)).write(lagging)
    files = "--aircraft", DEMO / "aircraft.toml", lagging
    words = *RECORDS, "--input", "delta_e", "--output", "q", "alpha", *files, "--out", tmp_path / "out"
    status, said, error = script_here("response", *words)
    assert status == 0, error
    told = json.loads((tmp_path / "out" / "response.json").read_text())
    q = told["responses"][0]
    found = cs.frequency_response(RECORDS, "delta_e", "q")
    assert q["flight"]["gain_db"] == pytest.approx(found.gain_db)
    compared = cs.compare_responses(found, {"a": cs.linear_model(aircraft, RECORDS, outputs=["q"])})
    assert q["models"]["aircraft"]["cost"] == pytest.approx(compared.mismatches["a"].cost)
    assert q["models"]["lagging"]["cost"] < 0.2 * q["models"]["aircraft"]["cost"]
    assert sorted(path.name for path in (tmp_path / "out" / "figures").iterdir()) == [
        "bode_alpha_delta_e.svg",
        "bode_q_delta_e.svg",
    ]
    assert "alpha to delta_e" in said and "lagging" in said


def _lag() -> cs.EffectValue:
    return cs.EffectValue(kind="actuator_lag", target="delta_e", term=None, value=0.12, parameters={})


def test_json_is_all_that_is_printed(script_here, tmp_path: Path) -> None:
    words = RECORDS[0], "--input", "delta_e", "--output", "q", "--band", "1", "10", "--json", "--out", tmp_path
    status, said, error = script_here("response", *words)
    assert status == 0, error
    (one,) = json.loads(said)["responses"]
    assert one["omega"][0] == pytest.approx(1.0) and one["omega"][-1] == pytest.approx(10.0)
