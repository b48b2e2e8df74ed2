"""Files that are none, and damaged ones: one line of InputError, soon. The truth is the contract of bad input."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import casid as cs
from casid.acceptance.justification import findings_of
from casid.cli.options import DEMO
from casid.cli.run import script, status_of
from casid.cli.why import why
from casid.diagnosis.criteria import Criteria
from casid.errors import InputError
from casid.keeping import plain
from casid.records.column_map import ColumnMap

READERS: dict[str, Callable[[Path], object]] = {
    "aircraft": cs.Aircraft.read,
    "compare": lambda path: cs.compare_diagnoses(path, path),
    "criteria": Criteria.read,
    "daveml": lambda path: cs.Aircraft.from_daveml(path, path),
    "envelope": cs.MismatchEnvelope.read,
    "fmu": cs.fmu_model,
    "jsbsim": cs.Aircraft.from_jsbsim,
    "load": cs.load,
    "map": ColumnMap.read,
    "petab": cs.read_petab,
    "record": cs.read_record,
    "records": cs.read_records,
    "standard": cs.Standard.read,
}
DEEP = {
    "toml": "a = " + "[" * 100_000 + "]" * 100_000,
    "json": '{"a": ' + "[" * 100_000 + "]" * 100_000 + "}",
    "yaml": "a: " + "[" * 5_000 + "]" * 5_000,
}


def no_file(kind: str, folder: Path) -> Path:
    """A path of a kind that cannot be read as a file."""
    path = folder / "file.toml"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "circle":
        path.symlink_to(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "name":
        path = folder / ("n" * 5000 + ".toml")
    else:
        path.write_text(DEEP[kind])
    return path


@pytest.fixture
def soon() -> Iterator[None]:
    """A test that waits for a file fails."""

    def late(number: int, frame: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no such files")
@pytest.mark.parametrize("kind", ["fifo", "device", "circle", "folder", "name", *DEEP])
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_one_line(reader: str, kind: str, tmp_path: Path, soon: None) -> None:
    with pytest.raises(InputError) as fault:
        READERS[reader](no_file(kind, tmp_path))
    assert "\n" not in str(fault.value)
    assert len(str(fault.value)) < 1000


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no such files")
@pytest.mark.parametrize("kind", ["fifo", "device", "circle", "name", *DEEP])
def test_why_of_what_is_no_file_is_one_line(
    kind: str, tmp_path: Path, soon: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(script(why), [str(no_file(kind, tmp_path))]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@cache
def document() -> dict[str, Any]:
    """What a diagnosis of a lag with a biased reading writes."""
    model = cs.define_model(
        "lag",
        states=["x"],
        inputs=["u"],
        parameters={"T": 0.5},
        outputs=["x"],
        dynamics=lambda s: {"x": (s.u - s.x) / s.T},
        output=lambda s: {"x": s.x},
        prior_std={"T": 0.05},
    )
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 20.0, 0.05)
    records = []
    for k in range(2):
        record = cs.Record(name=f"r{k}", t=t, channels={"u": np.repeat(rng.normal(size=20), 20)})
        read = cs.simulate(model, record, [0.0]).output("x") + 0.2 + rng.normal(0.0, 0.01, len(t))
        records.append(record.with_channels(x=read).renamed(f"r{k}"))
    found = plain(cs.diagnose(model, records).to_dict())
    assert found["causes"]
    return found


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a document: keys and positions, from the outside in."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inside:
        yield (*at, key)
        yield from places(part, (*at, key))


def changed(data: st.DataObject, told: dict[str, Any]) -> None:
    """Take something out of a document, or put something of another type in its place."""
    wanted = ("decisions", "claims", "causes", "gain", "data", "notes", "schema")
    at = data.draw(st.sampled_from([place for place in places(told) if place[0] in wanted]))
    holder: Any = told
    for key in at[:-1]:
        holder = holder[key]
    other = data.draw(st.sampled_from(["drop", None, True, 3, -1e300, "text", [], ["a"], {}, {"a": 1}, [[1]]]))
    if other == "drop":
        del holder[at[-1]]
    else:
        holder[at[-1]] = other


@settings(max_examples=150, deadline=None)
@given(data=st.data(), cut=st.none() | st.floats(0.0, 0.999))
def test_a_damaged_diagnosis_is_read_or_one_line(
    data: st.DataObject, cut: float | None, tmp_path_factory: pytest.TempPathFactory
) -> None:
    told = json.loads(json.dumps(document()))
    for _ in range(data.draw(st.integers(1, 3))):
        changed(data, told)
    text = json.dumps(told)
    folder = tmp_path_factory.mktemp("diagnosis")
    (folder / "diagnosis.json").write_text(text if cut is None else text[: int(cut * len(text))])
    (folder / "extended.toml").write_bytes((DEMO / "aircraft.toml").read_bytes())
    for words in ([], ["sensor_bias"], ["--json"]):
        assert status_of(script(why), [str(folder), *words]) in (0, 2)
    with suppress(InputError):
        found = findings_of(folder)
        assert all(isinstance(text, str) for both in found.sentences.items() for text in both)
        assert all(isinstance(name, str) for name in (*found.fitted, *found.held_out, *found.ratios))
        assert all(isinstance(ratio, float) for ratio in found.ratios.values())
