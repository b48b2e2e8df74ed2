"""Campaigns: nothing lost, nothing done twice, whatever ends them; the same on processes and on a Dask cluster."""

from __future__ import annotations

import importlib.util
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import campaign_work
import pytest

from casid.errors import InputError
from problems.campaign.run import run_campaign
from problems.campaign.store import FILE, open_store

REPO = Path(__file__).resolve().parents[2]
PATHS = os.pathsep.join([str(REPO), str(REPO / "tests")])
COUNT = 24
# a campaign of its own process: folder, log of what was done, seconds per task, jobs
PROGRAM = """
import sys
from problems.campaign.run import run_campaign
from problems.campaign.store import open_store
from campaign_work import square

if __name__ == "__main__":
    folder, log, seconds, jobs = sys.argv[1:]
    tasks = {f"t{i:02d}": {"x": i, "log": log, "seconds": float(seconds)} for i in range(24)}
    with open_store(folder, {"v": 1}) as store:
        run_campaign(tasks, square, store, jobs=int(jobs), report=lambda done, total: print(done, flush=True))
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    return path


def start(program: Path, folder: Path, seconds: float = 0.05, jobs: int = 2) -> subprocess.Popen:
    command = [sys.executable, str(program), str(folder), str(folder.parent / "log"), str(seconds), str(jobs)]
    environment = {**os.environ, "PYTHONPATH": PATHS}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def until_some_are_finished(process: subprocess.Popen, count: int) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if int(line) >= count:
            return
    raise AssertionError("the campaign ended early")


def squares(folder: Path) -> dict[str, int]:
    with open_store(folder, {"v": 1}) as store:
        return {key: result["square"] for key, result in store.results().items()}


def done(folder: Path) -> list[int]:
    return [int(line) for line in (folder.parent / "log").read_text().split()]


TRUTH = {f"t{i:02d}": i * i for i in range(COUNT)}


@pytest.mark.parametrize("jobs", [0, 1, 2])
def test_all_tasks_are_done_once(tmp_path: Path, jobs: int) -> None:
    tasks = {f"t{i:02d}": {"x": i, "log": str(tmp_path / "log")} for i in range(COUNT)}
    told = []
    with open_store(tmp_path / "c", {"v": 1}) as store:
        run_campaign(tasks, campaign_work.square, store, jobs=jobs, report=lambda d, n: told.append((d, n)))
        run_campaign(tasks, campaign_work.square, store, jobs=jobs)
        processes = {result["process"] for result in store.results().values()}
        threads = {result["threads"] for result in store.results().values()}
    assert squares(tmp_path / "c") == TRUTH
    assert sorted(done(tmp_path / "c")) == list(range(COUNT))
    assert told == [(i, COUNT) for i in range(COUNT + 1)]
    assert (os.getpid() in processes) == (jobs == 0)
    assert jobs == 0 or threads == {"1"}


def test_killed_run_resumes_where_it_stopped(tmp_path: Path, program: Path) -> None:
    """kill -9 of the parent: what was told finished is there; at most what was under way is done again."""
    folder = tmp_path / "c"
    with start(program, folder) as process:
        until_some_are_finished(process, 5)
        process.kill()
    kept = squares(folder)
    assert len(kept) >= 5 and kept.items() <= TRUTH.items()
    with start(program, folder) as process:
        assert process.communicate()[0].split()[0] == str(len(kept))
    assert squares(folder) == TRUTH
    again = len(done(folder)) - COUNT
    assert 0 <= again <= 4  # two processes, two tasks each in their queue


def test_workers_follow_a_killed_parent(tmp_path: Path, program: Path) -> None:
    folder = tmp_path / "c"
    with start(program, folder, seconds=0.2) as process:
        until_some_are_finished(process, 2)
        process.kill()
    time.sleep(1.0)
    before = len(done(folder))
    time.sleep(1.0)
    assert len(done(folder)) == before < COUNT


def test_ctrl_c_keeps_what_was_finished(tmp_path: Path, program: Path) -> None:
    folder = tmp_path / "c"
    with start(program, folder, seconds=0.2) as process:
        until_some_are_finished(process, 5)
        process.send_signal(signal.SIGINT)
        assert "KeyboardInterrupt" in process.communicate(timeout=20)[1]
    kept = squares(folder)
    assert 5 <= len(kept) < COUNT and kept.items() <= TRUTH.items()
    with start(program, folder, seconds=0.2) as process:
        process.communicate()
    assert squares(folder) == TRUTH


def test_a_signal_does_not_wait_for_what_is_under_way(tmp_path: Path, program: Path) -> None:
    """Tasks of ten minutes each."""
    with start(program, tmp_path / "c", seconds=600.0) as process:
        until_some_are_finished(process, 0)
        time.sleep(2.0)  # the workers are at it
        process.send_signal(signal.SIGINT)
        assert "KeyboardInterrupt" in process.communicate(timeout=20)[1]


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.4])
def test_workers_say_nothing_of_ctrl_c(tmp_path: Path, program: Path, seconds: float) -> None:
    """A terminal sends it to all processes, those that still import among them; the parent alone speaks."""
    command = [sys.executable, str(program), str(tmp_path / "c"), str(tmp_path / "log"), "0.2", "2"]
    environment = {**os.environ, "PYTHONPATH": PATHS}
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    with subprocess.Popen(command, env=environment, **options) as process:
        assert process.stdout is not None and process.stdout.readline() == "0\n"  # the workers start now
        time.sleep(seconds)
        os.killpg(process.pid, signal.SIGINT)
        errors = process.communicate(timeout=30)[1].splitlines()
    # counted by its last line: an interrupt inside an `except` of the standard library prints two tracebacks
    assert errors.count("KeyboardInterrupt") == 1


def test_a_store_in_which_nothing_was_finished_is_not_left(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--jobs -3"), open_store(tmp_path / "a" / "b", {"v": 1}) as store:
        run_campaign({"a": {"x": 1}}, campaign_work.square, store, jobs=-3)
    assert list(tmp_path.iterdir()) == []


def test_a_worker_that_dies_is_replaced(tmp_path: Path) -> None:
    tasks = {f"t{i}": {"mark": str(tmp_path / f"mark{i}")} for i in range(2)}
    with open_store(tmp_path, {}) as store:
        run_campaign(tasks, campaign_work.die_once, store, jobs=1)
        assert store.results() == {"t0": 1, "t1": 1}


def test_a_task_that_kills_every_worker_ends_the_campaign(tmp_path: Path) -> None:
    with open_store(tmp_path, {}) as store, pytest.raises(InputError, match="died 3 times over 'bad'"):
        run_campaign({"bad": {}}, campaign_work.die_always, store, jobs=1)


@pytest.mark.parametrize("jobs", [0, 1])
def test_an_exception_in_the_work_is_raised_and_the_rest_kept(tmp_path: Path, jobs: int) -> None:
    with open_store(tmp_path, {}) as store:
        with pytest.raises(ValueError, match="two is not welcome"):
            run_campaign({str(i): {"x": i} for i in range(4)}, campaign_work.fail, store, jobs=jobs)
        assert {"0": 0, "1": 1}.items() <= store.results().items()


def test_store_refuses_what_would_mix_results(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing to resume"), open_store(tmp_path / "none", {}, must_exist=True):
        pass
    with open_store(tmp_path, {"v": 1}) as store:
        store.put("a", {}, 1, 0.1)
        with pytest.raises(InputError, match="cannot be done twice"):
            store.put("a", {}, 2, 0.1)
        with pytest.raises(InputError, match="another run is at work"), open_store(tmp_path, {"v": 1}):
            pass
    with pytest.raises(InputError, match="another protocol"), open_store(tmp_path, {"v": 2}):
        pass
    with open_store(tmp_path, {"v": 1}, must_exist=True) as store:
        assert store.results() == {"a": 1}


def test_a_file_that_is_no_store_is_said_to_be_none(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("this is no database, but long enough to be looked at as if it were one" * 20)
    with pytest.raises(InputError, match="is no campaign store"), open_store(tmp_path, {}):
        pass


def test_a_store_is_plain_sqlite(tmp_path: Path) -> None:
    """Anyone may read the results with the sqlite3 of their language."""
    with open_store(tmp_path, {}) as store:
        store.put("a", {"x": 1}, {"y": 2.5}, 0.1)
    connection = sqlite3.connect(tmp_path / FILE)
    assert connection.execute("SELECT key, task, result FROM results").fetchall() == [("a", '{"x": 1}', '{"y": 2.5}')]
    connection.close()


def test_no_cluster_and_bad_jobs_are_one_line_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("problems.campaign.run._ANSWERS", 0.5)
    with open_store(tmp_path, {}) as store:
        with pytest.raises(InputError, match="expected a number of processes"):
            run_campaign({"a": {"x": 1}}, campaign_work.square, store, jobs=-1)
        with pytest.raises(InputError, match="--scheduler"):
            run_campaign({"a": {"x": 1}}, campaign_work.square, store, scheduler="tcp://127.0.0.1:9")


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs distributed")
@pytest.mark.filterwarnings("ignore")
def test_dask_cluster_with_a_worker_killed_in_mid_run(tmp_path: Path) -> None:
    """A scheduler and two workers on loopback, each a process of its own; one is killed with work in hand."""
    environment = {**os.environ, "PYTHONPATH": PATHS, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "10"}
    file, processes = tmp_path / "scheduler.json", []

    def launch(*arguments: str) -> subprocess.Popen:
        command = [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        processes.append(process)
        return process

    try:
        launch("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        workers = [
            launch("dask_worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard")
            for _ in range(2)
        ]
        address = _address(file)
        tasks = {f"t{i:02d}": {"x": i, "log": str(tmp_path / "log"), "seconds": 0.2} for i in range(COUNT)}

        def report(finished: int, total: int) -> None:
            if finished == 6 and workers[0].poll() is None:
                workers[0].kill()

        with open_store(tmp_path / "c", {"v": 1}) as store:
            run_campaign(tasks, campaign_work.square, store, scheduler=address, report=report)
            computed_by = {result["process"] for result in store.results().values()}
        assert squares(tmp_path / "c") == TRUTH
        assert computed_by == {workers[0].pid, workers[1].pid}
        assert workers[0].poll() is not None
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


def _address(file: Path) -> str:
    import json

    for _ in range(200):
        if file.exists() and file.read_text().strip():
            return json.loads(file.read_text())["address"]
        time.sleep(0.1)
    raise AssertionError("the scheduler did not start")
