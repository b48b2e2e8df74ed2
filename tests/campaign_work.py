"""Tasks that test campaigns run, in a module so that worker processes can import them; they leave a mark when done."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def square(task: Mapping[str, Any]) -> dict[str, Any]:
    """The square of task["x"]; a line in task["log"] for every time that it is done."""
    time.sleep(task.get("seconds", 0.0))
    if "log" in task:
        with Path(task["log"]).open("a") as file:
            file.write(f"{task['x']}\n")
    return {"square": task["x"] ** 2, "process": os.getpid(), "threads": os.environ.get("OPENBLAS_NUM_THREADS")}


def die_once(task: Mapping[str, Any]) -> int:
    """Kill the own process the first time."""
    mark = Path(task["mark"])
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 1


def die_always(task: Mapping[str, Any]) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def fail(task: Mapping[str, Any]) -> int:
    if task["x"] == 2:
        raise ValueError("two is not welcome")
    return task["x"]
