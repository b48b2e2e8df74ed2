"""Stages of a diagnosis: how long each takes, and a word to the user when it begins."""

from __future__ import annotations

import time
from collections.abc import Callable


class Stages:
    """Wall time per stage, and a word to the user at the beginning of each."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._name, self._since = "", time.perf_counter()
        self.seconds: dict[str, float] = {}

    def begin(self, name: str) -> None:
        self.end()
        self._name, self._since = name, time.perf_counter()
        self._report(name)

    def end(self) -> None:
        if self._name:
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + time.perf_counter() - self._since
        self._name = ""
