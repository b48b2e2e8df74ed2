"""The scripts of the paper: their files, the same numbers again, resumption, bad input.

As processes of their own where the process is the point, otherwise in this one, which spares them the imports.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
Run = Callable[..., subprocess.CompletedProcess[str]]
Here = Callable[..., tuple[int, str, str]]
FOLDERS = ("scripts", "benchmarks")
SCRIPTS = ("table5", "compare_shooting", "weighting", "constraints", "paper_figures")


def start(script: str, *arguments: str) -> subprocess.Popen:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, str(REPO / "scripts" / f"{script}.py"), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_table5_is_exact_without_noise(tmp_path: Path, script_here: Here) -> None:
    """Truth: A and C are exact (claim 1 of the paper)."""
    exact = ("--cases", "A,C", "--manoeuvres", "1", "--method", "multiple-open")
    status, said, error = script_here("table5", *exact, "--jobs", "0", "--out", tmp_path)
    assert (status, error) == (0, "") and "claim 1 confirmed" in said
    table = rows(tmp_path / "table5.csv")
    assert list(table[0]) == ["case", "estimator", "method", "statistic", "value"]
    published = {r["statistic"] for r in rows(REPO / "problems" / "paper" / "table5.csv")}
    names = {r["statistic"] for r in table}
    assert {n for n in published if not n.startswith("departures")} <= names
    derivatives = [float(r["value"]) for r in table if r["statistic"][:2] in ("Cl", "Cm", "Cn")]
    assert len(derivatives) == 2 * 3 * 16 and max(derivatives) < 1e-6
    page = (tmp_path / "table5.html").read_text()
    assert "confirmed" in page and "http" not in page.split("</style>")[1]


@pytest.mark.slow
def test_table5_does_not_show_what_was_compiled_before(
    tmp_path: Path, run_script: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a machine that has compiled nothing yet and on one that has, in one process and in two, with noise: the same
    to the last digit."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    noisy = ("--cases", "D", "--manoeuvres", "1", "--method", "multiple-open")
    for name, jobs in (("first", "0"), ("again", "2")):
        assert run_script("table5", *noisy, "--jobs", jobs, "--out", str(tmp_path / name)).returncode == 0
    assert (tmp_path / "first" / "table5.csv").read_bytes() == (tmp_path / "again" / "table5.csv").read_bytes()


@pytest.mark.slow
def test_table5_killed_in_mid_run_resumes_to_the_same_table(tmp_path: Path, script_here: Here) -> None:
    cases = ("--cases", "B,D", "--manoeuvres", "1,2", "--method", "multiple-open")
    assert script_here("table5", *cases, "--jobs", "0", "--out", tmp_path / "whole")[0] == 0
    process = start("table5", *cases, "--jobs", "1", "--out", str(tmp_path / "cut"))
    store = tmp_path / "cut" / "campaign.sqlite"
    for _ in range(600):
        if store.exists() and store.stat().st_size > 30_000:
            break
        time.sleep(0.05)
    process.kill()
    process.communicate()
    assert not (tmp_path / "cut" / "table5.csv").exists()
    status, out, _ = script_here("table5", *cases, "--jobs", "0", "--resume", "--out", tmp_path / "cut")
    assert status == 0 and "found finished" in out
    assert (tmp_path / "cut" / "table5.csv").read_bytes() == (tmp_path / "whole" / "table5.csv").read_bytes()


@pytest.mark.slow
def test_compare_shooting_tells_the_methods_apart(tmp_path: Path, script_here: Here) -> None:
    """Truth: an unstable aircraft cannot be simulated open loop for 20 s; in pieces of half a second it can."""
    arguments = ("--starts", "2", "--no-basin", "--method", "single", "multiple 25", "--jobs", "0")
    status, _, err = script_here("compare_shooting", *arguments, "--out", tmp_path)
    assert (status, err) == (0, "")
    right = {
        (r["aircraft"], r["method"]): int(r["right of random starts"]) for r in rows(tmp_path / "compare_shooting.csv")
    }
    assert right[("destabilised", "single")] == 0
    assert right[("destabilised", "multiple 25")] == right[("stable", "multiple 25")] == 2
    assert (tmp_path / "compare_shooting.html").exists()


@pytest.mark.slow
def test_weighting_ends_at_the_pure_estimators(tmp_path: Path, script_here: Here) -> None:
    arguments = ("--starts", "0", "--manoeuvres", "1", "--jobs", "0", "--out", tmp_path)
    status, out, err = script_here("weighting", *arguments)
    assert (status, err) == (0, "")
    curve = {(r["case"], r["weight"]): r for r in rows(tmp_path / "weighting.csv")}
    assert {w for _, w in curve} >= {"0", "0.5", "1"}
    assert all(float(curve[(case, "0.5")][d]) == 1.0 for case in "BDFH" for d in ("equation domain", "output domain"))
    # linear with noise: output error is the maximum-likelihood end, so it beats the other end in its own domain
    assert float(curve[("B", "0")]["output domain"]) < float(curve[("B", "1")]["output domain"])
    assert "weights by table 4" in out


@pytest.mark.slow
def test_constraints_and_figures_write_their_files(tmp_path: Path, script_here: Here) -> None:
    status, out, _ = script_here("constraints", "--experiment", "static margin", "--out", tmp_path / "c")
    assert status == 0 and "multiplier" in out
    assert {p.name for p in (tmp_path / "c").iterdir()} == {"constraints.html", "constraints.csv", "run.json"}
    status, _, _ = script_here("paper_figures", "--out", tmp_path / "f")
    assert status == 0
    names = {p.name for p in (tmp_path / "f").iterdir()}
    assert names == {*(f"figure_{i}.svg" for i in range(1, 7)), "paper_figures.html", "run.json"}


@pytest.mark.parametrize(
    ("script", "arguments", "words"),
    [
        ("table5", ("--cases", "J"), "expected letters of A to H"),
        ("table5", ("--manoeuvres", "9"), "expected numbers of 1 to 8"),
        ("table5", ("--method", "multi"), "did you mean 'multiple-open'"),
        ("table5", ("--resume",), "nothing to resume"),
        ("table5", ("--jobs", "two"), "table5.py --help"),
        ("table5", ("--jobs", "-3"), "expected a number of processes"),
        ("table5", ("--out", ""), "--out is empty"),
        ("compare_solvers", ("--only", "zzz"), "no problem is called so"),
        ("compare_shooting", ("--method", "multiple 26"), "did you mean 'multiple 25'"),
        ("compare_shooting", ("--starts", "-1"), "0 or more"),
        ("weighting", ("--manoeuvres", "x"), "expected numbers of 1 to 8"),
        ("constraints", ("--experiment", "tie"), "did you mean 'tied'"),
        ("paper_figures", ("--case", "A"), "has no record"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    tmp_path: Path, script_here: Here, script: str, arguments: tuple[str, ...], words: str
) -> None:
    out = () if script == "compare_solvers" or "--out" in arguments else ("--out", tmp_path / "o")
    status, _, err = script_here(script, *arguments, *out)
    assert status == 2 and not (tmp_path / "o").exists()
    assert words in err and err.count("\n") == 1 and err.startswith("error: ")


@pytest.mark.parametrize("script", SCRIPTS)
def test_scripts_say_what_they_do(script: str) -> None:
    """A lab protocol: question, set-up, expectation in the docstring."""
    (path,) = (REPO / folder / f"{script}.py" for folder in FOLDERS if (REPO / folder / f"{script}.py").exists())
    text = path.read_text(encoding="utf-8").split('"""')[1]
    assert all(word in text for word in ("Question ", "Set-up ", "Expectation ", str(path.relative_to(REPO))))
