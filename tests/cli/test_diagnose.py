"""`casid diagnose` as a user runs it. Truth: the published interface; what each broken input has wrong with it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_flight import NAMES, aircraft_file, records

from casid.cli.diagnose import diagnose
from casid.cli.run import script, status_of
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.given.scope import split
from casid.model.aircraft import Aircraft
from casid.records.readers import read_record, write_record
from casid.records.record import Record
from casid.records.thinning import thinned


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the records first.csv and second.csv, and aircraft.toml."""
    folder = tmp_path_factory.mktemp("flight")
    for record in records():
        write_record(record, folder / f"{record.name}.csv")
    aircraft_file().write(folder / "aircraft.toml")
    return folder


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """`run(*arguments)` runs the script in this process: (exit status, standard error)."""

    def start(*arguments: object, instead: Callable | None = None) -> tuple[int, str]:
        if instead is not None:
            monkeypatch.setattr("casid.diagnosis.diagnose.diagnose", instead)
        status = status_of(script(diagnose, "diagnose.py"), [str(argument) for argument in arguments])
        return status, capsys.readouterr().err

    return start


class Seen:
    """Stands for `diagnose`: keeps what it was given, and stops as Ctrl-C does."""

    aircraft: Aircraft
    fitted: list[str]
    held: list[str]
    samples: int
    criteria: Criteria
    axes: str | None
    choices: tuple[str, bool]

    def __call__(
        self,
        aircraft: Aircraft,
        given: Sequence[Record],
        hold_out: Sequence[Record],
        report: Callable,
        criteria: Criteria,
        **choices: Any,
    ) -> None:
        self.aircraft, self.samples, self.criteria = aircraft, len(given[0]), criteria
        self.axes, self.as_recorded = choices["axes"], choices["as_recorded"]
        fitted, held = split(given, hold_out, criteria.parts)
        self.fitted, self.held = [r.name for r in fitted], [r.name for r in held]
        raise KeyboardInterrupt


# -- a whole run -------------------------------------------------------------------------------------------------------


def test_whole_run(script_here: Callable, flight: Path, tmp_path: Path) -> None:
    files = [flight / f"{name}.csv" for name in NAMES]
    words = ("--aircraft", flight / "aircraft.toml", "--out", tmp_path / "out")
    status, said, error = script_here("diagnose", *files, *words)
    assert (status, error) == (0, "")
    written = {path.name for path in (tmp_path / "out").iterdir()}
    proposed = {name for name in written if name.startswith("next_flight")}  # where something stayed ambiguous
    assert written - proposed == {"diagnosis.json", "extended.toml", "report.html", "report_figures", "run.json"}
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert said.count(f"{document['verdict']}: ") == 1 and str(tmp_path / "out" / "report.html") in said
    assert all(f" s  {stage}" in said for stage in document["seconds"])
    assert document["next"] and all(one["text"] in said and one["command"] in said for one in document["next"])
    asked = [words for one in document["next"] if (words := shlex.split(one["command"]))]
    again = next(words for words in asked if words[1] == "simulate")
    assert script_here(*again[1:])[0] == 0
    made_with = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert "seed" not in made_with and {"casid", "casadi", "numpy"} <= set(made_with["versions"])


# -- which records are fitted, which are held out ----------------------------------------------------------------------


def test_without_records_the_embedded_example_runs(run: Callable, tmp_path: Path) -> None:
    seen = Seen()
    status, _ = run("--out", tmp_path, instead=seen)
    assert status == 130 and seen.aircraft.name == "Fokker 50, cruise"
    assert seen.fitted == ["m1", "m2", "m3"] and seen.held == ["m4"]


def test_the_last_record_is_held_out(run: Callable, flight: Path, tmp_path: Path) -> None:
    seen = Seen()
    run(flight / "*.csv", "--aircraft", flight / "aircraft.toml", "--out", tmp_path, instead=seen)
    assert (seen.fitted, seen.held) == (["first"], ["second"])


def test_of_a_single_record_its_last_third_is_held_out(run: Callable, flight: Path, tmp_path: Path) -> None:
    seen = Seen()
    run(flight / "first.csv", "--aircraft", flight / "aircraft.toml", "--out", tmp_path, instead=seen)
    assert seen.fitted == ["first"] and seen.held == ["first, last third"]


def test_choices_are_passed_on(run: Callable, flight: Path, tmp_path: Path) -> None:
    seen = Seen()
    words = [flight / "*.csv", "--aircraft", flight / "aircraft.toml", "--out", tmp_path]
    run(*words, "--axes", "lateral", instead=seen)
    assert seen.axes == "lateral" and not seen.as_recorded
    run(*words, "--as-recorded", instead=seen)
    assert seen.as_recorded


def test_what_the_reader_remarks_is_said_once(run: Callable, flight: Path, tmp_path: Path) -> None:
    """On standard error, whatever the command: az in g, which reads as 1 m/s2."""
    rows = [line.split(",") for line in (flight / "first.csv").read_text().splitlines()]
    column = rows[0].index("az")
    in_g = [rows[0], *([*row[:column], repr(float(row[column]) / 9.80665), *row[column + 1 :]] for row in rows[1:])]
    (tmp_path / "m.csv").write_text("\n".join(",".join(row) for row in in_g))
    words = [tmp_path / "m.csv", flight / "second.csv", "--aircraft", flight / "aircraft.toml", "--out", tmp_path / "o"]
    _, said = run(*words, instead=Seen())
    assert said.count("note: m: az: about") == 1 and "write the header as 'az [g]'" in said


def test_what_is_held_out_is_not_fitted(run: Callable, flight: Path, tmp_path: Path) -> None:
    seen = Seen()
    options = ("--aircraft", flight / "aircraft.toml", "--out", tmp_path, "--hold-out", flight / "first.csv")
    run(flight / "*.csv", *options, instead=seen)
    assert (seen.fitted, seen.held) == (["second"], ["first"])


def test_columns_can_be_mapped(run: Callable, flight: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.csv"
    foreign.write_text((flight / "first.csv").read_text(encoding="utf-8").replace("alpha", "ALCG", 1), encoding="utf-8")
    seen = Seen()
    run(foreign, "--aircraft", flight / "aircraft.toml", "--map", "alpha=ALCG", "--out", tmp_path / "out", instead=seen)
    assert seen.fitted == ["foreign"]


def test_quick_thins_the_records(run: Callable, tmp_path: Path) -> None:
    full, quick = Seen(), Seen()
    run("--out", tmp_path, instead=full)
    run("--out", tmp_path, "--quick", instead=quick)
    assert quick.samples == (full.samples + 1) // 2  # 50 Hz to 25 Hz


def test_criteria_come_from_a_file(run: Callable, tmp_path: Path) -> None:
    file, seen = tmp_path / "my.toml", Seen()
    file.write_text("[parts]\nthird = 0.5\n", encoding="utf-8")
    run("--out", tmp_path / "out", "--criteria", file, instead=seen)
    assert seen.criteria == Criteria().with_values({"parts": {"third": 0.5}})
    file.write_text("[part]\nthird = 0.5\n", encoding="utf-8")
    status, error = run("--out", tmp_path / "out", "--criteria", file)
    assert status == 2 and "did you mean 'parts.third'" in error and error.count("\n") == 1


def test_thinning_keeps_every_nth_sample() -> None:
    record = records()[0]  # 25 Hz
    assert len(thinned(record, 25.0)) == len(record)
    third = thinned(record, 8.0)
    assert np.array_equal(third.t, record.t[::3]) and np.array_equal(third["alpha"], record["alpha"][::3])


# -- nothing half-written ----------------------------------------------------------------------------------------------


def test_ctrl_c_leaves_nothing_behind(run: Callable, flight: Path, tmp_path: Path) -> None:
    status, _ = run(flight / "*.csv", "--aircraft", flight / "aircraft.toml", "--out", tmp_path / "new", instead=Seen())
    assert status == 130 and not (tmp_path / "new").exists()


# -- bad input: status 2 and one line ----------------------------------------------------------------------------------


def broken(flight: Path, tmp_path: Path, change: Callable[[list[list[str]]], None]) -> Path:
    """A copy of first.csv whose rows were changed."""
    rows = [line.split(",") for line in (flight / "first.csv").read_text(encoding="utf-8").splitlines()]
    change(rows)
    file = tmp_path / "broken.csv"
    file.write_text("\n".join(",".join(row) for row in rows), encoding="utf-8")
    return file


def misspell(rows: list[list[str]]) -> None:
    rows[0][rows[0].index("alpha")] = "alhpa"


def gap_in_an_input(rows: list[list[str]]) -> None:
    rows[40][rows[0].index("delta_e")] = "nan"


def time_back(rows: list[list[str]]) -> None:
    rows[60][0] = rows[50][0]


def cut_short(rows: list[list[str]]) -> None:
    del rows[30:]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (misspell, ("alhpa", "alpha")),
        (gap_in_an_input, ("line 41", "delta_e", "missing")),
        (time_back, ("line 61", "time runs back")),
        (cut_short, ("too few",)),
    ],
)
def test_bad_record(run: Callable, flight: Path, tmp_path: Path, change: Callable, words: tuple[str, ...]) -> None:
    file = broken(flight, tmp_path, change)
    status, error = run(file, "--aircraft", flight / "aircraft.toml", "--out", tmp_path / "out")
    assert status == 2 and error.count("\n") == 1
    assert all(word in error for word in ("broken.csv", *words)), error
    assert not (tmp_path / "out").exists()


def test_unknown_aircraft_key(run: Callable, flight: Path, tmp_path: Path) -> None:
    wrong = tmp_path / "aircraft.toml"
    wrong.write_text((flight / "aircraft.toml").read_text(encoding="utf-8").replace("mass =", "maas ="))
    status, error = run(flight / "*.csv", "--aircraft", wrong, "--out", tmp_path / "out")
    assert status == 2 and error.count("\n") == 1 and "maas" in error and "'mass'" in error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("{flight}/first.csv",), "--aircraft"),
        (("{flight}/none.csv", "--aircraft", "{flight}/aircraft.toml"), "none.csv"),
        (("{flight}/first.csv", "--aircraft", "{flight}/none.toml"), "none.toml"),
        (("--hold-out", "{flight}/first.csv"), "--hold-out"),
        (("--speed",), "--speed"),
        (("{flight}/first.csv", "--aircraft", "{flight}/aircraft.toml", "--out", "{flight}/first.csv"), "--out"),
        (("{flight}/first.csv", "--aircraft", "{flight}/aircraft.toml", "--map", "alpha"), "alpha"),
        (
            ("{flight}/first.csv", "--aircraft", "{flight}/aircraft.toml", "--hold-out", "{flight}/first.csv"),
            "every record is held out",
        ),
    ],
)
def test_bad_arguments(run: Callable, flight: Path, arguments: tuple[str, ...], words: str) -> None:
    status, error = run(*(argument.format(flight=flight) for argument in arguments))
    assert status == 2 and error.count("\n") == 1 and words in error, error


def test_records_written_for_these_tests_are_read_back(flight: Path) -> None:
    for record in records():
        again = read_record(flight / f"{record.name}.csv")
        assert all(np.array_equal(again[c], record[c]) for c in record.channels)
