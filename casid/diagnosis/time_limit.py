"""The time that a diagnosis may take and what its search leaves out when that is over; the time of each stage."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from casid.native.memory import return_freed_memory


class TimeIsUpError(Exception):
    """A fit ends here, because there is no more time for it."""


class TimeLimit:
    """A limit of wall time, of one diagnosis; without `seconds` there is none.

    The beginning, which is everything before the search, may take half of the time. What the verdict can do without is
    cut short there, and in the search. What follows the search, the held-out records and the verdict, takes about as
    long as the beginning, and that time is kept for it; a last test is left out when the whole time is over.
    """

    def __init__(self, seconds: float | None = None) -> None:
        self._seconds, self._begin = math.inf if seconds is None else seconds, time.perf_counter()
        self._until = self._begin + self._seconds / 2.0
        self._interrupted = False
        self._cutting = False
        self._fits, self._others = list[str](), list[str]()

    def begin_search(self) -> None:
        """Keep as much time for the end as the beginning took."""
        now = time.perf_counter()
        self._until = max(self._begin + self._seconds - (now - self._begin), now)

    @property
    def is_up(self) -> bool:
        """Return True if what comes first, the beginning or the search, must end."""
        return self._interrupted or time.perf_counter() >= self._until

    @property
    def is_over(self) -> bool:
        """Return True if the whole time is over, also that of the end."""
        return time.perf_counter() >= self._begin + self._seconds

    @property
    def because(self) -> str:
        """Why something was not tried."""
        reason = "the search was interrupted" if self._interrupted else f"the limit of {self._seconds:g} s was reached"
        return f"not tried: {reason}"

    @contextmanager
    def answering(self, say: Callable[[str], None]) -> Iterator[TimeLimit]:
        """Begin a block in which the first Ctrl-C asks for the verdict so far, wherever it comes; a second one is
        answered as before. In a thread that gets no signals, and where Ctrl-C is ignored, nothing changes."""
        before = signal.getsignal(signal.SIGINT)
        of_main = threading.current_thread() is threading.main_thread()
        if not of_main or not callable(before):
            yield self
            return

        def interrupted(number: int, frame: FrameType | None) -> None:
            signal.signal(signal.SIGINT, before)
            self._interrupted = True
            with suppress(RuntimeError):  # where it comes while something is printed
                say("interrupted: the verdict so far follows; Ctrl-C again ends without it")

        signal.signal(signal.SIGINT, interrupted)
        try:
            yield self
        finally:
            if signal.getsignal(signal.SIGINT) is interrupted:
                signal.signal(signal.SIGINT, before)

    def leaves_out(self, what: str) -> bool:
        """Return True if something must be left out because the time is up, and note it."""
        if not self.is_up:
            return False
        self.leave_out(what)
        return True

    def leave_out(self, what: str) -> None:
        """Note that something was left out."""
        self._others += [what] if what not in self._others else []

    def leave_out_fit(self, cause: str) -> None:
        """Note that a cause was not fitted, because the time is up."""
        self._fits += [cause] if cause not in self._fits else []

    @property
    def left_out(self) -> list[str]:
        """List what was left out, in words."""
        fits = [f"fit{'s' if len(self._fits) > 1 else ''} of {', '.join(self._fits)}"] if self._fits else []
        return [*fits, *self._others]

    @contextmanager
    def cutting(self) -> Iterator[None]:
        """Begin a block in which fits may end by `TimeIsUpError`."""
        self._cutting = True
        try:
            yield
        finally:
            self._cutting = False

    def check(self) -> None:
        """Raise TimeIsUpError where a fit may end and the time is up."""
        if self._cutting and self.is_up:
            raise TimeIsUpError


class Stages:
    """Wall time of each stage; `report` is called when a stage begins. Memory that is free is returned at its end."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._name, self._since, self._processor = "", time.perf_counter(), time.process_time()
        self.seconds: dict[str, float] = {}

    def begin(self, name: str) -> None:
        self.end()
        self._name, self._since = name, time.perf_counter()
        self._report(name)

    @property
    def of_processor(self) -> float:
        """Time of the processor [s] since the first stage."""
        return time.process_time() - self._processor

    def end(self) -> None:
        if self._name:
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + time.perf_counter() - self._since
        self._name = ""
        return_freed_memory()
