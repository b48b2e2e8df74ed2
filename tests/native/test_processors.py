"""Work side by side: the same answers, in order, whatever the number of processors."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from diagnosis_flights import flights, one_round

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.controls import actuator_lag
from casid.native.processors import processors, share_out, side_by_side
from problems.do328 import do328


@pytest.fixture
def eight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(8), raising=False)


@pytest.mark.usefixtures("eight")
def test_results_come_in_the_order_of_the_tasks() -> None:
    meeting = threading.Barrier(4)  # none goes on before all four run: they are side by side

    def run(task: int) -> tuple[int, int]:
        meeting.wait(timeout=30.0)
        return task**2, processors()

    assert side_by_side(run, [3, 1, 4, 2]) == [(9, 2), (1, 2), (16, 2), (4, 2)]
    assert processors() == 8


@pytest.mark.parametrize(("asked", "used"), [("1", 1), ("3", 3), ("99", 8), ("0", 8), ("-1", 8), ("x", 8), ("", 8)])
def test_fewer_processors_may_be_asked_for(monkeypatch: pytest.MonkeyPatch, eight: None, asked: str, used: int) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert processors() == used


@pytest.mark.usefixtures("eight")
def test_what_is_shared_out_inside_stays_within_its_part() -> None:
    assert side_by_side(lambda _: side_by_side(lambda _: processors(), range(2)), range(4)) == [[1, 1]] * 4
    assert side_by_side(lambda _: processors(), range(9)) == [1] * 9
    assert side_by_side(lambda _: processors(), [0]) == [8]
    assert side_by_side(lambda _: processors(), []) == []


@pytest.mark.usefixtures("eight")
@pytest.mark.parametrize("parts", [0, 1, 3, 8, 20])
def test_every_part_is_in_one_stretch(parts: int) -> None:
    """And no call is made for nothing."""
    taken: list[tuple[int, int]] = []
    share_out(parts, lambda first, last: taken.append((first, last)))
    assert sorted(i for first, last in taken for i in range(first, last)) == list(range(parts))
    assert len(taken) == min(parts, 8) and all(last > first for first, last in taken)


@pytest.mark.usefixtures("eight")
def test_the_first_error_is_raised() -> None:
    def run(task: int) -> int:
        if task > 1:
            raise ValueError(f"task {task}")
        return task

    with pytest.raises(ValueError, match="task 2"):
        side_by_side(run, range(5))


@pytest.mark.parametrize("loaded", ["casid, numpy", "numpy, casid"])
def test_the_linear_algebra_has_one_thread_while_casid_works_and_the_callers_number_after(loaded: str) -> None:
    program = (
        f"import os, threading\nbefore = dict(os.environ)\nimport {loaded}, scipy.linalg\n"
        "from threadpoolctl import threadpool_info, threadpool_limits\n"
        "from casid.native.processors import side_by_side\n"
        "from casid.native.threads import single_threaded\n"
        "os.sched_getaffinity = lambda process: range(2)\n"
        "def threads():\n"
        "    return {i['num_threads'] for i in threadpool_info() if i['user_api'] == 'blas'}\n"
        "both = threading.Barrier(2)\n"
        "def run(task):\n"
        "    both.wait(30.0)\n"
        "    with single_threaded():\n"
        "        return threading.get_ident(), threads()\n"
        "with threadpool_limits(3, 'blas'):\n"
        "    found, after = side_by_side(run, range(2)), threads()\n"
        "print(len({who for who, _ in found}), [inside for _, inside in found], after, os.environ == before)"
    )
    environment = {k: v for k, v in os.environ.items() if k not in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.strip() == "2 [{1}, {1}] {3} True"


@pytest.mark.usefixtures("eight")
def test_functions_of_one_model_are_built_and_called_from_many_threads() -> None:
    """CasADi marks the expressions of a model while it differentiates them: two threads at once crashed it."""
    flight = prepare(do328(), flights(count=1, duration_s=4.0))
    model = flight.model()
    batch, X = flight.batch(model), model.guess(flight.records[0])[:, None]
    P, W = model.nominal_vector()[None], np.zeros((*X.shape[:2], len(model.disturbances)))
    free = [n for n in model.parameters if not n.startswith("bias_")]

    def slope(count: int) -> np.ndarray:
        stretches = flight.functions(model).by_parameters(free[:count]).in_stretches(batch, P, X, W)
        return np.concatenate([by_parameters for _, by_parameters, _ in stretches])

    found = side_by_side(slope, [2 + i % 12 for i in range(48)])
    for i, one in enumerate(found):
        np.testing.assert_array_equal(one, found[11][..., : 2 + i % 12])


def test_a_diagnosis_does_not_depend_on_the_number_of_processors(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """To the bit: all of it but its times."""
    slow = Attached(effect=actuator_lag("delta_e"), values={"value": 0.12})
    records, told = flights([slow], seed=3, count=2, duration_s=12.0), []
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(8), raising=False)
    for threads in ("1", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        found = diagnose(do328(), records, criteria=one_round())
        assert [(c.kind, c.target) for c in found.causes] == [("actuator_lag", "delta_e")]
        found.write(tmp_path / "diagnosis.json")
        written = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
        told.append({key: one for key, one in written.items() if not key.startswith("seconds")})
    assert told[1] == told[0]
