"""Coverage of intervals on few flights. Truth: binomial bounds of 95 %, the exact solution of the flown equations."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from casid.estimation import Problem, solve
from problems.studies.coverage import (
    CONDITIONS,
    NOISE,
    SURFACE_NOISE,
    TRUTH,
    flight,
    measured,
    run,
    short_period,
    table,
    tasks,
)

REPO = Path(__file__).resolve().parents[2]
RUNS = 60


def coverage(condition: str, kinds: list[str], runs: int, draws: int = 59) -> dict:
    todo = tasks([condition], runs, kinds, draws)
    return {row.kind: row for row in table({key: run(task) for key, task in todo.items()})}


def test_the_flight_obeys_its_equations():
    """Without noise the estimates are the truth, up to the error of a fourth-order step, dt^4 times the dynamics."""
    fit = solve(Problem(short_period(), [flight().record], free=["*"], noise=NOISE))
    np.testing.assert_allclose(list(fit.values.values()), list(TRUTH.values()), rtol=1e-5)


def test_conditions_draw_the_noise_that_they_name():
    truth = flight().record
    surfaces, coloured = measured("surfaces", 0), measured("coloured", 0)
    assert np.std(surfaces["delta_e"] - truth["delta_e"]) == pytest.approx(SURFACE_NOISE, rel=0.15)
    np.testing.assert_array_equal(coloured["delta_e"], truth["delta_e"])
    steps = [measured("coloured", seed)["q"] - truth["q"] for seed in range(20)]
    lag_one = np.mean([s[1:] @ s[:-1] for s in steps]) / np.mean([s @ s for s in steps])
    assert lag_one == pytest.approx(0.9, abs=0.04)
    assert np.sqrt(np.mean(np.square(steps))) == pytest.approx(NOISE["q"], rel=0.2)


@pytest.mark.parametrize(
    ("kind", "runs"),
    [("cramer_rao", RUNS), ("corrected", RUNS), pytest.param("profile", 25, marks=pytest.mark.slow)],
)
def test_clean_inputs_an_interval_contains_the_truth_as_often_as_it_says(kind, runs):
    """Each parameter within the binomial bounds of 95 % that one study in two thousand leaves (five parameters)."""
    row = coverage("clean", [kind], runs)[kind]
    assert row.runs == runs and row.failed == 0
    assert min(row.parameters.values()) >= binom.ppf(0.0001, runs, 0.95) / runs
    # half width over scatter: the scatter of so few runs is known to 1/sqrt(2 runs), five parameters, 3.5 sigma
    assert all(abs(np.log(ratio)) < 3.5 / np.sqrt(2 * runs) for ratio in row.width.values())


def test_noisy_surfaces_only_the_kinds_that_know_them_keep_their_promise():
    rows = coverage("surfaces", ["cramer_rao", "input_noise"], RUNS)
    low = binom.ppf(0.0001, RUNS, 0.95) / RUNS
    assert min(rows["cramer_rao"].parameters.values()) < low <= min(rows["input_noise"].parameters.values())


def test_coloured_noise_needs_the_correction():
    rows = coverage("coloured", ["cramer_rao", "corrected"], RUNS)
    assert rows["cramer_rao"].share < 0.7 < 0.87 < rows["corrected"].share


def test_noisy_surfaces_under_coloured_noise_need_the_colour_of_what_the_inputs_leave():
    rows = coverage("both", ["cramer_rao", "input_noise"], RUNS)
    assert rows["cramer_rao"].share < 0.6 < 0.87 < rows["input_noise"].share


def test_the_aircraft_is_covered_too():
    """16 derivatives at once: each within the bounds that one study in two thousand leaves."""
    row = coverage("destabilised", ["corrected"], 30)["corrected"]
    assert row.runs == 30 and len(row.parameters) == 16
    assert min(row.parameters.values()) >= binom.ppf(0.0005 / 16, 30, 0.95) / 30


def test_bootstrap_and_filter_give_an_interval_about_their_estimate():
    for condition, kind in (("clean", "bootstrap"), ("surfaces", "bootstrap_inputs"), ("surfaces", "filter")):
        found = run({"condition": condition, "seed": 1, "kinds": [kind], "draws": 39})[kind]
        assert all(low < value < high for value, low, high in found.values())
        assert all(abs(truth - found[n][0]) < 2 * (found[n][2] - found[n][1]) for n, truth in TRUTH.items())
    assert "input_noise" not in CONDITIONS["clean"].kinds


def test_the_script_writes_its_table_and_refuses_wrong_names(tmp_path, script_here):
    out = tmp_path / "coverage"
    asked = ("--runs", "3", "--condition", "clean", "--kind", "cramer_rao", "corrected", "--jobs", "0")
    status, _, error = script_here("coverage", *asked, "--out", out)
    assert status == 0, error
    with (out / "coverage.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(dict.fromkeys(row["interval"] for row in rows)) == ["Cramer-Rao", "corrected for coloured residuals"]
    assert {row["parameter"] for row in rows} == set(TRUTH)
    assert {row["runs"] for row in rows} == {"3"}
    assert json.loads((out / "run.json").read_text(encoding="utf-8"))["command"][0] == "coverage.py"
    status, _, error = script_here("coverage", "--condition", "clear")
    assert status == 2 and "did you mean 'clean'" in error and error.count("\n") == 1


def test_intervals_of_an_aircraft_side_by_side_and_the_bootstrap_resumes(tmp_path, script_here):
    """On one flight all kinds are of one size; a second run finds all draws done and writes the same numbers."""
    words = ["--axes", "longitudinal", "--free", "Cm_*", "--out", tmp_path]
    words += ["--draws", "39", "--jobs", "0", "--input-noise", "delta_e=0.001", "--profile", "Cm_q"]
    tables, names, told = [], [], ""
    for more in ([], ["--resume"]):
        status, told, error = script_here("intervals", *words, *more)
        assert status == 0, error
        with (tmp_path / "intervals.csv").open(encoding="utf-8") as file:
            tables.append(list(csv.DictReader(file)))
        names = [row["parameter"] for row in tables[-1]]
    assert "draws 39 of 39" in told and "draws 0 of 39" not in told
    for before, after in zip(*tables, strict=True):  # compiled or not, an estimation is the same to rounding only
        assert before.pop("parameter") == after.pop("parameter")
        np.testing.assert_allclose(*([float(v) for v in t.values() if v] for t in (before, after)), rtol=1e-5)
    pitch = tables[0][names.index("Cm_q")]
    half = {k: float(pitch[f"{k} high"]) - float(pitch[f"{k} low"]) for k in ("Cramer-Rao", "profile", "bootstrap")}
    assert all(0.5 < size / half["Cramer-Rao"] < 2.0 for size in half.values())
    assert float(pitch["noisy inputs high"]) - float(pitch["noisy inputs low"]) >= half["Cramer-Rao"] * (1 - 1e-6)
    status, _, error = script_here("intervals", *words, "--input-noise", "delta_e")
    assert status == 2 and "INPUT=SIGMA" in error
