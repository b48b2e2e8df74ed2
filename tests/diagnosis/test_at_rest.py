"""Records in which no aircraft flies. Truth: what was written into them, constants and white noise; and flights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.cli.estimate import estimate
from casid.cli.new_multirotor import multirotor_text
from casid.cli.options import DEMO
from casid.cli.run import call, script
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.records.given import unflown
from casid.records.record import Record
from casid.signals import SURFACES

MOVED = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az", "pdot", "qdot", "rdot")


def standing(noise: float, seed: int = 1) -> Record:
    """The first record of the example whose readings are their first ones, with white noise; the surfaces move on."""
    record, rng = cs.read_record(DEMO / "m1.csv"), np.random.default_rng(seed)
    still = {n: record[n][0] + noise * rng.standard_normal(len(record)) for n in MOVED if n in record}
    return record.with_channels(**still)


def diagnosed(record: Record, said: list[str]) -> None:
    cs.diagnose(DEMO / "aircraft.toml", [record, cs.read_record(DEMO / "m2.csv")], report=said.append)


def compatible(record: Record, said: list[str]) -> None:
    cs.compatibility([cs.read_record(DEMO / "m2.csv"), record])


@pytest.mark.parametrize("ask", [diagnosed, compatible])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 0.1])
def test_a_record_in_which_nothing_moves_ends_before_anything_is_fitted(
    ask: Callable[[Record, list[str]], None], noise: float
) -> None:
    said: list[str] = []
    with pytest.raises(InputError, match=r"record 'm1': nothing moves, .* leave the record out"):
        ask(standing(noise), said)
    assert said == []
    with pytest.raises(InputError, match="'m1': the aircraft stays on the ground"):
        ask(replace(cs.read_record(DEMO / "m1.csv"), grounded=True), said)
    assert said == []


def test_an_estimate_ends_with_one_line_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cs.write_record(standing(1e-3), tmp_path / "m1.csv")
    words = [str(tmp_path / "m1.csv"), "--aircraft", str(DEMO / "aircraft.toml"), "--out", str(tmp_path / "out")]
    with pytest.raises(InputError, match="estimate: record 'm1': nothing moves"):
        call(script(estimate), words)
    assert not (tmp_path / "out").exists() and capsys.readouterr().out == ""


def test_the_check_of_the_data_says_the_same() -> None:
    (found,) = [one for one in cs.check(standing(1e-3)).reported if one.target == "V"]
    assert found.records == ("m1",) and "nothing moves" in found.sentence


@pytest.mark.parametrize("seed", range(20))
def test_white_noise_of_any_channels_is_no_flight(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kept = rng.choice(MOVED[3:12], int(rng.integers(1, 9)), replace=False)
    record = standing(float(rng.uniform(0.0, 1.0)), seed)
    bare = record.without(*(n for n in record.channels if n not in (*kept, *SURFACES)))
    assert "nothing moves" in unflown(bare)


@pytest.mark.parametrize("name", ["m1", "m2", "m3", "m4"])
def test_a_flight_in_much_noise_is_one(name: str) -> None:
    """One channel that moves is enough, and noise as large as the motion of each hides no flight."""
    record, rng = cs.read_record(DEMO / f"{name}.csv"), np.random.default_rng(2)
    inertial = {n: record[n] for n in ("p", "q", "r", "ax", "ay", "az")}
    noisy = {n: x + np.std(x) * rng.standard_normal(len(x)) for n, x in inertial.items()}
    assert not unflown(record) and not unflown(record.with_channels(**noisy))
    still = {n: np.full(len(record), x[0]) for n, x in inertial.items() if n != "q"}
    assert not unflown(record.with_channels(**still))


@pytest.mark.parametrize("count", [14, 20, 60])
def test_few_readings_of_a_motion_are_a_flight(count: int) -> None:
    t = np.linspace(0.0, 4.0, count)
    channels = {name: rate * np.sin(2.0 * np.pi * t / 4.0) for name, rate in (("q", 0.2), ("delta_e", 0.05))}
    assert not unflown(Record(name="short", t=t, channels=channels))


def test_a_multirotor_with_a_pitot_that_reads_nothing_is_not_on_the_ground(tmp_path: Path) -> None:
    t = 0.02 * np.arange(300)
    rows = np.stack([t, 0.0 * t, 0.5 + 0.1 * np.sin(t), np.sin(t)], axis=1)
    for driver, grounded in (("m1", False), ("delta_e", True)):
        np.savetxt(tmp_path / "m.csv", rows, delimiter=",", header=f"t,V,{driver},q", comments="")
        assert cs.read_record(tmp_path / "m.csv").grounded is grounded


def test_a_multirotor_on_the_ground_is_not_diagnosed(tmp_path: Path) -> None:
    (tmp_path / "quad.toml").write_text(multirotor_text("quad", 4, 1.0, 0.2), encoding="utf-8")
    t, rng = 0.01 * np.arange(800), np.random.default_rng(3)
    idle = {f"m{i}": np.full(len(t), 0.1) for i in (1, 2, 3, 4)}
    still = {n: 0.01 * rng.standard_normal(len(t)) for n in ("p", "q", "r", "ax", "ay")}
    record = Record(name="pad", t=t, channels={**idle, **still, "az": -9.81 + still["ax"]})
    with pytest.raises(InputError, match="record 'pad': nothing moves"):
        cs.diagnose(Aircraft.read(tmp_path / "quad.toml"), [record])
