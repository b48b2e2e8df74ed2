"""Many independent tasks on local processes or a Dask cluster. Each result is stored as it finishes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from casid.errors import InputError
from problems.campaign.store import Store

_STEP_S = 2.0


def counted(stage: Callable[[str], None], what: str) -> Callable[[int, int], None]:
    """A `report` for `run_campaign` that tells `stage` how far the work is and how long it will take."""
    start, last, first = time.perf_counter(), [0.0], list[int]()

    def report(done: int, total: int) -> None:
        now = time.perf_counter()
        first.append(done)
        if done < total and now - last[0] < _STEP_S:
            return
        last[0] = now
        own = done - first[0]
        ahead = f", about {(now - start) / own * (total - done):.0f} s to go" if own and done < total else ""
        found = f" ({first[0]} found finished)" if first[0] else ""
        stage(f"{what} {done} of {total}{found}{ahead}")

    return report


Task = Mapping[str, Any]
Work = Callable[[Task], Any]
Finished = tuple[str, Any, float]
_AHEAD = 2  # tasks per process that wait in its queue: enough to keep it busy, few to lose
_DEATHS = 3  # of worker processes over one task before the task is to blame
_PATIENCE = 0.2  # s that Ctrl-C waits at most
_ANSWERS = 10.0  # seconds in which a scheduler must answer
# BLAS threads cost more than they give on small matrices: a factor of ten when two processes share two cores
_ONE_THREAD: dict[str, str] = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def run_campaign(
    tasks: Mapping[str, Task],
    work: Work,
    store: Store,
    *,
    jobs: int = 2,
    scheduler: str | None = None,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Do every task that the store does not have, and keep its result there.

    tasks      key -> task, plain data that JSON can hold
    work       a function of a module (processes import it by name), task -> result that JSON can hold
    jobs       local processes; 0: in this process
    scheduler  address of a Dask scheduler ("tcp://host:8786") that does the work instead
    report     told (finished, total) at the start and after each task
    An exception in `work` ends the campaign and is raised here; what finished before is kept. A worker that dies is
    replaced and its task repeated, up to three times. Raises InputError for a bad number of jobs or no cluster.
    """
    if jobs < 0:
        raise InputError(f"--jobs {jobs}: expected a number of processes, or 0 for none")
    done = store.finished()
    left = {key: task for key, task in tasks.items() if key not in done}
    finished = len(tasks) - len(left)
    report(finished, len(tasks))
    if not left:
        return
    stream = _dask(left, work, scheduler) if scheduler else _local(left, work, min(jobs, len(left)))
    for key, result, seconds in stream:
        store.put(key, left[key], result, seconds)
        finished += 1
        report(finished, len(tasks))


def timed(work: Work, task: Task) -> tuple[Any, float]:
    """(result, seconds) of one task, with everything compiled before it is used: then neither the load of the machine
    nor what an earlier run has compiled can be seen in the last digits."""
    begin = time.perf_counter()
    with _environment({"CASID_COMPILE_FIRST": "1"}):
        return work(task), time.perf_counter() - begin


def _local(tasks: Mapping[str, Task], work: Work, jobs: int) -> Iterator[Finished]:
    if jobs == 0:
        for key, task in tasks.items():
            yield key, *timed(work, task)
        return
    left, deaths = dict(tasks), dict.fromkeys(tasks, 0)
    while left:
        try:
            for finished in _pool(dict(left), work, jobs):
                del left[finished[0]]
                yield finished
        except _WorkerLostError as error:
            for key in error.keys:
                deaths[key] += 1
            worst = max(error.keys, key=lambda key: deaths[key])
            if deaths[worst] >= _DEATHS:
                raise InputError(f"campaign: a worker process died {_DEATHS} times over '{worst}'; memory?") from None


class _WorkerLostError(Exception):
    """A process of the pool is gone; `keys` are the tasks that were under way."""

    def __init__(self, keys: list[str]) -> None:
        super().__init__(", ".join(keys))
        self.keys = keys


def _pool(tasks: Mapping[str, Task], work: Work, jobs: int) -> Iterator[Finished]:
    context, others = multiprocessing.get_context("spawn"), set(multiprocessing.active_children())
    with _environment(_ONE_THREAD), ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin_worker) as pool:
        waiting, running = iter(tasks.items()), dict[Future, str]()

        def fill() -> None:
            while len(running) < jobs * _AHEAD and (entry := next(waiting, None)) is not None:
                with _ctrl_c_later():
                    running[pool.submit(timed, work, entry[1])] = entry[0]

        try:
            fill()
            while running:
                with _ctrl_c_later():  # in the midst of it, Ctrl-C would leave the locks of futures closed for ever
                    ready, _ = wait(running, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
                # in the order of submission, so that one process alone always finishes in the same order
                for future in [f for f in running if f in ready]:
                    result = future.result()
                    yield running.pop(future), *result
                fill()
        except BrokenProcessPool:
            raise _WorkerLostError(list(running.values())) from None
        except BaseException:  # a signal, or whoever takes the results has left: what is under way is of no use
            for worker in set(multiprocessing.active_children()) - others:
                worker.kill()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Environment variables for this process, and for those that it starts, while within."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _ctrl_c_later() -> Iterator[None]:
    """Ctrl-C waits while within, and processes that are started here never hear of it: from their first import on."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """Ctrl-C is the parent's business; a parent that was killed takes its workers along."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _dask(tasks: Mapping[str, Task], work: Work, scheduler: str) -> Iterator[Finished]:
    try:
        from distributed import Client, as_completed  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError(
            "--scheduler needs the package distributed; install it with: pip install distributed"
        ) from None
    try:
        client = Client(scheduler, timeout=_ANSWERS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {scheduler}: no Dask scheduler answers ({error}); start one, or check it"
        ) from None
    with client:
        # a dead worker's tasks go to another; Dask gives a task up after `allowed-failures` deaths (3 by default)
        futures = {client.submit(timed, work, task, pure=False): key for key, task in tasks.items()}
        for future in as_completed(futures, loop=client.loop):
            yield futures[future], *future.result()
