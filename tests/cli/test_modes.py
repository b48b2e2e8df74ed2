"""`casid modes`: the numbers of the function, whole folders, and bad input in one line."""

from __future__ import annotations

import json

import pytest

import casid as cs
from casid.cli.modes import modes
from casid.cli.options import DEMO


def test_the_numbers_are_those_of_the_function(tmp_path, capsys) -> None:
    extended = cs.Aircraft.read(DEMO / "aircraft.toml").with_effects([cs.EffectValue(kind="mass", value=500.0)])
    extended.write(tmp_path / "extended.toml")
    out = tmp_path / "out"
    modes(
        DEMO / "aircraft.toml",
        tmp_path / "extended.toml",
        record=[str(DEMO / "m4.csv")],
        V=100.0,
        out=out,
        as_json=True,
    )
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "modes.json").read_text(encoding="utf-8"))
    assert list(printed["aircraft"]) == ["aircraft", "extended"]
    found = cs.modes(extended, V=100.0)
    told = printed["aircraft"]["extended"]
    assert told["numbers"]["lift_over_drag"]["value"] == pytest.approx(found.numbers["lift_over_drag"].value)
    assert told["modes"]["phugoid"]["period"]["value"] == pytest.approx(found.modes["phugoid"].numbers["period"].value)
    parts = printed["theil"]["m4"]["aircraft"]["q"]
    assert parts["bias"] + parts["variance"] + parts["covariance"] == pytest.approx(1.0)
    assert (out / "modes.html").is_file() and (out / "modes_figures" / "eigenvalues.svg").is_file()


def test_an_estimate_stands_beside_its_file(tmp_path, capsys) -> None:
    wrong = tmp_path / "estimate.json"
    wrong.write_text("[]", encoding="utf-8")
    with pytest.raises(cs.InputError, match=r"estimate\.json"):
        modes(DEMO / "aircraft.toml", estimate=wrong, out=tmp_path / "out")
    with pytest.raises(cs.InputError, match="AIRCRAFT is missing"):
        modes(out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
    document = {
        "parameters": {"Cm_alpha": {"value": -2.0, "std": 0.02}},
        "correlation": {"names": ["Cm_alpha"], "matrix": [[1.0]]},
    }
    wrong.write_text(json.dumps(document), encoding="utf-8")
    modes(DEMO / "aircraft.toml", estimate=wrong, out=tmp_path / "out", as_json=True)
    told = json.loads(capsys.readouterr().out)["aircraft"]["aircraft, estimated"]["numbers"]["static_margin"]
    assert told["std"] / told["value"] == pytest.approx(0.01, rel=1e-6)  # CL_alpha is exact
