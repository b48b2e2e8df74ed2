"""Byte mutants of every format that is read: a value, or one line, within seconds, and nothing beside.

Truth: the contract of errors. `tests/corpus` keeps what once broke it, and `CASID_MUTANTS=100000` draws that many.
"""

from __future__ import annotations

import os
import random
import shutil
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from records.test_ardupilot_text import dataflash_text, telemetry
from records.test_drone_logs import blackbox, crazyflie, ros_bag
from records.test_formats import flown_log, old_px4
from records.test_igc import flight_recorder
from records.test_ros_bags import bag
from scipy.io import savemat

import casid as cs
from casid.cli.options import DEMO
from casid.records import limits

CORPUS = Path(__file__).resolve().parent.parent / "corpus"
MANY = int(os.environ.get("CASID_MUTANTS", "20000"))
SHARES = {"csv": 26, "txt": 9, "toml": 22, "xml": 13, "mat": 6, "npz": 5, "h5": 4, "parquet": 3, "xlsx": 1, "ulg": 1}
SHARES |= {"bin": 1, "bbl": 2, "usd": 5, "mcap": 2, "tlog": 1, "log": 2, "igc": 3, "bag": 1, "db3": 1}
LOGS = {"ulg": ("pyulog", old_px4), "bin": ("pymavlink", flown_log), "bbl": ("orangebox", blackbox)}
LOGS |= {"usd": ("casid", lambda: crazyflie(2)), "mcap": ("mcap", ros_bag), "tlog": ("pymavlink", telemetry)}
LOGS |= {"log": ("pymavlink", dataflash_text), "igc": ("casid", lambda: flight_recorder().encode("ascii"))}
LOGS |= {"bag": ("rosbags", lambda: bag_bytes(".bag")), "db3": ("rosbags", lambda: bag_bytes(".db3"))}
T = np.arange(0.0, 4.0, 0.06)
SMALL = {"t": T, "delta_e": 0.02 * np.sin(T), "q": 0.01 * np.cos(T), "V": 50.0 + 0.0 * T}
SPLICES = (
    b"\x00",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\n",
    b"\r",
    b"\x00\n",
    b",",
    b"1e999",
    b"nan",
    b"-1",
    b"&x;",
)
SPLICES += (
    b"[[",
    b"'''",
    b"<a>",
    b"</",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"99999999999999999999",
    b"\x1f\x8b",
    b"PK\x03\x04",
)


def bag_bytes(ending: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return bag(Path(folder), ending).read_bytes()


def sound(ending: str, folder: Path) -> bytes:
    """A small file of the format without fault."""
    path, rows = folder / f"sound.{ending}", np.stack(list(SMALL.values()), axis=1)
    if ending in ("csv", "txt"):
        mark = "," if ending == "csv" else " "
        np.savetxt(path, rows, delimiter=mark, header=mark.join(SMALL), comments="", fmt="%.6g")
    elif ending == "toml":
        text = (DEMO / "aircraft.toml").read_text(encoding="utf-8")
        path.write_text(
            text + '[[effects]]\nkind = "actuator_lag"\ntarget = "delta_e"\nvalue = 0.1\n', encoding="utf-8"
        )
    elif ending == "xml":
        cs.export(DEMO / "aircraft.toml", path, to="jsbsim")
    elif ending == "mat":
        savemat(path, SMALL, do_compression=False)
    elif ending == "npz":
        np.savez(path, **SMALL)
    elif ending == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file.update(SMALL)
    elif ending == "parquet":
        arrow = pytest.importorskip("pyarrow")
        pytest.importorskip("pyarrow.parquet").write_table(arrow.table(SMALL), path)
    elif ending == "xlsx":
        book = pytest.importorskip("openpyxl").Workbook()
        for row in (list(SMALL), *rows.tolist()):
            book.active.append(row)
        book.save(path)
    else:
        library, written = LOGS[ending]
        pytest.importorskip(library)
        return written()
    return path.read_bytes()


def mutant(content: bytes, rng: random.Random) -> bytes:
    made = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(made) + 1)
        length = rng.choice((1, 1, 2, 4, 8, 64, 512))
        fault = rng.randrange(6)
        if fault == 0 and at < len(made):
            made[at] ^= 1 << rng.randrange(8)
        elif fault == 1:
            made[at : at + length] = rng.randbytes(length)
        elif fault == 2:
            del made[at : at + length]
        elif fault == 3:
            splice = rng.choice(SPLICES)
            made[at : at + rng.choice((0, len(splice)))] = splice
        elif fault == 4:
            made[at:at] = made[at : at + length] * rng.choice((1, 2, 50))
        else:
            del made[at + length :]
    return bytes(made)


def read(path: Path) -> str:
    """What became of a file: "read" or "refused"."""
    try:
        cs.Aircraft.read(path) if path.suffix in (".toml", ".xml") else cs.read_record(path)
    except cs.CasidError as error:
        assert str(error).isprintable() and len(str(error)) <= 2100
        return "refused"
    return "read"


def tried(folder: Path, count: int, seed: int) -> Counter[str]:
    rng, found = random.Random(seed), Counter[str]()
    for ending, share in SHARES.items():
        content, path = sound(ending, folder), folder / f"m.{ending}"
        path.write_bytes(content)
        assert read(path) == "read", ending
        for number in range(max(1, count * share // 100)):
            path.write_bytes(mutant(content, rng))
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    found[f"{ending} {read(path)}"] += 1
            except Exception as error:
                kept = Path(os.environ.get("CASID_CORPUS", folder)) / f"{seed}-{number}.{ending}"
                shutil.copy(path, kept)
                pytest.fail(f"{kept}: {type(error).__name__}: {error}")
            assert {p.name for p in folder.iterdir()} <= {path.name, f"sound.{ending}"}
        for left in folder.iterdir():
            left.unlink()
    return found


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "_SECONDS", 3.0)


def test_a_mutant_is_read_or_refused(tmp_path: Path) -> None:
    found = tried(tmp_path, 500, 1)
    assert found["csv read"] and found["csv refused"] and found["toml read"] and found["xml refused"], found


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 2 + MANY // 2000))
def test_many_mutants_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    tried(tmp_path, 2000, seed)


@pytest.mark.parametrize("path", sorted(CORPUS.iterdir()), ids=lambda path: path.name)
def test_what_once_broke_a_reader_is_read_or_refused(path: Path) -> None:
    read(path)
