"""`casid compatibility`. Truth: a pitch rate whose gyro was given a bias, and the example as it is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from casid.cli.compatibility import compatibility
from casid.cli.options import DEMO
from casid.cli.run import call, script
from casid.diagnosis.kinematics.compatibility import compatibility as checked
from casid.records.readers import read_record, write_record
from casid.report.data_pages import write_compatibility


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


def test_a_page_without_errors_and_one_with_an_undetermined_one_state_no_number(tmp_path: Path) -> None:
    """An error of 200 m/s2 +- 240 that no instrument has; and a reconstruction that follows nothing."""
    found = checked(read_record(DEMO / "m1.csv"))
    first, *others = found.errors
    loose = replace(first, kind="sensor_bias", target="ax", value=200.0, std=240.0, unit="m/s2", largest=3.0)
    for errors, followed in (((loose, *others), True), ((), False)):
        folder = tmp_path / str(followed)
        write_compatibility(replace(found, errors=errors, followed=followed), folder)
        page = (folder / "compatibility.html").read_text()
        assert ("not determined" in page) == ("measured minus true" in page) == followed
        assert ("does not follow" in page) != followed and "200 ± 240" not in page and ">200<" not in page
