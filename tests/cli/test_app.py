"""The command `casid` as a user types it. Truth: exit statuses of the shell, the files that were there before."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest

from casid.cli.app import COMMANDS, main
from casid.cli.check import check
from casid.cli.convert import convert
from casid.cli.design import design
from casid.cli.new_aircraft import derivatives_of, inertia_of, new_aircraft
from casid.cli.options import DEMO
from casid.cli.run import call, script, status_of
from casid.cli.simulate import simulate
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.trim import trim
from casid.records.readers import read_record

REPO = Path(__file__).resolve().parents[2]


def casid(*arguments: object, **options) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "casid", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, stdin=subprocess.DEVNULL, **options)


@pytest.fixture
def casid_here(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Callable[..., tuple[int, str, str]]]:
    """`casid_here(*words)` is `casid(*words)` in this process: exit status, standard output, standard error."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def run(*words: object) -> tuple[int, str, str]:
        ended: list[int] = []
        monkeypatch.setattr(sys, "argv", ["casid", *map(str, words)])
        monkeypatch.setattr("casid.cli.app.leave", ended.append)
        main()
        return (ended[0], *capsys.readouterr())

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_keeps_the_patterns_of_its_docstring(casid_here: Callable, name: str) -> None:
    """Asterisks are emphasis to what formats the help: two of them in a paragraph would vanish."""
    patterns = re.findall(r"'[^'\s]*\*[^'\s]*'", resolve_name(COMMANDS[name]).__doc__ or "")
    printed = "".join(casid_here(name, "--help")[1].replace("│", "").split())
    assert [pattern for pattern in patterns if pattern not in printed] == []


def test_help_names_every_command_and_what_it_does(casid_here: Callable) -> None:
    status, printed, _ = casid_here("--help")
    said = " ".join(printed.replace("│", " ").split())
    assert status == 0 and all(name in said for name in COMMANDS)
    for where in COMMANDS.values():
        first = (resolve_name(where).__doc__ or "").split("\n\n")[0]
        assert " ".join(first.split()) in said
    _, alone, _ = casid_here("check", "--help")
    assert "The status is 0 when nothing is wrong" in alone  # all of its docstring, not its first line


def test_the_shell_completes_commands_and_options(
    casid_here: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", "/bin/bash")
    status, _, error = casid_here("--install-completion")
    assert status == 0, error
    (made,) = (tmp_path / ".local").rglob("casid")
    words = made.read_text()
    assert all(name in words for name in (*COMMANDS, "--hold-out"))


@pytest.mark.parametrize("arguments", [("diagnos",), ("estimate", "a.csv"), ("design", "--seed", "x")])
def test_bad_words_are_one_line_and_status_2(casid_here: Callable, arguments: tuple[str, ...]) -> None:
    status, said, error = casid_here(*arguments)
    assert status == 2 and said == ""
    assert error.startswith("error: ") and error.count("\n") == 1


def test_an_aircraft_without_records_is_an_error_and_not_the_demonstration(tmp_path: Path) -> None:
    """As a process: the status is what a shell sees."""
    done = casid("diagnose", "--aircraft", DEMO / "aircraft.toml", "--out", tmp_path / "out")
    assert done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert done.stdout == "" and "needs records" in done.stderr and not (tmp_path / "out").exists()


def test_a_terminated_run_leaves_nothing(tmp_path: Path) -> None:
    """Ctrl-C is another question: it leaves the results so far."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "casid", "demo", "--out", str(out)]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not list(tmp_path.glob(".out-*")) and running.poll() is None:
        time.sleep(0.01)
    running.send_signal(signal.SIGTERM)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 143 and said.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (OSError(28, "No space left on device", "/somewhere/out"), "the disk is full, at /somewhere/out"),
        (MemoryError(), "there is not enough memory"),
    ],
)
def test_a_full_disk_or_memory_is_one_line(fault: Exception, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> None:
        raise fault

    assert status_of(script(work, "work"), []) == 2
    assert capsys.readouterr().err.startswith(f"error: {said}")


def test_convert_writes_si_units(tmp_path: Path) -> None:
    source = tmp_path / "knots.csv"
    t = np.arange(0.0, 10.0, 0.1)
    rows = [f"{a},{b},{c}" for a, b, c in zip(t, 100.0 + np.sin(t), 2.0 * np.sin(t), strict=True)]
    source.write_text("\n".join(["t,V [kt],delta_e [deg]", *rows]))
    assert convert(str(source), str(tmp_path / "si.csv")) == 0
    back = read_record(tmp_path / "si.csv")
    np.testing.assert_allclose(back["V"], (100.0 + np.sin(t)) * 1852.0 / 3600.0, rtol=1e-9)
    np.testing.assert_allclose(back["delta_e"], np.deg2rad(2.0 * np.sin(t)), atol=1e-9)
    with pytest.raises(InputError, match="a source itself"):
        convert(str(tmp_path / "si.csv"), str(tmp_path / "si.csv"))


def test_a_new_aircraft_is_read_back_and_flies(tmp_path: Path) -> None:
    """The lift carries the weight at the given speed: alpha of the trim is small."""
    file = tmp_path / "mine.toml"
    new_aircraft(file, mass=1000.0, span=10.0, chord=1.5, area=15.0, speed=50.0, altitude=1000.0)
    aircraft = Aircraft.read(file)
    assert abs(trim(aircraft, V=50.0, altitude=1000.0).alpha) < np.deg2rad(2.0)
    with pytest.raises(InputError, match="there already"):
        new_aircraft(file, mass=1000.0, span=10.0, chord=1.5, area=15.0, speed=50.0)
    with pytest.raises(InputError, match="--mass, --speed"):
        call(script(new_aircraft), [str(tmp_path / "b.toml"), "--span", "10", "--chord", "1.5", "--area", "15"])
    with pytest.raises(InputError, match="positive"):
        new_aircraft(tmp_path / "c.toml", mass=-1.0, span=10.0, chord=1.5, area=15.0, speed=50.0)


class Terminal(io.StringIO):
    """Lines that somebody types, and Ctrl-D behind them."""

    def isatty(self) -> bool:
        return True


def test_a_new_aircraft_asks_with_units_and_refuses_a_bad_number_where_it_is_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("1000\n-10\nten\n10\n1.5\n15\n50\n"))
    new_aircraft(tmp_path / "mine.toml")
    asked = capsys.readouterr().out
    for unit, times in {"[kg]": 1, "[m]": 4, "[m2]": 1, "[m/s]": 1}.items():  # the span was asked for three times
        assert asked.count(unit) == times
    assert Aircraft.read(tmp_path / "mine.toml").moment_length_lateral == 10.0


def test_a_new_multirotor_asks_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("1.5\nfar\n0.25\n"))
    new_aircraft(tmp_path / "quad.toml", rotors=4)
    assert Aircraft.read(tmp_path / "quad.toml").mass == 1.5


def test_a_new_aircraft_whose_questions_end_early_is_one_line_and_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("1000\n10\n"))
    with pytest.raises(InputError, match="--chord") as error:
        new_aircraft(tmp_path / "mine.toml")
    assert "\n" not in str(error.value) and not list(tmp_path.iterdir())


@pytest.mark.parametrize(("wrong", "named"), [({"speed": 5.0}, "--speed"), ({"chord": 15.0}, "--chord")])
def test_a_new_aircraft_has_a_wing_that_can_be(tmp_path: Path, wrong: dict[str, float], named: str) -> None:
    """A lift coefficient of 43 is beyond any wing; a wing's area is near its span times its mean chord."""
    right = {"mass": 1000.0, "span": 10.0, "chord": 1.5, "area": 15.0, "speed": 50.0}
    with pytest.raises(InputError, match=named):
        new_aircraft(tmp_path / "a.toml", **right | wrong)
    assert not list(tmp_path.iterdir())


def test_typical_values_have_the_limits_of_theory() -> None:
    """An infinite wing has the lift slope 2 pi (thin aerofoil); inertias obey the triangle inequality."""
    assert derivatives_of(0.3, 1e9)["CL_alpha"] == pytest.approx(2.0 * np.pi)
    for length in (2.0, 8.0, 30.0):  # of a flying wing, of a usual one, of an X-3
        Ixx, Iyy, Izz, _ = inertia_of(1000.0, 10.0, length).values()
        assert Ixx + Iyy > Izz > max(Iyy, abs(Ixx - Iyy))  # a rigid body whose wing is flat


def test_a_design_beats_the_standard_within_its_limits(tmp_path: Path) -> None:
    """The designed pulses know more of every derivative in the mean (that is the criterion), and keep the limits."""
    call(
        script(design),
        ["--aircraft", str(DEMO / "aircraft.toml"), "--free", "Cm_*", "--duration", "5", "--out", str(tmp_path)],
    )
    designs = json.loads((tmp_path / "design.json").read_text())["designs"]
    assert designs["pulses4"]["cost"] < designs["3-2-1-1"]["cost"]
    flown = read_record(tmp_path / "pulses4.csv")
    assert np.abs(flown["delta_e"] - flown["delta_e"][0]).max() <= np.deg2rad(3.0) * 1.002
    assert np.abs(flown["alpha"] - flown["alpha"][0]).max() <= np.deg2rad(3.0) * 1.002


def test_a_check_writes_its_page(tmp_path: Path) -> None:
    """Sideslip frozen from the 200th to the 500th of 1301 samples: shown, its row marked; no net is needed."""
    rows = [line.split(",") for line in (DEMO / "m1.csv").read_text().splitlines()]
    column = rows[0].index("beta")
    for row in rows[200:500]:
        row[column] = rows[200][column]
    (tmp_path / "<i>.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
    out = tmp_path / "out"
    assert call(script(check), [str(tmp_path / "<i>.csv"), "--out", str(out)]) == 1
    page = (out / "check.html").read_text()
    assert json.loads((out / "check.json").read_text())["data"][0]["kind"] == "data_stuck"
    assert page.count("<img ") == 1 and '<tr class="marked">' in page and "&lt;i&gt;" in page and "<i>" not in page
    assert not re.search(r"""(?:src|href)\s*=\s*["']?http""", page)


def test_a_manoeuvre_that_separates_two_causes(tmp_path: Path) -> None:
    """The record is read back, moves the elevator within its limit, and what is promised stands in design.json."""
    options = ["--aircraft", str(DEMO / "aircraft.toml"), "--deflection-deg", "2", "--out", str(tmp_path)]
    call(script(design), [*options, "--separate", "actuator_lag(delta_e)=0.12", "input_delay(delta_e)=0.1"])
    told = json.loads((tmp_path / "design.json").read_text())
    assert told["log_odds"] > 10.0 and told["manoeuvre"]["surface"] == "delta_e"
    assert sum(told["told_by"].values()) == pytest.approx(told["log_odds"])
    record = read_record(tmp_path / "next_flight.csv")
    assert np.abs(record["delta_e"] - record["delta_e"][0]).max() <= np.radians(2.0) * 1.001


def test_a_design_needs_a_trim_point(tmp_path: Path) -> None:
    text = (DEMO / "aircraft.toml").read_text().replace("V = 95.038\n", "")
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match="needs V"):
        call(script(design), ["--aircraft", str(tmp_path / "a.toml"), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_check_says_what_is_wrong_by_its_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The record of the example is clean; with its pitch rate reversed it is not, and the channel is named."""
    aircraft = ["--aircraft", str(DEMO / "aircraft.toml")]
    assert call(script(check), [str(DEMO / "m1.csv"), *aircraft]) == 0
    rows = [line.split(",") for line in (DEMO / "m1.csv").read_text().splitlines()]
    column = rows[0].index("q")
    turned = [rows[0], *([*row[:column], f"-{row[column]}".replace("--", ""), *row[column + 1 :]] for row in rows[1:])]
    (tmp_path / "m.csv").write_text("\n".join(",".join(row) for row in turned))
    capsys.readouterr()
    assert call(script(check), [str(tmp_path / "m.csv"), *aircraft, "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["data"]
    assert [(one["kind"], one["target"]) for one in found] == [("data_sign", "q")]


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.3])
def test_ctrl_c_while_it_is_imported(tmp_path: Path, seconds: float) -> None:
    """From the first import of casid on: one line, status 130. What Python does before that is its own."""
    out, begun = tmp_path / "out", tmp_path / "begun"
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n"
        "class Told:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == 'cyclopts': open({str(begun)!r}, 'w').close()\n"
        "sys.meta_path.insert(0, Told())\n"
    )
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{REPO}"}
    command = [sys.executable, "-m", "casid", "demo", "--out", str(out)]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment, cwd=REPO)
    while not begun.exists() and running.poll() is None:
        time.sleep(0.002)
    time.sleep(seconds)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert said.startswith("interrupted; nothing") and said.count("\n") == 1
    assert running.returncode in (130, -signal.SIGINT)  # Python may end by the signal itself: to a shell both are 130
    assert not out.exists()


def test_a_signal_that_a_library_swallows_is_not_a_crash(capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("cannot import name 'x'") from None

    assert status_of(script(work, "work"), []) == 130
    assert capsys.readouterr().err == "interrupted; nothing half-written was left\n"


def test_an_effect_of_another_record_is_said_to_do_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    effect = '\n[[effects]]\nkind = "actuator_lag"\ntarget = "delta_e"\nvalue = 0.1\nrecords = ["zz"]\n'
    (tmp_path / "a.toml").write_text((DEMO / "aircraft.toml").read_text() + effect)
    words = [str(DEMO / "m1.csv"), "--aircraft", str(tmp_path / "a.toml"), "--out", str(tmp_path / "out")]
    assert call(script(simulate), words) == 0
    assert "actuator_lag of the aircraft file is of zz alone: it does nothing here" in capsys.readouterr().err


def test_an_impossible_lag_of_the_file_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    effect = '\n[[effects]]\nkind = "actuator_lag"\ntarget = "delta_e"\nvalue = -1.0\n'
    (tmp_path / "a.toml").write_text((DEMO / "aircraft.toml").read_text() + effect)
    words = [str(DEMO / "m1.csv"), "--aircraft", str(tmp_path / "a.toml")]
    assert call(script(check), words) == 1
    assert "elevator: actuator lag: -1 s in the file, which is impossible" in capsys.readouterr().out
    assert call(script(simulate), [*words, "--out", str(tmp_path / "out")]) == 0
    assert "note: a.toml: elevator: actuator lag: -1 s" in capsys.readouterr().err


def logs(folder: Path) -> Path:
    """Two records of the example and one that is too short, in a folder."""
    folder.mkdir()
    for name in ("m1", "m2"):
        (folder / f"{name}.csv").write_text((DEMO / f"{name}.csv").read_text())
    (folder / "short.csv").write_text("\n".join((DEMO / "m1.csv").read_text().splitlines()[:20]))
    return folder


def test_a_folder_of_logs_is_converted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All that can be read; the parts between two times where they are asked for."""
    words = [str(logs(tmp_path / "logs") / "*"), str(tmp_path / "si"), "--from", "2", "--to", "10"]
    assert call(script(convert), words) == 1
    assert "short.csv: not converted: " in capsys.readouterr().err
    for name in ("m1", "m2"):
        part, whole = read_record(tmp_path / "si" / f"{name}.csv"), read_record(DEMO / f"{name}.csv")
        np.testing.assert_array_equal(part["q"], whole.between(2.0, 10.0)["q"])
    assert sorted(one.name for one in (tmp_path / "si").iterdir()) == ["m1.csv", "m2.csv"]
    with pytest.raises(InputError, match="name a folder as the target"):
        call(script(convert), [str(tmp_path / "logs" / "m*"), str(tmp_path / "one.csv")])
    with pytest.raises(InputError, match="is a source itself"):
        call(script(convert), [str(tmp_path / "logs" / "m1.csv"), str(tmp_path / "logs")])


def test_check_goes_on_after_a_file_that_cannot_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pattern = str(logs(tmp_path / "logs") / "*.csv")
    assert call(script(check), [pattern, "--aircraft", str(DEMO / "aircraft.toml"), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["records"] == ["m1", "m2"] and found["data"] == []
    (file,) = found["unread"]
    assert file.endswith("short.csv") and "too few" in found["unread"][file]
    with pytest.raises(InputError, match="too few"):
        call(script(check), [str(tmp_path / "logs" / "short.csv")])


def test_a_simulation_is_drawn_with_its_inputs(tmp_path: Path) -> None:
    words = [str(DEMO / "m1.csv"), "--aircraft", str(DEMO / "aircraft.toml"), "--out", str(tmp_path / "out")]
    assert call(script(simulate), [*words, "--from", "0", "--to", "8"]) == 0
    record = read_record(DEMO / "m1.csv").between(0.0, 8.0)
    moved = [name for name in ("delta_e", "delta_a", "delta_r", "thrust") if np.ptp(record[name]) > 0.0]
    picture = (tmp_path / "out" / "figures" / "histories_m1.svg").read_text()
    assert moved and all(f"{name}" in picture for name in moved)
    assert len(read_record(tmp_path / "out" / "m1__aircraft.csv")) == len(record)
