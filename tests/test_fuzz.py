"""Files with faults drawn at random, from reading to the fit of the file as it is: a result or one line, nothing else.

`CASID_FUZZ=10000 python -m pytest tests/test_fuzz.py` draws that many. Truth: the contract of errors.
"""

from __future__ import annotations

import os
import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_flight import aircraft_file, records

import casid as cs

EXAMPLES = int(os.environ.get("CASID_FUZZ", "40"))
NUMBERS = ("0", "-1", "1e-300", "1e308", "-1e308", "nan", "inf", "1e5", "-0.5", "3", "0.001", "90", "1e-9")
CELLS = (*NUMBERS, "", "n/a", "1,5", "-999", "9999", '"', "1e999", "2026-05-17T09:30:00", "\x00", "0x10", "1_0")
HEADS = ("t", "alpha", "alpha [deg]", "V (kt)", "q_dps", "delta_e [g]", "", "t [ms]", "rho [slug/ft3]", "x", "hold")
WORDS = (*NUMBERS, "true", '"text"', "[]", "[1.0, 2.0]", "{ a = 1 }", "[[]]", '"wind"', '"body"', "-7", "1979-05-27")
EFFECTS = (
    '[[effects]]\nkind = "{kind}"\ntarget = "{target}"\nvalue = {value}\n',
    '[[effects]]\nkind = "{kind}"\ntarget = "{target}"\nterm = "alpha^2"\nvalue = {value}\nstd = {value}\n',
    '[[effects]]\nkind = "{kind}"\ntarget = "{target}"\nvalue = {value}\nonset_s = {{ first = [1.0, 2.0] }}\n',
)
KINDS = ("actuator_lag", "sensor_bias", "mass", "inertia", "aero_term", "gust", "cg_offset", "sensor_delay", "backlash")
TARGETS = ("delta_e", "q", "x", "Cm", "Ixz", "inertial", "", "alpha")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a record and of an aircraft file without fault."""
    folder = tmp_path_factory.mktemp("sound")
    aircraft_file().write(folder / "plane.toml")
    cs.write_record(records()[0].between(0.0, 4.0), folder / "first.csv")
    return folder


def spoilt_record(text: str, rng: random.Random) -> str:
    rows = [line.split(",") for line in text.splitlines()]
    for _ in range(rng.randint(0, 2)):
        fault, row, column = rng.randrange(9), rng.randrange(1, len(rows)), rng.randrange(len(rows[0]))
        column = min(column, len(rows[row]) - 1, len(rows[0]) - 1)
        if fault == 0:
            rows[row][column] = rng.choice(CELLS)
        elif fault == 1:
            rows[0][column] = rng.choice(HEADS)
        elif fault == 2:
            del rows[row]
        elif fault == 3:
            rows.insert(row, list(rng.choice(rows)))
        elif fault == 4:
            value = rng.choice(NUMBERS)
            rows[1:] = [[*r[:column], value, *r[column + 1 :]] for r in rows[1:]]
        elif fault == 5:
            rows = [r[:column] + r[column + 1 :] for r in rows]
        elif fault == 6:
            factor = rng.choice((-1.0, 0.0, 57.3, 1e3, 1e-3, 1e8))
            scaled = [[*r[:column], _times(r[column : column + 1], factor), *r[column + 1 :]] for r in rows[1:]]
            rows[1:] = scaled
        elif fault == 7:
            rows = rows[: rng.randrange(1, len(rows))] + [rows[-1][:column]]
        else:
            return rng.choice((";", "\t", ",,", "\n", "")).join(",".join(r) for r in rows)
        if len(rows) < 3 or not rows[0]:
            break
    return "\n".join(",".join(row) for row in rows)


def _times(cell: list[str], factor: float) -> str:
    try:
        return repr(factor * float(cell[0]))
    except (ValueError, IndexError):
        return ""


def spoilt_aircraft(text: str, rng: random.Random) -> str:
    lines = text.splitlines()
    for _ in range(rng.randint(0, 3)):
        fault, row = rng.randrange(7), rng.randrange(len(lines))
        key, equals, _ = lines[row].partition(" = ")
        if fault <= 2 and equals:
            lines[row] = f"{key} = {rng.choice(WORDS)}"
        elif fault == 3:
            del lines[row]
        elif fault == 4:
            lines.insert(row, rng.choice(lines))
        elif fault == 5 and equals:
            lines[row] = key[::-1] + lines[row][len(key) :]
        else:
            effect = rng.choice(EFFECTS)
            lines.append(
                effect.format(kind=rng.choice(KINDS), target=rng.choice(TARGETS), value=rng.choice((*NUMBERS, "0.1")))
            )
        if not lines:
            break
    return "\n".join(lines)


def fitted(folder: Path, rng: random.Random, sound: Path) -> str:
    """What became of one draw: "fit", or where it was refused."""
    (folder / "first.csv").write_text(spoilt_record((sound / "first.csv").read_text(), rng), encoding="utf-8")
    (folder / "plane.toml").write_text(spoilt_aircraft((sound / "plane.toml").read_text(), rng), encoding="utf-8")
    stage = "record"
    try:
        record = cs.read_record(folder / "first.csv")
        stage = "aircraft"
        plane = cs.Aircraft.read(folder / "plane.toml")
        stage = "model"
        axes = rng.choice(("full", "longitudinal", "lateral"))
        model, ready = cs.aircraft_model(plane, axes=axes), cs.flight_inputs(plane, record, axes)
        stage = "problem"
        problem = cs.Problem(model, [ready], free=["C*"], cost=rng.choice((cs.OutputError(), cs.EquationError())))
        stage = "solve"
        fit = cs.solve(problem, solver=cs.GaussNewton(iterations=2))
        assert "\n" not in fit.status and str(fit)
        return "fit"
    except cs.CasidError as error:
        assert "\n" not in str(error) and len(str(error)) < 2000, error
        return stage


@given(seed=st.integers(0, 2**63))
@settings(max_examples=EXAMPLES, derandomize=EXAMPLES <= 100, suppress_health_check=list(HealthCheck), database=None)
def test_a_spoilt_file_is_a_fit_or_one_line(seed: int, sound: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = FOLDER.setdefault("at", tmp_path_factory.mktemp("fuzz"))
    with np.errstate(all="warn"):
        COUNTED[fitted(folder, random.Random(seed), sound)] += 1


FOLDER: dict[str, Path] = {}
COUNTED: Counter[str] = Counter()


def test_all_stages_were_reached() -> None:
    """Faults are not all caught at the door: some files go through to the fit."""
    print(dict(COUNTED), sum(COUNTED.values()))
    assert COUNTED["fit"] > 0 and COUNTED["record"] > 0 and COUNTED["aircraft"] > 0
