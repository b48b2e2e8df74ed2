"""`casid diagnose --model`: a system of the user's own file. Truth: its closed-form motion, and a bias put on it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from casid.cli.diagnose import diagnose
from casid.cli.model_file import model_of
from casid.cli.run import script, status_of
from casid.errors import InputError
from casid.records.readers import write_record
from casid.records.record import Record

TANK = """
import casid as cs

def model():
    return cs.define_model(
        "tank", states=("h",), inputs=("pump",), parameters={"area": 1.0, "drain": 0.5}, outputs=("h", "out"),
        prior_std={"area": 0.02},
        dynamics=lambda s: {"h": (s.pump - s.drain * s.h) / s.area},
        output=lambda s: {"h": s.h, "out": s.drain * s.h},
    )

tank = model()
depth = 3.0
"""


def flown(name: str, seed: int) -> Record:
    """A linear tank of area 1 and drain 0.5 under a pump of steps, its outflow meter 0.3 too high."""
    rng, dt = np.random.default_rng(seed), 0.05
    t = np.arange(0.0, 20.0, dt)
    pump = np.repeat(rng.uniform(0.5, 2.0, 10), 40)
    h = [2.0]
    for u, after in zip(pump, pump[1:], strict=False):
        held = 0.5 * (u + after)
        h.append(held / 0.5 + (h[-1] - held / 0.5) * np.exp(-0.5 * dt))
    noise = rng.normal(scale=0.01, size=(2, len(t)))
    return Record(name=name, t=t, channels={"pump": pump, "h": h + noise[0], "out": 0.5 * np.array(h) + 0.3 + noise[1]})


def test_a_fault_of_the_users_own_system_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tank.py").write_text(TANK)
    for k in range(3):
        write_record(flown(f"m{k}", k), tmp_path / f"m{k}.csv")
    arguments = ["--model", f"{tmp_path / 'tank.py'}:model", "--out", str(tmp_path / "out"), "--json"]
    assert status_of(script(diagnose), [str(tmp_path / "m*.csv"), *arguments]) == 0
    printed = json.loads(capsys.readouterr().out)
    written = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert printed == written
    assert [(c["kind"], c["target"]) for c in written["causes"]] == [("sensor_bias", "out")]
    assert written["causes"][0]["value"] == pytest.approx(0.3, abs=0.01)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "out: sensor bias" in page and "area" in page and "m2 (held out)" in page
    assert 'id="figure-budget"' in page and 'id="figure-again-1"' in page  # the budget, and the held-out record
    assert (tmp_path / "out" / "diagnosis.txt").read_text().startswith("explained: ")


def test_a_model_may_stand_in_the_file_or_be_made_there(tmp_path: Path) -> None:
    (tmp_path / "tank.py").write_text(TANK)
    for name in ("model", "tank"):
        assert model_of(f"{tmp_path / 'tank.py'}:{name}").states == ("h",)


@pytest.mark.parametrize(
    ("text", "name", "says"),
    [
        (TANK, "tnak", "did you mean 'tank'"),
        (TANK, "depth", "'depth' is float; expected a casid Model"),
        ("x = (", "x", "line 1 is no Python"),
        ("import casid\n1 / 0\n", "x", "line 2: ZeroDivisionError"),
        (None, "x", "there is no file"),
    ],
)
def test_what_is_no_model_is_said_in_one_line(tmp_path: Path, text: str | None, name: str, says: str) -> None:
    if text is not None:
        (tmp_path / "tank.py").write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        model_of(f"{tmp_path / 'tank.py'}:{name}")
    assert "\n" not in str(caught.value)


def test_a_model_is_no_aircraft(tmp_path: Path) -> None:
    assert status_of(script(diagnose), ["--model", "tank.py:model", "--out", str(tmp_path / "out")]) == 2
    with pytest.raises(InputError, match=r"like tanks\.py:model"):
        model_of("tank.py")
