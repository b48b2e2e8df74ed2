"""Truth: what tests/witness.py calls the same, by the definition of its tolerance; files changed by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from casid.errors import InputError

QUICK = "estimate-equation-automatic"


@pytest.fixture
def differences(load_script: Callable[[str], ModuleType]) -> Callable[..., list[str]]:
    return load_script("witness").differences


@pytest.fixture
def run(load_script: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """The script's `main` with arguments; returns its status."""
    script = load_script("witness")

    def main(*arguments: object) -> int:
        monkeypatch.setattr("sys.argv", ["witness.py", *map(str, arguments)])
        return script.main()

    return main


def told(lines: list[str]) -> list[str]:
    """The places of differences."""
    return [line.split(":")[0] for line in lines]


def test_what_is_the_same_has_no_difference(differences) -> None:
    one = {"a": [1.0, {"b": math.nan, "c": None}], "text": "x", "yes": True, "big": math.inf}
    assert differences(one, json.loads(json.dumps(one)), 0.0) == []


def test_numbers_are_found_however_deep(differences) -> None:
    before, now = {"a": [1.0, {"b": 2.0, "c": 3.0}]}, {"a": [1.0, {"b": 2.0, "c": 3.1}]}
    assert told(differences(before, now, 1e-6)) == ["a/1/c"]


@pytest.mark.parametrize(("factor", "count"), [(0.99, 0), (1.01, 1)])
@pytest.mark.parametrize("size", [1e-30, 1.0, 1e30])
def test_a_number_may_differ_by_the_tolerance_of_itself(differences, size: float, factor: float, count: int) -> None:
    assert len(differences({"rms": size}, {"rms": size * (1.0 + 1e-6 * factor)}, 1e-6)) == count


@pytest.mark.parametrize(("off", "count"), [(0.9e-8, 0), (1.1e-8, 1)])
def test_an_estimate_may_differ_by_the_tolerance_of_its_standard_deviation(differences, off: float, count: int) -> None:
    """A bias of 1e-9 +- 0.01 is zero: only its standard deviation has a scale."""
    before, now = ({"value": value, "std": 0.01} for value in (1e-9, 1e-9 + off))
    assert len(differences(before, now, 1e-6)) == count


@pytest.mark.parametrize("place", ["p_value", "missing", "log_likelihood"])
def test_likelihoods_and_probabilities_have_the_scale_of_one(differences, place: str) -> None:
    """Also below: {"missing": {"Cm": gain}}. A probability of 1e-300 is as good as one of 1e-200."""
    assert differences({place: {"Cm": 1e-300}}, {place: {"Cm": 1e-200}}, 1e-6) == []
    assert differences({"rms": {"Cm": 1e-300}}, {"rms": {"Cm": 1e-200}}, 1e-6) != []
    assert told(differences({place: 0.01}, {place: 0.02}, 1e-6)) == [place]


def test_what_one_side_lacks_is_a_difference(differences) -> None:
    lines = differences({"a": 1.0, "b": {"c": 1.0}}, {"b": {"d": 1.0}}, 1e-6)
    assert lines == ["a: only before", "b/c: only before", "b/d: only now"]
    assert differences([1.0, 2.0], [1.0], 1e-6) == ["1: only before"]


@pytest.mark.parametrize(
    ("before", "now"),
    [
        (math.nan, 1.0),
        (1.0, math.nan),
        (math.inf, 1.0),
        (math.inf, -math.inf),
        (None, 0.0),
        ("1", 1.0),
        ({"a": 1.0}, 1.0),
        ("converged", "stuck"),
    ],
)
def test_unlike_things_differ(differences, before: Any, now: Any) -> None:
    assert told(differences({"x": before}, {"x": now}, 1e-6)) == ["x"]


def test_a_clock_and_residues_of_rounding_are_not_compared(differences) -> None:
    before = {"seconds": 1.0, "stationarity": 1e-12, "defect": 1e-16, "cost": 1.0}
    now = {"seconds": 2.0, "stationarity": 3e-12, "defect": 0.0, "cost": 1.0}
    assert differences(before, now, 0.0) == []


def test_causes_are_compared_by_what_they_are(differences) -> None:
    """Two candidates of equal strength may change places; their numbers may not."""
    lag = {"kind": "actuator_lag", "target": "delta_e", "term": None, "statistic": 100.0}
    bias = {"kind": "sensor_bias", "target": "q", "term": None, "statistic": 100.0}
    assert differences([lag, bias], [bias, lag], 1e-6) == []
    changed = differences([lag, bias], [bias, lag | {"statistic": 90.0}], 1e-6)
    assert [line.split(": ")[0] for line in changed] == ["actuator_lag:delta_e/statistic"]


def test_numbers_of_numpy_survive_the_file(load_script) -> None:
    found = {"a": np.float64(0.1), "b": np.int64(2), "c": np.array([1.0, np.nan]), "d": (np.bool_(True),)}
    plain = load_script("witness").plain(found)
    assert (plain["a"], plain["b"], plain["d"]) == (0.1, 2, [True])
    assert math.isnan(plain["c"][1])


def test_a_changed_number_is_told_and_gives_status_1(run, capsys, tmp_path: Path) -> None:
    """One estimation written, compared with itself, and with a file in which its cost is another."""
    file = tmp_path / "witness.json"
    assert run("--out", file, "--only", QUICK) == 0
    assert run("--against", file, "--only", QUICK) == 0
    assert "0 differences in 1 cases" in capsys.readouterr().out
    document = json.loads(file.read_text())
    document["cases"][QUICK]["found"]["cost"] *= 1.0 + 1e-5
    file.write_text(json.dumps(document))
    assert run("--against", file, "--only", QUICK) == 1
    assert f"{QUICK}/cost: " in capsys.readouterr().out
    assert run("--against", file, "--only", QUICK, "--tolerance", "1e-4") == 0


def test_a_case_without_its_data_is_a_difference_when_the_file_has_it(run, capsys, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv("CASID_DATA", raising=False)
    file = tmp_path / "witness.json"
    assert run("--out", file, "--only", "hfb320") == 0
    assert run("--against", file, "--only", "hfb320") == 0
    document = json.loads(file.read_text())
    document["cases"]["hfb320"] = {"seconds": 1.0, "found": {}}
    file.write_text(json.dumps(document))
    assert run("--against", file, "--only", "hfb320") == 1
    assert "hfb320: only before" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "--out FILE"),
        (("--out", "w.json", "--only", "nonsense"), "fits none of demo"),
        (("--against", "nowhere.json"), "cannot be read"),
        (("--out", "w.json", "--tolerance", "-1"), "--tolerance -1.0"),
        (("--out", "w.json", "--tolerance", "few"), "invalid float value"),
        (("--out", "no/such/folder/w.json", "--only", QUICK), "cannot be written"),
    ],
)
def test_bad_input_is_one_line(run, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    given = [tmp_path / a if a.endswith(".json") else a for a in arguments]
    with pytest.raises(InputError, match=words) as told:
        run(*given)
    assert "\n" not in str(told.value)
    assert not list(tmp_path.iterdir())
