"""Every page is written, with every picture, for the smallest and the largest model. Truth: closed-form motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_flight import aircraft_file, records

from casid.model.aircraft import Aircraft
from casid.records.readers import write_record
from casid.records.record import Record
from problems.do328 import V_TRIM

MODELS = """
import casid as cs

SENSORS = [f"sensor_{k}" for k in range(40)]

lag = cs.define_model(
    "lag", states=("y",), inputs=("u",), parameters={"a": 2.0}, outputs=("y",),
    dynamics=lambda s: {"y": s.a * (s.u - s.y)}, output=lambda s: {"y": s.y},
)
decay = cs.define_model(
    "d", states=("y",), inputs=(), parameters={"a": 2.0}, outputs=("y",),
    dynamics=lambda s: {"y": -0.1 * s.a * s.y}, output=lambda s: {"y": s.y},
)
many = cs.define_model(
    "many", states=("x",), inputs=("u",), parameters={"a": 2.0}, outputs=SENSORS,
    dynamics=lambda s: {"x": s.a * (s.u - s.x)},
    output=lambda s: {name: (1.0 + k) * s.x for k, name in enumerate(SENSORS)},
)
"""
PACE, RATE_HZ = 2.0, 40.0  # the parameter a of the models; --quick thins to 25 Hz


def motion(model: str, seed: int, pace: float, bias: float) -> Record:
    """20 s of a model of `MODELS` with its a = `pace`, noise of 0.01 and a constant `bias` on its last output."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 20.0, 1.0 / RATE_HZ)
    u = np.repeat(rng.uniform(-1.0, 1.0, 20), len(t) // 20)
    y, kept = [0.0], np.exp(-pace / RATE_HZ)
    for before, after in zip(u, u[1:], strict=False):
        y.append(kept * y[-1] + (1.0 - kept) * 0.5 * (before + after))
    clean = {
        "lag": lambda: {"y": np.array(y)},
        "decay": lambda: {"y": 3.0 * np.exp(-0.1 * pace * t)},
        "many": lambda: {f"sensor_{k}": (1.0 + k) * np.array(y) for k in range(40)},
    }[model]()
    measured = {name: values + rng.normal(scale=0.01, size=len(t)) for name, values in clean.items()}
    last = list(measured)[-1]
    measured[last] = measured[last] + bias
    return Record(name=f"r{seed}", t=t, channels=measured | ({} if model == "decay" else {"u": u}))


@pytest.fixture
def whole_page(script_here: Callable, tmp_path: Path) -> Callable[..., str]:
    """`whole_page(command, page, *arguments)` runs a command, requires its page with all pictures, and returns it."""

    def page_of(command: str, page: str, *arguments: object, statuses: Sequence[int] = (0,)) -> str:
        out = tmp_path / "out"
        status, _, error = script_here(command, *arguments, "--out", out)
        assert status in statuses, error
        text = (out / page).read_text(encoding="utf-8")
        assert "could not be drawn" not in text + error
        assert "not drawn yet" not in text
        return text

    return page_of


@pytest.mark.parametrize("options", [(), ("--quick",)], ids=["whole", "quick"])
@pytest.mark.parametrize("bias", [0.0, 0.5], ids=["exact", "bias"])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("model", ["lag", "decay", pytest.param("many", marks=pytest.mark.slow)])
def test_a_model_of_any_size(
    whole_page: Callable, tmp_path: Path, model: str, count: int, bias: float, options: tuple[str, ...]
) -> None:
    (tmp_path / "models.py").write_text(MODELS)
    for seed in range(count):
        write_record(motion(model, seed, PACE, bias), tmp_path / f"r{seed}.csv")
    files = [tmp_path / f"r{seed}.csv" for seed in range(count)]
    whole_page("diagnose", "report.html", *files, "--model", f"{tmp_path / 'models.py'}:{model}", *options)


@pytest.mark.parametrize("pace", [PACE, 0.7 * PACE], ids=["exact", "value"])
def test_forty_outputs_of_one_record(whole_page: Callable, tmp_path: Path, pace: float) -> None:
    (tmp_path / "models.py").write_text(MODELS)
    write_record(motion("many", 0, pace, 0.0), tmp_path / "r0.csv")
    where = f"{tmp_path / 'models.py'}:many"
    page = whole_page("diagnose", "report.html", tmp_path / "r0.csv", "--model", where, "--quick")
    assert all(f"sensor_{k}" in page for k in range(40))


def of_elevator(folder: Path, *measured: str) -> tuple[Path, Path]:
    """An aircraft file, and one record of it with the elevator, density and `measured` alone."""
    record = records()[0]
    kept = {"delta_e", "rho", *measured}
    write_record(record.without(*(name for name in record.channels if name not in kept)), folder / "r.csv")
    aircraft_file().write(folder / "a.toml")
    return folder / "a.toml", folder / "r.csv"


def at_trim() -> Aircraft:
    """The aircraft file with the level flight of its records."""
    return replace(aircraft_file(), trim={"V": V_TRIM, "altitude": 3000.0})


@pytest.mark.parametrize("options", [(), ("--axes", "longitudinal", "--quick")], ids=["whole", "quick"])
def test_the_smallest_flight(whole_page: Callable, tmp_path: Path, options: tuple[str, ...]) -> None:
    aircraft, record = of_elevator(tmp_path, "alpha", "q")
    whole_page("diagnose", "report.html", record, "--aircraft", aircraft, *options)


def test_one_measured_output_of_a_flight_is_refused_in_a_line(script_here: Callable, tmp_path: Path) -> None:
    aircraft, record = of_elevator(tmp_path, "q")
    status, _, error = script_here("diagnose", record, "--aircraft", aircraft, "--quick", "--out", tmp_path / "out")
    assert status == 2 and "at least two" in error and "Traceback" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("command", "measured", "words"),
    [
        ("simulate", (), ("--aircraft", "a.toml")),
        ("estimate", (), ("--aircraft", "a.toml", "--free", "Cm_alpha")),
        ("check", (), ()),
        ("compatibility", ("V", "ax", "az"), ()),
        ("response", (), ("--input", "delta_e", "--output", "q")),
        ("segments", (), ()),
    ],
)
def test_other_commands_with_the_smallest_flight(
    whole_page: Callable, tmp_path: Path, command: str, measured: tuple[str, ...], words: tuple[str, ...]
) -> None:
    aircraft, record = of_elevator(tmp_path, "alpha", "q", *measured)
    arguments = [aircraft if word == "a.toml" else word for word in words]
    whole_page(command, f"{command}.html", record, *arguments, statuses=(0, 1))  # 1: the page says what it found


@pytest.fixture
def largest(tmp_path: Path) -> tuple[Path, Path]:
    """An aircraft file, and a record of it with every channel of an aircraft."""
    record, aircraft = records()[0], aircraft_file()
    t, zero = record.t, np.zeros(len(record.t))
    measured = {f"{rate}dot": np.gradient(record[rate], t) for rate in "pqr"}
    further = {"altitude": zero + 3000.0, "psi": np.cumsum(record["r"]) / 25.0, "fx": zero, "fy": zero, "fz": zero}
    write_record(
        record.with_channels(**measured, **{k: v for k, v in further.items() if k not in record}), tmp_path / "r.csv"
    )
    aircraft.write(tmp_path / "a.toml")
    return tmp_path / "a.toml", tmp_path / "r.csv"


@pytest.mark.parametrize("size", ["smallest", "largest"])
@pytest.mark.parametrize(
    ("command", "page", "words"),
    [
        ("modes", "modes", ("a.toml",)),
        ("match", "match", ("r.csv", "--aircraft", "a.toml")),
        (
            "isolate",
            "isolability",
            ("--aircraft", "a.toml", "--manoeuvre", "r.csv", "--only-this", "--causes", "sensor_bias*"),
        ),
        ("design", "design", ("--aircraft", "a.toml", "--duration", "4", "--free", "Cm_alpha")),
        ("simulate", "simulate", ("r.csv", "--aircraft", "a.toml")),
        ("response", "response", ("r.csv", "--input", "delta_e", "--output", "q")),
        ("estimate", "estimate", ("r.csv", "--aircraft", "a.toml", "--free", "Cm_alpha")),
    ],
)
def test_pages_that_need_an_aircraft(
    whole_page: Callable,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    command: str,
    page: str,
    words: tuple[str, ...],
    size: str,
) -> None:
    """Truth: two measured channels of one plane, and every channel there is; neither loses a picture."""
    aircraft, record = (
        of_elevator(tmp_path, "alpha", "q", "V") if size == "smallest" else request.getfixturevalue("largest")
    )
    if command in ("isolate", "design", "modes"):  # they fly the level flight of the file
        at_trim().write(aircraft)
    files = {"a.toml": aircraft, "r.csv": record}
    whole_page(command, f"{page}.html", *(files.get(word, word) for word in words), statuses=(0, 1))


@pytest.mark.slow
def test_diagnosis_of_the_largest_flight(whole_page: Callable, largest: tuple[Path, Path]) -> None:
    aircraft, record = largest
    whole_page("diagnose", "report.html", record, "--aircraft", aircraft, "--quick")
