"""Truth: estimates of an independent program on the same records, and a repeat that shares nothing with them."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from diagnosis_flights import one_round

from casid.errors import InputError
from casid.records.record import Record
from problems.real import attas


@pytest.fixture(scope="module")
def attas_run(flight_data, load_script, tmp_path_factory) -> tuple[Path, str]:
    """The folder that scripts/attas.py writes, and what it prints.

    Its diagnosis looks at one round and the likeliest causes only: it has to say that linear models leave something.
    """
    module, out = load_script("attas"), tmp_path_factory.mktemp("attas")
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(StringIO()) as printed:
        patched.setattr(module, "diagnose", partial(module.diagnose, criteria=one_round()))
        patched.setattr(sys, "argv", ["attas.py", str(flight_data), "--out", str(out)])
        module.main()
    return out, printed.getvalue()


@pytest.mark.slow
def test_attas_script(attas_run):
    """Independent estimates within two standard errors that allow for coloured residuals; high R2 all the same.

    The repeats say which standard error is meant: estimates of two flights differ by several Cramer-Rao deviations.
    """
    folder, printed = attas_run
    assert "Which is honest" in printed and "late, not ahead" in printed
    result = json.loads((folder / "attas.json").read_text())
    for part, values in (("lateral", attas.LATERAL), ("longitudinal", attas.LONGITUDINAL)):
        assert result[part]["converged"]
        for name, value in values.items():
            parameter = result[part]["parameters"][name]
            assert abs(parameter["value"] - value) < 2.0 * parameter["std"], name
    for manoeuvre in result["held_out"].values():
        for channel, found in manoeuvre.items():
            assert found["R2"] > 0.94 and found["lag1"] > 0.75, channel
    for ratio in result["repeatability"].values():
        assert ratio["std"] > 3.0 and ratio["std_corrected"] < 0.5 * ratio["std"]
    diagnosis = json.loads((folder / "diagnosis.json").read_text())
    assert diagnosis["verdict"] != "adequate"
    assert diagnosis["gain"]["held_out"]["records"] == ["fAttasAilRud2-1", "fAttasAilRud2-2", "fAttasElv2"]


@pytest.mark.slow
def test_instruments_of_attas_are_the_same_in_both_sets_of_flights(attas_run):
    """What kinematics alone find in one set of flights they find in the other, which shares nothing with it: within
    three standard deviations that allow for colour. Truth: the columns' own agreement, no bound per cent."""
    result = json.loads((attas_run[0] / "attas.json").read_text())
    once, again = (one["found"] for one in result["instruments"].values())
    off = {n: (once[n][0] - again[n][0]) / np.hypot(once[n][1], again[n][1]) for n in once}
    assert max(map(abs, off.values())) < 3.0, off
    for name in ("sensor_bias(q)", "sensor_scale(p)", "vane_position(alpha)", "vane_position(beta)"):
        assert min(one[name][0] / one[name][1] for one in (once, again)) > 2.5, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angle", "rate", "records"), [("alpha", "q", ("Elv1", "Elv2")), ("beta", "r", ("AilRud1", "AilRud2"))]
)
def test_vanes_of_attas_stand_where_regression_puts_them(attas_run, flight_data, angle, rate, records):
    """Truth: flow angles integrated from accelerations, rates and attitude, and least squares of the measured ones on
    these, on rate over airspeed (the arm) and on drifts. Outside the package: no filter, no noise, no aerodynamics."""
    result = json.loads((attas_run[0] / "attas.json").read_text())
    for found, name in zip(result["instruments"].values(), records, strict=True):
        arms = [regressed_arm(record, angle, rate) for record in attas.records_from(flight_data, f"fAttas{name}")]
        value, std = found["found"][f"vane_position({angle})"]
        assert abs(value - np.mean(arms)) < 3.0 * std and 11.0 < np.mean(arms) < 16.0, (value, std, arms)


def regressed_arm(record: Record, angle: str, rate: str) -> float:
    """Metres by which a vane stands ahead of the centre of gravity."""
    r, g, V = record, 9.80665, record["V"]
    if angle == "alpha":
        along = np.tan(r["alpha"]) * (r["ax"] - g * np.sin(r["theta"]))
        normal = r["az"] + g * np.cos(r["theta"]) * np.cos(r["phi"]) - along
        turn, sign = r["q"] + normal * np.cos(r["alpha"]) / V, -1.0
    else:
        side = r["ay"] + g * np.cos(r["theta"]) * np.sin(r["phi"])
        turn, sign = side / V - r["r"] * np.cos(r["alpha"]) + r["p"] * np.sin(r["alpha"]), 1.0
    by_inertia, turned = (
        np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(r.t))]) for x in (turn, sign * r[rate])
    )
    drifts = np.vander(np.linspace(0.0, 1.0, len(r)), 4)
    columns = np.column_stack([by_inertia, sign * r[rate] / V, turned, drifts])
    return float(np.linalg.lstsq(columns, r[angle], rcond=None)[0][1])


def test_attas_without_its_records_says_so(load_script: Callable[[str], ModuleType], monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "argv", ["attas.py", str(tmp_path), "--out", str(tmp_path / "out")])
    with pytest.raises(InputError, match=r"fAttasAilRud1.mat: no such file"):
        load_script("attas").main()
