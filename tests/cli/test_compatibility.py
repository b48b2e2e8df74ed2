"""`casid compatibility`. Truth: a pitch rate whose gyro was given a bias, and the example as it is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from casid.cli.compatibility import compatibility
from casid.cli.options import DEMO
from casid.cli.run import call, script
from casid.records.readers import read_record, write_record


@pytest.mark.parametrize(("bias", "status"), [(0.0, 0), (0.01, 1)])
def test_status_page_and_json(bias: float, status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = read_record(DEMO / "m1.csv")
    write_record(record.with_channels(q=record["q"] + bias), tmp_path / "m.csv")
    out = tmp_path / "out"
    assert call(script(compatibility), [str(tmp_path / "m.csv"), "--out", str(out), "--json"]) == status
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads((out / "compatibility.json").read_text()) and told["passed"] == (status == 0)
    failed = [(one["kind"], one["target"]) for one in told["errors"] if not one["passed"]]
    assert failed == ([("sensor_bias", "q")] if bias else [])
    page = (out / "compatibility.html").read_text()
    assert ("Fail" if bias else "Pass") in page and "reconstructed" in page
