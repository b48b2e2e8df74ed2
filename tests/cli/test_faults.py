"""A diagnosis without memory somewhere. Truth: what lay in its folder before, and the results of a whole run."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_flight import aircraft_file, records

import casid as cs
from casid.cli.diagnose import diagnose
from casid.cli.run import script, status_of

MAKERS = ("empty", "zeros", "ones", "full", "stack", "concatenate", "column_stack", "tile", "einsum", "zeros_like")
SAMPLED = int(os.environ.get("CASID_FAULTS", "40"))
COUNT = {"made": 0, "last": -1}


def counted(maker: Callable[..., Any]) -> Callable[..., Any]:
    """An array maker whose call that is armed has no memory."""

    def made(*arguments: Any, **options: Any) -> Any:
        COUNT["made"] += 1
        if COUNT["made"] == COUNT["last"]:
            raise MemoryError
        return maker(*arguments, **options)

    return made


def run(place: Path, last: int) -> None:
    """Diagnose in this process, without memory from the call `last` on its way."""
    for name in MAKERS:
        setattr(np, name, counted(getattr(np, name)))
    COUNT["last"] = last
    with (place / "said").open("w") as said:
        sys.stdout = sys.stderr = said
        files = [str(place / f"{name}.csv") for name in ("first", "second")]
        words = [*files, "--aircraft", str(place / "a.toml"), "--quick", "--out", str(place / "out")]
        status = status_of(script(diagnose), words)
        said.flush()
    (place / "count").write_text(str(COUNT["made"]))
    os._exit(status)


def ended(place: Path, last: int) -> int:
    """The status of such a run in a process of its own."""
    running = multiprocessing.get_context("fork").Process(target=run, args=(place, last))
    running.start()
    running.join(300)
    assert running.exitcode is not None and running.exitcode >= 0, f"{last}: {running.exitcode}"
    return running.exitcode


def results(place: Path) -> dict[str, Any]:
    return {name: value for name, value in json.loads((place / "out" / "diagnosis.json").read_text()).items()}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="forks a process that has the libraries")
def test_a_diagnosis_without_memory_leaves_the_old_folder_or_a_whole_new_one(tmp_path: Path) -> None:
    """Any array of the reading, the fits, the search and the page may be the one that cannot be made; `CASID_FAULTS`
    of them are drawn. The run ends in one line, and what it writes is what it writes with memory."""
    for record in records():
        cs.write_record(record, tmp_path / f"{record.name}.csv")
    aircraft_file().write(tmp_path / "a.toml")
    assert ended(tmp_path, -1) == 0
    whole, every = results(tmp_path), int((tmp_path / "count").read_text())
    old = tmp_path / "out" / "report.html"
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*") if path.is_file()}
    for last in sorted(np.random.default_rng(1).choice(np.arange(1, every + 1), SAMPLED, replace=False).tolist()):
        status, said = ended(tmp_path, last), (tmp_path / "said").read_text()
        assert "Traceback" not in said, f"{last} of {every}: {said}"
        now = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*") if path.is_file()}
        if status != 0:
            assert now == kept, f"{last} of {every}: {said}"
            continue
        found = results(tmp_path)
        assert old.exists() and [c["kind"] for c in found["causes"]] == [c["kind"] for c in whole["causes"]], last
        assert found["verdict"] == whole["verdict"], f"{last} of {every}"
        kept = now
